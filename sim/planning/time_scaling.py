"""Which time law an order asks for along a learned path, and what has to be slowed or refused for an arm to keep it.

A law is made from ceilings known on a grid of places, sampled as an arm will be sent it, and slowed where the cubic
between two samples would need more than a joint may do, until it needs no more.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from sim.arm_model import ArmModel, Floats
from sim.findings import Finding, MotionRefused
from sim.order import MotionOrder
from sim.planning import checks
from sim.planning.corners import corner_speeds, curvature
from sim.planning.kinematics import InverseResult, kinematics
from sim.planning.path import ToolPath
from sim.planning.postures import Poses, Posture, steady_posture
from sim.planning.rates import rates, spline_velocities
from sim.planning.timing import JointPath, TimeLaw, fastest, law_speed, ramps, time_at
from sim.planning.tool_orientation import Holding

LATER = 1.1
# Slower than this share of the speed asked for is no constant speed any more: refused whatever the order says.
SLOWEST_SHARE = 0.2
TRIALS, ROUNDS, PASSES, LENGTHENED = 12, 12, 3, 4
# Rows are slowed until none needs more than this share of a limit, and then by this much more than it needs.
NEARLY, SPARE = 0.985, 0.97
AT_SPEED = 0.999
TOLD, AROUND = 0.99, 2e-3
RUN_IN_NODES, RUN_IN_SPARE, SHORTEST_RUN_IN = 8, 1.1, 2e-4


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A path as an arm follows it in one posture, on an even grid of arc lengths (g,).

    Phases, the people's times in s, joints, and two ceilings (g,) in m/s: ``even`` for a speed that does not change,
    ``careful`` with something left to change it. ``by_step`` says where the time step is what keeps ``even`` down,
    ``told`` how the nozzle is held otherwise than it should be.
    """

    path: ToolPath
    held: Holding
    arm: ArmModel
    lengths: Floats
    phases: Floats
    shown: Floats
    joints: JointPath
    even: Floats
    careful: Floats
    by_step: np.ndarray
    told: tuple[Finding, ...]

    @property
    def inside(self) -> np.ndarray:
        """Return which places (g,) are on the learned path, not on its run-in or run-out."""
        return (self.lengths >= 0.0) & (self.lengths <= self.path.length)

    def at(self, lengths: Floats) -> tuple[InverseResult, Floats]:
        """Return joints (n, dof) and nozzle (n, 3) at arc lengths (n,): exact, near the posture on the grid."""
        points = self.path.points(lengths)
        solved = kinematics(self.arm).refine(points, self.held.at_lengths(lengths), self.joints.spline(lengths))
        return solved, points


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """The time on a law (n,) in s at each sample; samples ``first`` and ``last`` are the learned path's own ends.

    ``stretch`` is how much faster the law's own time passes than that of the samples.
    """

    times: Floats
    first: int
    last: int
    stretch: float


def clock_of(law: TimeLaw, length: float, step: float) -> Clock:
    """Return when to sample a law every ``step`` s: path, run-in and run-out take whole steps each.

    The path is stretched by less than a step; run-in and run-out begin and end with less than a step of standing.
    """
    begins = time_at(law, 0.0) if law.start < 0.0 else 0.0
    ends = time_at(law, length) if law.end > length else law.duration
    found = checks.check_samples(law.duration / step)
    if found:
        raise MotionRefused(found)
    steps = max(1, math.ceil((ends - begins) / step - 1e-9))
    each = (ends - begins) / steps
    before, after = (math.ceil(part / each - 1e-9) for part in (begins, law.duration - ends))
    times = begins + np.arange(-before, steps + after + 1, dtype=np.float64) * each
    return Clock(times, before, before + steps, each / step)


def law_for(
    path: ToolPath, order: MotionOrder, arm: ArmModel, held: Holding, posture: Posture | None
) -> tuple[Followed, TimeLaw, list[Finding]]:
    """Return the time law an order asks for, and what was slowed down for it.

    Constant speed runs straight into the path and out of it, so that the speed is the same from its first point to
    its last but for the corners. Every other law begins and ends at rest at the path's own ends. Raises
    ``MotionRefused``.
    """
    if order.timing == "constant_speed":
        return _constant(path, order, arm, held, posture)
    followed = follow(path, 0.0, order, arm, held, posture)
    if order.timing == "time_optimal":
        law, _, _ = _kept(followed, np.full(len(followed.lengths), math.inf), followed.careful, order)
        return followed, law, []
    return followed, *_demonstrated(followed, order)


