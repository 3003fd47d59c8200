"""How near an arm comes to itself, its table, the part and the fixtures around, by capsules and boxes.

Capsules cover every link (``ArmModel.capsules``, from the arm's limits file), so a distance here is never larger than
the true one. Segment to segment follows Ericson, Real-Time Collision Detection, 5.1.9; segment to box is a convex
function of the place on the segment, found by golden sections.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from sim.arm_model import ArmModel, Capsule, Floats, Pose
from sim.findings import Finding
from sim.order import Plate
from sim.planning.kinematics import kinematics

MARGIN = 5e-3
PART_BORDER = 0.02
AT_THE_TIP = 2e-3
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
SECTIONS = 28


@dataclass(frozen=True, slots=True)
class Box:
    """Something in the way: a box of full ``size`` (m) whose middle is at ``pose`` in the arm's base frame."""

    name: str
    pose: Pose
    size: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Cell:
    """What surrounds an arm. ``table_height`` is the plane it stands on; ``fixtures`` are clamps, walls, feeders."""

    fixtures: tuple[Box, ...] = ()
    table_height: float = 0.0

    def table(self) -> Box:
        """Return the table as a box."""
        return Box("table", (0.0, 0.0, self.table_height - 0.5, 0.0, 0.0, 0.0, 1.0), (4.0, 4.0, 1.0))


@dataclass(frozen=True, slots=True)
class Nearest:
    """The smallest distance met: between what, in m, at which row."""

    distance: float
    what: str
    row: int


def part_box(points: Floats, frame: Pose, table_height: float, plate: Plate | None = None) -> Box:
    """Return the part with what it lies on: below the part's plane, as large as the plate, down to the table.

    ``plate`` is x y of its corner, length and width in m in the part's frame. Where nobody said how large the part is,
    it is taken to reach 20 mm around the path: ``points`` (n, 3), the nozzle tip's, in the base frame.
    """
    turn = Rotation.from_quat(frame[3:])
    local = turn.inv().apply(points - np.array(frame[:3]))
    low, high = local.min(axis=0) - PART_BORDER, local.max(axis=0) + PART_BORDER
    if plate is not None:
        low, high = np.array(plate[:2]), np.array(plate[:2]) + np.array(plate[2:])
    depth = max(0.01, frame[2] - table_height)
    middle = turn.apply([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), -0.5 * depth]) + np.array(frame[:3])
    x, y, z = (float(value) for value in middle)
    return Box("part", (x, y, z, *frame[3:]), (float(high[0] - low[0]), float(high[1] - low[1]), depth))


def check_clearance(
    model: ArmModel,
    joints: Floats,
    times: Floats,
    phases: Floats,
    boxes: tuple[Box, ...],
    *,
    off_path: str = "on the way to or from the path",
) -> tuple[list[Finding], float]:
    """Return what comes too near over joints (n, dof), and the smallest distance in m found between anything."""
    if not model.capsules:
        return [], math.inf
    found: list[Finding] = []
    places = _capsules(model, joints)
    nearest = [
        _nearest(_gaps_among_links(model, places)),
        *(_nearest(_gaps_to_box(model, places, box)) for box in boxes),
    ]
    for near in nearest:
        if near.distance < MARGIN:
            i, gap = near.row, near.distance * 1e3
            state = f"{gap:.1f} mm apart" if gap >= 0.0 else f"{-gap:.1f} mm inside each other"
            where = off_path if math.isnan(phases[i]) else f"at {times[i]:.2f} s, {100 * phases[i]:.1f} % of the path"
            needed = f"{MARGIN * 1e3:.0f} mm are needed: move the part or clear the way"
            text = f"{near.what} would be {state} {where}, {needed}"
            short = MARGIN * 1e3 - gap
            place = float(times[i]), float(phases[i])
            found.append(Finding("Collision", *place, short, "mm", text, asked=gap, limit=MARGIN * 1e3))
    return found, min(near.distance for near in nearest)


