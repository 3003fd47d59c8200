"""A motion plan: every sample an arm will be sent, checked, hashed and never changed.

What was dry-run is what runs.
"""

import hashlib
import math
from dataclasses import dataclass, field, fields, replace
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from models.motion import Motion
from sim import checks
from sim.arm import ArmModel, Bools, Floats, Pose, Stage
from sim.checks import Finding, MotionRefused
from sim.clearance import Box, Cell, check_clearance, part_box
from sim.holding import Holding, NozzleTurn, quaternions
from sim.kinematics import kinematics
from sim.path import ToolPath
from sim.way import Way, joint_way, line_way, path_way

Timing = Literal["demonstrated", "constant_speed", "time_optimal"]
LIFT_HOME = 0.05
CAREFUL = (1.0, 0.8, 0.6)
SAME_BRANCH = 1e-2


@dataclass(frozen=True, slots=True)
class MotionOrder:
    """How a skill is to be run: the part of a recipe that moves the arm. SI units.

    ``duration`` and ``speed`` scale the demonstrated timing (0: as learned); for ``constant_speed`` ``speed`` is the
    nozzle's. ``speed_override`` and ``speed_fraction`` (0.25 in test mode) slow the whole plan. ``frame`` is the part
    in the arm's base. ``dispense_lead`` opens and closes the valve that much earlier. ``max_deviation`` stops the run
    when the measured nozzle is farther than that from the commanded one (0: not watched); ``tube_sigmas`` watches the
    skill's own spread, ``tube_policy`` says whether leaving it is told or stops the run.

    ``chord_tolerance`` is the most by which straight lines between the samples may cut the path. Where constant speed
    is impossible in a corner, ``corners`` refuses the plan or slows down and tells where. ``blend_radius`` rounds
    corners. Where the skill carries the tool's orientation, ``nozzle_turn`` follows all of it (``shown``) or only the
    nozzle's axis (``free``), which leaves a round nozzle's turn about that axis to the arm.
    """

    time_step: float = 0.008
    timing: Timing = "demonstrated"
    duration: float = 0.0
    speed: float = 0.0
    speed_override: float = 1.0
    frame: Pose = (0.42, 0.0, 0.10, 0.0, 0.0, 0.0, 1.0)
    standoff: float = 0.001
    approach_height: float = 0.05
    retract_height: float = 0.05
    dispense_lead: float = 0.0
    max_deviation: float = 0.0
    speed_fraction: float = 1.0
    blend_radius: float = 0.0
    corners: Literal["slow", "refuse"] = "slow"
    chord_tolerance: float = 5e-5
    tube_sigmas: float = 0.0
    tube_policy: Literal["flag", "stop"] = "flag"
    nozzle_turn: NozzleTurn = "shown"


@dataclass(frozen=True, slots=True)
class Segment:
    """Samples ``first`` to ``last`` of a plan, both included; neighbours share a sample."""

    stage: Stage
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class ValveEvent:
    """The valve opens or closes.

    At ``time`` in s of the plan, lead included, for the place ``arc_length`` m along the path.
    """

    opens: bool
    time: float
    arc_length: float


