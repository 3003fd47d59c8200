"""A plan at any moment, and the fewest lines or cubics found that follow it within a tolerance."""

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from opcua_skill.programs.values import Language, Lines, Splines, Switch
from sim.arm_model import ArmModel, Floats
from sim.plan import MotionPlan
from sim.planning.kinematics import kinematics
from sim.planning.tool_orientation import quaternions

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


def _grid(followed: Followed, language: Language, events: tuple[Switch, ...]) -> tuple[Floats, frozenset[int]]:
    """Return the times (g,) at which rows may begin or end, and which of them they have to."""
    quantum, duration = language.quantum, followed.plan.duration
    moments, last = followed.moments(), _whole(followed.plan.duration, quantum)
    grid = np.unique(np.round(moments / quantum) * quantum) if quantum > 0.0 else moments
    count = int(duration / language.longest_row) + 1 if language.longest_row < math.inf else 1
    fixed = np.concatenate([[one.time for one in events], np.linspace(0.0, duration, count + 1)[1:-1]])
    fixed = np.round(fixed / quantum) * quantum if quantum > 0.0 else fixed
    grid = np.unique(np.concatenate([grid[grid < last - 1e-9], fixed, [0.0, last]]))
    grid = grid[np.concatenate([[True], np.diff(grid) > 1e-7])]
    return grid, frozenset({*(int(np.abs(grid - time).argmin()) for time in fixed), len(grid) - 1})


def _kept(size: int, stops: frozenset[int], good: Callable[[int, int], bool]) -> list[int]:
    """Return rows of a grid, from the first to the last, as far apart as ``good`` allows; ``stops`` are among them.

    From each one the next is looked for by doubling the stride and halving again. A single step is taken even where
    it is not good: comparing the whole afterwards tells.
    """
    found, here, stride = [0], 0, 1
    ends = sorted(stops)
    while here < size - 1:
        most = ends[bisect_right(ends, here)]
        low, high = here + 1, min(most, here + 2 * stride)
        while high > low and good(here, high):
            low, high = high, min(most, here + 2 * (high - here))
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if good(here, middle) else (low, middle)
        stride, here = low - here, low
        found.append(here)
    return found


def as_lines(followed: Followed, language: Language, tolerance: float, turn_tolerance: float) -> Lines:
    """Return the fewest lines found that are where the plan is at each moment, within m and rad."""
    events = switches(followed.plan, language.quantum)
    grid, stops = _grid(followed, language, events)
    inside = np.minimum(grid, followed.plan.duration)
    points, held = followed.at(inside)
    moments = followed.moments()
    places, turns = followed.at(moments)
    first, after = np.searchsorted(moments, grid - 1e-12), np.searchsorted(moments, grid + 1e-12)
    still = float((turns[0].inv() * turns).magnitude().max()) <= 1e-12

    def good(begin: int, end: int) -> bool:
        part = slice(int(first[begin]), int(after[end]))
        share = ((moments[part] - grid[begin]) / (grid[end] - grid[begin]))[:, None]
        off = places[part] - points[begin] - share * (points[end] - points[begin])
        if (off**2).sum(axis=1).max(initial=0.0) > tolerance**2:
            return False
        if still or not len(share):
            return True
        way = (held[begin].inv() * held[end]).as_rotvec()
        line = held[begin] * Rotation.from_rotvec(share * way)
        return bool((line.inv() * turns[part]).magnitude().max() <= turn_tolerance)

    kept = _kept(len(grid), stops, good)
    how = np.asarray(held.as_quat(), dtype=np.float64)[kept]
    return Lines(grid[kept], points[kept], how, events)


def as_splines(followed: Followed, language: Language, tolerance: float, turn_tolerance: float) -> Splines:
    """Return the fewest cubics of the joints found whose tip is where the plan's is at each moment."""
    events = switches(followed.plan, language.quantum)
    grid, stops = _grid(followed, language, events)
    inside = np.minimum(grid, followed.plan.duration)
    joints, speeds = (np.asarray(followed.joints(inside, order), dtype=np.float64) for order in (0, 1))
    moments = followed.moments()
    places, turns = followed.at(moments)
    first, after = np.searchsorted(moments, grid - 1e-12), np.searchsorted(moments, grid + 1e-12)
    chain = kinematics(followed.arm)

    def good(begin: int, end: int) -> bool:
        part = slice(int(first[begin]), int(after[end]))
        ends = [begin, end]
        cubic = CubicHermiteSpline(grid[ends], joints[ends], speeds[ends])
        tip, held = chain.forward(np.asarray(cubic(moments[part]), dtype=np.float64))
        if ((tip - places[part]) ** 2).sum(axis=1).max(initial=0.0) > tolerance**2:
            return False
        off = (Rotation.from_matrix(held).inv() * turns[part]).magnitude()
        return bool(off.max(initial=0.0) <= turn_tolerance)

    kept = _kept(len(grid), stops, good)
    return Splines(grid[kept], joints[kept], speeds[kept], events)
