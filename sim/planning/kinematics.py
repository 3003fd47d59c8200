"""Where the nozzle is for given joints, and the joints for a given nozzle pose: batches of poses at once, in numpy.

Forward kinematics and the geometric Jacobian follow Siciliano et al., Robotics (2009), sections 2.7 and 3.1; the
inverse is Newton's method with damped least squares (section 3.7) along a straight way from one common seed, the
arm's home. So the joints are a function of the pose alone: no history, no drift from part to part, the same numbers
in any batch.

Arrays inside keep the batch in their last axis and use element-wise arithmetic only, no BLAS: a pose gives bitwise
the same joints whatever stands beside it, and a step costs about a microsecond.
"""

from dataclasses import dataclass
from functools import lru_cache
from xml.etree import ElementTree

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from sim.arm_model import ArmModel, Floats

FEWEST_AXES, MOST_AXES = 3, 7
STAGES = 2
POLISH = 14
# With fewer than six axes a rest of the turn stays, and Newton's steps shrink by a factor only.
POLISH_FEW = 60
DAMPING = 1e-9
TOLERANCE = 1e-12
CHUNK = 2048
REACHED = 1e-9
LONG_STRIDE = 6
KINDS = ("revolute", "continuous", "prismatic", "fixed")
# Below this share of the largest, a direction in which the axes can turn the nozzle is none.
TURNS_NOT = 1e-6


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint of the chain: constant offset from the frame before it, then a turn about ``axis`` or a slide along it.

    ``axis`` None: fixed.
    """

    name: str
    parent: str
    child: str
    offset: Floats
    rotation: Floats
    axis: Floats | None
    slides: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class InverseResult:
    """Joints (n, dof) in rad or m, and how far the nozzle is from each pose asked for: (n,) in m and (n,) in rad.

    For an arm of fewer than six axes the angle is only what the axes could still turn towards the pose.
    """

    joints: Floats
    position_error: Floats
    angle_error: Floats

    @property
    def reached(self) -> np.ndarray:
        """Return which poses are reached, to a nanometre and a nanoradian."""
        return (self.position_error < REACHED) & (self.angle_error < REACHED)


class Kinematics:
    """The chain from an arm's base to its nozzle tip."""

    def __init__(
        self, urdf: str, tip: str, seed: tuple[float, ...], lower: tuple[float, ...], upper: tuple[float, ...]
    ):
        self.joints = _chain(urdf, tip)
        self.slides = np.array([joint.slides for joint in self.joints if joint.axis is not None], dtype=bool)
        self.dof = len(self.slides)
        if not FEWEST_AXES <= self.dof <= MOST_AXES:
            raise ValueError(f"the description has {self.dof} moving joints: arms of {FEWEST_AXES} to {MOST_AXES} plan")
        if self.dof != len(seed):
            raise ValueError(f"the description has {self.dof} moving joints and the home position {len(seed)} values")
        self.seed = np.array(seed)
        self.lower, self.upper = np.array(lower), np.array(upper)
        position, rotation = self.forward(self.seed[None])
        self.seed_position, self.seed_rotation = position[0], rotation[0]

    def forward(self, joints: Floats) -> tuple[Floats, Floats]:
        """Return nozzle tip positions (n, 3) in m and rotations (n, 3, 3) in the base frame for joints (n, dof)."""
        columns, position, _, _ = self._sweep(np.ascontiguousarray(joints.T))
        return position.T.copy(), np.stack(columns, axis=1).transpose(2, 0, 1)

    def jacobian(self, joints: Floats) -> Floats:
        """Return the geometric Jacobian (n, 6, dof) of the nozzle tip in the base frame: m/s then rad/s per rad/s."""
        _, position, axes, origins = self._sweep(np.ascontiguousarray(joints.T))
        return _columns_of_jacobian(position, axes, origins, self.slides).transpose(2, 1, 0)

    def frames(self, joints: Floats) -> dict[str, tuple[Floats, Floats]]:
        """Return for every link of the chain its position (n, 3) and rotation (n, 3, 3) in the base frame."""
        links: dict[str, tuple[list[Floats], Floats]] = {}
        self._sweep(np.ascontiguousarray(joints.T), links)
        return {
            name: (position.T.copy(), np.stack(columns, axis=1).transpose(2, 0, 1))
            for name, (columns, position) in links.items()
        }

    def inverse(self, positions: Floats, rotations: Floats) -> InverseResult:
        """Return joints whose nozzle pose is nearest to positions (n, 3) with rotations (3, 3) or (n, 3, 3).

        Joint limits are not enforced on a pose that is reached: a joint outside is for the checks to name. A pose
        that cannot be reached gets the nearest joints found inside the limits.
        """
        parts = [
            self._inverse(positions[i : i + CHUNK], rotations if rotations.ndim == 2 else rotations[i : i + CHUNK])
            for i in range(0, len(positions), CHUNK)
        ]
        if not parts:
            return InverseResult(np.empty((0, self.dof)), np.empty(0), np.empty(0))
        return InverseResult(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def refine(self, positions: Floats, rotations: Floats, seeds: Floats) -> InverseResult:
        """Return joints for nozzle poses by Newton's steps from seeds (n, dof) near them; what is not met is told."""
        parts = []
        for i in range(0, len(positions), CHUNK):
            part = slice(i, i + CHUNK)
            n = len(positions[part])
            wanted = _columns(rotations if rotations.ndim == 2 else rotations[part], n)
            parts.append(self._polish(seeds[part].T.copy(), np.ascontiguousarray(positions[part].T), wanted))
        if not parts:
            return InverseResult(np.empty((0, self.dof)), np.empty(0), np.empty(0))
        return InverseResult(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def along(self, positions: Floats, rotation: Floats, start: Floats) -> InverseResult:
        """Return joints that follow nozzle positions (n, 3) on a line from ``start`` (dof,), n at least 4.

        In long strides one after the other first, each near the one before; then all of them near those.
        """
        rows = np.unique(np.linspace(0, len(positions) - 1, max(4, len(positions) // LONG_STRIDE)).astype(int))
        found = [self.refine(positions[:1], rotation, start[None]).joints]
        for row in rows[1:]:
            ahead = found[-1] if len(found) < 2 else 2.0 * found[-1] - found[-2]
            found.append(self.refine(positions[row][None], rotation, ahead).joints)
        between = scipy.interpolate.CubicSpline(rows, np.concatenate(found))
        return self.refine(positions, rotation, between(np.arange(len(positions))))

    def nearest(self, positions: Floats, rotations: Floats, seeds: Floats) -> InverseResult:
        """Return joints inside the limits as near to nozzle poses as is found from seeds (n, dof) far away."""
        goal, wanted = np.ascontiguousarray(positions.T), _columns(rotations, len(positions))
        q, distance, angle = self._nearest(goal, wanted, seeds.T.copy())
        return InverseResult(q.T.copy(), distance, angle)

    def spare(self, joints: Floats, moves: Floats) -> Floats:
        """Return the part of moves (n, dof) at joints (n, dof) that leaves the nozzle where it is."""
        q, move = np.ascontiguousarray(joints.T), np.ascontiguousarray(moves.T)
        _, position, axes, origins = self._sweep(q)
        jacobian = _columns_of_jacobian(position, axes, origins, self.slides)
        weights = _solve(jacobian, _total([jacobian[k] * move[k] for k in range(self.dof)]), DAMPING)
        return (move - _total([jacobian[:, k] * weights[k] for k in range(6)])).T.copy()

    def centred(self, joints: Floats, share: float) -> Floats:
        """Return joints (n, dof) moved towards the middle of their ranges, as far as the nozzle stays where it is."""
        if self.dof <= 6:
            return joints
        pull = share * (0.5 * (self.lower + self.upper) - joints)
        return joints + self.spare(joints, pull)

    def _inverse(self, positions: Floats, rotations: Floats) -> tuple[Floats, Floats, Floats]:
        n = len(positions)
        goal = np.ascontiguousarray(positions.T)
        turn = Rotation.from_matrix(rotations @ self.seed_rotation.T).as_rotvec()
        q = np.repeat(self.seed[:, None], n, axis=1)
        start = self.seed_position[:, None]
        for stage in range(1, STAGES + 1):
            part = stage / STAGES
            way = (Rotation.from_rotvec(part * turn) * Rotation.from_matrix(self.seed_rotation)).as_matrix()
            step, _, _ = self._step(q, start + part * (goal - start), _columns(way, n), DAMPING)
            q += step
        wanted = _columns(np.asarray(rotations), n)
        joints, distance, angle = self._polish(q, goal, wanted)
        lost = np.flatnonzero((distance > REACHED) | (angle > REACHED) | ~np.isfinite(joints).all(axis=1))
        if len(lost):
            seeds = np.repeat(np.clip(self.seed, self.lower, self.upper)[:, None], len(lost), axis=1)
            found, distance[lost], angle[lost] = self._nearest(goal[:, lost], [c[:, lost] for c in wanted], seeds)
            joints[lost] = found.T
        return joints, distance, angle

    def _polish(self, q: Floats, goal: Floats, wanted: list[Floats]) -> tuple[Floats, Floats, Floats]:
        """Return joints (n, dof) after Newton's steps from ``q`` (dof, n), and the errors left."""
        n = q.shape[1]
        active = np.arange(n)
        distance, angle = np.full(n, np.inf), np.full(n, np.inf)
        for _ in range(POLISH if self.dof >= 6 else POLISH_FEW):
            everything = len(active) == n
            now, there = (q, goal) if everything else (q[:, active], goal[:, active])
            turned = wanted if everything else [c[:, active] for c in wanted]
            step, distance[active], angle[active] = self._step(now, there, turned, DAMPING, TOLERANCE)
            going = (distance[active] > TOLERANCE) | (angle[active] > TOLERANCE)
            if not going.any():
                break
            q[:, active] += np.where(going, np.clip(step, -0.5, 0.5), 0.0)
            active = active[going]
        return q.T.copy(), distance, angle

    def _nearest(self, goal: Floats, wanted: list[Floats], q: Floats) -> tuple[Floats, Floats, Floats]:
        """Return joints inside the limits with the least pose error found from joints ``q`` (dof, n).

        Levenberg-Marquardt, one damping a pose.
        """
        n = goal.shape[1]
        lower, upper = self.lower[:, None], self.upper[:, None]
        damping = np.full(n, 1e-2)
        _, distance, angle = self._step(q, goal, wanted, damping)
        for _ in range(60):
            step, _, _ = self._step(q, goal, wanted, damping)
            trial = np.clip(q + np.clip(step, -0.3, 0.3), lower, upper)
            _, near, turn = self._step(trial, goal, wanted, damping)
            better = near**2 + (0.2 * turn) ** 2 < distance**2 + (0.2 * angle) ** 2
            q = np.where(better, trial, q)
            distance, angle = np.where(better, near, distance), np.where(better, turn, angle)
            damping = np.clip(np.where(better, damping * 0.3, damping * 4), 1e-9, 1e3)
        return q, distance, angle

    def _step(
        self, q: Floats, goal: Floats, wanted: list[Floats], damping: float | Floats, enough: float = 0.0
    ) -> tuple[Floats, Floats, Floats]:
        """Return the damped least-squares step (dof, n) towards the goal, and the errors (n,) in m and rad before.

        The step is zero if every error is small ``enough`` already.
        """
        columns, position, axes, origins = self._sweep(q)
        error = np.empty((6, q.shape[1]))
        away, twist = error[:3], error[3:]
        np.subtract(goal, position, out=away)
        _turn_between(columns, wanted, twist)
        distance = np.sqrt(_squared(away))
        cosine = 0.5 * (_total([c * w for c, w in zip(columns, wanted, strict=True)]).sum(axis=0) - 1.0)
        angle = np.arctan2(np.sqrt(_squared(twist)), np.clip(cosine, -1.0, 1.0))
        if distance.max(initial=0.0) <= enough and angle.max(initial=0.0) <= enough:
            return np.zeros_like(q), distance, angle
        jacobian = _columns_of_jacobian(position, axes, origins, self.slides)
        if self.dof < 6:
            step, angle = _step_of_few(jacobian, error, columns[2], damping)
            return step, distance, angle
        weights = _solve(jacobian, error, damping)
        return _total([jacobian[:, k] * weights[k] for k in range(6)]), distance, angle

    def _sweep(
        self, q: Floats, links: dict[str, tuple[list[Floats], Floats]] | None = None
    ) -> tuple[list[Floats], Floats, list[Floats], list[Floats]]:
        """Walk the chain for joints (dof, n).

        Columns of the tip's rotation, its position, and every joint's axis and origin.
        """
        n = q.shape[1]
        columns = [np.repeat(np.eye(3)[:, [k]], n, axis=1) for k in range(3)]
        position = np.zeros((3, n))
        cosines, sines = np.cos(q), np.sin(q)
        axes: list[Floats] = []
        origins: list[Floats] = []
        moving = 0
        if links is not None:
            links["base"] = ([c.copy() for c in columns], position.copy())
        for joint in self.joints:
            position = position + _combine(columns, joint.offset, n)
            columns = [_combine(columns, joint.rotation[:, k], n) for k in range(3)]
            if joint.axis is not None:
                axis = _combine(columns, joint.axis, n)
                axes.append(axis)
                origins.append(position)
                if joint.slides:
                    position = position + axis * q[moving]
                else:
                    columns = _turn(columns, joint.axis, axis, cosines[moving], sines[moving])
                moving += 1
            if links is not None:
                links[joint.child] = ([c.copy() for c in columns], position.copy())
        return columns, position, axes, origins


@lru_cache(maxsize=16)
def kinematics(model: ArmModel) -> Kinematics:
    """Return the kinematics of an arm's nozzle tip; made once for each arm."""
    return Kinematics(model.urdf, model.tool.tip, model.home, model.limits.lower, model.limits.upper)


def _combine(columns: list[Floats], weights: Floats, n: int) -> Floats:
    """Return the sum of columns times constant weights: skips what is zero, so right angles cost nothing."""
    total: Floats | None = None
    for column, weight in zip(columns, weights, strict=True):
        if weight != 0.0:
            term = column if weight == 1.0 else column * weight
            total = term if total is None else total + term
    return np.zeros((3, n)) if total is None else total


def _turn(columns: list[Floats], axis: Floats, world: Floats, cosine: Floats, sine: Floats) -> list[Floats]:
    """Turn a frame about its own ``axis``; ``world`` is that axis in the base frame. Rodrigues' formula."""
    if axis[2] == 1.0:
        x, y, z = columns
        return [x * cosine + y * sine, y * cosine - x * sine, z]
    return [c * cosine + _cross(world, c) * sine + world * (axis[k] * (1.0 - cosine)) for k, c in enumerate(columns)]


def _total(terms: list[Floats]) -> Floats:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def _cross(a: Floats, b: Floats) -> Floats:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _turn_between(columns: list[Floats], wanted: list[Floats], out: Floats) -> None:
    """Write half the sum of the cross products of two frames' columns: the axis times the sine of the turn."""
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        out[k] = 0.5 * _total([c[a] * w[b] - c[b] * w[a] for c, w in zip(columns, wanted, strict=True)])


def _squared(rows: Floats) -> Floats:
    return rows[0] * rows[0] + rows[1] * rows[1] + rows[2] * rows[2]


def _columns(rotations: Floats, n: int) -> list[Floats]:
    """Return the three columns (3, n) of one rotation for all, or of one rotation for each."""
    if rotations.ndim == 2:
        return [np.repeat(rotations[:, [k]], n, axis=1) for k in range(3)]
    return [np.ascontiguousarray(rotations[:, :, k].T) for k in range(3)]


def _columns_of_jacobian(position: Floats, axes: list[Floats], origins: list[Floats], slides: np.ndarray) -> Floats:
    """Return the columns (dof, 6, n) of the geometric Jacobian; ``slides`` (dof,) go along their axis."""
    axis, arm = np.stack(axes, axis=1), position[:, None] - np.stack(origins, axis=1)
    jacobian = np.empty((axis.shape[1], 6, axis.shape[2]))
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        jacobian[:, k] = axis[a] * arm[b] - axis[b] * arm[a]
        jacobian[:, k + 3] = axis[k]
    if slides.any():
        jacobian[slides, :3] = axis[:, slides].transpose(1, 0, 2)
        jacobian[slides, 3:] = 0.0
    return jacobian


def _step_of_few(jacobian: Floats, error: Floats, nozzle: Floats, damping: float | Floats) -> tuple[Floats, Floats]:
    """Return the step (dof, n) of an arm with fewer than six axes, and what of the turn (n,) it could still make.

    The place comes first; what the axes can do without moving the tip turns it as near to the pose as they allow.
    With five axes that is the nozzle's axis (3, n) alone: the turn about it is free.
    """
    columns, wanted = jacobian.transpose(2, 1, 0), error.T[:, :, None]
    dof, axis = columns.shape[2], nozzle.T[:, :, None]
    shift, turn, away, twist = columns[:, :3], columns[:, 3:], wanted[:, :3], wanted[:, 3:]
    if dof == 5:
        across = np.eye(3) - axis @ axis.transpose(0, 2, 1)
        turn, twist = across @ turn, across @ twist
    back = shift.transpose(0, 2, 1)
    damped = shift @ back + np.asarray(damping).reshape(-1, 1, 1) * np.eye(3)
    inverse = back @ np.linalg.inv(damped)
    step = inverse @ away
    free = turn @ (np.eye(dof) - inverse @ shift)
    useful, size, directions = np.linalg.svd(free, full_matrices=False)
    reach = np.where(size > TURNS_NOT, 1.0 / np.maximum(size, TURNS_NOT), 0.0)
    ahead = useful.transpose(0, 2, 1) @ (twist - turn @ step)
    step = step + directions.transpose(0, 2, 1) @ (reach[:, :, None] * ahead)
    left = (useful.transpose(0, 2, 1) @ twist)[:, :, 0] * (size > TURNS_NOT)
    return np.ascontiguousarray(step[:, :, 0].T), np.sqrt((left**2).sum(axis=1))


def _solve(jacobian: Floats, error: Floats, damping: float | Floats) -> Floats:
    """Solve (J J^T + damping I) x = error, (6, n), for Jacobian columns (dof, 6, n) by L D L^T, upper rows only."""
    rows: list[Floats] = []
    for k in range(6):
        row = np.empty((7 - k, error.shape[1]))
        np.multiply(jacobian[0, k], jacobian[0, k:], out=row[:-1])
        for column in jacobian[1:]:
            row[:-1] += column[k] * column[k:]
        row[0] += damping
        row[-1] = error[k]
        rows.append(row)
    for k in range(6):
        row = rows[k]
        scaled = row[1:] / np.maximum(row[0], 1e-18)
        for i in range(k + 1, 6):
            rows[i] -= row[i - k] * scaled[i - k - 1 :]
        rows[k] = scaled
    x = np.empty_like(error)
    for k in range(5, -1, -1):
        x[k] = rows[k][-1]
        for i in range(k + 1, 6):
            x[k] -= rows[k][i - k - 1] * x[i]
    return x


def _chain(urdf: str, tip: str) -> tuple[Joint, ...]:
    """Read the joints from the base to ``tip``, in order."""
    by_child: dict[str, ElementTree.Element] = {}
    for joint in ElementTree.fromstring(urdf).findall("joint"):
        if by_child.setdefault(_link(joint, "child"), joint) is not joint:
            raise ValueError(f"link {_link(joint, 'child')!r} hangs on two joints: a chain has one before each link")
    joints: list[Joint] = []
    link = tip
    while link in by_child:
        if len(joints) == len(by_child):
            raise ValueError(f"the joints before {tip!r} go round in a circle: a chain has to begin somewhere")
        element = by_child[link]
        origin = element.find("origin")
        offset = _numbers(origin.get("xyz") if origin is not None else None)
        angles = _numbers(origin.get("rpy") if origin is not None else None)
        rotation = Rotation.from_euler("xyz", angles).as_matrix()
        rotation[np.abs(rotation) < 1e-15] = 0.0
        rotation[np.abs(np.abs(rotation) - 1.0) < 1e-15] = np.sign(rotation[np.abs(np.abs(rotation) - 1.0) < 1e-15])
        name, kind, axis = element.get("name", ""), element.get("type", ""), None
        if kind not in KINDS:
            raise ValueError(f"joint {name!r} is of type {kind!r}: it has to be one of {', '.join(KINDS)}")
        if element.find("mimic") is not None:
            raise ValueError(f"joint {name!r} copies another one (mimic): every joint has to move on its own")
        if kind != "fixed":
            tag = element.find("axis")
            axis = _numbers(tag.get("xyz") if tag is not None else "1 0 0")
            size = float(np.linalg.norm(axis))
            if not size > 0.0:
                raise ValueError(f"the axis of joint {name!r} is {axis.tolist()}: it has to have a direction")
            axis = axis / size
        parent = _link(element, "parent")
        joints.append(Joint(name, parent, link, offset, rotation, axis, kind == "prismatic"))
        link = parent
    if not joints:
        raise ValueError(f"the description has no link {tip!r} at the end of a chain")
    return tuple(reversed(joints))


def _link(joint: ElementTree.Element, end: str) -> str:
    tag = joint.find(end)
    return "" if tag is None else tag.get("link", "")


def _numbers(text: str | None) -> Floats:
    values = np.array([float(value) for value in (text or "0 0 0").split()])
    if values.shape != (3,) or not np.isfinite(values).all():
        raise ValueError(f"the description has {text!r} where three finite numbers have to be")
    return values