@dataclass(frozen=True, slots=True, eq=False)
class MotionPlan:
    """All an arm needs to run a skill once, from home to home.

    One row every ``order.time_step`` seconds: ``times`` (n,), ``joints`` and ``velocities`` (n, dof), ``tool`` (n, 3)
    nozzle tip in the base frame, ``orientations`` (n, 4) the nozzle's unit quaternions x y z w there (z out of the
    tip), ``phases`` (n,) along the learned path, NaN off it, ``dispense`` (n,) valve open, lead included. Between
    samples an arm follows the cubic through positions and velocities. ``valve`` (v, 2) holds plan times of opening
    and closing without lead. ``covariances`` (m, 3, 3) belong to the samples of ``path_rows``.

    ``path_error`` is the RMS and largest distance in m of the exact learned path from straight lines between the
    samples. ``digest`` covers everything else here.
    """

    arm: str
    arm_digest: str
    skill_digest: str
    recipe_id: str
    order: MotionOrder
    times: Floats
    joints: Floats
    velocities: Floats
    tool: Floats
    orientations: Floats
    phases: Floats
    dispense: Bools
    segments: tuple[Segment, ...]
    valve: Floats
    valve_events: tuple[ValveEvent, ...]
    path_rows: tuple[int, int]
    covariances: Floats
    path_error: tuple[float, float]
    findings: tuple[Finding, ...]
    report: dict[str, float] = field(repr=False)
    digest: str = ""

    @property
    def samples(self) -> int:
        """Number of time steps commanded."""
        return len(self.times)

    @property
    def duration(self) -> float:
        """Time in s from the first sample to the last."""
        return float(self.times[-1])

    def stage_at(self, time: float) -> Stage:
        """Return what is being done at a time in s of the plan."""
        row = int(np.searchsorted(self.times, time))
        for segment in self.segments:
            if row <= segment.last:
                return segment.stage
        return self.segments[-1].stage

    def content_digest(self) -> str:
        """Return the SHA-256 over the plan's content in hex; a plan whose ``digest`` differs has been changed."""
        told = hashlib.sha256()
        for entry in fields(self):
            if entry.name != "digest":
                value = getattr(self, entry.name)
                content = (
                    np.ascontiguousarray(value).tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
                )
                told.update(f"{entry.name}:{len(content)}:".encode() + content)
        return told.hexdigest()


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
    found = checks.check_order(order)
    if found:
        raise MotionRefused(found)
    frame = _unit_frame(order.frame)
    path = ToolPath(motion, frame, order.standoff, order.blend_radius)
    if not np.isfinite(path.length) or path.length < 1e-5:
        raise MotionRefused([checks.invalid("path", f"{path.length * 1e3:.3f} mm long", "longer than 0.01 mm")])
    for share in CAREFUL[:-1]:
        try:
            return _planned(path, order, arm, share, (skill_digest, recipe_id), cell or Cell())
        except MotionRefused as refused:
            if any(finding.unit != checks.OF_THE_LIMIT for finding in refused.findings):
                raise
    return _planned(path, order, arm, CAREFUL[-1], (skill_digest, recipe_id), cell or Cell())


def _planned(
    path: ToolPath, order: MotionOrder, arm: ArmModel, share: float, names: tuple[str, str], surroundings: Cell
) -> MotionPlan:
    """Return the plan whose path is timed for this share of the joints' acceleration; checked with all of it.

    A corner sharper than the timing's grid takes more than the timing knows; samples show it.
    """
    frame = _unit_frame(order.frame)
    held = Holding(path, arm, order.nozzle_turn)
    up = path.rotation[:, 2]
    limits = replace(arm.limits, acceleration=tuple(share * one for one in arm.limits.acceleration))
    main = path_way(path, order, replace(arm, limits=limits) if share < 1.0 else arm, held)
    start, end = main.tool[0], main.tool[-1]
    home = np.array(arm.home)
    down = line_way("approach", start + order.approach_height * up, start, order, arm, held.at_end(False))
    lift = line_way("retract", end, end + order.retract_height * up, order, arm, held.at_end(True))
    there = joint_way(home, (down or main).joints[0], order, arm)
    back = joint_way((lift or main).joints[-1], home, order, arm)
    ways = [way for way in (there, down, *main.split(), lift, back) if way is not None]
    part = part_box(main.tool, frame, surroundings.table_height)
    boxes = (surroundings.table(), part, *surroundings.fixtures)
    return _assembled(ways, order, arm, *names, main, boxes)


