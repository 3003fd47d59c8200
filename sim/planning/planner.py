"""From a learned motion and an order to a plan: in which posture, by which way there and back, and how fast."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from models.motion import Motion
from sim.arm_model import ArmModel, Floats, Pose
from sim.findings import Finding, MotionRefused
from sim.order import MotionOrder
from sim.plan import MotionPlan, Segment, ValveEvent, valve_open
from sim.planning import checks
from sim.planning.clearance import Box, Cell, check_clearance, part_box
from sim.planning.kinematics import kinematics
from sim.planning.path import ToolPath
from sim.planning.postures import Poses, Posture, other_postures
from sim.planning.rates import Rates, eased, rates, spline_velocities
from sim.planning.segments import Learned, Line, Way, joint_way, path_way
from sim.planning.tool_orientation import Holding, quaternions
from sim.planning.travel import free_way

LIFT_HOME = 0.05
# What another posture of the arm may mend.
OF_THE_POSTURE = frozenset({"NoIkSolution", "JointLimit", "Singularity", "Collision", "WorkspaceLimit"})
# A piece that still needs more than a joint may do is run so much slower than it needs, and looked at again.
SLOWED, MENDINGS = 1.01, 12
CHORD_SPARE = 1.02
LINE_POSES = 51
Piece = Callable[[float], Way | None]
"""Makes one piece of a plan, run so many times slower than it could be."""


def plan_motion(
    motion: Motion,
    order: MotionOrder,
    arm: ArmModel,
    *,
    skill_digest: str = "",
    recipe_id: str = "",
    cell: Cell | None = None,
) -> MotionPlan:
    """Return the plan that runs a learned motion once, from home to home.

    The skill is evaluated by regression at the phase of every time step. ``cell`` is what surrounds the arm; without
    one there is the table it stands on, and the part. Raises ``MotionRefused`` with everything found.
    """
    found = checks.check_order(order) or checks.check_hull(arm)
    if found:
        raise MotionRefused(found)
    frame = _unit_frame(order.frame)
    path = ToolPath(motion, frame, order.standoff, order.blend_radius)
    if not np.isfinite(path.length) or path.length < 1e-5:
        raise MotionRefused([checks.invalid("path", f"{path.length * 1e3:.3f} mm long", "longer than 0.01 mm")])
    held = Holding(path, arm, order.nozzle_turn)
    surroundings = cell or Cell()
    part = part_box(path.points(path.lengths), frame, surroundings.table_height, order.plate)
    boxes = (surroundings.table(), part, *surroundings.fixtures)
    found = _home_blocked(arm, boxes)
    if found:
        raise MotionRefused(found)
    first: MotionRefused | None = None
    too_fast: MotionRefused | None = None
    for posture in _postures(path, order, arm, held, boxes):
        try:
            return _planned(path, order, arm, held, posture, (skill_digest, recipe_id), boxes)
        except MotionRefused as refused:
            first = first or refused
            if first.failure not in OF_THE_POSTURE:
                raise
            if refused.failure == "SpeedLimit":
                too_fast = too_fast or refused
    assert first is not None
    # A posture that could do it slower says more than one that cannot do it at all.
    raise too_fast or first


def _home_blocked(arm: ArmModel, boxes: tuple[Box, ...]) -> list[Finding]:
    """Return what touches an arm where every run starts: no posture and no way round can mend that."""
    none = np.array([math.nan])
    return check_clearance(arm, np.array([arm.home]), none, none, boxes, off_path="at home")[0]


def _postures(
    path: ToolPath, order: MotionOrder, arm: ArmModel, held: Holding, boxes: tuple[Box, ...]
) -> Iterator[Posture | None]:
    """Yield the postures to try: near home first (None), any other only when that one was refused."""
    yield None
    points = path.points(path.lengths)
    rotations = np.broadcast_to(held.at_lengths(path.lengths), (len(points), 3, 3))
    up = path.rotation[:, 2]
    down = points[0] + np.linspace(order.approach_height, 0.0, LINE_POSES)[:-1, None] * up
    lift = points[-1] + np.linspace(0.0, order.retract_height, LINE_POSES)[1:, None] * up
    first, last = len(down), len(down) + len(points) - 1
    turned = [np.repeat(rotations[[k]], LINE_POSES - 1, axis=0) for k in (0, -1)]
    poses = Poses(
        np.concatenate([down, points, lift]),
        np.concatenate([turned[0], rotations, turned[1]]),
        first,
        last,
        path.lengths,
    )
    yield from other_postures(arm, poses, boxes)


def _planned(
    path: ToolPath,
    order: MotionOrder,
    arm: ArmModel,
    held: Holding,
    posture: Posture | None,
    names: tuple[str, str],
    boxes: tuple[Box, ...],
) -> MotionPlan:
    """Return the plan that runs a path in one posture."""
    up = path.rotation[:, 2]
    home = np.array(arm.home)
    learned = Learned.of(path, order, arm, held, posture)
    (start, start_held, begins), (end, end_held, ends) = learned.ends()
    down = Line.of(start, start + order.approach_height * up, start_held, begins, arm)
    lift = Line.of(end, end + order.retract_height * up, end_held, ends, arm)
    there = free_way(home, down.end if down else begins, arm, boxes)
    back = free_way(lift.end if lift else ends, home, arm, boxes)
    pieces: list[Piece] = [
        lambda slower: joint_way(there, order, arm, slower),
        lambda slower: down.in_time("approach", order, slower, backwards=True) if down else None,
        lambda slower: path_way(learned, order, slower),
        lambda slower: lift.in_time("retract", order, slower) if lift else None,
        lambda slower: joint_way(back, order, arm, slower),
    ]
    return _sealed(_slowed(pieces, order, arm), order, arm, *names, boxes)


def plan_home(
    arm: ArmModel, joints: Floats | tuple[float, ...], *, speed_fraction: float = 0.5, cell: Cell | None = None
) -> MotionPlan:
    """Return the plan that brings an arm home from where it stands at rest: straight up first, then in joint space.

    Raises ``MotionRefused`` if the way is not free or the joints are out of range.
    """
    order = MotionOrder(speed_fraction=speed_fraction)
    here = np.asarray(joints, dtype=float)
    none = np.array([math.nan])
    if not np.isfinite(here).all() or len(here) != arm.dof:
        raise MotionRefused([checks.invalid("joints", list(here), f"{arm.dof} finite numbers")])
    found = checks.check_hull(arm) or checks.check_joints(arm, here[None], none, none)
    if found:
        raise MotionRefused(found)
    surroundings = cell or Cell()
    boxes = (surroundings.table(), *surroundings.fixtures)
    home = np.array(arm.home)
    lift = _lift(arm, here)
    back = free_way(lift.end if lift else here, home, arm, boxes)
    pieces: list[Piece] = [
        lambda slower: lift.in_time("retract", order, slower) if lift else None,
        lambda slower: joint_way(back, order, arm, slower),
    ]
    joined = _slowed(pieces, order, arm)
    return _sealed(joined, order, arm, "", "", boxes)


def _lift(arm: ArmModel, here: Floats) -> Line | None:
    """Return the line straight up from where an arm stands, as high as home at most; None if it cannot be followed."""
    position, rotation = (value[0] for value in kinematics(arm).forward(here[None]))
    room = float(kinematics(arm).seed_position[2] - position[2])
    if room <= 1e-3:
        return None
    try:
        return Line.of(position, position + np.array([0.0, 0.0, min(LIFT_HOME, room)]), rotation, here, arm)
    except MotionRefused:
        return None


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """Pieces of a plan joined at their common samples: joints and velocities (n, dof), what is done between them."""

    ways: tuple[Way, ...]
    joints: Floats
    velocities: Floats
    rates: Rates

    @property
    def main(self) -> Way | None:
        """Return the learned path, if there is one."""
        return next((way for way in self.ways if way.path is not None), None)

    @classmethod
    def of(cls, ways: list[Way], order: MotionOrder) -> "Joined":
        """Join pieces; the plan's first and last sample are at rest, and begin and end without acceleration."""
        joints = np.concatenate([ways[0].joints, *(way.joints[1:] for way in ways[1:])])
        if len(joints) == 1:
            joints = np.repeat(joints, 2, axis=0)
        joints = eased(joints, order.time_step)
        velocities = spline_velocities(joints, order.time_step)
        return cls(tuple(ways), joints, velocities, rates(joints, velocities, order.time_step))

    def excess(self, arm: ArmModel) -> list[float]:
        """Return by what factor each piece is too fast for an arm's limits."""
        rows = self.rates.excess(arm.limits)
        found, first = [], 0
        for way in self.ways:
            found.append(float(rows[first : first + way.steps].max(initial=0.0)))
            first += way.steps
        return found


