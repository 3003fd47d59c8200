"""The pieces of a plan.

A joint move, a straight line, the learned path. Each starts and ends at rest, on whole time steps.
"""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sim import checks
from sim.arm import ArmModel, Floats, PathLimits, Stage
from sim.checks import Finding, MotionRefused
from sim.kinematics import kinematics
from sim.path import ToolPath
from sim.timing import JointPath, SteadyLaw, TimeLaw, fastest, joint_move, law_speed, s_curve, steady

if TYPE_CHECKING:
    from sim.plan import MotionOrder

TRAVEL_SHARE = 0.4
LINE_SPEED = 0.1
LINE_ACCELERATION, LINE_JERK = 1.0, 50.0
STEADY_SHARE = 0.98
NEAR = 1e-9
LATER = 1.1


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """Joints (n, dof), nozzle (n, 3) and phase (n,) of one piece, one row a time step.

    ``law`` and ``stretch`` belong to the learned path: arc length = law(time * stretch); ``marks`` are the rows at
    which the learned path itself begins and ends, between run-in and run-out.
    """

    stage: Stage
    joints: Floats
    tool: Floats
    phases: Floats
    path: ToolPath | None = None
    law: TimeLaw | SteadyLaw | None = None
    stretch: float = 1.0
    marks: tuple[int, int] = (0, 0)
    path_error: tuple[float, float] = (0.0, 0.0)
    findings: tuple[Finding, ...] = ()
    report: dict[str, float] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """Number of time steps this piece takes."""
        return len(self.joints) - 1

    @classmethod
    def still(cls, stage: Stage, joints: Floats, arm: ArmModel) -> "Way":
        """Return a piece of one sample, standing."""
        return cls(stage, joints[None], kinematics(arm).forward(joints[None])[0], np.array([math.nan]))

    def split(self) -> tuple["Way", ...]:
        """Return run-in, learned path and run-out as pieces of their own, leaving out what is empty."""
        first, last = self.marks
        cuts: tuple[tuple[Stage, int, int], ...] = (
            ("approach", 0, first),
            ("dispense", first, last),
            ("retract", last, self.steps),
        )
        return tuple(
            Way(stage, self.joints[a : b + 1], self.tool[a : b + 1], self.phases[a : b + 1])
            for stage, a, b in cuts
            if b > a
        )

    def time_of(self, length: float) -> float:
        """Return the time in s since the learned path's first sample at which the nozzle is at an arc length."""
        assert self.law is not None
        grid = np.linspace(0.0, self.law.duration, 20_001)
        at = self.law.lengths(grid)
        step = self.report["time_step"]
        first = self.marks[0] * step
        return float(np.interp(length, at, grid)) / self.stretch - first


def tool_rotation(arm: ArmModel, part: Floats) -> Floats:
    """Return the nozzle's rotation in the base frame: against the part's z axis, turned about it as at home.

    A round nozzle may turn about its own axis as it likes; staying as at home keeps the wrist away from its limits
    whichever way the part is turned.
    """
    z = -part[:, 2]
    x = kinematics(arm).seed_rotation[:, 0]
    x = x - z * (x @ z)
    if np.linalg.norm(x) < 1e-6:
        x = part[:, 0]
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def joint_way(start: Floats, end: Floats, order: "MotionOrder", arm: ArmModel) -> Way | None:
    """Return the jerk-limited joint move between two positions, None if they are the same."""
    if np.abs(end - start).max() < 1e-9:
        return None
    duration, positions = joint_move(start, end, arm.limits, TRAVEL_SHARE)
    grid = positions(np.linspace(0.0, duration, 101))
    tool = kinematics(arm).forward(grid)[0]
    fastest_tool = np.sqrt((np.diff(tool, axis=0) ** 2).sum(axis=1)).max() / (duration / 100)
    slower = max(1.0, fastest_tool / arm.path_limits.speed) / _rate(order)
    steps = max(1, math.ceil(duration * slower / order.time_step - 1e-9))
    joints = positions(np.arange(steps + 1, dtype=np.float64) * (duration / steps))
    joints[0], joints[-1] = start, end
    return Way("travel", joints, kinematics(arm).forward(joints)[0], np.full(steps + 1, math.nan))


