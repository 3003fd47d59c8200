"""What an arm is to everybody else: its model, its state, the commands it obeys and how it says no.

A real robot is one new file with a class that fits ``Arm`` and passes ``sim.testing.conformance.ArmConformance``.
Lengths are in metres, angles in radians, times in seconds; a pose is seven numbers x y z qx qy qz qw in the arm's base
frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np

from models.errors import SkillError
from sim.arm_model import ArmModel, Bools, Floats, Pose, Stage
from sim.plan import MotionPlan


class ArmMode(StrEnum):
    """What an arm is doing."""

    CLOSED = "closed"
    IDLE = "idle"
    RUNNING = "running"
    PAUSED = "paused"
    STOPPING = "stopping"
    PROTECTIVE_STOP = "protective stop"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class ArmState:
    """What is known of an arm now.

    ``known`` is False after a loss of contact, until a reset: then joints are the last seen.
    """

    joints: tuple[float, ...]
    tool_pose: Pose
    at_rest: bool
    mode: ArmMode
    protective_stop: bool
    fault: str
    known: bool
    override: float = 1.0


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is: ``fraction`` 0..1 of the plan, ``time`` in s along the plan, and what is being done."""

    fraction: float
    time: float
    phase_of_plan: Stage


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """What was commanded and what was measured, one row a time step of the recipe.

    ``times`` (n,) in s since the start by the arm's clock, pauses included; ``path_times`` (n,) in s along the plan
    (they differ under override and pause); ``joints_*`` (n, dof) in rad; ``tool_*`` (n, 3) nozzle tip in the base
    frame, m; ``dispense`` (n,) valve open; ``override`` (n,) the rate at which the plan was run, 0 while paused: a
    pause is two rows more, at its beginning and at its end. ``source`` says what kind of arm this was measured on.
    ``events`` are things worth telling, such as leaving the skill's tube: (time, text).
    ``orientation_*`` (n, 4) are the nozzle's unit quaternions x y z w in the base frame, (0, 4) where not recorded.
    """

    times: Floats
    path_times: Floats
    joints_commanded: Floats
    joints_measured: Floats
    tool_commanded: Floats
    tool_measured: Floats
    dispense: Bools
    override: Floats
    source: str = ""
    events: tuple[tuple[float, str], ...] = ()
    orientation_commanded: Floats = field(default_factory=lambda: np.empty((0, 4)))
    orientation_measured: Floats = field(default_factory=lambda: np.empty((0, 4)))

    def tracking_error(self) -> tuple[float, float]:
        """Return RMS and maximum in m of the distance between commanded and measured nozzle tip at the same time."""
        if len(self.times) == 0:
            return 0.0, 0.0
        distance = np.linalg.norm(self.tool_measured - self.tool_commanded, axis=1)
        return float(np.sqrt(np.mean(distance**2))), float(distance.max())

    def orientation_error(self) -> tuple[float, float]:
        """Return RMS and maximum in rad of the angle between commanded and measured nozzle at the same time."""
        if len(self.orientation_commanded) == 0:
            return 0.0, 0.0
        apart = angles_between(self.orientation_commanded, self.orientation_measured)
        return float(np.sqrt(np.mean(apart**2))), float(apart.max())


def angles_between(one: Floats, other: Floats) -> Floats:
    """Return the angle (n,) in rad between rotations given as unit quaternions (n, 4); exact for small ones too."""
    apart = np.minimum(np.sqrt(((one - other) ** 2).sum(axis=1)), np.sqrt(((one + other) ** 2).sum(axis=1)))
    return 4.0 * np.arcsin(np.clip(0.5 * apart, 0.0, 1.0))


class ArmError(SkillError):
    """Something an arm would not or could not do. ``failure`` is the word of the job report's list of failures."""

    def __init__(self, failure: str, text: str) -> None:
        super().__init__(failure, text)
        self.failure = failure
        self.text = text

    def __str__(self) -> str:
        """Return what is wrong in one sentence."""
        return self.text


class StartRefused(ArmError):
    """The arm did not start: nothing has moved."""


class CommandRefused(ArmError):
    """A command that makes no sense now, or a value out of range: nothing has changed."""


class ArmFault(ArmError):
    """A run ended by a fault. ``trace`` is what was recorded until then, None if that was lost too."""

    def __init__(self, failure: str, text: str, trace: Trace | None = None) -> None:
        super().__init__(failure, text)
        self.trace = trace


class Stopped(Exception):
    """A run ended because somebody stopped it; the arm is at rest."""

    def __init__(self, because: str, trace: Trace) -> None:
        super().__init__(f"stopped: {because}")
        self.because = because
        self.trace = trace


class Arm(Protocol):
    """An arm as the job engine sees it. Every method may be called from one event loop only."""

    @property
    def model(self) -> ArmModel:
        """The kind of arm this is."""
        ...

    async def open(self) -> None:
        """Make contact. The arm is then idle, at rest and known. Opening an open arm changes nothing."""
        ...

    async def close(self) -> None:
        """Stop, then let go. May be called at any time and as often as one likes."""
        ...

    def state(self) -> ArmState:
        """Return the latest known state at once."""
        ...

    async def run(self, plan: MotionPlan, on_progress: Callable[[Progress], None]) -> Trace:
        """Run a plan from its first sample to its last and return when the arm is at rest at its end.

        Raises ``StartRefused`` when nothing has moved, ``Stopped`` after a stop, ``ArmFault`` otherwise. The arm is
        at rest on every way out, cancelling included. ``on_progress`` is called 10 to 20 times a second at most and
        must return at once.
        """
        ...

    async def pause(self, because: str) -> None:
        """Slow down to rest on the path, valve closed.

        Return when at rest. Only ``resume`` or ``stop`` ends a pause.
        """
        ...

    async def resume(self) -> None:
        """Go on from where the arm was paused."""
        ...

    async def stop(self, because: str) -> None:
        """Come to rest on the path and end the run; return when at rest. Stopping an arm at rest changes nothing."""
        ...

    async def protective_stop(self, because: str) -> None:
        """Come to rest as fast as the limits allow, and refuse to move until ``reset``."""
        ...

    async def set_override(self, fraction: float) -> None:
        """Run the plan slower from now on: more than 0, at most 1. Holds for this run and those after it."""
        ...

    async def reset(self) -> None:
        """Acknowledge a protective stop or a fault; the arm is known again and has not moved by it."""
        ...