def follow(
    path: ToolPath, extra: float, order: MotionOrder, arm: ArmModel, held: Holding, posture: Posture | None
) -> Followed:
    """Return an arm's way along a path and ``extra`` m straight on before and after it.

    Refuses what cannot be reached.
    """
    count = len(path.lengths)
    spacing = path.length / (count - 1)
    more = spacing * np.arange(1, math.ceil(extra / spacing) + 1, dtype=np.float64)
    lengths = np.concatenate([-more[::-1], np.linspace(0.0, path.length, count, dtype=np.float64), path.length + more])
    points, phases, rotations = path.points(lengths), path.phases_at(lengths), held.at_lengths(lengths)
    shown = path.motion.times_at(phases)
    chain = kinematics(arm)
    solved = (
        chain.inverse(points, rotations) if posture is None else chain.refine(points, rotations, posture.near(lengths))
    )
    if posture is None and solved.reached.all():
        turned = np.broadcast_to(rotations, (len(points), 3, 3))
        poses = Poses(points, turned, 0, len(points) - 1, lengths)
        steady = steady_posture(arm, poses, solved.joints)
        if steady is not None:
            solved = chain.refine(points, rotations, steady.near(lengths))
    paced = shown * ((order.duration or path.motion.duration) / path.motion.duration)
    found = checks.check_reach(arm, points, solved, paced, phases)
    if held.as_shown and any(finding.code == "NoIkSolution" for finding in found):
        lost = ~solved.reached
        if chain.inverse(points[lost], held.upright).reached.all():
            found[0] = checks.blame_tilt(arm, found[0], float(held.tilts(phases[lost][:1])[0]))
    found = found or checks.check_posture(arm, solved.joints, paced, phases)
    leaning: list[Finding] = []
    if arm.dof < 6 and not found:
        wanted = np.broadcast_to(rotations, (len(points), 3, 3))
        leaning = checks.check_lean(arm, wanted, chain.forward(solved.joints)[1], phases)
        found = [finding for finding in leaning if finding.fatal]
    if found:
        raise MotionRefused(found)
    joints = JointPath(lengths, solved.joints)
    ceilings = [joints.ceiling(arm.limits, even=even) for even in (True, False)]
    with np.errstate(divide="ignore"):
        by_chord = 0.95 * np.sqrt(8.0 * order.chord_tolerance / curvature(points, lengths)) / order.time_step

    def exact(at: Floats) -> Floats:
        return chain.refine(path.points(at), held.at_lengths(at), joints.spline(at)).joints

    for nodes, speed in corner_speeds(lengths, solved.joints, exact, arm.limits, order.time_step):
        for ceiling in ceilings:
            ceiling[nodes] = speed
    even, careful = (np.minimum(ceiling, by_chord) for ceiling in ceilings)
    return Followed(path, held, arm, lengths, phases, shown, joints, even, careful, by_chord <= even, tuple(leaning))


def _kept(
    followed: Followed, wanted: Floats, ceiling: Floats, order: MotionOrder, brake: Floats | None = None
) -> tuple[TimeLaw, Floats, Floats]:
    """Return the quickest law below ``wanted`` and ``ceiling`` (g,) whose samples keep every limit and the chord.

    Also returns ceiling and share of the acceleration (g,) that were found to be needed for it. Where they were not
    found, the plan's own check slows the whole path.
    """
    arm, lengths, step = followed.arm, followed.lengths, order.time_step
    brake = np.ones_like(ceiling) if brake is None else brake
    tips = scipy.interpolate.make_interp_spline(lengths, followed.path.points(lengths), k=3)
    reach = max(3, round(1e-3 / (lengths[1] - lengths[0])))
    law = fastest(followed.joints, arm.limits, arm.path_limits, np.minimum(wanted, ceiling), brake)
    for _ in range(ROUNDS):
        clock = clock_of(law, followed.path.length, step)
        at = law.lengths(clock.times)
        joints = followed.at(at)[0].joints
        excess = rates(joints, spline_velocities(joints, step), step).excess(arm.limits)
        excess = np.maximum(excess, np.sqrt(_cuts(tips, at) / order.chord_tolerance))
        if excess.max(initial=0.0) <= NEARLY:
            break
        cut = scipy.ndimage.minimum_filter1d(
            np.where(excess > NEARLY, SPARE / np.maximum(excess, NEARLY), 1.0), 5, mode="nearest"
        )
        at_nodes = cut[np.clip(np.searchsorted(at, lengths) - 1, 0, len(cut) - 1)]
        np.minimum.at(at_nodes, np.clip(np.searchsorted(lengths, at[:-1]), 0, len(lengths) - 1), cut)
        np.minimum.at(at_nodes, np.clip(np.searchsorted(lengths, at[1:]), 0, len(lengths) - 1), cut)
        slow = np.minimum(law_speed(law, lengths), np.minimum(ceiling, wanted))
        ceiling = np.where(at_nodes < 1.0, np.maximum(slow, 1e-5) * at_nodes, ceiling)
        brake = brake * np.asarray(scipy.ndimage.minimum_filter1d(at_nodes, 2 * reach + 1), dtype=np.float64) ** 2
        law = fastest(followed.joints, arm.limits, arm.path_limits, np.minimum(wanted, ceiling), brake)
    return law, ceiling, brake


