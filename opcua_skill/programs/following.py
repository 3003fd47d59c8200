"""A plan at any moment, and the fewest lines or cubics found that follow it within a tolerance."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from opcua_skill.programs.values import Language, Lines, Splines, Switch
from sim.arm import ArmModel, Floats
from sim.holding import quaternions
from sim.kinematics import kinematics
from sim.plan import MotionPlan

# Moments looked at: twice a sample of the plan at least, and so close together that an arm's nozzle, at two metres per
# second squared, is on the chord between them to a micrometre.
BETWEEN, CLOSE = 2, 2e-3


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A plan between its samples too: as the arm follows it, on the cubic through positions and velocities."""

    plan: MotionPlan
    arm: ArmModel
    joints: CubicHermiteSpline

    @classmethod
    def of(cls, plan: MotionPlan, arm: ArmModel) -> "Followed":
        """Return a plan for its own arm."""
        return cls(plan, arm, CubicHermiteSpline(plan.times, plan.joints, plan.velocities))

    def moments(self) -> Floats:
        """Return the times (m,) at which a program is held against the plan: at the samples and between them."""
        times = self.plan.times
        count = max(BETWEEN, math.ceil(self.plan.order.time_step / CLOSE - 1e-9))
        inner = [times[:-1] + k / count * np.diff(times) for k in range(count)]
        return np.append(np.stack(inner, axis=1).reshape(-1), times[-1])

    def at(self, times: Floats) -> tuple[Floats, Rotation]:
        """Return the tip's places (n, 3) and orientations at times (n,)."""
        places, turns = kinematics(self.arm).forward(np.asarray(self.joints(times), dtype=np.float64))
        return places, Rotation.from_quat(quaternions(turns))


def switches(plan: MotionPlan, quantum: float) -> tuple[Switch, ...]:
    """Return when the valve is to switch, within the plan, in whole quanta."""
    found: list[Switch] = []
    for event in sorted(plan.valve_events, key=lambda one: one.time):
        time = min(max(event.time, 0.0), plan.duration)
        found.append(Switch(_whole(time, quantum), event.opens))
    return tuple(found)


def _whole(time: float, quantum: float) -> float:
    return round(time / quantum) * quantum if quantum > 0.0 else time


def knots(moments: Floats, fixed: Floats, quantum: float, good: Callable[[float, float], bool]) -> Floats:
    """Return times (k,) from the first moment to the last, as far apart as ``good`` allows; ``fixed`` are among them.

    From each one the next is looked for by doubling the stride and halving again. A single step is taken even where
    it is not good: comparing the whole afterwards tells.
    """
    grid = np.unique(np.round(moments / quantum) * quantum) if quantum > 0.0 else moments
    last = _whole(float(moments[-1]), quantum)
    fixed = np.round(fixed / quantum) * quantum if quantum > 0.0 else fixed
    grid = np.unique(np.concatenate([grid[grid < last - 1e-9], fixed, [0.0, last]]))
    grid = grid[np.concatenate([[True], np.diff(grid) > 1e-7])]
    stops = {int(np.abs(grid - time).argmin()) for time in fixed} | {len(grid) - 1}
    found, here, stride = [0], 0, 1
    while here < len(grid) - 1:
        most = min(stop for stop in stops if stop > here)
        low, high = here + 1, min(most, here + 2 * stride)
        while good(grid[here], grid[high]) and high < most:
            low, high = high, min(most, here + 2 * (high - here))
        if good(grid[here], grid[high]):
            low = high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if good(grid[here], grid[middle]) else (low, middle)
        stride, here = low - here, low
        found.append(here)
    return grid[found]


def _fixed(events: tuple[Switch, ...], duration: float, longest: float) -> Floats:
    """Return the times that are kept as they are: where the valve switches, and so that no row takes too long."""
    count = int(duration / longest) + 1 if longest < math.inf else 1
    spread = np.linspace(0.0, duration, count + 1)[1:-1]
    return np.concatenate([np.array([one.time for one in events]), spread])


def as_lines(followed: Followed, language: Language, tolerance: float, turn_tolerance: float) -> Lines:
    """Return the fewest lines found that are where the plan is at each moment, within m and rad."""
    quantum = language.quantum
    moments = followed.moments()
    places, turns = followed.at(moments)
    still = float((turns[0].inv() * turns).magnitude().max()) <= 1e-12

    def good(begin: float, end: float) -> bool:
        first, last = np.searchsorted(moments, [begin - 1e-12, end + 1e-12])
        if last - first < 2:
            return True
        (start, goal), held = followed.at(np.array([begin, end]))
        share = (moments[first:last] - begin) / (end - begin)
        off = places[first:last] - start - share[:, None] * (goal - start)
        if (off**2).sum(axis=1).max() > tolerance**2:
            return False
        if still:
            return True
        way = (held[0].inv() * held[1]).as_rotvec()
        line = held[0] * Rotation.from_rotvec(share[:, None] * way)
        return bool((line.inv() * turns[first:last]).magnitude().max() <= turn_tolerance)

    events = switches(followed.plan, quantum)
    times = knots(moments, _fixed(events, followed.plan.duration, language.longest_row), quantum, good)
    points, held = followed.at(np.minimum(times, followed.plan.duration))
    return Lines(times, points, np.asarray(held.as_quat(), dtype=np.float64), events)


def as_splines(followed: Followed, language: Language, tolerance: float, turn_tolerance: float) -> Splines:
    """Return the fewest cubics of the joints found whose tip is where the plan's is at each moment."""
    quantum = language.quantum
    moments = followed.moments()
    places, turns = followed.at(moments)
    chain = kinematics(followed.arm)

    def good(begin: float, end: float) -> bool:
        first, last = np.searchsorted(moments, [begin - 1e-12, end + 1e-12])
        if last - first < 2:
            return True
        ends = np.array([begin, end])
        cubic = CubicHermiteSpline(ends, followed.joints(ends), followed.joints(ends, 1))
        tip, held = chain.forward(np.asarray(cubic(moments[first:last]), dtype=np.float64))
        if ((tip - places[first:last]) ** 2).sum(axis=1).max() > tolerance**2:
            return False
        off = (Rotation.from_matrix(held).inv() * turns[first:last]).magnitude()
        return bool(off.max() <= turn_tolerance)

    events = switches(followed.plan, quantum)
    times = knots(moments, _fixed(events, followed.plan.duration, language.longest_row), quantum, good)
    inside = np.minimum(times, followed.plan.duration)
    joints, speeds = (np.asarray(followed.joints(inside, order), dtype=np.float64) for order in (0, 1))
    return Splines(times, joints, speeds, events)