def _slowed(pieces: list[Piece], order: MotionOrder, arm: ArmModel) -> Joined:
    """Return pieces joined, each as much slower as it has to be for no joint to exceed a limit between any samples."""
    slower = [1.0] * len(pieces)
    made: list[Way | None] = [piece(1.0) for piece in pieces]
    joined = Joined.of([way for way in made if way is not None] or [_standing(arm)], order)
    for _ in range(MENDINGS):
        kept = [k for k, way in enumerate(made) if way is not None]
        excess = joined.excess(arm) if kept else []
        main = joined.main
        for k, way in enumerate(joined.ways if kept else ()):
            if way is main and main is not None:
                excess[k] = max(excess[k], math.sqrt(main.report["chord_error"] / order.chord_tolerance / CHORD_SPARE))
        late = [(kept[k], factor) for k, factor in enumerate(excess) if factor > 1.0]
        if not late:
            break
        for k, factor in late:
            slower[k] *= SLOWED * factor
            way = pieces[k](slower[k])
            if way is not None and way.path is not None:
                way = replace(way, findings=(*way.findings, checks.slowed_whole(arm, slower[k])))
            made[k] = way
        joined = Joined.of([way for way in made if way is not None], order)
    return joined


def _standing(arm: ArmModel) -> Way:
    return Way.still("travel", np.array(arm.home), arm)


