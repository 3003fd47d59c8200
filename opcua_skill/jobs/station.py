"""A workstation as the job engine sees it: its arm, what surrounds it, what it can do, and its two lanes of jobs."""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from library.description import Cause
from library.errors import LibraryUnusable, NotAllowedInState
from library.store import SkillLibrary
from opcua_skill.configuration.atomic_skills import motions_of
from opcua_skill.configuration.settings import Workstation
from opcua_skill.jobs.errors import ArmNotReady
from opcua_skill.jobs.motion.completion import in_background, is_lost
from opcua_skill.jobs.motion.motion_queue import MotionQueue
from opcua_skill.jobs.motion.release import PATIENCE, ArmQueue
from sim import robots
from sim.arm import Arm, ArmError, ArmMode, ArmState
from sim.arm_model import ArmModel
from sim.drivers.preconditions import START_TOLERANCE
from sim.planning.checks import check_confirmed, check_hull
from sim.planning.clearance import Box, Cell

ArmFactory = Callable[[str, bool], Arm]
"""Makes the arm of a workstation by name; True: a fresh simulation beside it, as fast as possible."""
OVERRIDE_STEP = 1e-9
WRITE_AGAIN = 1.0

_log = logging.getLogger(__name__)


@dataclass
class Station:
    """A workstation at work. ``speed_override`` is the one that was asked for last: the arm's never rises above it."""

    name: str
    library: SkillLibrary
    model: ArmModel
    cell: Cell
    arm: Arm
    atomic_skills: frozenset[str]
    queue: ArmQueue
    lane: MotionQueue
    simulation: MotionQueue
    speed_override: float = 1.0

    @property
    def is_home(self) -> bool:
        """Whether the arm stands where every run starts."""
        away = np.abs(np.array(self.arm.state().joints) - np.array(self.model.home)).max()
        return bool(away <= START_TOLERANCE)

    def trouble(self) -> Cause:
        """Return why no job may begin on the arm now, while nothing of ours moves it; Cause.NONE: it stands ready."""
        state = self.arm.state()
        if state.protective_stop:
            return Cause.PROTECTIVE_STOP
        if is_lost(self.arm):
            return Cause.ARM_LOST
        if state.mode is ArmMode.PAUSED:
            return Cause.UNASKED_PAUSE
        if state.mode is not ArmMode.IDLE or not state.at_rest or not self.is_home:
            return Cause.UNASKED_STOP
        return Cause.NONE

    def check_ready_for_release(self) -> None:
        """Raise NotAllowedInState or ArmNotReady unless the arm stands at home, at rest, with nothing under way."""
        self.lane.check_at_rest(f"the arm of {self.name}")
        self.check_ready()
        state = self.arm.state()
        if state.mode is not ArmMode.IDLE or not state.at_rest:
            raise NotAllowedInState(f"the arm of {self.name}", state.mode.value, "it has to be at rest")
        if not self.is_home:
            raise ArmNotReady(f"the arm of {self.name} is away from home: send it home first (GoHome)")

    async def open(self) -> None:
        """Take up what is remembered and make contact with the arm.

        One that does not answer must not keep the others from being served. An arm that does not stand ready at home
        holds its queue: whatever left it there, a person has to look.
        """
        record = await self.library.station(self.name)
        self.queue.restore(record)
        self.speed_override = record.speed_override
        try:
            await self.arm.open()
            await self.arm.set_override(self.speed_override)
        except (ArmError, OSError) as silent:
            _log.error("the arm of %s does not answer, reset it to try again: %s", self.name, silent)
        trouble = self.trouble()
        if trouble is not Cause.NONE:
            lasting = trouble in {Cause.PROTECTIVE_STOP, Cause.ARM_LOST}
            self.queue.hold(trouble if lasting else Cause.UNFINISHED_AT_START, "arm" if lasting else "server")

    async def reset(self) -> None:
        """Acknowledge what stopped the arm, or make contact if there was none; it has not moved by it.

        An arm that was lost before contact was made needs both. Raises ArmNotReady if it still does not answer.
        """
        if self.arm.state().mode is not ArmMode.CLOSED:
            await self.arm.reset()
        if self.arm.state().mode is ArmMode.CLOSED:
            try:
                await self.arm.open()
            except (ArmError, OSError) as silent:
                raise ArmNotReady(f"the arm of {self.name} does not answer: {silent}") from silent
        await self.arm.set_override(self.speed_override)

    async def set_override(self, fraction: float) -> None:
        """Make the arm slower, or faster again, and remember it.

        Slower counts at once, whatever the database does; faster not before it is written down.
        """
        if fraction <= self.speed_override:
            await self.arm.set_override(fraction)
            self.speed_override = fraction
            await asyncio.wait({in_background(self._remember())}, timeout=PATIENCE)
            return
        try:
            await self.library.change_station(self.name, speed_override=fraction)
        except BaseException:
            in_background(self._remember())
            raise
        await self.arm.set_override(fraction)
        self.speed_override = fraction

    async def _remember(self) -> None:
        """Write the override down, as often as it takes."""
        while True:
            try:
                await self.library.change_station(self.name, speed_override=self.speed_override)
                return
            except LibraryUnusable as unusable:
                _log.warning("the override of %s is not written down yet: %s", self.name, unusable)
                await asyncio.sleep(WRITE_AGAIN)

    async def keep_override(self) -> None:
        """Take the arm's override down to the one asked for, where the arm's own side let it rise."""
        if self.arm.state().override > self.speed_override + OVERRIDE_STEP:
            _log.warning("the override of %s rose by itself: set back to %g", self.name, self.speed_override)
            await self.arm.set_override(self.speed_override)

    def check_ready(self) -> None:
        """Raise ArmNotReady while the arm waits for a reset: a new command must not be what sets it going again."""
        state = self.arm.state()
        if not ready_to_move(state):
            raise ArmNotReady(f"the arm of {self.name} waits for a reset: {state.fault or state.mode.value}")


def ready_to_move(state: ArmState) -> bool:
    """Return whether an arm may be given something to do, rather than wait for a reset."""
    return state.known and not state.protective_stop and state.mode not in {ArmMode.FAULT, ArmMode.CLOSED}


def cell_of(workstation: Workstation) -> Cell:
    """Return what surrounds a workstation's arm, as configured."""
    boxes = tuple(Box(one.name, one.pose, one.size) for one in workstation.fixtures)
    return Cell(boxes, workstation.table_height)


def model_of(workstation: Workstation) -> ArmModel:
    """Return a workstation's arm with what the workstation changes of it.

    Raises ``ValueError`` with one sentence where there is no such arm, or where it does not fit.
    """
    tool = workstation.tool
    checked = workstation.collisions == "checked"
    changes = robots.Changes(
        workspace_low=workstation.workspace_low,
        workspace_high=workstation.workspace_high,
        home=workstation.home,
        tip=tool.offset if tool and (any(tool.offset) or any(tool.turn)) else None,
        tip_turn=tool.turn if tool else (0.0, 0.0, 0.0),
        tool=tool.name if tool else "",
        collisions_checked=checked,
    )
    model = robots.changed(robots.load(workstation.arm), changes)
    for finding in (*check_hull(model), *check_confirmed(model)):
        raise ValueError(finding.text)
    return model


def atomic_skills_of(workstation: Workstation, model: ArmModel) -> frozenset[str]:
    """Return what the arm and the process equipment of a workstation can do together."""
    return frozenset(motions_of(model)) | {skill for item in workstation.equipment for skill in item.atomic_skills}
