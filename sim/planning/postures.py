"""The ways in which an arm can hold itself along one and the same path: its branches, and where its elbow may be.

The first posture is always the one that is near home: the joints are then a function of the pose alone. Only where
that one cannot be run is looked for others: joints that reach the path's first point are found from many places inside
the limits, and each is followed along the path, all at once.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from sim.arm_model import ArmModel, Floats
from sim.planning.checks import POSTURE_JUMP, SINGULAR, singular_values
from sim.planning.clearance import Box, check_clearance, tool_blocked
from sim.planning.kinematics import Kinematics, kinematics

SEEDS, MOST_STARTS, MOST_TRIED = 384, 48, 6
# Two sets of joints nearer to each other than this, in rad or m, are one posture.
ALIKE, ALIKE_SPARE = 0.02, 0.25
STRIDE, STRIDE_TURN, MOST_STRIDES = 2e-3, np.deg2rad(2.0), 1500
# A spare joint is drawn to the middle of its range by this share a stride, or left where it is.
DRAWN = (0.0, 0.03)
CLEARANCE_STRIDE = 5
# A spare joint that changes its pace by more than this in rad between two places next to each other has jumped.
JUMP, JUMP_SHARE = 1e-5, 50.0


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """Joints along a path as a smooth function of arc length in m, near enough for Newton's steps to be exact."""

    spline: "scipy.interpolate.CubicSpline"

    def near(self, lengths: Floats) -> Floats:
        """Return joints (n, dof) near those at arc lengths (n,): straight on beyond the path's ends."""
        first, last = self.spline.x[0], self.spline.x[-1]
        inside = np.clip(lengths, first, last)
        return self.spline(inside) + (lengths - inside)[:, None] * self.spline(inside, 1)


def steady_posture(arm: ArmModel, poses: "Poses", joints: Floats) -> Posture | None:
    """Return the posture that goes on from the first of joints (g, dof) where those jump with the nozzle going on.

    With seven axes the joints that are a function of the pose may jump a little where Newton's way from home bends.
    None where they do not, or where it cannot be followed.
    """
    if arm.dof <= 6:
        return None
    chain = kinematics(arm)
    drifts = chain.spare(joints[:-1], np.diff(joints, axis=0))
    sudden = np.abs(np.diff(drifts, axis=0)).max(axis=1)
    if sudden.max(initial=0.0) < max(JUMP, JUMP_SHARE * float(np.median(sudden))):
        return None
    rows = _strides(poses)
    ways = _followed(chain, joints[:1], np.zeros(1), poses.points[rows], poses.rotations[rows])
    return Posture(scipy.interpolate.CubicSpline(poses.lengths[rows], ways[0])) if ways else None


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Nozzle points (g, 3) and rotations (g, 3, 3) from above the path along it to above its end.

    Rows ``first`` to ``last`` are the path's, at arc lengths (p,) in m.
    """

    points: Floats
    rotations: Floats
    first: int
    last: int
    lengths: Floats


def other_postures(arm: ArmModel, poses: Poses, boxes: tuple[Box, ...]) -> Iterator[Posture]:
    """Yield further postures in which an arm can go along poses, nearest to home first.

    Each stays within the joints' ranges, away from singular positions, clear of itself and of ``boxes``, and never
    jumps.
    """
    rows = _strides(poses)
    points, rotations = poses.points[rows], poses.rotations[rows]
    if arm.dof >= 6 and tool_blocked(arm, points, rotations, boxes):
        return
    ways = _every_way(arm, points, rotations)
    if arm.dof > 6:
        ways += [way[::-1] for way in _every_way(arm, points[::-1], rotations[::-1])]
    ways = [way for way in _turned_back(arm, ways) if _possible(arm, way)]
    home = np.array(arm.home)
    ways.sort(key=lambda way: float(np.abs(way[[0, -1]] - home).max()))
    alike = ALIKE if arm.dof <= 6 else ALIKE_SPARE
    on_path = (rows >= poses.first) & (rows <= poses.last)
    tried: list[Floats] = []
    for way in ways:
        if len(tried) >= MOST_TRIED or any(np.abs(way - one).max() < alike for one in tried):
            continue
        few = way[::CLEARANCE_STRIDE]
        none = np.zeros(len(few))
        if check_clearance(arm, few, none, none, boxes)[0]:
            continue
        tried.append(way)
        yield Posture(scipy.interpolate.CubicSpline(poses.lengths[rows[on_path] - poses.first], way[on_path]))


def _every_way(arm: ArmModel, points: Floats, rotations: Floats) -> list[Floats]:
    """Return the joints (g, dof) of every start that can be followed along poses, drawn to the middle or not."""
    starts = _starts(arm, points[0], rotations[0])
    if not len(starts):
        return []
    draw = np.zeros(len(starts))
    if arm.dof > 6:
        draw = np.repeat(DRAWN, len(starts))
        starts = np.concatenate([starts] * len(DRAWN))
    return _followed(kinematics(arm), starts, draw, points, rotations)


def _strides(poses: Poses) -> np.ndarray:
    """Return rows of poses at most a short way and a small turn apart, with the path's first and last."""
    turns = Rotation.from_matrix(poses.rotations)
    moved = np.sqrt((np.diff(poses.points, axis=0) ** 2).sum(axis=1)) / STRIDE
    moved += (turns[1:] * turns[:-1].inv()).magnitude() / STRIDE_TURN
    along = np.concatenate([[0.0], np.cumsum(moved)])
    count = int(np.clip(np.ceil(along[-1]), 16, MOST_STRIDES))
    rows = np.searchsorted(along, np.linspace(0.0, along[-1], count + 1))
    last = len(along) - 1
    return np.unique(np.concatenate([[0, poses.first, poses.last, last], np.clip(rows, 0, last)]))


