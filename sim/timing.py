"""From a path to a motion in time: how fast the nozzle goes where, within what the joints can do.

The fastest speed along a path under bounds on joint velocity and acceleration follows Bobrow, Dubowsky and Gibson
(1985): a ceiling at every place, then one sweep forward and one back with the acceleration allowed there. Two short
moving averages in time make the jerk finite (Biagiotti and Melchiorri, Trajectory Planning, section 4.5): they change
when the nozzle is where, never where it is. Ramps on a straight line and joint moves are ruckig's (Berscheid and
Kroeger, 2021), solved offline.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from ruckig import InputParameter, Result, Ruckig, Trajectory
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.ndimage import minimum_filter1d

from sim.arm import Floats, Limits, PathLimits

TICK = 5e-4
VELOCITY_SHARE, CORNER_SHARE, ACCELERATION_SHARE, JERK_SHARE = 0.95, 0.6, 0.95, 0.9
ROUNDS = 16
# What is kept at every tick is kept between the ticks as well.
NEARLY = 0.99
MOST_TICKS = 400_000


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

    ``lengths`` (g,), ``joints`` (g, dof).
    """

    def __init__(self, lengths: Floats, joints: Floats) -> None:
        self.lengths = lengths
        self.spline = make_interp_spline(lengths, joints, k=5)
        self.first, self.second, self.third = (np.abs(self.spline.derivative(k)(lengths)) for k in (1, 2, 3))

    def ceiling(self, limits: Limits) -> Floats:
        """Return the speed (g,) in m/s at which no joint's velocity, centripetal acceleration or jerk is too large."""
        velocity, acceleration, jerk = _rows(limits)
        with np.errstate(divide="ignore"):
            by_velocity = (VELOCITY_SHARE * velocity / self.first).min(axis=1)
            by_acceleration = np.sqrt((CORNER_SHARE * acceleration / self.second).min(axis=1))
            by_jerk = np.cbrt((CORNER_SHARE * jerk / self.third).min(axis=1))
        return np.minimum(np.minimum(by_velocity, by_acceleration), by_jerk)

    def excess(self, law: "TimeLaw | SteadyLaw", limits: Limits, times: Floats) -> tuple[Floats, Floats]:
        """Return the arc length (n,) at times, and by what factor (n,) the speed there is too high for the limits."""
        at = law.lengths(times)
        speed, push, jolt = (value[:, None] for value in law.derivatives(times))
        first, second, third = (self.spline.derivative(k)(at) for k in (1, 2, 3))
        velocity, acceleration, jerk = _rows(limits)
        of_velocity = np.abs(first * speed) / velocity
        of_acceleration = np.abs(second * speed**2 + first * push) / acceleration
        of_jerk = np.abs(third * speed**3 + 3 * second * speed * push + first * jolt) / jerk
        worst = np.maximum(of_velocity.max(axis=1), np.sqrt(of_acceleration.max(axis=1)))
        return at, np.maximum(worst, np.cbrt(of_jerk.max(axis=1)))


def s_curve(start: float, end: float, speed: float, bounds: PathLimits) -> TimeLaw:
    """Return rest to rest along a straight or long way at constant ``speed``, with jerk-limited ramps."""
    trajectory = _ruckig([start], [end], [speed], [bounds.acceleration], [bounds.jerk])
    times = _ticks(trajectory.duration)
    values = np.array([trajectory.at_time(t)[0][0] for t in times])
    return _law(times, values, start, end)