def least_distances(model: ArmModel, joints: Floats, boxes: tuple[Box, ...]) -> Floats:
    """Return the smallest distance (n,) in m between anything that must not touch, at joints (n, dof)."""
    places = _capsules(model, joints)
    gaps = [gap for _, gap in _gaps_among_links(model, places)]
    gaps += [gap for box in boxes for _, gap in _gaps_to_box(model, places, box)]
    return np.min(gaps, axis=0) if gaps else np.full(len(joints), math.inf)


def between_links(model: ArmModel, joints: Floats, first: str, second: str) -> Floats:
    """Return how far (n,) in m two links' capsules are from each other at joints (n, dof)."""
    places = list(zip(model.capsules, _capsules(model, joints), strict=True))
    gaps = [
        _between_segments(*here, *there) - one.radius - other.radius
        for one, here in places
        if one.link == first
        for other, there in places
        if other.link == second
    ]
    return np.asarray(np.min(gaps, axis=0), dtype=np.float64)


def _capsules(model: ArmModel, joints: Floats) -> list[tuple[Floats, Floats]]:
    """Return start and end (n, 3) of every capsule in the base frame."""
    frames = kinematics(model).frames(joints)
    base = frames.pop("base")
    places = []
    for capsule in model.capsules:
        position, rotation = frames.get(capsule.link, base)
        places.append(tuple(position + rotation @ np.array(end) for end in (capsule.start, capsule.end)))
    return places


def tool_blocked(model: ArmModel, points: Floats, rotations: Floats, boxes: tuple[Box, ...]) -> bool:
    """Return whether the tool itself comes too near a box at nozzle points (n, 3) with rotations (n, 3, 3).

    What is fixed to the nozzle is where the nozzle is, however the rest of the arm holds it.
    """
    chain = kinematics(model)
    frames = chain.frames(chain.seed[None])
    position, rotation = chain.seed_position, chain.seed_rotation
    at_tip, fixed = _needle(model), _after_the_last_joint(model)
    for k, capsule in enumerate(model.capsules):
        if capsule.link not in fixed:
            continue
        (at,), (turn,) = frames[capsule.link]
        ends = [rotation.T @ (at + turn @ np.array(end) - position) for end in (capsule.start, capsule.end)]
        start, end = (points + rotations @ one for one in ends)
        for box in boxes:
            if k == at_tip and box.name in {"table", "part"}:
                continue
            if (_to_box_from_segment(start, end, box) - capsule.radius).min() < MARGIN:
                return True
    return False


@lru_cache(maxsize=16)
def _after_the_last_joint(model: ArmModel) -> frozenset[str]:
    """Return the links that move only as the nozzle does."""
    links: set[str] = set()
    for joint in reversed(kinematics(model).joints):
        links.add(joint.child)
        if joint.axis is not None:
            break
    return frozenset(links)


Gaps = Iterator[tuple[str, Floats]]


def _gaps_among_links(model: ArmModel, places: list[tuple[Floats, Floats]]) -> Gaps:
    """Yield for every watched pair of capsules what they belong to, and how far apart (n,) they are."""
    watched = set(model.apart)
    for i, first in enumerate(model.capsules):
        for j, second in enumerate(model.capsules[:i]):
            if (second.link, first.link) in watched or (first.link, second.link) in watched:
                gap = _between_segments(*places[i], *places[j]) - first.radius - second.radius
                yield f"{second.link} and {first.link} of {model.name}", gap


def _gaps_to_box(model: ArmModel, places: list[tuple[Floats, Floats]], box: Box) -> Gaps:
    """Yield for every capsule that has to keep clear of a box what it belongs to, and how far (n,) it is."""
    at_tip, standing = _needle(model), _standing(model)
    watched = [
        (capsule, place)
        for k, (capsule, place) in enumerate(zip(model.capsules, places, strict=True))
        if box.name not in {"table", "part"} or not (k == at_tip or capsule.link in standing)
    ]
    if not watched:
        return
    # All at once: a call for each capsule costs more than its arithmetic.
    starts, ends = (np.concatenate([place[k] for _, place in watched]) for k in (0, 1))
    gaps = _to_box_from_segment(starts, ends, box).reshape(len(watched), -1)
    for (capsule, _), gap in zip(watched, gaps, strict=True):
        yield f"{capsule.link} of {model.name} and the {box.name}", gap - capsule.radius


