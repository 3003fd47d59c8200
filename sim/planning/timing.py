"""From a path to a motion in time: how fast the nozzle goes where, within what the joints can do.

The fastest speed along a path under bounds on joint velocity and acceleration follows Bobrow, Dubowsky and Gibson
(1985): a ceiling at every place, then one sweep forward and one back with the acceleration allowed there. Two short
moving averages in time make the jerk finite (Biagiotti and Melchiorri, Trajectory Planning, section 4.5). So that the
average stays below the ceiling, dips of the ceiling are widened by as much time as the averages take (erosion, Serra,
1982), and no peak of the speed is shorter than that. Joint moves and straight lines are ruckig's (Berscheid and
Kroeger, 2021), solved offline.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from ruckig import InputParameter, Result, Ruckig, Trajectory

from sim.arm_model import Floats, Limits, PathLimits

TICK, LONGEST_TICK, MOST_TICKS = 5e-4, 4e-3, 400_000
VELOCITY_SHARE, ACCELERATION_SHARE, JERK_SHARE = 0.95, 0.95, 0.6
# Of its acceleration and jerk, what a joint may need for the way's bends alone: where the speed is even, and elsewhere.
EVEN, BENT, BENT_JERK, TURNING_JERK = 0.95, 0.6, 0.4, 0.35
SECOND_AVERAGE = 0.6
# The averages are felt a little farther than half their widths, as the nozzle is where the mean is.
WIDER = 1.25
LEAST_PUSH = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class TimeLaw:
    """Arc length in m as a smooth function of time, at rest at both ends.

    ``length`` is met exactly at ``duration``.
    """

    duration: float
    start: float
    end: float
    spline: Any

    def lengths(self, times: Floats) -> Floats:
        """Return the arc length (n,) at times (n,) in s."""
        inside = np.clip(self.spline(np.clip(times, 0.0, self.duration)), self.start, self.end)
        return np.where(times >= self.duration, self.end, np.where(times <= 0.0, self.start, inside))

    def speeds(self, times: Floats) -> Floats:
        """Return the speed along the path (n,) in m/s."""
        return np.maximum(self.spline(times, 1), 0.0)

    def derivatives(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return speed, acceleration and jerk along the path, each (n,)."""
        return self.spline(times, 1), self.spline(times, 2), self.spline(times, 3)


class JointPath:
    """Joints along a path by arc length, with the derivatives that bound the speed.

    ``lengths`` (g,) evenly spaced, ``joints`` (g, dof).
    """

    def __init__(self, lengths: Floats, joints: Floats) -> None:
        self.lengths = lengths
        self.joints = joints
        self.spline = scipy.interpolate.make_interp_spline(lengths, joints, k=5)
        self.first, self.second, self.third = (np.abs(self.spline.derivative(k)(lengths)) for k in (1, 2, 3))

    def ceiling(self, limits: Limits, *, even: bool) -> Floats:
        """Return the speed (g,) in m/s at which no joint's velocity, centripetal acceleration or jerk is too large.

        ``even``: at a speed that does not change; otherwise something is left for changing it.
        """
        velocity, acceleration, jerk = _rows(limits)
        with np.errstate(divide="ignore"):
            by_velocity = (VELOCITY_SHARE * velocity / self.first).min(axis=1)
            by_acceleration = np.sqrt(((EVEN if even else BENT) * acceleration / self.second).min(axis=1))
            by_jerk = np.cbrt(((EVEN if even else BENT_JERK) * jerk / self.third).min(axis=1))
        return np.minimum(np.minimum(by_velocity, by_acceleration), by_jerk)


def joint_move(start: Floats, end: Floats, limits: Limits, share: float) -> tuple[float, Any]:
    """Return the duration in s of a synchronised jerk-limited joint move, and its positions (n, dof) by times."""
    velocity, acceleration, jerk = (share * row for row in _rows(limits))
    trajectory = _ruckig(list(start), list(end), list(velocity), list(acceleration), list(jerk))

    def positions(times: Floats) -> Floats:
        return np.array([trajectory.at_time(min(float(t), trajectory.duration))[0] for t in times])

    return trajectory.duration, positions


