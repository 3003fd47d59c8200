"""Where on its plan an arm should be at every tick, under override, pause and stop. No clock, no robot, no asyncio.

Slower and faster, pause and stop only change how fast the plan's own time passes, so the nozzle never leaves the
path. The rate follows a cubic step, as long as needed for joints and nozzle to keep their acceleration limits,
whatever they are doing then.
"""

import math
from enum import StrEnum

import numpy as np

from sim.arm import ArmModel, Bools, Floats, Trace
from sim.holding import quaternions
from sim.kinematics import kinematics
from sim.plan import MotionPlan, valve_open

LONGEST_TICK = 1e-3
SHORTEST_RAMP = 0.04
STEEPEST = 1.5
LOOK_AHEAD = 0.5
SPARE, LEAST_SPARE = 0.95, 0.25


class Phase(StrEnum):
    """What the run is doing."""

    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    STOPPING = "stopping"
    ENDED = "ended"


class Execution:
    """One run of a plan, tick by tick.

    ``dt`` is the tick in s, a whole fraction of the plan's time step, at most 1 ms.
    """

    def __init__(self, plan: MotionPlan, model: ArmModel, override: float = 1.0) -> None:
        self.plan = plan
        self.phase = Phase.RUNNING
        self.stop_reason = ""
        self.failure = ""
        self.path_time = 0.0
        self.rate = override
        self.override = override
        self.clock = 0.0
        step = plan.order.time_step
        self.ticks_a_row = max(1, math.ceil(step / LONGEST_TICK - 1e-9))
        self.dt = step / self.ticks_a_row
        self._step = step
        self._cubic = _hermite(plan.joints, plan.velocities, step)
        self._acceleration = np.abs(np.gradient(plan.velocities, step, axis=0))
        self._velocity = np.abs(plan.velocities)
        self._tool_speed = np.sqrt((np.gradient(plan.tool, step, axis=0) ** 2).sum(axis=1))
        self._limits = np.array(model.limits.acceleration)
        self._tool_limit = model.path_limits.acceleration
        self._mark = (0.0, 0)
        self._ramp: tuple[float, float, float, float] | None = None

    def tick(self) -> Floats:
        """Go on by one tick and return the joints (dof,) to be at now."""
        self.clock += self.dt
        if self._ramp is not None:
            self._follow_ramp()
            self._mark = (self.path_time, 0)
        elif self.phase is not Phase.PAUSED:
            # Counted from the last change of rate, not added up: the n-th tick is at n times the tick, to the last bit.
            base, ticks = self._mark
            self._mark = (base, ticks + 1)
            self.path_time = base + (ticks + 1) * self.dt * self.rate
        if self.path_time >= self.plan.duration - 1e-9:
            self.path_time = self.plan.duration
            self.phase = Phase.ENDED
            self._ramp = None
        return self.joints()

    def joints(self) -> Floats:
        """Return the joints (dof,) to be at now."""
        row = min(int(self.path_time / self._step), len(self._cubic) - 1)
        u = self.path_time / self._step - row
        a, b, c, d = self._cubic[row]
        return ((d * u + c) * u + b) * u + a

    @property
    def valve(self) -> bool:
        """Whether the valve is open now: closed at rest and as soon as a stop is asked for."""
        if self.rate <= 0.0 or self.phase in {Phase.STOPPING, Phase.PAUSED, Phase.ENDED}:
            return False
        lead = self.plan.order.dispense_lead * self.rate
        return bool(valve_open(self.plan.valve, np.array([self.path_time]), lead)[0])

    @property
    def fraction(self) -> float:
        """How much of the plan is done, 0..1."""
        return self.path_time / self.plan.duration

    def pause(self) -> None:
        """Slow down to rest on the path."""
        if self.phase is Phase.RUNNING:
            self.phase = Phase.PAUSING
            self._aim(0.0)

    def resume(self) -> None:
        """Go on after a pause."""
        if self.phase in {Phase.PAUSED, Phase.PAUSING}:
            self.phase = Phase.RUNNING
            self._aim(self.override)

    def stop(self, because: str, failure: str = "") -> None:
        """Slow down to rest on the path and end there; ``failure`` is empty when somebody wished it."""
        if self.phase in {Phase.ENDED, Phase.STOPPING}:
            return
        self.stop_reason, self.failure = because, failure
        resting = self.phase is Phase.PAUSED
        self.phase = Phase.ENDED if resting else Phase.STOPPING
        if not resting:
            self._aim(0.0)

    def set_override(self, fraction: float) -> None:
        """Change how fast the plan's time passes; at once when at rest, else along a ramp."""
        self.override = fraction
        if self.phase is Phase.RUNNING:
            self._aim(fraction)

    def _aim(self, rate: float) -> None:
        """Begin a ramp from the rate now to another, long enough for every acceleration limit."""
        if rate == self.rate:
            self._ramp = None
            return
        change = abs(rate - self.rate)
        first = int(self.path_time / self._step)
        window = slice(first, first + max(2, math.ceil(LOOK_AHEAD / self._step)) + 1)
        busy = self._acceleration[window].max(axis=0) * max(rate, self.rate) ** 2
        spare = np.maximum(LEAST_SPARE * self._limits, SPARE * self._limits - busy)
        by_joints = float((self._velocity[window].max(axis=0) / spare).max())
        by_tool = float(self._tool_speed[window].max()) / self._tool_limit
        length = max(SHORTEST_RAMP, STEEPEST * change * max(by_joints, by_tool))
        self._ramp = (self.rate, rate, length, 0.0)

    def _follow_ramp(self) -> None:
        assert self._ramp is not None
        start, end, length, since = self._ramp
        since = min(since + self.dt, length)
        u = since / length
        before = self.rate
        self.rate = start + (end - start) * u * u * (3.0 - 2.0 * u)
        self.path_time += 0.5 * (before + self.rate) * self.dt
        self._ramp = (start, end, length, since)
        if since >= length:
            self.rate = end
            self._ramp = None
            if self.phase is Phase.PAUSING:
                self.phase = Phase.PAUSED
            elif self.phase is Phase.STOPPING:
                self.phase = Phase.ENDED


