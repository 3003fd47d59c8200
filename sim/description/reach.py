"""Which places an arm's nozzle reaches within its joints' ranges, whatever the posture."""

import numpy as np

from sim.arm_model import Bools, Floats
from sim.planning.kinematics import Kinematics

SEEDS = 8
NUMBER = 11
# What is farther than that, in m and rad, when looked for from far away is not worth Newton's steps.
NEAR, NEAR_TURN = 5e-3, 0.05


def seeds(chain: Kinematics, count: int = SEEDS) -> Floats:
    """Return joints (count, dof) to start from: home, and others all over the ranges, always the same ones."""
    random = np.random.default_rng(NUMBER)
    drawn = random.uniform(chain.lower, chain.upper, (count, chain.dof))
    far = ~chain.slides & (np.abs(drawn) > np.pi)
    drawn = np.clip(np.where(far, 0.5 * drawn, drawn), chain.lower, chain.upper)
    drawn[0] = np.clip(chain.seed, chain.lower, chain.upper)
    return drawn


def reaching(chain: Kinematics, points: Floats, rotation: Floats, starts: Floats) -> tuple[Floats, Bools]:
    """Return joints (n, k, dof) from k starts for nozzle places (n, 3), and which (n, k) reach inside the ranges."""
    count, tries = len(points), len(starts)
    goal = np.repeat(points, tries, axis=0)
    near = chain.nearest(goal, rotation, np.tile(starts, (count, 1)))
    joints, good = near.joints, np.zeros(count * tries, dtype=np.bool_)
    close = np.flatnonzero((near.position_error < NEAR) & (near.angle_error < NEAR_TURN))
    solved = chain.refine(goal[close], rotation, joints[close])
    inside = ((solved.joints >= chain.lower - 1e-9) & (solved.joints <= chain.upper + 1e-9)).all(axis=1)
    joints[close], good[close] = solved.joints, solved.reached & inside
    return joints.reshape(count, tries, chain.dof), good.reshape(count, tries)


def reachable(chain: Kinematics, points: Floats, rotation: Floats) -> Bools:
    """Return which nozzle places (n, 3) are reached with a rotation (3, 3) in any posture found."""
    found = np.asarray(reaching(chain, points, rotation, seeds(chain, 1))[1].any(axis=1), dtype=np.bool_)
    lost = np.flatnonzero(~found)
    if len(lost):
        found[lost] = reaching(chain, points[lost], rotation, seeds(chain))[1].any(axis=1)
    return found


def grid(low: Floats, high: Floats, counts: tuple[int, int, int]) -> Floats:
    """Return places (n, 3) spread evenly over a box, its faces included."""
    axes = [np.linspace(low[k], high[k], counts[k]) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