def _starts(arm: ArmModel, point: Floats, rotation: Floats) -> Floats:
    """Return joints (k, dof) inside the limits that reach one nozzle pose, as different from each other as can be."""
    chain = kinematics(arm)
    random = np.random.default_rng(7)
    seeds = random.uniform(chain.lower, chain.upper, (SEEDS, arm.dof))
    seeds[:, ~chain.slides] = np.where(
        np.abs(seeds[:, ~chain.slides]) > np.pi, seeds[:, ~chain.slides] / 2.0, seeds[:, ~chain.slides]
    )
    goal, held = np.repeat(point[None], SEEDS, axis=0), np.repeat(rotation[None], SEEDS, axis=0)
    near = chain.nearest(goal, held, seeds)
    solved = chain.refine(goal, held, near.joints)
    joints = _wrapped(chain, solved.joints)
    good = solved.reached & ((joints >= chain.lower) & (joints <= chain.upper)).all(axis=1)
    joints = joints[good]
    kept: list[Floats] = []
    if not len(joints):
        return np.empty((0, arm.dof))
    apart = np.full(len(joints), np.inf)
    chosen = int(np.abs(joints - chain.seed).max(axis=1).argmin())
    while len(kept) < MOST_STARTS and apart[chosen] > ALIKE:
        kept.append(joints[chosen])
        apart = np.minimum(apart, np.abs(joints - joints[chosen]).max(axis=1))
        chosen = int(apart.argmax())
    return np.array(kept)


def _wrapped(chain: Kinematics, joints: Floats) -> Floats:
    """Return joints (n, dof) whose turns are as near to home as full turns and the limits allow."""
    turning = ~chain.slides
    wrapped = joints.copy()
    full = 2.0 * np.pi
    wrapped[:, turning] -= full * np.round((joints - chain.seed)[:, turning] / full)
    wrapped[:, turning] += full * ((wrapped < chain.lower)[:, turning] & (wrapped + full <= chain.upper)[:, turning])
    wrapped[:, turning] -= full * ((wrapped > chain.upper)[:, turning] & (wrapped - full >= chain.lower)[:, turning])
    return wrapped


def _followed(chain: Kinematics, starts: Floats, draw: Floats, points: Floats, rotations: Floats) -> list[Floats]:
    """Return the joints (g, dof) of every start (k, dof) that could be followed along the poses without a jump."""
    ways = [starts]
    alive = np.arange(len(starts))
    for point, rotation in zip(points[1:], rotations[1:], strict=True):
        now = ways[-1][alive]
        share = draw[alive, None]
        ahead = chain.centred(now, 1.0) - now if chain.dof > 6 and share.any() else 0.0
        count = len(alive)
        goal, held = np.repeat(point[None], count, axis=0), np.repeat(rotation[None], count, axis=0)
        solved = chain.refine(goal, held, now + share * ahead)
        met = solved.reached & (np.abs(solved.joints - now).max(axis=1) < POSTURE_JUMP)
        row = np.full_like(starts, np.nan)
        row[alive] = solved.joints
        ways.append(row)
        alive = alive[met]
        if not len(alive):
            return []
    whole = np.array(ways)
    return [whole[:, k] for k in alive]


def _turned_back(arm: ArmModel, ways: list[Floats]) -> list[Floats]:
    """Return ways (g, dof) brought into the joints' ranges by full turns, where there are such."""
    lower, upper = np.array(arm.limits.lower), np.array(arm.limits.upper)
    turning = ~kinematics(arm).slides
    found = []
    for way in ways:
        middle = 0.5 * (way.min(axis=0) + way.max(axis=0))
        turns = np.where(turning, np.round((0.5 * (lower + upper) - middle) / (2.0 * np.pi)), 0.0)
        inside = ((way >= lower) & (way <= upper)).all(axis=0)
        found.append(way + np.where(inside, 0.0, 2.0 * np.pi * turns))
    return found


def _possible(arm: ArmModel, way: Floats) -> bool:
    inside = (way >= np.array(arm.limits.lower)).all() and (way <= np.array(arm.limits.upper)).all()
    return bool(inside) and not (singular_values(arm, way) < SINGULAR).any()
