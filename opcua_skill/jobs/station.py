"""A workstation as the job engine sees it: its arm, what surrounds it, what it can do, and its two lanes of jobs."""

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from opcua_skill.atomic_skills import motions_of
from opcua_skill.jobs.reasons import ArmNotReady
from opcua_skill.lane import Lane
from opcua_skill.settings import Workstation
from sim.arm import Arm, ArmError, ArmMode, ArmModel, ArmState
from sim.clearance import Box, Cell

ArmFactory = Callable[[str, bool], Arm]
"""Makes the arm of a workstation by name; True: a fresh simulation beside it, as fast as possible."""
START_TOLERANCE = 2e-3

_log = logging.getLogger(__name__)


@dataclass
class Station:
    """A workstation at work. ``stopped_unasked``: its last motion ended in a way that a person has to look at."""

    name: str
    model: ArmModel
    cell: Cell
    arm: Arm
    atomic_skills: frozenset[str]
    lane: Lane
    simulation: Lane
    stopped_unasked: bool = False

    @property
    def is_home(self) -> bool:
        """Whether the arm stands where every run starts."""
        away = np.abs(np.array(self.arm.state().joints) - np.array(self.model.home)).max()
        return bool(away <= START_TOLERANCE)

    async def open(self) -> None:
        """Make contact with the arm; one that does not answer must not keep the others from being served."""
        try:
            await self.arm.open()
        except (ArmError, OSError) as silent:
            _log.error("the arm of %s does not answer, reset it to try again: %s", self.name, silent)

    async def reset(self) -> None:
        """Acknowledge what stopped the arm, or make contact if there was none; it has not moved by it.

        Raises ArmNotReady if the arm still does not answer.
        """
        if self.arm.state().mode is not ArmMode.CLOSED:
            await self.arm.reset()
            return
        try:
            await self.arm.open()
        except (ArmError, OSError) as silent:
            raise ArmNotReady(f"the arm of {self.name} does not answer: {silent}") from silent

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


def atomic_skills_of(workstation: Workstation, model: ArmModel) -> frozenset[str]:
    """Return what the arm and the process equipment of a workstation can do together."""
    return frozenset(motions_of(model)) | {skill for item in workstation.equipment for skill in item.atomic_skills}