def _cuts(tips: object, at: Floats) -> Floats:
    """Return by how much in m the straight line of every row (n - 1,) cuts the nozzle's way, a spline of arc length."""
    ends = tips(at)  # pyright: ignore[reportCallIssue]
    chord = np.diff(ends, axis=0)
    size = np.maximum((chord**2).sum(axis=1, keepdims=True), 1e-30)
    worst = np.zeros(len(chord))
    for part in (0.25, 0.5, 0.75):
        away = tips(at[:-1] + part * np.diff(at)) - ends[:-1]  # pyright: ignore[reportCallIssue]
        along = np.clip((away * chord).sum(axis=1, keepdims=True) / size, 0.0, 1.0)
        worst = np.maximum(worst, np.sqrt(((away - along * chord) ** 2).sum(axis=1)))
    return worst


def _demonstrated(followed: Followed, order: MotionOrder) -> tuple[TimeLaw, list[Finding]]:
    """Return the people's own pace, scaled to the time asked for; told where an arm cannot keep it."""
    shown, path, arm = followed.shown, followed.path, followed.arm
    pace = np.diff(followed.lengths) / np.maximum(np.diff(shown), 1e-9)
    natural = np.minimum(np.concatenate([[pace[0]], pace]), np.concatenate([pace, [pace[-1]]]))
    wanted = order.duration or (path.length / order.speed if order.speed > 0.0 else float(shown[-1]))
    scale, ceiling, brake = float(shown[-1]) / wanted, followed.careful, np.ones_like(followed.careful)
    law = None
    for _ in range(PASSES):
        scale = _scaled(followed, natural, scale, wanted, ceiling, brake)
        law, ceiling, brake = _kept(followed, natural * scale, ceiling, order, brake)
        if abs(law.duration - wanted) < 1e-3 * wanted:
            break
    assert law is not None
    if law.duration > LATER * wanted and (order.duration or order.speed):
        text = f"the path cannot be run in {wanted:.3g} s: {arm.name} needs at least {law.duration:.3g} s"
        late = law.duration - wanted
        raise MotionRefused(
            [Finding("SpeedLimit", math.nan, math.nan, late, "s", text, asked=wanted, limit=law.duration)]
        )
    top = np.minimum(ceiling, arm.path_limits.speed)
    excess = natural * scale / top
    if excess.max() <= 1.01:
        return law, []
    i = int(excess.argmax())
    asked, allowed = float(natural[i] * scale) * 1e3, float(top[i]) * 1e3
    text = (
        f"slowed to {allowed:.0f} mm/s at {100 * followed.phases[i]:.1f} % of the path, where the people's "
        f"pace is {asked:.0f} mm/s: {arm.name} cannot turn faster there"
    )
    time, phase, place = float(shown[i]), float(followed.phases[i]), float(followed.lengths[i])
    told = Finding(
        "SpeedLimit", time, phase, allowed, "mm/s", text, fatal=False, place=place, asked=asked, limit=allowed
    )
    return law, [told]


def _scaled(followed: Followed, natural: Floats, scale: float, wanted: float, ceiling: Floats, brake: Floats) -> float:
    """Return by what the people's pace (g,) has to be multiplied for the path to take ``wanted`` s, or nearly."""
    arm = followed.arm

    def lasts(scale: float) -> float:
        top = np.minimum(natural * scale, ceiling)
        return fastest(followed.joints, arm.limits, arm.path_limits, top, brake).duration

    duration = lasts(scale)
    for _ in range(TRIALS):
        if abs(duration - wanted) < 5e-4 * wanted:
            break
        better = scale * duration / wanted
        trial = lasts(better)
        if trial > duration - 1e-6 and duration > wanted:
            break
        scale, duration = better, trial
    return scale