def line_way(
    stage: Stage, start: Floats, end: Floats, order: "MotionOrder", arm: ArmModel, rotation: Floats,
    start_joints: Floats | None = None,
) -> Way | None:  # fmt: skip
    """Return the straight line between two nozzle positions, None if they are the same."""
    length = float(np.linalg.norm(end - start))
    if length < 1e-9:
        return None
    speed = min(LINE_SPEED, arm.path_limits.speed)
    law = s_curve(0.0, length, speed, PathLimits(speed, LINE_ACCELERATION, LINE_JERK, ""))
    steps = max(1, math.ceil(law.duration / _rate(order) / order.time_step - 1e-9))
    part = law.lengths(np.arange(steps + 1, dtype=np.float64) * (law.duration / steps)) / length
    points = start + part[:, None] * (end - start)
    solved = kinematics(arm).inverse(points, rotation)
    none = np.full(len(points), math.nan)
    found = checks.check_reach(arm, points, solved, none, none)
    if found:
        raise MotionRefused(found)
    return Way(stage, solved.joints, points, none)


def path_way(path: ToolPath, order: "MotionOrder", arm: ArmModel, rotation: Floats) -> Way:
    """Return the learned path in time; with a straight run-in and run-out if the speed is to be constant."""
    bounds = arm.path_limits
    constant = order.timing == "constant_speed"
    rate = _rate(order)
    if constant and order.speed > bounds.speed:
        most = bounds.speed * 1e3
        text = f"speed is {order.speed * 1e3:.0f} mm/s: the nozzle of {arm.name} may go {most:.0f} mm/s at most"
        raise MotionRefused([Finding("SpeedLimit", 0.0, 0.0, order.speed * 1e3 - most, "mm/s", text)])
    even = steady(path.length, order.speed, order.time_step * rate, bounds) if constant else None
    extra = -even.start if even is not None else 0.0
    count = len(path.lengths) + 2 * math.ceil(extra / max(path.length / (len(path.lengths) - 1), 1e-9))
    lengths = np.linspace(-extra, path.length + extra, count)
    points, phases = path.points(lengths), path.phases_at(lengths)
    shown = path.motion.times_at(phases) * ((order.duration or path.motion.duration) / path.motion.duration)
    solved = kinematics(arm).inverse(points, rotation)
    found = checks.check_reach(arm, points, solved, shown, phases)
    if found:
        raise MotionRefused(found)
    joint_path = JointPath(lengths, solved.joints)
    ceiling = _ceiling(path, joint_path, lengths, order, arm)
    if even is not None:
        law, told = _constant(path, joint_path, even, lengths, phases, ceiling, order, arm)
    else:
        law, told = _law(path, joint_path, lengths, phases, ceiling, order, arm)
    steps = max(1, math.ceil(law.duration / rate / order.time_step - 1e-9))
    stretch = law.duration / (steps * order.time_step)
    clock = np.arange(steps + 1, dtype=np.float64) * (law.duration / steps)
    at = law.lengths(clock)
    tool = path.points(at)
    joints = kinematics(arm).inverse(tool, rotation).joints
    inside = (at >= -NEAR) & (at <= path.length + NEAR)
    first, last = int(np.argmax(inside)), int(len(at) - 1 - np.argmax(inside[::-1]))
    row_phases = np.where(inside, path.phases_at(at), math.nan)
    speeds = law.speeds(clock)[first : last + 1] * stretch
    error, chord = _path_error(path, at[first : last + 1], tool[first : last + 1])
    longest = order.time_step * math.sqrt(order.chord_tolerance / chord) if chord > 0.0 else math.inf
    if chord > order.chord_tolerance * 1.02:
        text = (
            f"time step is {order.time_step * 1e3:.3g} ms: straight lines between the samples cut the path by "
            f"{chord * 1e3:.3f} mm where {order.chord_tolerance * 1e3:.3f} mm are allowed: at most "
            f"{longest * 1e3:.2g} ms, or go slower"
        )
        raise MotionRefused([Finding("ParameterInvalid", math.nan, math.nan, chord * 1e3, "mm", text)])
    report = {
        "length": path.length,
        "path_duration": (last - first) * order.time_step,
        "speed_mean": float(speeds.mean()),
        "speed_min": float(speeds.min()),
        "speed_max": float(speeds.max()),
        "chord_error": chord,
        "longest_time_step": min(longest, checks.LONGEST_STEP),
        "time_step": order.time_step,
    }
    return Way("dispense", joints, tool, row_phases, path, law, stretch, (first, last), error, tuple(told), report)