def _sealed(
    joined: Joined, order: MotionOrder, arm: ArmModel, skill_digest: str, recipe_id: str, boxes: tuple[Box, ...]
) -> MotionPlan:
    """Check what came out, and seal it."""
    joints, velocities, main = joined.joints, joined.velocities, joined.main
    segments, phases = _segments(joined)
    times = np.arange(len(joints), dtype=np.float64) * order.time_step
    tool, rotations = kinematics(arm).forward(joints)
    on_path = np.flatnonzero(~np.isnan(phases))
    rows = (int(on_path[0]), int(on_path[-1])) if len(on_path) else (0, -1)
    since = times - (times[rows[0]] if main else 0.0)
    found, report = _checked(joined, segments, (tool, since, phases), arm, boxes)
    if any(finding.fatal for finding in found):
        raise MotionRefused([finding for finding in found if finding.fatal])
    valve, events, dispense, covariances = np.empty((0, 2)), (), np.zeros(len(times), dtype=bool), np.empty((0, 3, 3))
    error = (0.0, 0.0)
    if main is not None and main.path is not None:
        valve, events = _valve(main, times[rows[0]], order)
        dispense = valve_open(valve, times, order.dispense_lead)
        covariances = main.path.covariances(phases[rows[0] : rows[1] + 1])
        error = main.path_error
        report |= main.report
        found += main.findings
    plan = MotionPlan(
        arm.name, arm.digest, skill_digest, recipe_id, order, times, joints, velocities, tool,
        quaternions(rotations), phases, dispense,
        segments, valve, events, rows, covariances, error, tuple(found), report,
    )  # fmt: skip
    for entry in fields(plan):
        value = getattr(plan, entry.name)
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    return replace(plan, digest=plan.content_digest())