@dataclass(frozen=True, slots=True)
class SteadyLaw:
    """Constant speed from arc length 0 to ``length``, with a ramp of ``ramp`` s before and after it.

    The speed rises as a cubic step, so the ramp's way is half the speed times its time. Answers as a ``TimeLaw``.
    """

    length: float
    speed: float
    ramp: float

    @property
    def start(self) -> float:
        """Arc length in m at time 0."""
        return -0.5 * self.speed * self.ramp

    @property
    def end(self) -> float:
        """Arc length in m at the end."""
        return self.length - self.start

    @property
    def duration(self) -> float:
        """Time in s from rest to rest."""
        return self.length / self.speed + 2.0 * self.ramp

    def lengths(self, times: Floats) -> Floats:
        """Return the arc length (n,) at times (n,) in s."""
        up, down = self._ramps(times)
        steady = np.clip(times - self.ramp, 0.0, self.length / self.speed) * self.speed
        way = up**3 - 0.5 * up**4 - 0.5, 0.5 - (down**3 - 0.5 * down**4)
        return steady + self.speed * self.ramp * (way[0] + way[1])

    def speeds(self, times: Floats) -> Floats:
        """Return the speed along the path (n,) in m/s."""
        return self.derivatives(times)[0]

    def derivatives(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return speed, acceleration and jerk along the path, each (n,)."""
        up, down = self._ramps(times)
        inside = np.minimum(up, down)
        sign = np.where(up <= down, 1.0, -1.0)
        moving = inside < 1.0
        return (
            self.speed * inside**2 * (3.0 - 2.0 * inside),
            sign * self.speed / self.ramp * 6.0 * inside * (1.0 - inside),
            np.where(moving, self.speed / self.ramp**2 * 6.0 * (1.0 - 2.0 * inside), 0.0),
        )

    def _ramps(self, times: Floats) -> tuple[Floats, Floats]:
        """Return how much of the first and of the last ramp is speed, 0..1."""
        return np.clip(times / self.ramp, 0.0, 1.0), np.clip((self.duration - times) / self.ramp, 0.0, 1.0)


def steady(length: float, speed: float, step: float, bounds: PathLimits) -> SteadyLaw:
    """Return constant speed, at most ``speed``, with ramp and path of a whole number of steps each.

    So the first and the last sample on the path are the path's own ends.
    """
    even = length / (math.ceil(length / (speed * step) - 1e-9) * step)
    shortest = max(1.5 * even / bounds.acceleration, math.sqrt(6.0 * even / bounds.jerk))
    return SteadyLaw(length, even, math.ceil(shortest / step) * step)


def joint_move(start: Floats, end: Floats, limits: Limits, share: float) -> tuple[float, Any]:
    """Return the duration in s of a synchronised jerk-limited joint move, and its positions (n, dof) by times."""
    velocity, acceleration, jerk = (share * row for row in _rows(limits))
    trajectory = _ruckig(list(start), list(end), list(velocity), list(acceleration), list(jerk))

    def positions(times: Floats) -> Floats:
        return np.array([trajectory.at_time(min(float(t), trajectory.duration))[0] for t in times])

    return trajectory.duration, positions


def fastest(
    path: JointPath, limits: Limits, bounds: PathLimits, wanted: Floats, ceiling: Floats
) -> tuple[TimeLaw, Floats]:
    """Return the quickest law from rest to rest that nowhere exceeds ``wanted`` (g,) m/s, the ceiling or the limits.

    Also returns the speed (g,) allowed at every place, so that a slow-down can be told with where it is and why.
    """
    acceleration = np.array(limits.acceleration)
    allowed = np.minimum(ceiling, bounds.speed)
    brake = np.ones_like(allowed)
    law = None
    for _ in range(ROUNDS):
        top = np.minimum(wanted, allowed)
        with np.errstate(divide="ignore", invalid="ignore"):
            left = (ACCELERATION_SHARE * acceleration - path.second * top[:, None] ** 2) / path.first
        push = np.minimum(bounds.acceleration, np.where(np.isnan(left), np.inf, left).min(axis=1)) * brake
        law = _smoothed(path.lengths, _sweeps(path.lengths, top, np.maximum(push, 1e-3)), bounds)
        times = _ticks(law.duration)
        at, factor = path.excess(law, limits, times)
        over = factor > NEARLY
        if not over.any():
            break
        cut = np.ones_like(allowed)
        nodes = np.clip(np.searchsorted(path.lengths, at[over]), 0, len(cut) - 1)
        np.minimum.at(cut, nodes, 0.97 / factor[over])
        spread = max(3, round(1e-3 / max(path.lengths[1] - path.lengths[0], 1e-9)))
        cut = minimum_filter1d(cut, 2 * spread + 1)
        allowed, brake = np.minimum(allowed, np.maximum(law_speed(law, path.lengths), 1e-4)) * cut, brake * cut**2
        allowed = np.where(cut < 1.0, allowed, np.minimum(ceiling, bounds.speed))
    assert law is not None
    return law, allowed


def law_speed(law: TimeLaw, lengths: Floats) -> Floats:
    """Return the speed (g,) in m/s that a law has at each arc length."""
    times = _ticks(law.duration)
    at = law.lengths(times)
    rising = np.concatenate([[True], np.diff(at) > 0.0])
    return np.interp(lengths, at[rising], law.speeds(times)[rising])


def _sweeps(lengths: Floats, top: Floats, push: Floats) -> Floats:
    """Return the highest speed (g,) from rest to rest below ``top`` with acceleration at most ``push`` (g,)."""
    gain = 2.0 * np.diff(lengths) * np.minimum(push[1:], push[:-1])
    reach = np.concatenate([[0.0], np.cumsum(gain)])
    square = top**2
    square[0] = square[-1] = 0.0
    square = np.minimum.accumulate(square - reach) + reach
    square = (np.minimum.accumulate((square + reach)[::-1]))[::-1] - reach
    return np.sqrt(np.maximum(square, 0.0))


def _smoothed(lengths: Floats, speeds: Floats, bounds: PathLimits) -> TimeLaw:
    """Return a law that follows the speeds, with finite jerk."""
    steps = 2.0 * np.diff(lengths) / np.maximum(speeds[1:] + speeds[:-1], 1e-6)
    nodes = np.concatenate([[0.0], np.cumsum(steps)])
    times = _ticks(float(nodes[-1]))
    cell = np.clip(np.searchsorted(nodes, times, side="right") - 1, 0, len(steps) - 1)
    since = times - nodes[cell]
    slope = (speeds[cell + 1] - speeds[cell]) / steps[cell]
    values = lengths[cell] + since * (speeds[cell] + 0.5 * slope * since)
    tick = times[1] - times[0]
    for share in (1.0, 0.6):
        width = max(3, round(share * bounds.acceleration / bounds.jerk / tick))
        padded = np.concatenate([np.full(width - 1, lengths[0]), values, np.full(width - 1, lengths[-1])])
        total = np.concatenate([[0.0], np.cumsum(padded - lengths[0])])
        values = (total[width:] - total[:-width]) / width + lengths[0]
    values = np.maximum.accumulate(np.clip(values, lengths[0], lengths[-1]))
    values[-1] = lengths[-1]
    return _law(np.arange(len(values)) * tick, values, float(lengths[0]), float(lengths[-1]))


def _law(times: Floats, values: Floats, start: float, end: float) -> TimeLaw:
    rest = [(1, 0.0), (2, 0.0)]
    spline = (
        make_interp_spline(times, values, k=5, bc_type=(rest, rest))
        if len(times) > 8
        else CubicSpline(times, values, bc_type="clamped")
    )
    return TimeLaw(float(times[-1]), start, end, spline)


def _ticks(duration: float) -> Floats:
    count = int(np.clip(np.ceil(duration / TICK), 16, MOST_TICKS))
    return np.linspace(0.0, duration, count + 1, dtype=np.float64)


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