def _law(
    path: ToolPath, joint_path: JointPath, lengths: Floats, phases: Floats, ceiling: Floats, order: "MotionOrder",
    arm: ArmModel,
) -> tuple[TimeLaw | SteadyLaw, list[Finding]]:  # fmt: skip
    """Return the time law the order asks for, and what had to be slowed for it to be possible."""
    bounds, limits = arm.path_limits, arm.limits
    if order.timing == "time_optimal":
        return fastest(joint_path, limits, bounds, np.full(len(lengths), math.inf), ceiling)[0], []
    shown = path.motion.times_at(phases)
    pace = np.diff(lengths) / np.maximum(np.diff(shown), 1e-9)
    natural = np.minimum(np.concatenate([[pace[0]], pace]), np.concatenate([pace, [pace[-1]]]))
    wanted = order.duration or (path.length / order.speed if order.speed > 0.0 else float(shown[-1]))
    scale = float(shown[-1]) / wanted
    law, _ = fastest(joint_path, limits, bounds, natural * scale, ceiling)
    for _ in range(12):
        if abs(law.duration - wanted) < 1e-3 * wanted:
            break
        better = scale * law.duration / wanted
        if better > 50 * scale or better < 1e-3:
            break
        trial, _ = fastest(joint_path, limits, bounds, natural * better, ceiling)
        if trial.duration > law.duration - 1e-6 and law.duration > wanted:
            break
        scale, law = better, trial
    found: list[Finding] = []
    if law.duration > LATER * wanted and (order.duration or order.speed):
        text = f"the path cannot be run in {wanted:.3g} s: {arm.name} needs at least {law.duration:.3g} s"
        raise MotionRefused([Finding("SpeedLimit", math.nan, math.nan, law.duration - wanted, "s", text)])
    slow = np.minimum(ceiling, bounds.speed) < 0.99 * natural * scale
    if slow.any():
        i = int(np.argmax(np.where(slow, natural * scale / np.minimum(ceiling, bounds.speed), 0.0)))
        text = (
            f"slowed to {ceiling[i] * 1e3:.0f} mm/s at {100 * phases[i]:.1f} % of the path, where the people went "
            f"{natural[i] * scale * 1e3:.0f} mm/s: {arm.name} cannot turn faster there"
        )
        found.append(
            Finding("SpeedLimit", float(shown[i]), float(phases[i]), float(ceiling[i]) * 1e3, "mm/s", text, fatal=False)
        )
    return law, found


def _constant(
    path: ToolPath, joint_path: JointPath, law: SteadyLaw, lengths: Floats, phases: Floats, ceiling: Floats,
    order: "MotionOrder", arm: ArmModel,
) -> tuple[TimeLaw | SteadyLaw, list[Finding]]:  # fmt: skip
    """Return constant speed over the whole path.

    Refuse it, or slow down in corners and tell, where it is impossible.
    """
    bounds = arm.path_limits
    grid = np.linspace(0.0, law.duration, int(np.clip(law.duration / 5e-4, 200, 200_000)))
    at, factor = joint_path.excess(law, arm.limits, grid)
    highest = STEADY_SHARE * order.speed / np.maximum(factor, 1e-9)
    inside = (at >= 0.0) & (at <= path.length)
    i = int(np.argmin(np.where(inside, highest, math.inf)))
    if highest[i] >= order.speed and factor.max() <= 1.0 and not sharp_corners(path, lengths):
        return law, []
    where = float(np.interp(at[i], lengths, phases))
    time = float(grid[i] - grid[int(np.argmax(inside))])
    allowed = min(float(highest[i]), order.speed, *(float(ceiling[k]) for k, _ in sharp_corners(path, lengths)))
    short = (order.speed - allowed) * 1e3
    what = f"at {time:.2f} s, {100 * where:.1f} % of the path, a corner allows {allowed * 1e3:.0f} mm/s"
    if order.corners == "refuse":
        text = (
            f"constant {order.speed * 1e3:.0f} mm/s is impossible: {what}: lower the speed, give a blend radius, "
            "or allow slowing in corners"
        )
        raise MotionRefused([Finding("SpeedLimit", time, where, short, "mm/s", text)])
    slower, _ = fastest(joint_path, arm.limits, bounds, np.full(len(lengths), order.speed), ceiling)
    lowest = float(law_speed(slower, lengths)[(lengths >= 0.0) & (lengths <= path.length)].min())
    text = f"slowed from {order.speed * 1e3:.0f} to {lowest * 1e3:.0f} mm/s in corners: {what}"
    return slower, [Finding("SpeedLimit", time, where, short, "mm/s", text, fatal=False)]


