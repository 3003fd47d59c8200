"""Whether an arm could have run an order after all: tried from very many joints, without any of the planner's choices.

Every start that reaches the first pose is dragged along approach, path and retract by damped least squares, a spare
joint drifting at random. What stays in range, away from singular positions and clear of everything could have been
planned.
"""

import numpy as np
from numpy.typing import NDArray
from random_orders import Case
from scipy.spatial.transform import Rotation

from sim.planning.checks import MOST_LEAN
from sim.planning.clearance import Cell, check_clearance, part_box
from sim.planning.kinematics import Kinematics, kinematics
from sim.planning.path import ToolPath
from sim.planning.tool_orientation import Holding

Floats = NDArray[np.float64]
STARTS, STRIDE, TURN = 500, 2e-3, 0.04
REACH, SINGULAR = 1e-7, 0.03


def could_be_run(case: Case, seed: int = 5) -> bool:
    """Return whether some joints follow an order's poses from above its start to above its end."""
    arm, order = case.arm, case.order
    chain = kinematics(arm)
    path = ToolPath(case.motion, order.frame, order.standoff, order.blend_radius)  # pyright: ignore[reportArgumentType]
    points, rotations = _poses(path, Holding(path, arm, order.nozzle_turn), order.approach_height, order.retract_height)
    low, high = np.array(arm.workspace_low), np.array(arm.workspace_high)
    if (points < low - 1e-9).any() or (points > high + 1e-9).any():
        return False
    boxes = (Cell().table(), part_box(path.points(path.lengths), order.frame, 0.0))
    none = np.full(1, np.nan)
    if check_clearance(arm, np.array([arm.home]), none, none, boxes)[0]:
        return False
    random = np.random.default_rng(seed)
    now = random.uniform(np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi), (STARTS, arm.dof))
    for _ in range(120):
        now = np.clip(
            now + np.clip(_step(chain, now, points[0], rotations[0], 1e-4), -0.2, 0.2), chain.lower, chain.upper
        )
    now = now[_met(chain, now, points[0], rotations[0]) & _inside(chain, now)]
    drift = random.normal(size=now.shape) * 0.01
    ways = [now]
    for point, rotation in zip(points[1:], rotations[1:], strict=True):
        if not len(now):
            return False
        before = now
        if arm.dof > 6:
            now = now + _spare(chain, now, drift)
        for _ in range(4):
            now = now + _step(chain, now, point, rotation, 1e-9)
        good = _met(chain, now, point, rotation) & _inside(chain, now) & (np.abs(now - before).max(axis=1) < 0.4)
        good &= np.linalg.svd(chain.jacobian(now), compute_uv=False)[:, -1] >= SINGULAR
        now, drift, ways = now[good], drift[good], [way[good] for way in ways]
        ways.append(now)
    whole = np.array(ways)[::4]
    none = np.full(len(whole), np.nan)
    return any(not check_clearance(arm, whole[:, k], none, none, boxes)[0] for k in range(whole.shape[1]))


def _poses(path: ToolPath, held: Holding, above: float, beyond: float) -> tuple[Floats, Floats]:
    points = path.points(path.lengths)
    rotations = np.broadcast_to(held.at_lengths(path.lengths), (len(points), 3, 3))
    up = path.rotation[:, 2]
    down, lift = (
        points[0] + np.linspace(above, 0.0, 40)[:, None] * up,
        points[-1] + np.linspace(0, beyond, 40)[:, None] * up,
    )
    points = np.concatenate([down, points[1:], lift[1:]])
    rotations = np.concatenate([[rotations[0]] * 40, rotations[1:], [rotations[-1]] * 39])
    turns = Rotation.from_matrix(rotations)
    moved = (
        np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)) / STRIDE + (turns[1:] * turns[:-1].inv()).magnitude() / TURN
    )
    along = np.concatenate([[0.0], np.cumsum(moved)])
    rows = np.unique(np.append(np.searchsorted(along, np.arange(0.0, along[-1])), len(points) - 1))
    return points[rows], rotations[rows]


def _errors(chain: Kinematics, joints: Floats, point: Floats, rotation: Floats) -> Floats:
    position, turned = chain.forward(joints)
    twist = (Rotation.from_matrix(rotation) * Rotation.from_matrix(turned).inv()).as_rotvec()
    return np.concatenate([point - position, twist], axis=1)


def _step(chain: Kinematics, joints: Floats, point: Floats, rotation: Floats, damping: float) -> Floats:
    if chain.dof < 6:
        count = len(joints)
        goal, held = np.repeat(point[None], count, axis=0), np.repeat(rotation[None], count, axis=0)
        return chain.refine(goal, held, joints).joints - joints
    jacobian = chain.jacobian(joints)
    back = jacobian.transpose(0, 2, 1)
    square = jacobian @ back + damping * np.eye(6)
    return (back @ np.linalg.solve(square, _errors(chain, joints, point, rotation)[:, :, None]))[:, :, 0]


def _spare(chain: Kinematics, joints: Floats, drift: Floats) -> Floats:
    jacobian = chain.jacobian(joints)
    return drift - (np.linalg.pinv(jacobian) @ (jacobian @ drift[:, :, None]))[:, :, 0]


def _met(chain: Kinematics, joints: Floats, point: Floats, rotation: Floats) -> NDArray[np.bool_]:
    errors = np.abs(_errors(chain, joints, point, rotation))
    if chain.dof < 6:
        # Few axes lean the nozzle, but not by more than is of use.
        along = chain.forward(joints)[1][:, :, 2] @ rotation[:, 2]
        return (errors[:, :3].max(axis=1) < REACH) & (along > np.cos(np.deg2rad(MOST_LEAN)))
    return errors.max(axis=1) < REACH


def _inside(chain: Kinematics, joints: Floats) -> NDArray[np.bool_]:
    return ((joints >= chain.lower) & (joints <= chain.upper)).all(axis=1)