class Recorder:
    """Rows of a run while it goes on; becomes a ``Trace`` at its end."""

    def __init__(self, model: ArmModel, source: str) -> None:
        self._model = model
        self._source = source
        self._rows: list[tuple[float, float, bool, float]] = []
        self._commanded: list[Floats] = []
        self._measured: list[Floats] = []
        self.events: list[tuple[float, str]] = []

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._rows)

    def add(self, execution: Execution, commanded: Floats, measured: Floats) -> None:
        """Write down one row."""
        self._rows.append((execution.clock, execution.path_time, execution.valve, execution.rate))
        self._commanded.append(commanded)
        self._measured.append(measured)

    def measured(self) -> Floats:
        """Return the joints (dof,) measured last."""
        return self._measured[-1]

    def last(self, count: int) -> tuple[Floats, Floats, Floats]:
        """Return plan times (k,), commanded and measured nozzle tips (k, 3) of the last ``count`` rows."""
        forward = kinematics(self._model).forward
        times = np.array([row[1] for row in self._rows[-count:]])
        return times, forward(np.array(self._commanded[-count:]))[0], forward(np.array(self._measured[-count:]))[0]

    def trace(self) -> Trace:
        """Return everything recorded."""
        columns = np.array([row[:2] + row[3:] for row in self._rows], dtype=float).reshape(-1, 3)
        valve: Bools = np.array([row[2] for row in self._rows], dtype=bool)
        shape = (-1, self._model.dof)
        commanded = np.array(self._commanded, dtype=float).reshape(shape)
        measured = np.array(self._measured, dtype=float).reshape(shape)
        forward = kinematics(self._model).forward
        (wanted, held), (found, holds) = forward(commanded), forward(measured)
        return Trace(
            columns[:, 0], columns[:, 1], commanded, measured, wanted, found, valve, columns[:, 2], self._source,
            tuple(self.events), quaternions(held), quaternions(holds),
        )  # fmt: skip


def _hermite(values: Floats, slopes: Floats, step: float) -> Floats:
    """Return the cubics (n - 1, 4, dof) in the fraction of a step, through values with slopes."""
    low, high = values[:-1], values[1:]
    rise, fall = slopes[:-1] * step, slopes[1:] * step
    return np.stack([low, rise, 3 * (high - low) - 2 * rise - fall, 2 * (low - high) + rise + fall], axis=1)
