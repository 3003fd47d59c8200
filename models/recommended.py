"""The recommended alignment: medoid reference, exact dtw on 256 points of the way, open end for who let go early."""

from dataclasses import dataclass

import numpy as np

from models.alignment import medoid, warp, warp_fast
from models.cleaning import CleanMotion
from models.correspondence import Correspondence, taken_at
from models.demonstration import Floats
from models.phase import at, travelled

POINTS = 256
MEDOID_POINTS = 64
EARLY_DISTANCE = 0.05
EARLY_PHASE = 0.98


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A motion by its way: ``positions`` (POINTS,) are fractional samples, evenly spaced along it; ``points`` (POINTS, d)."""

    positions: Floats
    points: Floats


def shape(motion: CleanMotion) -> Shape:
    """Return a motion at 256 points, evenly spaced along its way."""
    index = np.arange(len(motion.times), dtype=np.float64)
    positions = np.interp(np.linspace(0.0, 1.0, POINTS), travelled(motion), index)
    return Shape(positions, at(positions, index, motion.points))


def diagonal(points: Floats) -> float:
    """Return the diagonal in m of the box around points (..., d)."""
    reach = np.ptp(points.reshape(-1, points.shape[-1]), axis=0)
    return float(np.sqrt((reach * reach).sum()))


def to_medoid(motions: list[CleanMotion], method: str, radius: int) -> tuple[Correspondence, Floats]:
    """Return motions warped to their medoid, and how far (u,) along it, 0..1, each of them got."""
    shapes = [shape(motion) for motion in motions]
    curves = np.stack([one.points for one in shapes])
    coarse = curves[:, np.linspace(0, POINTS - 1, MEDOID_POINTS).round().astype(int)]
    reference = medoid(coarse)
    size = diagonal(curves[reference])
    away = np.sqrt(((curves[:, -1] - curves[reference, -1]) ** 2).sum(axis=1))
    open_ended = warp(curves[reference], curves, np.ones(len(motions), dtype=bool))
    early = (away > EARLY_DISTANCE * size) & (open_ended.reached < EARLY_PHASE * (POINTS - 1))
    if method == "fastdtw":
        closed = np.stack([_fast(curves[reference], curve, radius) for curve in curves])
    else:
        closed = warp(curves[reference], curves).positions
    found = np.where(early[:, None], open_ended.positions, closed)
    positions = np.stack(
        [
            np.interp(where, np.arange(POINTS), one.positions) + 0.0 * where
            for where, one in zip(found, shapes, strict=True)
        ]
    )
    clock = np.interp(shapes[reference].positions, np.arange(len(motions[reference].times)), motions[reference].times)
    reached = np.where(early, open_ended.reached / (POINTS - 1.0), 1.0)
    return taken_at(motions, positions, clock), reached


def _fast(reference: Floats, other: Floats, radius: int) -> Floats:
    path = warp_fast(reference, other, radius)
    hits = np.bincount(path[:, 0], minlength=len(reference))
    return np.bincount(path[:, 0], weights=path[:, 1], minlength=len(reference)) / hits
