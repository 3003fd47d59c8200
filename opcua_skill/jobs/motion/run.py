"""One motion under way: the job and its plan, who wants it to end, where it is, and when it stood still."""

import asyncio
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

import numpy as np

from library.description import Cause, Failure, JobState
from opcua_skill.jobs.motion.run_record import OwnRecord
from sim.arm import Arm
from sim.arm_model import Floats
from sim.plan import MotionPlan


@dataclass(frozen=True)
class QueuedMotion:
    """A job and the plan that was checked for it: what was checked is what runs.

    ``notes`` says what is worth knowing of a plan that may run, such as where it slows down.
    """

    job_id: str
    plan: MotionPlan
    notes: str = ""


class StoppedBefore(Exception):
    """A job was stopped after its turn had come and before the arm moved."""


class NoLongerExecutable(Exception):
    """A job whose turn has come may not run any more: what it was checked for has changed meanwhile."""

    def __init__(self, failure: Failure, reason: str) -> None:
        super().__init__(reason)
        self.failure = failure


@dataclass
class Run:
    """What is known of a run. ``state`` is the last one written down; ``over`` is set once the arm rests at its end."""

    order: QueuedMotion
    arm: Arm
    state: JobState = JobState.QUEUED
    stop_because: str = ""
    stop_cause: Cause = Cause.ABORTED
    pause_wanted: bool = False
    pauses_asked: int = 0
    progress: float = 0.0
    path_time: float = 0.0
    told_at: float = 0.0
    paused_from: tuple[datetime, ...] = ()
    paused_until: tuple[datetime, ...] = ()
    seen: OwnRecord = field(default_factory=OwnRecord)
    over: asyncio.Event = field(default_factory=asyncio.Event)
    _began: datetime = field(default_factory=lambda: datetime.now(UTC))
    _clock: float = field(default_factory=time.monotonic)

    def moment(self) -> datetime:
        """Return the time now, counted from the run's start: the clock on the wall may be set meanwhile."""
        return self._began + timedelta(seconds=time.monotonic() - self._clock)

    @property
    def stop_failure(self) -> Failure:
        """The word of the job's report for what was asked for."""
        return Failure.PROTECTIVE_STOP if self.stop_cause is Cause.PROTECTIVE_STOP else Failure.ABORTED

    def stop(self, because: str, cause: Cause) -> None:
        """Note who wants the job to end, and why; the first reason counts, but a protective stop is said."""
        if not self.stop_because or cause is Cause.PROTECTIVE_STOP:
            self.stop_because, self.stop_cause = because, cause

    def check_wanted(self) -> None:
        """Raise StoppedBefore if the job was stopped while the arm stood still and there was nothing to stop."""
        if self.stop_because:
            raise StoppedBefore

    def note_pause(self) -> None:
        """Note that the arm stands still."""
        if len(self.paused_from) == len(self.paused_until):
            self.paused_from = (*self.paused_from, self.moment())

    def note_going_on(self) -> None:
        """Note that the arm goes on, or that the run has ended."""
        if len(self.paused_from) > len(self.paused_until):
            self.paused_until = (*self.paused_until, self.moment())

    @property
    def pauses(self) -> dict[str, tuple[datetime, ...]]:
        """The fields of the job's report that say when the run stood still."""
        return {"paused_from": self.paused_from, "paused_until": self.paused_until}


def place_at(plan: MotionPlan, path_time: float) -> tuple[float | None, float | None]:
    """Return where on the learned path a plan is at one of its times: phase 0..1 and m along it; None off the path."""
    row = int(np.clip(np.searchsorted(plan.times, path_time), 0, plan.samples - 1))
    first, last = plan.path_rows
    if not first <= row <= last or not np.isfinite(plan.phases[row]):
        return None, None
    return float(plan.phases[row]), float(_steps(plan.tool[first : row + 1]).sum())


def slowed_to(plan: MotionPlan) -> float:
    """Return the least speed in m/s that a path was slowed to, at the places its findings name; 0 if it was not."""
    places = [one.phase for one in plan.findings if one.code == "SpeedLimit" and np.isfinite(one.phase)]
    first, last = plan.path_rows
    if not places or last - first < 2:
        return 0.0
    speeds = _steps(plan.tool[first : last + 1]) / plan.order.time_step
    phases = plan.phases[first:last]
    return min(float(speeds[int(np.nanargmin(np.abs(phases - place)))]) for place in places)


def _steps(points: Floats) -> Floats:
    return np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
