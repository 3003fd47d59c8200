"""The pieces of a plan.

A joint move, a straight line, the learned path. Each starts and ends at rest, on whole time steps.
"""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from sim import checks
from sim.arm import ArmModel, Floats, PathLimits, Stage
from sim.checks import Finding, MotionRefused
from sim.holding import Holding
from sim.kinematics import kinematics
from sim.laws import law_for
from sim.path import ToolPath
from sim.timing import SteadyLaw, TimeLaw, joint_move, s_curve

if TYPE_CHECKING:
    from sim.plan import MotionOrder

TRAVEL_SHARE = 0.4
LINE_SPEED = 0.1
LINE_ACCELERATION, LINE_JERK = 1.0, 50.0
LINE_TRIALS, LINE_SHARE = 4, 0.9
NEAR = 1e-9


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
    stage: Stage, start: Floats, end: Floats, order: "MotionOrder", arm: ArmModel, rotation: Floats
) -> Way | None:  # fmt: skip
    """Return the straight line between two nozzle positions with one rotation (3, 3), None if they are the same."""
    length = float(np.linalg.norm(end - start))
    if length < 1e-9:
        return None
    speed = min(LINE_SPEED, arm.path_limits.speed)
    law = s_curve(0.0, length, speed, PathLimits(speed, LINE_ACCELERATION, LINE_JERK, ""))
    slower = 1.0 / _rate(order)

    def in_time() -> Way:
        steps = max(1, math.ceil(law.duration * slower / order.time_step - 1e-9))
        part = law.lengths(np.arange(steps + 1, dtype=np.float64) * (law.duration / steps)) / length
        points = start + part[:, None] * (end - start)
        solved = kinematics(arm).inverse(points, rotation)
        none = np.full(len(points), math.nan)
        found = checks.check_reach(arm, points, solved, none, none)
        if found:
            raise MotionRefused(found)
        return Way(stage, solved.joints, points, none)

    way = in_time()
    for _ in range(LINE_TRIALS):
        excess = _excess(way.joints, arm, order.time_step)
        if excess <= LINE_SHARE:
            break
        slower *= 1.05 * excess / LINE_SHARE
        way = in_time()
    return way


def _excess(joints: Floats, arm: ArmModel, step: float) -> float:
    """Return by what factor joints (n, dof), one row a step, are too fast for an arm's limits."""
    if len(joints) < 3:
        return 0.0
    rates = np.diff(joints, axis=0) / step
    pushes = np.diff(rates, axis=0) / step
    by_speed = float((np.abs(rates) / np.array(arm.limits.velocity)).max())
    return max(by_speed, math.sqrt(float((np.abs(pushes) / np.array(arm.limits.acceleration)).max())))


def path_way(path: ToolPath, order: "MotionOrder", arm: ArmModel, held: Holding) -> Way:
    """Return the learned path in time; with a straight run-in and run-out if the speed is to be constant."""
    rate = _rate(order)
    law, told = law_for(path, order, arm, held, order.time_step * rate)
    steps = max(1, math.ceil(law.duration / rate / order.time_step - 1e-9))
    stretch = law.duration / (steps * order.time_step)
    clock = np.arange(steps + 1, dtype=np.float64) * (law.duration / steps)
    at = law.lengths(clock)
    tool = path.points(at)
    rotations = held.at_lengths(at)
    joints = kinematics(arm).inverse(tool, rotations).joints
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
    report = _held_report(path, held, at[first : last + 1], order.time_step) | {
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


def _held_report(path: ToolPath, held: Holding, at: Floats, step: float) -> dict[str, float]:
    """Return how the nozzle is held where that was learned: tilt, rate of turning, and the error between samples.

    Between two samples an arm turns evenly from one orientation to the next; the error in rad is the angle from that
    to the exact learned orientation a quarter, half and three quarters on.
    """
    if not held.as_shown or len(at) < 2:
        return {}
    phases = path.phases_at(at)
    turns = Rotation.from_matrix(held.at_phases(phases))
    between = (turns[:-1].inv() * turns[1:]).as_rotvec()
    away: list[Floats] = []
    for part in (0.25, 0.5, 0.75):
        exact = Rotation.from_matrix(held.at_phases(path.phases_at(at[:-1] + part * np.diff(at))))
        away.append(((turns[:-1] * Rotation.from_rotvec(part * between)).inv() * exact).magnitude())
    off = np.concatenate(away)
    return {
        "orientation_error_rms": float(np.sqrt(np.mean(off**2))),
        "orientation_error_max": float(off.max()),
        "turning_max": float(np.sqrt((between**2).sum(axis=1)).max()) / step,
        "tilt_max": float(held.tilts(phases).max()),
    }


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
