"""Where on its plan an arm should be at every tick, under override, pause and stop. No clock, no robot, no asyncio.

Slower and faster, pause and stop only change how fast the plan's own time passes, so the nozzle never leaves the
path. The rate follows ramps (``sim.drivers.ramps``) that keep the joints' velocity, acceleration and jerk whatever they
are doing then. A ramp under way is left for another only where the other keeps them too.
"""

import math
from enum import StrEnum

import numpy as np

from sim.arm import Trace
from sim.arm_model import ArmModel, Bools, Floats
from sim.drivers.ramps import SPARE, Ramp, Ramps
from sim.plan import MotionPlan, valve_open
from sim.planning.kinematics import kinematics
from sim.planning.tool_orientation import quaternions

LONGEST_TICK = 1e-3
# Where no ramp keeps every limit, another place a little later is tried, so far; then the least evil is done.
TRY_AGAIN, PATIENCE = 0.004, 0.2
# Before a ramp longer than this, in s, beginning so much later is tried: it may be over sooner.
LONG, WAITS, WELL_BEFORE = 0.12, (0.01, 0.02, 0.04, 0.08, 0.16), 0.9


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
        self._ramps = Ramps(plan, model, self.dt)
        self._mark = (0.0, 0)
        self._ramp: Ramp | None = None
        self._since = 0
        self._slope = 0.0
        self._wanted: float | None = None
        self._asked, self._next = 0.0, 0.0
        self._shut = False

    def tick(self) -> Floats:
        """Go on by one tick and return the joints (dof,) to be at now."""
        self.clock += self.dt
        if self._wanted is not None and self.clock >= self._next:
            self._begin_ramp(self._wanted)
        if self._ramp is not None:
            self._follow_ramp(self._ramp)
            self._mark = (self.path_time, 0)
        elif self.phase is not Phase.PAUSED:
            # Counted from the last change of rate, not added up: the n-th tick is at n times the tick, to the last bit.
            base, ticks = self._mark
            self._mark = (base, ticks + 1)
            self.path_time = base + (ticks + 1) * self.dt * self.rate
        if self.path_time >= self.plan.duration - 1e-9:
            self.path_time = self.plan.duration
            self.phase = Phase.ENDED
            self._ramp = self._wanted = None
        return self.joints()

    def rest(self, seconds: float) -> None:
        """Let time pass while paused."""
        self.clock += seconds
        self._asked += seconds
        self._next += seconds

    def joints(self) -> Floats:
        """Return the joints (dof,) to be at now."""
        row = min(int(self.path_time / self._step), len(self._cubic) - 1)
        u = self.path_time / self._step - row
        a, b, c, d = self._cubic[row]
        return ((d * u + c) * u + b) * u + a

    @property
    def valve(self) -> bool:
        """Whether the valve is open now.

        Closed as soon as a pause or stop is asked for, until the nozzle is on its path at the speed wanted again.
        """
        if self._shut or self.phase is Phase.ENDED:
            return False
        lead = self.plan.order.dispense_lead * self.rate
        return bool(valve_open(self.plan.valve, np.array([self.path_time]), lead)[0])

    @property
    def fraction(self) -> float:
        """How much of the plan is done, 0..1."""
        return self.path_time / self.plan.duration

    def pause(self) -> None:
        """Close the valve and slow down to rest on the path, once the valve has had its ``dispense_lead`` to close."""
        if self.phase is Phase.RUNNING:
            flows = self.valve
            self.phase = Phase.PAUSING
            self._shut = True
            self._aim(0.0, self.plan.order.dispense_lead if flows else 0.0)

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
        self._shut = True
        if not resting:
            self._aim(0.0)

    def set_override(self, fraction: float) -> None:
        """Change how fast the plan's time passes; at once when at rest, else along a ramp."""
        self.override = fraction
        if self.phase is Phase.RUNNING:
            self._aim(fraction)

    def _aim(self, rate: float, later: float = 0.0) -> None:
        """Have the rate go to another, from ``later`` s on, as soon as a ramp there keeps every limit."""
        self._wanted = rate
        self._asked = self._next = self.clock + max(0.0, later)

    def _begin_ramp(self, rate: float) -> None:
        """Begin the shortest ramp from the rate now to another; where there is none, a little later."""
        if self._ramp is not None and self._ramp.end == rate:
            self._wanted = None
            return
        if self._ramp is None and rate == self.rate:
            self._wanted = None
            self._arrive()
            return
        top = max(self.rate, rate, self._ramp.end if self._ramp else 0.0)
        ramp, share = self._ramps.find(self.path_time, self.rate, self._slope, rate, top)
        late = self._ramp is None and self.clock - self._asked > PATIENCE
        if share > 1.0 + SPARE and not late:
            self._next = self.clock + TRY_AGAIN
            return
        if self._ramp is None and not late and ramp.length > LONG:
            wait = self._worth_waiting(ramp, top)
            if wait:
                self._next = self.clock + wait
                return
        self._ramp, self._since, self._wanted = ramp, 0, None

    def _worth_waiting(self, ramp: Ramp, top: float) -> float:
        """Return after how many s a ramp may begin that is over well before this one would be; 0 for none."""
        soonest, best = WELL_BEFORE * ramp.length, 0.0
        for wait in WAITS:
            later, share = self._ramps.find(ramp.start + wait * ramp.rate, ramp.rate, 0.0, ramp.end, top)
            if share <= 1.0 + SPARE and wait + later.length < soonest:
                soonest, best = wait + later.length, wait
        return best

    def _follow_ramp(self, ramp: Ramp) -> None:
        self._since += 1
        since = self._since * self.dt
        self.path_time, rate, self._slope = ramp.at(since)
        self.rate = max(rate, 0.0)
        if since >= ramp.length - 0.5 * self.dt:
            self.rate, self._slope = ramp.end, 0.0
            self._ramp = None
            if self._wanted is None:
                self._arrive()

    def _arrive(self) -> None:
        """The rate is what was wanted."""
        if self.phase is Phase.PAUSING:
            self.phase = Phase.PAUSED
        elif self.phase is Phase.STOPPING:
            self.phase = Phase.ENDED
        elif self.phase is Phase.RUNNING:
            self._shut = False


Rows = tuple[list[tuple[float, float, bool, float]], Floats, Floats]
"""Clock, plan's time, valve and rate of some rows, and their joints, commanded and measured (k, dof)."""


class Recorder:
    """Rows of a run while it goes on; becomes a ``Trace`` at its end.

    A pause is two rows, at its beginning and at its end.
    """

    def __init__(self, model: ArmModel, source: str) -> None:
        self._model = model
        self._source = source
        self._rows: list[tuple[float, float, bool, float]] = []
        self._commanded: list[Floats] = []
        self._measured: list[Floats] = []
        self.events: list[tuple[float, str]] = []
        self._told = 0

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._rows)

    def add(self, execution: Execution, commanded: Floats, measured: Floats) -> None:
        """Write down one row."""
        self._rows.append((execution.clock, execution.path_time, execution.valve, execution.rate))
        self._commanded.append(commanded)
        self._measured.append(measured)

    def new_rows(self) -> Rows:
        """Return the rows that were added since this was asked last, to be kept somewhere else too."""
        new = slice(self._told, len(self))
        self._told = len(self)
        return self._rows[new], np.array(self._commanded[new]), np.array(self._measured[new])

    def extend(self, rows: Rows) -> None:
        """Write down rows that another recorder told."""
        self._rows += rows[0]
        self._commanded += list(rows[1])
        self._measured += list(rows[2])

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
