"""How fast the time of a plan may change: ramps of its rate that keep every limit of the joints on the way ahead.

Where the plan's time s passes at the rate r, a joint q(s) has the velocity q' r, the acceleration q'' r² + q' r' and
the jerk q''' r³ + 3 q'' r r' + q' r''. What a ramp may do follows from the plan where it will be run: every ramp is
looked at along its own stretch of the plan before it begins.
"""

from dataclasses import dataclass

import numpy as np

from sim.arm_model import ArmModel, Floats
from sim.plan import MotionPlan

SHORTEST_TICKS, LONGEST = 4, 6.0
FINER, PLACES = 1.12, 33
SPARE = 1e-6
"""What rounding may add to a share of a limit."""


@dataclass(frozen=True, slots=True)
class Ramp:
    """A cubic change of rate: from ``rate`` with slope ``slope`` (1/s) to ``end``, level there, in ``length`` s.

    ``start`` is the time in s of the plan at which it begins.
    """

    start: float
    rate: float
    slope: float
    end: float
    length: float

    def at(self, since: float) -> tuple[float, float, float]:
        """Return the plan's time in s, the rate and its slope in 1/s so many s after the beginning."""
        size, u = self.length, since / self.length
        first = self.slope * size
        change = self.end - self.rate - first
        second, third = 3.0 * change + first, -first - 2.0 * change
        time = self.start + size * u * (self.rate + u * (first / 2.0 + u * (second / 3.0 + u * third / 4.0)))
        rate = self.rate + u * (first + u * (second + u * third))
        return time, rate, (first + u * (2.0 * second + 3.0 * third * u)) / size


class Ramps:
    """Finds ramps for one plan on one arm; ``dt`` is the tick in s."""

    def __init__(self, plan: MotionPlan, model: ArmModel, dt: float) -> None:
        step = plan.order.time_step
        self._step, self._dt, self._duration = step, dt, plan.duration
        before, after = plan.velocities[:-1], plan.velocities[1:]
        way = np.diff(plan.joints, axis=0) / step
        self._first = before
        self._second = (6.0 * way - 4.0 * before - 2.0 * after) / step
        self._third = 6.0 * (before + after - 2.0 * way) / step**2
        limits = model.limits
        self._limits = tuple(np.array(row) for row in (limits.velocity, limits.acceleration, limits.jerk))
        self._tool_limits = model.path_limits.acceleration, model.path_limits.jerk
        self._tool = np.sqrt((np.gradient(plan.tool, step, axis=0) ** 2).sum(axis=1))
        ticks = SHORTEST_TICKS * FINER ** np.arange(200)
        self._lengths = np.unique(np.rint(ticks[ticks * dt <= LONGEST])) * dt

    def find(self, start: float, rate: float, slope: float, end: float, top: float) -> tuple[Ramp, float]:
        """Return the shortest ramp that keeps every limit and 0..``top``, and by what share it does (1 or less).

        Where none does the share is more than 1, and the ramp is the one that is least beyond.
        """
        asked = Ramp(start, rate, slope, end, 0.0)
        shares = self._shares(asked, self._lengths, PLACES, top)
        least, best = np.inf, float(self._lengths[int(shares.argmin())])
        likely = np.flatnonzero(shares <= 1.0 + SPARE)
        # Each that fails makes the next step to a longer one larger: looking closely at all of them would take long.
        for i in likely[np.unique(np.cumsum(np.arange(len(likely))).clip(0, max(0, len(likely) - 1)))]:
            length = float(self._lengths[i])
            share = float(self._shares(asked, self._lengths[i : i + 1], 2 * round(length / self._dt) + 1, top)[0])
            if share < least:
                least, best = share, length
            if share <= 1.0 + SPARE:
                break
        return Ramp(start, rate, slope, end, best), least

    def _shares(self, asked: Ramp, lengths: Floats, places: int, top: float) -> Floats:
        """Return the largest share of any limit (k,) that the ramp needs with each length (k,); inf where it errs."""
        times, rates, slopes, bends = _courses(asked, lengths, np.linspace(0.0, 1.0, places)[None])
        wrong = ((rates < -SPARE) | (rates > top + SPARE)).any(axis=1)
        moving = times < self._duration
        rows = np.clip((times / self._step).astype(int), 0, len(self._first) - 1)
        since = (times - rows * self._step)[..., None]
        rate, slope, bend = (np.where(moving, values, 0.0)[..., None] for values in (rates, slopes, bends))
        third = self._third[rows]
        second = self._second[rows] + since * third
        first = self._first[rows] + since * (self._second[rows] + 0.5 * since * third)
        velocity, acceleration, jerk = self._limits
        shares = np.abs(first * rate / velocity).max(axis=(1, 2))
        push = second * rate**2 + first * slope
        shares = np.maximum(shares, np.abs(push / acceleration).max(axis=(1, 2)))
        jolt = third * rate**3 + 3.0 * second * rate * slope + first * bend
        shares = np.maximum(shares, np.abs(jolt / jerk).max(axis=(1, 2)))
        tool = self._tool[rows]
        shares = np.maximum(shares, (tool * np.abs(slope[..., 0])).max(axis=1) / self._tool_limits[0])
        shares = np.maximum(shares, (tool * np.abs(bend[..., 0])).max(axis=1) / self._tool_limits[1])
        return np.where(wrong, np.inf, shares)


def _courses(ramp: Ramp, lengths: Floats, parts: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return plan times in s, rates, slopes (1/s) and bends (1/s²), each (k, m).

    For lengths (k,) in s at parts (1, m) 0..1 of each.
    """
    size = lengths[:, None]
    first = ramp.slope * size
    change = ramp.end - ramp.rate - first
    second, third = 3.0 * change + first, -first - 2.0 * change
    u = parts
    rates = ramp.rate + u * (first + u * (second + u * third))
    times = ramp.start + size * u * (ramp.rate + u * (first / 2.0 + u * (second / 3.0 + u * third / 4.0)))
    slopes = (first + u * (2.0 * second + 3.0 * third * u)) / size
    bends = (2.0 * second + 6.0 * third * u) / size**2
    return times, rates, slopes, bends