def fastest(path: JointPath, limits: Limits, bounds: PathLimits, top: Floats, brake: Floats | float = 1.0) -> TimeLaw:
    """Return the quickest law from rest to rest along a path that stays below ``top`` (g,) m/s and can be accelerated.

    Ramps are sized from what the joints can do at each place; ``brake`` (g,) is a share of that.
    """
    top = np.minimum(top, bounds.speed)
    push, width = ramps(path, limits, bounds, top)
    push = np.maximum(push * brake, LEAST_PUSH)
    lengths = path.lengths
    swept = _sweeps(lengths, top, push)
    widest = (1.0 + SECOND_AVERAGE) * width
    top = np.minimum(top, _widened(lengths, top, swept, WIDER * widest))
    return _smoothed(lengths, _sweeps(lengths, top, push), width)


def ramps(path: JointPath, limits: Limits, bounds: PathLimits, top: Floats) -> tuple[Floats, float]:
    """Return the acceleration (g,) in m/s² that the joints leave at each place, and the time in s it takes to rise.

    ``top`` (g,) in m/s is how fast the nozzle may be there.
    """
    _, acceleration, jerk = _rows(limits)
    speed = top[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        bend = np.minimum(path.second * speed**2, BENT * acceleration)
        left = np.nan_to_num((ACCELERATION_SHARE * acceleration - bend) / path.first, nan=np.inf)
        turning = np.nan_to_num(TURNING_JERK * jerk / (3.0 * path.second * speed), nan=np.inf)
        by_jerk = np.nan_to_num(JERK_SHARE * jerk / path.first, nan=np.inf)
    rise = np.minimum(bounds.jerk, by_jerk.min(axis=1))
    push = np.minimum(np.minimum(bounds.acceleration, left.min(axis=1)), np.sqrt(float(top.max()) * rise))
    width = float((push / rise).max())
    return np.minimum(push, np.maximum(turning.min(axis=1), 0.1 * push)), width


def law_speed(law: TimeLaw, lengths: Floats) -> Floats:
    """Return the speed (g,) in m/s that a law has at each arc length."""
    times = law.spline.x
    at = law.lengths(times)
    rising = np.concatenate([[True], np.diff(at) > 0.0])
    return np.interp(lengths, at[rising], law.speeds(times)[rising])


def time_at(law: TimeLaw, length: float) -> float:
    """Return the time in s at which a law is at an arc length inside it."""
    times = law.spline.x
    at = law.lengths(times)
    row = int(np.clip(np.searchsorted(at, length), 1, len(at) - 1))
    low, high = float(times[row - 1]), float(times[row])
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(law.lengths(np.array([middle]))[0]) < length else (low, middle)
    return 0.5 * (low + high)


def _sweeps(lengths: Floats, top: Floats, push: Floats) -> Floats:
    """Return the highest speed (g,) from rest to rest below ``top`` with acceleration at most ``push`` (g,)."""
    gain = 2.0 * np.diff(lengths) * np.minimum(push[1:], push[:-1])
    reach = np.concatenate([[0.0], np.cumsum(gain)])
    square = top**2
    square[0] = square[-1] = 0.0
    square = np.minimum.accumulate(square - reach) + reach
    square = (np.minimum.accumulate((square + reach)[::-1]))[::-1] - reach
    return np.sqrt(np.maximum(square, 0.0))


def _in_time(lengths: Floats, speeds: Floats, tick: float) -> tuple[Floats, Floats, Floats]:
    """Return ticks (t,) in s, and arc length and speed (t,) at them, for a speed that changes evenly between places."""
    steps = 2.0 * np.diff(lengths) / np.maximum(speeds[1:] + speeds[:-1], 1e-7)
    nodes = np.concatenate([[0.0], np.cumsum(steps)])
    tick = max(tick, float(nodes[-1]) / MOST_TICKS)
    times = np.arange(max(16, math.ceil(float(nodes[-1]) / tick)) + 1, dtype=np.float64) * tick
    cell = np.clip(np.searchsorted(nodes, times, side="right") - 1, 0, len(steps) - 1)
    since = np.minimum(times - nodes[cell], steps[cell])
    slope = (speeds[cell + 1] - speeds[cell]) / steps[cell]
    return times, lengths[cell] + since * (speeds[cell] + 0.5 * slope * since), speeds[cell] + slope * since


def _widened(lengths: Floats, top: Floats, swept: Floats, width: float) -> Floats:
    """Return the ceiling (g,) that is nowhere above ``top`` within half of ``width`` s before and after."""
    times, at, _ = _in_time(lengths, swept, _tick(width))
    tick = float(times[1])
    # The lowest node in a tick counts, however narrow: every node lowers the tick before and after it.
    ceiling = np.interp(at, lengths, top)
    place = np.searchsorted(at, lengths)
    np.minimum.at(ceiling, np.clip(place, 0, len(at) - 1), top)
    np.minimum.at(ceiling, np.clip(place - 1, 0, len(at) - 1), top)
    low = scipy.ndimage.minimum_filter1d(ceiling, 2 * math.ceil(0.5 * width / tick) + 1, mode="nearest")
    rising = np.concatenate([[True], np.diff(at) > 0.0])
    return np.interp(lengths, at[rising], low[rising])


def _smoothed(lengths: Floats, speeds: Floats, width: float) -> TimeLaw:
    """Return a law that follows the speeds, with accelerations that take ``width`` s to rise."""
    lower = _cut_flat(lengths, speeds, (1.0 + SECOND_AVERAGE) * width + 2.0 * _tick(width))
    times, at, _ = _in_time(lengths, lower, _tick(width))
    tick = float(times[1])
    wide = max(3, math.ceil(width / tick)), max(3, math.ceil(SECOND_AVERAGE * width / tick))
    start, end = float(lengths[0]), float(lengths[-1])
    for count in wide:
        padded = np.concatenate([np.full(count - 1, start), at, np.full(count - 1, end)])
        total = np.concatenate([[0.0], np.cumsum(padded - start)])
        at = (total[count:] - total[:-count]) / count + start
    at = np.maximum.accumulate(np.clip(at, start, end))
    at[0], at[-1] = start, end
    times = np.arange(len(at)) * float(times[1])
    return TimeLaw(
        float(times[-1]), start, end, scipy.interpolate.CubicHermiteSpline(times, at, _slopes(at, float(times[1])))
    )


def _cut_flat(lengths: Floats, speeds: Floats, seconds: float) -> Floats:
    """Return the highest speeds (g,) nowhere above ``speeds`` whose every peak lasts at least so many seconds.

    Where all of a stretch may be as fast as h, it is passed at h or in that time, whichever is slower: the tree of
    such stretches (Vuillemin's Cartesian tree, 1980) is gone through from the lowest speed up.
    """
    n = len(speeds)
    left, right = np.full(n, -1), np.full(n, n)
    open_ones: list[int] = []
    for k, speed in enumerate(speeds.tolist()):
        while open_ones and speeds[open_ones[-1]] > speed:
            right[open_ones.pop()] = k
        left[k] = open_ones[-1] if open_ones else -1
        open_ones.append(k)
    padded = np.concatenate([lengths, lengths[-1:]])
    extent = padded[np.minimum(right, n) - 1] - lengths[left + 1]
    found = np.minimum(speeds, extent / seconds)
    for k in np.argsort(speeds, kind="stable").tolist():
        around = [one for one in (left[k], right[k]) if 0 <= one < n]
        if around:
            found[k] = max(found[k], found[max(around, key=lambda one: speeds[one])])
    return np.minimum(found, speeds)


def _slopes(values: Floats, tick: float) -> Floats:
    """Return the derivative (t,) of even samples, to the fourth order inside, at rest at both ends."""
    slopes = np.zeros_like(values)
    slopes[1:-1] = (values[2:] - values[:-2]) / (2.0 * tick)
    slopes[2:-2] = (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12.0 * tick)
    return np.maximum(slopes, 0.0)


def _tick(width: float) -> float:
    return float(np.clip(width / 24.0, TICK, LONGEST_TICK))


def _rows(limits: Limits) -> tuple[Floats, Floats, Floats]:
    return np.array(limits.velocity), np.array(limits.acceleration), np.array(limits.jerk)


def _ruckig(
    start: list[float], end: list[float], velocity: list[float], acceleration: list[float], jerk: list[float]
) -> Any:
    """Solve one move from rest to rest on this machine.

    Never through waypoints, which ruckig would send to its vendor.
    """
    dof = len(start)
    order = InputParameter(dof)
    order.current_position, order.target_position = start, end
    order.max_velocity, order.max_acceleration, order.max_jerk = velocity, acceleration, jerk
    trajectory = Trajectory(dof)
    result = Ruckig(dof).calculate(order, trajectory)
    if result not in {Result.Working, Result.Finished}:
        raise ValueError(f"no jerk-limited move from {start} to {end}: {result}")
    return trajectory