def _segments(joined: Joined) -> tuple[tuple[Segment, ...], Floats]:
    """Return what is done in which samples, and the phase (n,) of every sample."""
    phases = np.full(len(joined.joints), math.nan)
    segments: list[Segment] = []
    first = 0
    for way in joined.ways:
        for piece in way.split() if way.path is not None else (way,):
            last = min(first + max(1, piece.steps), len(phases) - 1)
            segments.append(Segment(piece.stage, first, last))
            inside = ~np.isnan(piece.phases)
            phases[first : first + len(piece.phases)][inside] = piece.phases[inside]
            first = last
    return tuple(segments), phases


def _checked(
    joined: Joined,
    segments: tuple[Segment, ...],
    rows: tuple[Floats, Floats, Floats],
    arm: ArmModel,
    boxes: tuple[Box, ...],
) -> tuple[list[Finding], dict[str, float]]:
    """Return what is wrong with a plan's samples, nozzle (n, 3), times and phases (n,), and the report of it."""
    joints = joined.joints
    tool, since, phases = rows
    found, used = checks.check_rates(arm, joined.rates, since, phases)
    found += checks.check_joints(arm, joints, since, phases)
    sparse = _sparse(tool, joints)
    led = np.zeros(len(joints), dtype=bool)
    for segment in segments:
        led[segment.first : segment.last + 1] |= segment.stage != "travel"
    in_line = sparse[led[sparse]]
    near, least = checks.check_singularity(arm, joints[in_line], since[in_line], phases[in_line])
    found += near
    near, clearance = check_clearance(arm, joints[sparse], since[sparse], phases[sparse], boxes)
    found += near
    low, high = np.array(arm.workspace_low), np.array(arm.workspace_high)
    outside = np.maximum(low - tool, tool - high).max(axis=1)
    if joined.main is not None and outside.max() > 1e-6 and not found:
        i = int(outside.argmax())
        size = float(outside[i]) * 1e3
        text = f"the nozzle leaves the workspace of {arm.name} on the way to or from the path by {size:.1f} mm"
        found.append(Finding("WorkspaceLimit", float(since[i]), math.nan, size, "mm", text))
    report = {f"largest_{name}_share": share for name, share in used.items()} | {"smallest_singular_value": least}
    return found, report | {"smallest_clearance": clearance}


def _valve(main: Way, start: float, order: MotionOrder) -> tuple[Floats, tuple[ValveEvent, ...]]:
    """Return the plan times (v, 2) between which the process is on, and the events with their lead."""
    path = main.path
    assert path is not None
    times: list[tuple[float, float]] = []
    events: list[ValveEvent] = []
    for interval in path.motion.dispense:
        lengths = np.interp(interval, path.phases, path.lengths)
        opens, closes = (float(start + main.time_of(float(length))) for length in lengths)
        times.append((opens, closes))
        events += [
            ValveEvent(True, opens - order.dispense_lead, float(lengths[0])),
            ValveEvent(False, closes - order.dispense_lead, float(lengths[1])),
        ]
    return np.array(times).reshape(-1, 2), tuple(events)


def _sparse(tool: Floats, joints: Floats) -> np.ndarray:
    """Return rows at most about 1 mm of nozzle way or 0.01 rad of joint way apart."""
    moved = (
        np.sqrt((np.diff(tool, axis=0) ** 2).sum(axis=1)) / 1e-3 + np.abs(np.diff(joints, axis=0)).max(axis=1) / 1e-2
    )
    count = np.floor(np.concatenate([[0.0], np.cumsum(moved)]))
    return np.flatnonzero(np.concatenate([[True], np.diff(count) > 0]))


def _unit_frame(frame: Pose) -> Pose:
    size = math.sqrt(sum(value**2 for value in frame[3:]))
    x, y, z, w = (value / size for value in frame[3:])
    return (*frame[:3], x, y, z, w)