def _constant(
    path: ToolPath, order: MotionOrder, arm: ArmModel, held: Holding, posture: Posture | None
) -> tuple[Followed, TimeLaw, list[Finding]]:
    """Return constant speed over the whole path.

    Where a corner does not allow it: refused, or slowed down there and told. Whether it is refused depends on what
    the corners allow, not on the speed asked for, so what is accepted is accepted at every lower speed.
    """
    bounds, speed = arm.path_limits, order.speed
    asked = speed * 1e3
    if speed > bounds.speed:
        most = bounds.speed * 1e3
        text = f"speed is {asked:.0f} mm/s: the nozzle of {arm.name} may go {most:.0f} mm/s at most"
        raise MotionRefused([Finding("SpeedLimit", 0.0, 0.0, asked - most, "mm/s", text, asked=asked, limit=most)])
    followed = follow(path, 0.0, order, arm, held, posture)
    _refuse_corners(followed, order)
    room = _room(path)
    extra = min(_run_in(followed, speed), room)
    law, slowest = None, 0.0
    for _ in range(LENGTHENED):
        followed = _with_run_in(path, extra, order, arm, held, posture)
        top = np.where(followed.even >= speed, speed, np.minimum(followed.careful, speed))
        law, ceiling, _ = _kept(followed, np.full(len(top), speed), top, order)
        outside = ~followed.inside
        speeds = law_speed(law, np.array([0.0, path.length]))
        if (speeds >= AT_SPEED * speed).all() or (ceiling[outside] < speed).any():
            break
        if not outside.any() or extra >= room:
            break
        extra = min(1.5 * extra, room)
    assert law is not None
    inside = followed.inside
    reached = law_speed(law, followed.lengths[inside])
    i = int(reached.argmin())
    slowest = float(reached[i]) * 1e3
    if slowest >= TOLD * asked:
        return followed, law, []
    if order.corners == "refuse":
        raise MotionRefused([_corner(followed, order, i, slowest, refused=True)])
    return followed, law, [_corner(followed, order, i, slowest, refused=False)]


def _with_run_in(
    path: ToolPath, extra: float, order: MotionOrder, arm: ArmModel, held: Holding, posture: Posture | None
) -> Followed:
    """Return an arm's way along a path with as much of ``extra`` m before and after it as the arm can follow."""
    while extra > SHORTEST_RUN_IN:
        try:
            return follow(path, extra, order, arm, held, posture)
        except MotionRefused:
            extra *= 0.5
    return follow(path, 0.0, order, arm, held, posture)


def _room(path: ToolPath) -> float:
    """Return how far in m the nozzle may go straight on before and beyond a path without going into the part.

    It may not come nearer to the part's plane than half as near as the path itself does.
    """
    normal = path.rotation[:, 2]
    high = (path.points(path.lengths) - path.origin) @ normal
    floor = float(high.min()) - 0.5 * path.standoff
    step = 1e-3
    ahead = (path.points(np.array([-step, path.length + step])) - path.origin) @ normal
    room = math.inf
    for here, there in zip(high[[0, -1]], ahead, strict=True):
        if there < here - 1e-9:
            room = min(room, step * float(here - floor) / float(here - there))
    return room


def _run_in(followed: Followed, speed: float) -> float:
    """Return the way in m that the nozzle needs to gather a speed before the path and to lose it afterwards."""
    push, width = ramps(
        followed.joints, followed.arm.limits, followed.arm.path_limits, np.full_like(followed.even, speed)
    )
    slowest = float(min(push[:RUN_IN_NODES].min(), push[-RUN_IN_NODES:].min()))
    spacing = float(followed.lengths[1] - followed.lengths[0])
    return max(RUN_IN_NODES * spacing, RUN_IN_SPARE * 0.5 * speed * (speed / slowest + 1.7 * width))


def _refuse_corners(followed: Followed, order: MotionOrder) -> None:
    """Raise where a corner does not allow a constant speed, or only one too far below it."""
    i = int(followed.even.argmin())
    allowed = float(followed.even[i])
    enough = order.speed * (1.0 - 1e-9) if order.corners == "refuse" else SLOWEST_SHARE * order.speed
    if allowed < enough:
        raise MotionRefused([_corner(followed, order, i, allowed * 1e3, refused=True)])


def _corner(followed: Followed, order: MotionOrder, row: int, allowed: float, *, refused: bool) -> Finding:
    """Return what is told of a corner: ``row`` counts from the path's first place, ``allowed`` in mm/s."""
    i = row + int(np.argmax(followed.inside))
    asked = order.speed * 1e3
    phase, length = float(followed.phases[i]), float(followed.lengths[i])
    time = length / order.speed
    # The nozzle is slow for a little while before and after what makes it slow.
    around = np.flatnonzero(np.abs(followed.lengths - length) <= AROUND)
    narrowest = int(around[followed.careful[around].argmin()])
    if followed.even[narrowest] >= order.speed:
        cause = "the way into the path and out of it"
    elif followed.by_step[narrowest]:
        cause = f"a time step of {order.time_step * 1e3:.3g} ms"
    else:
        cause = "a corner"
    what = f"at {time:.2f} s, {100 * phase:.1f} % of the path, {cause} allows {allowed:.0f} mm/s"
    text = (
        f"constant {asked:.0f} mm/s is impossible: {what}: lower the speed, or give a blend radius"
        if refused
        else f"slowed from {asked:.0f} to {allowed:.0f} mm/s in corners: {what}"
    )
    short = asked - allowed
    return Finding(
        "SpeedLimit", time, phase, short, "mm/s", text, fatal=refused, place=length, asked=asked, limit=allowed
    )
