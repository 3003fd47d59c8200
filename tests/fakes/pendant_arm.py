"""An arm with a side of its own: a pendant, faults, a cable, a hand; it writes down every beginning of a motion."""

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sim.arm import ArmFault, ArmMode, ArmState, CommandRefused, Progress, Stopped, Trace
from sim.arm_model import ArmModel
from sim.drivers.preconditions import check_start
from sim.plan import MotionPlan
from sim.planning.kinematics import kinematics
from sim.pose import pose_of

AWAY = 0.3
"""How far in rad the first joint of an arm on its way is from home."""
Journal = Callable[[str, str], None]


@dataclass
class Motion:
    """A run under way: its plan, and how it will end."""

    plan: MotionPlan
    ended: "asyncio.Future[Exception | None]"
    trace: list[float] = field(default_factory=lambda: [0.0])


class PendantArm:
    """Fits ``sim.arm.Arm``. ``journal`` is told each beginning: run, home, resume or pendant, and the plan's digest.

    A motion lasts until ``arrive`` is called, or for ``seconds``. ``latency`` is how many turns of the event loop pass
    between being told to run and running: a stop in between finds an arm at rest and changes nothing.
    """

    def __init__(self, model: ArmModel, journal: Journal, *, away: bool = False, seconds: float = 0.0) -> None:
        self.model = model
        self.journal = journal
        self.handed = 0
        self.seconds = seconds
        self.latency = 0
        self.cable = True
        self._motion: Motion | None = None
        self._paused = False
        self._protective = ""
        self._override = 1.0
        self._open = False
        self._known = True
        self._joints = self._away() if away else tuple(model.home)
        self._pose = pose_of(kinematics(model), np.array(model.home))

    def _away(self) -> tuple[float, ...]:
        return (self.model.home[0] + AWAY, *self.model.home[1:])

    @property
    def moves(self) -> bool:
        """Whether it moves now."""
        return self._motion is not None and not self._paused

    def state(self) -> ArmState:
        mode = ArmMode.RUNNING if self._motion is not None else ArmMode.IDLE
        if self._motion is not None and self._paused:
            mode = ArmMode.PAUSED
        elif self._motion is None and not self._known:
            mode = ArmMode.FAULT
        elif self._motion is None and self._protective:
            mode = ArmMode.PROTECTIVE_STOP
        elif not self._open:
            mode = ArmMode.CLOSED
        fault = self._protective or ("" if self._known else "no cable")
        return ArmState(
            self._joints, self._pose, not self.moves, mode, bool(self._protective), fault, self._known, self._override
        )

    async def open(self) -> None:
        if not self.cable:
            raise ArmFault("Timeout", "no cable")
        self._open = self._known = True

    async def close(self) -> None:
        self._end(Stopped("the arm was closed", self._trace()))
        self._open = False

    async def run(self, plan: MotionPlan, on_progress: Callable[[Progress], None]) -> Trace:
        check_start(self.model, self.state(), plan)
        self.handed = time.monotonic_ns()
        for _ in range(self.latency):
            await asyncio.sleep(0)
        check_start(self.model, self.state(), plan)
        motion = self._motion = Motion(plan, asyncio.get_running_loop().create_future())
        self._paused = False
        self.journal("run" if plan.skill_digest else "home", plan.digest)
        self._joints = self._away()
        on_progress(Progress(0.5, 0.5 * plan.duration, plan.stage_at(0.5 * plan.duration)))
        if self.seconds:
            asyncio.get_running_loop().create_task(self._arrive_later(motion))
        try:
            fault = await motion.ended
        finally:
            self._motion, self._paused = None, False
        if fault is not None:
            raise fault
        return self._trace()

    async def _arrive_later(self, motion: Motion) -> None:
        left = self.seconds
        while left > 0.0 and self._motion is motion:
            await asyncio.sleep(0.02)
            left -= 0.0 if self._paused else 0.02
        if self._motion is motion:
            self.arrive()

    async def pause(self, because: str) -> None:
        if self._motion is None:
            raise CommandRefused("ParameterInvalid", "nothing runs")
        await asyncio.sleep(0)
        self._paused = True

    async def resume(self) -> None:
        if self._motion is None or not self._paused:
            raise CommandRefused("ParameterInvalid", "it is not paused")
        self._paused = False
        self.journal("resume", self._motion.plan.digest)

    async def stop(self, because: str) -> None:
        if self._motion is not None:
            await asyncio.sleep(0)
            self._end(Stopped(because, self._trace()))

    async def protective_stop(self, because: str) -> None:
        self._protective = because
        self._end(ArmFault("ProtectiveStop", because, self._trace()))

    async def set_override(self, fraction: float) -> None:
        self._override = fraction

    async def reset(self) -> None:
        if self._motion is not None:
            raise CommandRefused("Busy", "it is running: stop it before a reset")
        if not self.cable:
            raise ArmFault("Timeout", "no cable")
        self._protective, self._known = "", True

    # The arm's own side

    def arrive(self) -> None:
        """Come to the end of the motion under way."""
        if self._motion is not None and not self._paused and not self._motion.ended.done():
            self._joints = tuple(self.model.home)
            self._end(None)

    def pendant_pause(self) -> None:
        """Pause at the pendant, or at the door."""
        self._paused = self._motion is not None

    def pendant_resume(self) -> None:
        """Go on by the pendant."""
        if self._motion is not None and self._paused:
            self._paused = False
            self.journal("pendant", self._motion.plan.digest)

    def pendant_stop(self) -> None:
        """End the motion at the pendant."""
        self._end(Stopped("stopped at the pendant", self._trace()))

    def fault(self) -> None:
        """Stop with a fault of one motion."""
        self._end(ArmFault("ToleranceExceeded", "it left the path", self._trace()))

    def lose(self) -> None:
        """Lose contact, moving or not."""
        self._known = self.cable = False
        self._end(ArmFault("Interrupted", "no cable"))

    def mend(self) -> None:
        """Put the cable back; the arm stays unknown until a reset."""
        self.cable = True

    def push(self) -> None:
        """Be pushed away from home by a hand, while it stands."""
        if self._motion is None:
            self._joints = self._away()

    def survivor(self, journal: Journal) -> "PendantArm":
        """Return the arm as the next server finds it: the one it obeyed is gone, it stands where that left it."""
        found = PendantArm(self.model, journal, seconds=self.seconds)
        found.cable, found._known, found._protective = self.cable, self._known, self._protective
        found._joints, found._override = self._joints, self._override
        self.journal = lambda _kind, _digest: None
        return found

    def let_override_rise(self) -> None:
        """Be at full speed again, as controllers are that forget."""
        self._override = 1.0

    def _end(self, how: Exception | None) -> None:
        if self._motion is not None and not self._motion.ended.done():
            self._motion.ended.set_result(how)

    def _trace(self) -> Trace:
        joints, tool = np.zeros((2, self.model.dof)), np.zeros((2, 3))
        times: Any = np.array([0.0, 0.01])
        return Trace(times, times, joints, joints, tool, tool, np.zeros(2, dtype=bool), np.ones(2))
