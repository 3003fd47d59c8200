"""How fast an arm may go through what is sharper than the grid on which its path is known: corners of the way, and
places where the tool was turned at once.

There the derivatives on the grid say nothing. What counts is what an arm is sent: the cubics through samples a time
step apart, tried at every speed on a finer grid, wherever the samples may fall.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np

from sim.arm_model import Floats, Limits

# A joint way that bends by more than this share of itself from one place to the next is looked at closely.
SUDDEN, LEAST = 0.1, 1e-9
FINER, AROUND, MOST_NODES = 16, 8, 400
LADDER = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
USED = 0.9
# The spline's second derivative at a sample is this weighted sum of the second differences around it.
WEIGHTS = np.sqrt(3.0) * (np.sqrt(3.0) - 2.0) ** np.abs(np.arange(-3, 4))


def curvature(points: Floats, lengths: Floats) -> Floats:
    """Return the curvature (g,) in 1/m of the nozzle's way through points (g, 3)."""
    first = np.gradient(points, lengths, axis=0)
    second = np.gradient(first, lengths, axis=0)
    return np.sqrt((np.cross(first, second) ** 2).sum(axis=1))


def corner_speeds(
    lengths: Floats, joints: Floats, exact: Callable[[Floats], Floats], limits: Limits, step: float
) -> Iterator[tuple[np.ndarray, float]]:
    """Yield places (k,) of the grid at which the way is sharper than the grid, and the speed in m/s possible there.

    ``exact`` returns the joints at any arc lengths; ``step`` is the time in s from one sample to the next.
    """
    bend = np.abs(joints[2:] - 2.0 * joints[1:-1] + joints[:-2]).max(axis=1)
    way = 0.5 * np.abs(joints[2:] - joints[:-2]).max(axis=1)
    sharp = np.concatenate([[False], bend > SUDDEN * way + LEAST, [False]])
    if sharp.sum() > MOST_NODES:
        sharp &= np.concatenate([[0.0], bend, [0.0]]) >= np.sort(bend)[-MOST_NODES]
    nodes = np.flatnonzero(sharp)
    for group in np.split(nodes, np.flatnonzero(np.diff(nodes) > 2 * AROUND) + 1) if len(nodes) else []:
        first, last = max(0, group[0] - AROUND), min(len(lengths) - 1, group[-1] + AROUND)
        fine = np.linspace(lengths[first], lengths[last], FINER * (last - first) + 1)
        speed = _fastest(exact(fine), float(fine[1] - fine[0]), limits, step)
        if math.isfinite(speed):
            yield np.arange(max(0, group[0] - 1), min(len(lengths), group[-1] + 2)), speed


def _fastest(joints: Floats, spacing: float, limits: Limits, step: float) -> float:
    """Return the speed in m/s up to which samples of joints (n, dof), ``spacing`` m apart, keep the limits.

    Infinite where the way is not sharp at the grid's own spacing.
    """
    acceleration, jerk = USED * np.array(limits.acceleration), USED * np.array(limits.jerk)
    allowed = 0.0
    for stride in LADDER:
        speed = stride * spacing / step
        if len(joints) <= 9 * stride:
            break
        second = joints[2 * stride :] - 2.0 * joints[stride:-stride] + joints[: -2 * stride]
        around = np.array(
            [
                np.convolve(column, np.kron(WEIGHTS, np.eye(1, stride)[0])[: 6 * stride + 1], "valid")
                for column in second.T
            ]
        ).T
        push = np.abs(around) / step**2 / acceleration
        jolt = np.abs(around[stride:] - around[:-stride]) / step**3 / jerk
        worst = max(float(push.max(initial=0.0)), float(jolt.max(initial=0.0)))
        if worst > 1.0:
            return max(allowed, speed / worst)
        allowed = speed
    return math.inf
