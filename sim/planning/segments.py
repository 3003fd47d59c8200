"""The pieces of a plan.

A joint move, a straight line, the learned path. Each starts and ends at rest, on whole time steps.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from sim.arm_model import ArmModel, Floats, PathLimits, Stage
from sim.findings import Finding, MotionRefused
from sim.order import MotionOrder
from sim.planning import checks
from sim.planning.kinematics import kinematics
from sim.planning.path import ToolPath
from sim.planning.postures import Posture
from sim.planning.time_scaling import Followed, clock_of, law_for, time_at
from sim.planning.timing import JointPath, TimeLaw, fastest, joint_move
from sim.planning.tool_orientation import Holding

TRAVEL_SHARE = 0.4
LINE_SPEED, LINE_STRIDE, LINE_FEWEST = 0.1, 1e-3, 16
LINE_ACCELERATION, LINE_JERK = 1.0, 50.0
# A piece has at least so many steps: fewer tell nothing of its acceleration.
FEWEST_STEPS = 6
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
    law: TimeLaw | None = None
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
        assert self.path is not None
        begins = time_at(self.law, 0.0) if self.law.start < 0.0 else 0.0
        return (time_at(self.law, length) - begins) / self.stretch


def joint_way(places: list[Floats], order: MotionOrder, arm: ArmModel, slower: float = 1.0) -> Way | None:
    """Return the jerk-limited joint moves from each place (dof,) to the next, None if they are all the same."""
    pieces: list[Floats] = []
    for start, end in pairwise(places):
        if np.abs(end - start).max() < 1e-9:
            continue
        duration, positions = joint_move(start, end, arm.limits, TRAVEL_SHARE)
        tool = kinematics(arm).forward(positions(np.linspace(0.0, duration, 101)))[0]
        fastest_tool = np.sqrt((np.diff(tool, axis=0) ** 2).sum(axis=1)).max() / (duration / 100)
        longer = max(1.0, fastest_tool / arm.path_limits.speed) * slower / _rate(order)
        steps = max(FEWEST_STEPS, math.ceil(duration * longer / order.time_step - 1e-9))
        joints = positions(np.arange(steps + 1, dtype=np.float64) * (duration / steps))
        joints[0], joints[-1] = start, end
        pieces.append(joints if not pieces else joints[1:])
    if not pieces:
        return None
    whole = np.concatenate(pieces)
    return Way("travel", whole, kinematics(arm).forward(whole)[0], np.full(len(whole), math.nan))


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A straight line of the nozzle with one rotation (3, 3), as an arm follows it from joints (dof,) at its start."""

    start: Floats
    way: Floats
    rotation: Floats
    arm: ArmModel
    joints: JointPath

    @classmethod
    def of(cls, start: Floats, end: Floats, rotation: Floats, joints: Floats, arm: ArmModel) -> "Line | None":
        """Follow the line between nozzle positions (3,), step by step; None if they are the same.

        Raises ``MotionRefused`` where the arm cannot.
        """
        length = float(np.sqrt(((end - start) ** 2).sum()))
        if length < 1e-9:
            return None
        count = max(LINE_FEWEST, math.ceil(length / LINE_STRIDE))
        points = start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)
        solved = kinematics(arm).along(points, rotation, joints)
        none = np.full(len(points), math.nan)
        found = checks.check_reach(arm, points, solved, none, none)
        found = found or checks.check_posture(arm, solved.joints, none, none)
        if found:
            raise MotionRefused(found)
        return cls(
            start, (end - start) / length, rotation, arm, JointPath(np.linspace(0.0, length, count + 1), solved.joints)
        )

    @property
    def end(self) -> Floats:
        """Return the joints (dof,) at its end."""
        return self.joints.joints[-1]

    def in_time(self, stage: Stage, order: MotionOrder, slower: float = 1.0, *, backwards: bool = False) -> Way:
        """Return the line in time, from rest to rest."""
        bounds = PathLimits(
            min(LINE_SPEED, self.arm.path_limits.speed),
            min(LINE_ACCELERATION, self.arm.path_limits.acceleration),
            min(LINE_JERK, self.arm.path_limits.jerk),
            "",
        )
        top = np.full(len(self.joints.lengths), bounds.speed)
        law = fastest(
            self.joints, self.arm.limits, bounds, np.minimum(top, self.joints.ceiling(self.arm.limits, even=False))
        )
        steps = max(FEWEST_STEPS, math.ceil(law.duration * slower / _rate(order) / order.time_step - 1e-9))
        at = law.lengths(np.arange(steps + 1, dtype=np.float64) * (law.duration / steps))
        points = self.start + at[:, None] * self.way
        joints = kinematics(self.arm).refine(points, self.rotation, self.joints.spline(at)).joints
        turn = slice(None, None, -1 if backwards else 1)
        return Way(stage, joints[turn].copy(), points[turn].copy(), np.full(len(at), math.nan))


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """The learned path with its time law: ``law`` at full pace, ``told`` what had to be slowed for it."""

    followed: Followed
    law: TimeLaw
    told: tuple[Finding, ...]

    @classmethod
    def of(cls, path: ToolPath, order: MotionOrder, arm: ArmModel, held: Holding, posture: Posture | None) -> "Learned":
        """Find the law that an order asks for. Raises ``MotionRefused``."""
        followed, law, told = law_for(path, order, arm, held, posture)
        return cls(followed, law, (*told, *followed.told))

    def ends(self) -> tuple[tuple[Floats, Floats, Floats], tuple[Floats, Floats, Floats]]:
        """Return nozzle (3,), rotation (3, 3) and joints (dof,) at the very first and the very last place."""
        at = np.array([self.law.start, self.law.end])
        solved, points = self.followed.at(at)
        rotations = np.broadcast_to(self.followed.held.at_lengths(at), (2, 3, 3))
        return (points[0], rotations[0], solved.joints[0]), (points[1], rotations[1], solved.joints[1])


def path_way(learned: Learned, order: MotionOrder, slower: float = 1.0) -> Way:
    """Return the learned path in time; with a straight run-in and run-out if the speed is to be constant."""
    followed, law = learned.followed, learned.law
    path, held = followed.path, followed.held
    clock = clock_of(law, path.length, order.time_step * _rate(order) / slower)
    stretch = clock.stretch * _rate(order) / slower
    at = law.lengths(clock.times)
    first, last = clock.first, clock.last
    at[first], at[last] = 0.0, path.length
    solved, tool = followed.at(at)
    inside = np.arange(len(at))
    inside = (inside >= first) & (inside <= last)
    row_phases = np.where(inside, path.phases_at(at), math.nan)
    speeds = law.speeds(clock.times)[first : last + 1] * stretch
    error, chord = _path_error(path, at[first : last + 1], tool[first : last + 1])
    longest = order.time_step * math.sqrt(order.chord_tolerance / chord) if chord > 0.0 else math.inf
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
    return Way(
        "dispense", solved.joints, tool, row_phases, path, law, stretch, (first, last), error, learned.told, report
    )


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


def _rate(order: MotionOrder) -> float:
    return order.speed_override * order.speed_fraction