def _ceiling(path: ToolPath, joint_path: JointPath, lengths: Floats, order: "MotionOrder", arm: ArmModel) -> Floats:
    """Return the speed (g,) in m/s that joints, time step and sharp corners allow at each arc length."""
    ceiling = joint_path.ceiling(arm.limits)
    step = order.time_step * _rate(order)
    with np.errstate(divide="ignore"):
        by_chord = np.sqrt(8.0 * order.chord_tolerance / curvature(path, lengths)) / step
    if order.timing != "constant_speed" or order.corners == "slow":
        ceiling = np.minimum(ceiling, 0.95 * by_chord)
    for i, angle in sharp_corners(path, lengths):
        turn = np.abs(joint_path.first[i]) * angle
        with np.errstate(divide="ignore"):
            ceiling[i] = min(ceiling[i], float((0.25 * np.array(arm.limits.acceleration) / turn).min()) * step)
    return ceiling


def curvature(path: ToolPath, lengths: Floats) -> Floats:
    """Return the curvature (g,) in 1/m of the nozzle's way."""
    points = path.points(lengths)
    first = np.gradient(points, lengths, axis=0)
    second = np.gradient(first, lengths, axis=0)
    return np.sqrt((np.cross(first, second) ** 2).sum(axis=1))


def sharp_corners(path: ToolPath, lengths: Floats) -> list[tuple[int, float]]:
    """Return grid indices at which the path has a corner without radius, and the angle in rad it turns there."""
    points = path.points(lengths)
    way = np.diff(points, axis=0)
    way /= np.maximum(np.sqrt((way**2).sum(axis=1, keepdims=True)), 1e-15)
    turn = np.arccos(np.clip((way[1:] * way[:-1]).sum(axis=1), -1.0, 1.0))
    spacing = float(lengths[1] - lengths[0])
    found: list[tuple[int, float]] = []
    for i in np.flatnonzero(turn > 0.1) + 1:
        fine = path.points(np.linspace(lengths[i] - spacing, lengths[i] + spacing, 65))
        short = np.diff(fine, axis=0)
        short /= np.maximum(np.sqrt((short**2).sum(axis=1, keepdims=True)), 1e-15)
        sudden = np.arccos(np.clip((short[2:] * short[:-2]).sum(axis=1), -1.0, 1.0)).max()
        if sudden > 0.5 * turn[i - 1]:
            found.append((int(i), float(sudden)))
    return found


def _path_error(path: ToolPath, at: Floats, tool: Floats) -> tuple[tuple[float, float], float]:
    """Return RMS and largest distance of the exact learned path from the chords, and how much chords cut the way."""
    inner = np.concatenate([at[:-1] + part * np.diff(at) for part in (0.25, 0.5, 0.75)])
    start = np.concatenate([tool[:-1]] * 3)
    chord = np.concatenate([np.diff(tool, axis=0)] * 3)
    size = np.maximum((chord**2).sum(axis=1), 1e-30)

    def away(points: Floats) -> Floats:
        part = np.clip(((points - start) * chord).sum(axis=1) / size, 0.0, 1.0)
        return np.sqrt(((points - start - part[:, None] * chord) ** 2).sum(axis=1))

    cut = away(path.points(inner))
    exact = np.concatenate(
        [away(path.exact(path.phases_at(inner))), np.sqrt(((path.exact(path.phases_at(at)) - tool) ** 2).sum(axis=1))]
    )
    return (float(np.sqrt(np.mean(exact**2))), float(exact.max())), float(cut.max())


def _rate(order: "MotionOrder") -> float:
    return order.speed_override * order.speed_fraction
