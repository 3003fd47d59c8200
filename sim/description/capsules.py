"""Capsules around points: the smallest found that holds every one of them, and by how much it is too large."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from sim.arm_model import Capsule, Floats

DIGITS = 4
ROUNDING = 10.0**-DIGITS
DIRECTIONS = 600


@dataclass(frozen=True, slots=True)
class Fit:
    """A capsule that holds all points, and ``excess``: how far in m its surface is from their convex hull at most."""

    capsule: Capsule
    excess: float


def distances(points: Floats, start: Floats, end: Floats) -> Floats:
    """Return how far points (n, 3) are from the segment start-end, (n,)."""
    way = end - start
    part = np.clip((points - start) @ way / max(float(way @ way), 1e-18), 0.0, 1.0)
    return np.sqrt(((points - start - part[:, None] * way) ** 2).sum(axis=1))


def beyond(points: Floats, capsule: Capsule) -> Floats:
    """Return how far in m points (n, 3) of its link are outside of a capsule, (n,); negative inside."""
    return distances(points, np.array(capsule.start), np.array(capsule.end)) - capsule.radius


def fit(link: str, points: Floats) -> Fit:
    """Return the capsule of least volume found around points (n, 3), rounded outwards to a tenth of a millimetre."""
    corners, faces = _hull(points)
    middle = corners.mean(axis=0)
    axes = np.linalg.svd(corners - middle, full_matrices=False)[2]
    starts: list[Floats] = []
    for axis in axes:
        along = (corners - middle) @ axis
        across = np.sqrt(np.maximum(((corners - middle) ** 2).sum(axis=1) - along**2, 0.0)).max()
        low, high = along.min() + across, along.max() - across
        low, high = (low, high) if low < high else (0.5 * (low + high),) * 2
        starts.append(np.concatenate([middle + low * axis, middle + high * axis]))
    began = min(starts, key=lambda ends: _volume(ends, corners))
    options = {"maxiter": 900, "xatol": 2e-5, "fatol": 1e-9, "adaptive": True}
    best = np.asarray(minimize(_volume, began, (corners,), "Nelder-Mead", options=options).x)
    # Adding zero: no minus zeros in the file.
    rounded = np.asarray(np.round(best, DIGITS) + 0.0, dtype=np.float64)
    start, end = rounded[:3], rounded[3:]
    radius = math.ceil(float(distances(points, start, end).max()) / ROUNDING + 1e-6) * ROUNDING
    x, y, z = (float(value) for value in start)
    capsule = Capsule(link, (x, y, z), tuple(float(value) for value in end), round(radius, DIGITS))  # type: ignore[arg-type]
    return Fit(capsule, _excess(start, end, radius, corners, faces))


def _volume(ends: Floats, points: Floats) -> float:
    start, end = ends[:3], ends[3:]
    radius = float(distances(points, start, end).max())
    return math.pi * radius**2 * (float(np.linalg.norm(end - start)) + 4.0 / 3.0 * radius)


def _hull(points: Floats) -> tuple[Floats, Floats]:
    """Return the corners (m, 3) and faces (f, 4) of the convex hull; no faces where the points are flat."""
    distinct = np.unique(points, axis=0)
    try:
        hull = ConvexHull(distinct)
    except QhullError:
        return distinct, np.empty((0, 4))
    return distinct[hull.vertices], np.asarray(hull.equations)


def _excess(start: Floats, end: Floats, radius: float, corners: Floats, faces: Floats) -> float:
    """Return how far the capsule's surface is from the hull at most, at places all around."""
    k = np.arange(DIRECTIONS)
    heights, turns = 1.0 - (2.0 * k + 1.0) / DIRECTIONS, math.pi * (1.0 + math.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - heights**2)
    around = np.column_stack([ring * np.cos(turns), ring * np.sin(turns), heights])
    surface = np.concatenate(
        [one + radius * around[(around @ (one - other)) >= 0.0] for one, other in ((start, end), (end, start))]
    )
    if not len(faces):
        return float(np.sqrt(((surface[:, None] - corners[None]) ** 2).sum(axis=2)).min(axis=1).max())
    return max(0.0, float((surface @ faces[:, :3].T + faces[:, 3]).max(axis=1).max()))