def plan_home(
    arm: ArmModel, joints: Floats | tuple[float, ...], *, speed_fraction: float = 0.5, cell: Cell | None = None
) -> MotionPlan:
    """Return the plan that brings an arm home from where it stands at rest: straight up first, then in joint space.

    Raises ``MotionRefused`` if the way is not free or the joints are out of range.
    """
    order = MotionOrder(speed_fraction=speed_fraction)
    here = np.asarray(joints, dtype=float)
    none = np.array([math.nan])
    found = checks.check_joints(arm, here[None], none, none) if np.isfinite(here).all() else []
    if not np.isfinite(here).all() or len(here) != arm.dof:
        found = [checks.invalid("joints", list(here), f"{arm.dof} finite numbers")]
    if found:
        raise MotionRefused(found)
    position, rotation = (value[0] for value in kinematics(arm).forward(here[None]))
    home = np.array(arm.home)
    room = float(kinematics(arm).seed_position[2] - position[2])
    apart = kinematics(arm).inverse(position[None], rotation).joints[0] - here
    lift = None
    if room > 1e-3 and np.abs(apart).max() < SAME_BRANCH:
        lift = line_way(
            "retract", position, position + np.array([0.0, 0.0, min(LIFT_HOME, room)]), order, arm, rotation
        )
    if lift is not None:
        fade = np.linspace(1.0, 0.0, len(lift.joints))[:, None]
        lift = replace(lift, joints=lift.joints - apart * fade**2 * (3.0 - 2.0 * fade))
    back = joint_way(lift.joints[-1] if lift else here, home, order, arm)
    ways = [way for way in (lift, back) if way is not None] or [Way.still("travel", here, arm)]
    return _assembled(ways, order, arm, "", "", None, ((cell or Cell()).table(), *(cell.fixtures if cell else ())))


def _assembled(
    ways: list[Way],
    order: MotionOrder,
    arm: ArmModel,
    skill_digest: str,
    recipe_id: str,
    main: Way | None,
    boxes: tuple[Box, ...],
) -> MotionPlan:
    """Join the ways at their common samples, check what came out, and seal it."""
    step = order.time_step
    joints = np.concatenate([ways[0].joints, *(way.joints[1:] for way in ways[1:])])
    phases = np.concatenate([ways[0].phases, *(way.phases[1:] for way in ways[1:])])
    segments: list[Segment] = []
    first = 0
    for way in ways:
        segments.append(Segment(way.stage, first, first + way.steps))
        if not np.isnan(way.phases[0]):
            phases[first] = way.phases[0]  # the sample shared with the way before is the path's first
        first += way.steps
    if len(joints) == 1:
        joints, phases = np.repeat(joints, 2, axis=0), np.repeat(phases, 2)
        segments = [replace(segments[0], last=1)]
    times = np.arange(len(joints), dtype=np.float64) * step
    tool, rotations = kinematics(arm).forward(joints)
    spline = CubicSpline(times, joints, bc_type="clamped")
    velocities, accelerations = spline(times, 1), spline(times, 2)
    velocities[0] = velocities[-1] = 0.0
    on_path = np.flatnonzero(~np.isnan(phases))
    rows = (int(on_path[0]), int(on_path[-1])) if len(on_path) else (0, -1)
    since = times - (times[rows[0]] if main else 0.0)
    found, used = checks.check_rates(arm, (velocities, accelerations), since, phases)
    found += checks.check_joints(arm, joints, since, phases)
    sparse = _sparse(tool, joints)
    near, least = checks.check_singularity(arm, joints[sparse], since[sparse], phases[sparse])
    found += near
    near, clearance = check_clearance(arm, joints[sparse], since[sparse], phases[sparse], boxes)
    found += near
    low, high = np.array(arm.workspace_low), np.array(arm.workspace_high)
    outside = np.maximum(low - tool, tool - high).max(axis=1)
    if main is not None and outside.max() > 1e-6 and not found:
        i = int(outside.argmax())
        text = (
            f"the nozzle leaves the workspace of {arm.name} on the way to or from the path by {outside[i] * 1e3:.1f} mm"
        )
        found.append(Finding("WorkspaceLimit", float(since[i]), math.nan, float(outside[i]) * 1e3, "mm", text))
    if any(finding.fatal for finding in found):
        raise MotionRefused([finding for finding in found if finding.fatal])
    report = {f"largest_{name}_share": share for name, share in used.items()} | {"smallest_singular_value": least}
    report["smallest_clearance"] = clearance
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
        tuple(segments), valve, events, rows, covariances, error, tuple(found), report,
    )  # fmt: skip
    for entry in fields(plan):
        value = getattr(plan, entry.name)
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    return replace(plan, digest=plan.content_digest())


def valve_open(valve: Floats, times: Floats, lead: Floats | float) -> Bools:
    """Return whether the valve is open at plan times (n,), opening and closing ``lead`` s early."""
    ahead = times + lead
    inside = np.zeros(len(times), dtype=bool)
    for opens, closes in valve:
        inside |= (ahead >= opens - 1e-9) & (ahead < closes - 1e-9)
    return inside


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
