"""An arm without a simulator: exactly where it is commanded to be, unless it was made imperfect on purpose.

For machines without PyBullet, and for fast tests. It watches the order's tolerances as every simulated arm does.
"""

import asyncio
import math
import time
from collections.abc import Callable

import numpy as np
import scipy.interpolate  # noqa: F401 - used by what runs here: not loaded while something moves
import scipy.ndimage  # noqa: F401

from sim.arm import ArmFault, ArmMode, ArmState, CommandRefused, Progress, Stopped, Trace
from sim.arm_model import ArmModel, Floats
from sim.drivers.execution import Execution, Phase, Recorder
from sim.drivers.monitor import Monitor
from sim.drivers.preconditions import check_override, check_start
from sim.plan import MotionPlan
from sim.planning.kinematics import kinematics
from sim.pose import pose_of
from sim.testing.disturbances import Faults, Imperfection

SLICE = 0.002
PROGRESS_PERIOD = 0.07
NAP = 0.005
SETTLE = 2.0
AT_REST = frozenset({Phase.ENDED, Phase.PAUSED})


class KinematicArm:
    """An ``Arm`` that obeys exactly, or as badly as ``imperfection`` says.

    ``realtime`` paces it like a real one; else it runs as fast as the computer allows.
    """

    def __init__(self, model: ArmModel, realtime: bool = True, imperfection: Imperfection | None = None) -> None:
        self.model = model
        self._realtime = realtime
        self._imperfection = imperfection
        self._joints: Floats = np.array(model.home)
        self._execution: Execution | None = None
        self._is_open = False
        self._protective = ""
        self._override = 1.0
        self._turn = asyncio.Event()

    async def open(self) -> None:
        """Make contact: the arm stands where it was left, at home the first time."""
        self._is_open = True

    async def close(self) -> None:
        """Stop and let go."""
        if self._execution is not None:
            await self.stop("the arm was closed")
        self._is_open = False

    def state(self) -> ArmState:
        """Return where the arm is and what it does."""
        return ArmState(
            joints=tuple(float(value) for value in self._joints),
            tool_pose=pose_of(kinematics(self.model), self._joints),
            at_rest=self._execution is None or self._execution.phase is Phase.PAUSED,
            mode=self._mode(),
            protective_stop=bool(self._protective),
            fault=self._protective,
            known=True,
            override=self._override,
        )

    async def run(self, plan: MotionPlan, on_progress: Callable[[Progress], None]) -> Trace:
        """Run a plan to its end and return what was commanded, which here is also what was measured."""
        check_start(self.model, self.state(), plan)
        execution = self._execution = Execution(plan, self.model, self._override)
        worse = self._imperfection
        how = f", {worse.label()}" if worse else ": exactly as commanded, no physics"
        recorder = Recorder(self.model, f"{self.model.name}, kinematic{how}")
        follower = Follower(execution, self._joints, worse)
        try:
            await self._drive(execution, follower, recorder, on_progress)
        finally:
            if execution.phase is not Phase.ENDED:
                execution.stop("the run was cancelled")
                while execution.phase is not Phase.ENDED:
                    follower.tick()
            self._joints = follower.settle(SETTLE)
            self._execution = None
            self._tell()
        if execution.failure:
            if execution.failure == "ProtectiveStop":
                self._protective = execution.stop_reason
            raise ArmFault(execution.failure, execution.stop_reason, recorder.trace())
        if execution.stop_reason:
            raise Stopped(execution.stop_reason, recorder.trace())
        on_progress(Progress(1.0, plan.duration, plan.segments[-1].stage))
        return recorder.trace()

    async def pause(self, because: str) -> None:
        """Slow down to rest on the path."""
        self._running("pause").pause()
        await self._until(Phase.PAUSED, Phase.RUNNING)

    async def resume(self) -> None:
        """Go on after a pause."""
        execution = self._running("resume")
        if execution.phase not in {Phase.PAUSED, Phase.PAUSING}:
            raise CommandRefused("ParameterInvalid", f"{self.model.name} is not paused")
        execution.resume()
        self._tell()

    async def stop(self, because: str) -> None:
        """Come to rest on the path and end the run."""
        if self._execution is not None:
            self._execution.stop(because)
            self._tell()
            await self._until()

    async def protective_stop(self, because: str) -> None:
        """Come to rest and refuse to move until reset."""
        if self._execution is None:
            self._protective = because
            return
        self._execution.stop(because, "ProtectiveStop")
        self._tell()
        await self._until()

    async def set_override(self, fraction: float) -> None:
        """Run slower, or at full speed again."""
        check_override(fraction)
        self._override = fraction
        if self._execution is not None:
            self._execution.set_override(fraction)

    async def reset(self) -> None:
        """Acknowledge a protective stop."""
        if self._execution is not None:
            raise CommandRefused("Busy", f"{self.model.name} is {self._mode()}: stop it before a reset")
        self._protective = ""

    async def _drive(
        self,
        execution: Execution,
        follower: "Follower",
        recorder: Recorder,
        on_progress: Callable[[Progress], None],
    ) -> None:
        monitor = Monitor(execution.plan, recorder)
        recorder.add(execution, follower.wanted, follower.measured())
        began = time.monotonic()
        told = 0.0
        ticks = 0
        due = math.inf
        while execution.phase is not Phase.ENDED:
            if execution.phase is Phase.PAUSED:
                recorder.add(execution, follower.wanted, follower.measured())
                waiting = time.monotonic()
                while execution.phase is Phase.PAUSED:
                    self._tell()
                    await self._turn.wait()
                execution.rest(time.monotonic() - waiting)
                recorder.add(execution, follower.wanted, follower.measured())
                continue
            until = time.monotonic() + SLICE
            if self._realtime:
                due = time.monotonic() - began
            while execution.phase not in AT_REST and execution.clock < due and time.monotonic() < until:
                self._joints = follower.tick()
                ticks += 1
                if ticks % execution.ticks_a_row == 0 or execution.phase is Phase.ENDED:
                    recorder.add(execution, follower.wanted, follower.measured())
                    monitor.look(execution)
            now = time.monotonic()
            if now - told >= PROGRESS_PERIOD:
                told = now
                at = execution.path_time
                on_progress(Progress(execution.fraction, at, execution.plan.stage_at(at)))
            await asyncio.sleep(NAP if execution.clock >= due else 0)

    def _running(self, command: str) -> Execution:
        if self._execution is None:
            raise CommandRefused("ParameterInvalid", f"{self.model.name} runs nothing: there is nothing to {command}")
        return self._execution

    async def _until(self, *phases: Phase) -> None:
        """Wait until the run has ended or reached one of the phases."""
        execution = self._execution
        while execution is not None and self._execution is execution and execution.phase not in phases:
            await self._turn.wait()

    def _tell(self) -> None:
        """Wake everybody who waits for a change."""
        self._turn.set()
        self._turn = asyncio.Event()

    def _mode(self) -> ArmMode:
        if not self._is_open:
            return ArmMode.CLOSED
        if self._execution is None:
            return ArmMode.PROTECTIVE_STOP if self._protective else ArmMode.IDLE
        if self._execution.phase is Phase.PAUSED:
            return ArmMode.PAUSED
        return ArmMode.STOPPING if self._execution.phase is Phase.STOPPING else ArmMode.RUNNING


class Follower:
    """Where the joints really are in one run: where they are sent, or worse if that was asked for."""

    def __init__(self, execution: Execution, joints: Floats, imperfection: Imperfection | None) -> None:
        self._execution = execution
        self._faults: Faults | None = imperfection.begin(joints, execution.dt) if imperfection else None
        self.wanted = joints
        self._joints = joints

    def tick(self) -> Floats:
        """Go on by one tick and return the joints (dof,) as they are."""
        return self._to(self._execution.tick())

    def settle(self, longest: float) -> Floats:
        """Let joints that lag behind arrive, ``longest`` s at most, and return where they rest."""
        for _ in range(int(longest / self._execution.dt)):
            if self._faults is None or self._faults.settled:
                break
            self._to(self.wanted)
        return self._joints

    def measured(self) -> Floats:
        """Return the joints (dof,) as the encoders tell them."""
        return self._joints if self._faults is None else self._faults.measure(self._joints)

    def _to(self, wanted: Floats) -> Floats:
        before, self.wanted = self.wanted, wanted
        self._joints = wanted if self._faults is None else self._faults.command(before, wanted)[1]
        return self._joints