def _nearest(gaps: Gaps) -> Nearest:
    best = Nearest(math.inf, "", 0)
    for what, gap in gaps:
        row = int(gap.argmin())
        if gap[row] < best.distance:
            best = Nearest(float(gap[row]), what, row)
    return best


@lru_cache(maxsize=16)
def _needle(model: ArmModel) -> int:
    """Return which capsule ends at the nozzle's tip, -1 if none does: it alone has to come near the part."""
    chain = kinematics(model)
    tip = chain.forward(chain.seed[None])[0]
    gaps = [
        float(_between_segments(tip, tip, start, end)[0]) - capsule.radius
        for capsule, (start, end) in zip(model.capsules, _capsules(model, chain.seed[None]), strict=True)
    ]
    best = int(np.argmin(gaps)) if gaps else -1
    return best if gaps and gaps[best] < AT_THE_TIP else -1


def needle(model: ArmModel) -> Capsule | None:
    """Return the capsule that ends at the nozzle's tip: it alone may come near the part. None: there is none."""
    row = _needle(model)
    return model.capsules[row] if row >= 0 else None


@lru_cache(maxsize=16)
def _standing(model: ArmModel) -> frozenset[str]:
    """Return the links that stand on the table and belong there: the base, what is fixed to it, and the first to move.

    Without a first link that turns, as in a gantry, what slides along the table stands on it just so.
    """
    links = {"base"}
    chain = kinematics(model).joints
    links.add(chain[0].parent)
    for joint in chain:
        links.add(joint.child)
        if joint.axis is not None:
            break
    return frozenset(links)


def _between_segments(p1: Floats, q1: Floats, p2: Floats, q2: Floats) -> Floats:
    """Return the distance (n,) between segments p1-q1 and p2-q2, each (n, 3)."""
    d1, d2, r = q1 - p1, q2 - p2, p1 - p2
    a, e, f = _dot(d1, d1) + 1e-18, _dot(d2, d2) + 1e-18, _dot(d2, r)
    b, c = _dot(d1, d2), _dot(d1, r)
    across = a * e - b * b
    s = np.where(across > 1e-12, np.clip((b * f - c * e) / np.maximum(across, 1e-12), 0.0, 1.0), 0.0)
    s = np.where(e < 1e-12, np.clip(-c / a, 0.0, 1.0), s)
    t = (b * s + f) / e
    s = np.where(t < 0.0, np.clip(-c / a, 0.0, 1.0), np.where(t > 1.0, np.clip((b - c) / a, 0.0, 1.0), s))
    gap = r + d1 * s[:, None] - d2 * np.clip(t, 0.0, 1.0)[:, None]
    return np.sqrt(_dot(gap, gap))


def _to_box_from_segment(start: Floats, end: Floats, box: Box) -> Floats:
    """Return the distance (n,) between segments and a box.

    Inside the box it is minus the depth of the deepest point.
    """
    turn = Rotation.from_quat(box.pose[3:]).as_matrix()
    middle, half = np.array(box.pose[:3]), 0.5 * np.array(box.size)
    start, end = (start - middle) @ turn, (end - middle) @ turn

    def gap(part: Floats) -> Floats:
        outside = np.abs(start + part[:, None] * (end - start)) - half
        beyond = np.maximum(outside, 0.0)
        return np.sqrt(_dot(beyond, beyond)) + np.minimum(outside.max(axis=1), 0.0)

    low, high = np.zeros(len(start)), np.ones(len(start))
    for _ in range(SECTIONS):
        left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        keep_left = gap(left) < gap(right)
        low, high = np.where(keep_left, low, left), np.where(keep_left, right, high)
    return np.minimum(gap(0.5 * (low + high)), np.minimum(gap(np.zeros(len(start))), gap(np.ones(len(start)))))


def _dot(a: Floats, b: Floats) -> Floats:
    return (a * b).sum(axis=1)
