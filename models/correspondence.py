"""Demonstrations laid upon each other: what both pipelines hand to the clock and the mixture."""

from dataclasses import dataclass

import numpy as np

from models.alignment import warp, warp_fast
from models.cleaning import CleanMotion
from models.demonstration import Floats
from models.phase import at

MOST_SAMPLES = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Correspondence:
    """u motions at the same n instants of the task; NaN where a motion has nothing to say.

    ``points`` (u, n, d) in m; ``times`` (u, n): each motion's own time in s; ``triggers`` (u, n), 0..1;
    ``orientations`` (u, n, 4) or None.
    """

    points: Floats
    times: Floats
    triggers: Floats
    orientations: Floats | None


def to_longest(motions: list[CleanMotion], method: str, radius: int) -> tuple[Correspondence, Floats]:
    """Return motions warped to the one with most samples, sample for sample of it, and its times (n,): as the paper does."""
    reference = motions[int(np.argmax([len(motion.times) for motion in motions]))]
    stride = -(-len(reference.times) // MOST_SAMPLES) if method == "dtw" else 1
    places = np.arange(0, len(reference.times), stride)
    positions = []
    for motion in motions:
        if method == "fastdtw":
            positions.append(warp_fast(reference.points, motion.points, radius))
        else:
            grid = np.linspace(0, len(motion.times) - 1, min(len(motion.times), MOST_SAMPLES))
            other = at(grid, np.arange(len(motion.times)), motion.points)
            found = warp(reference.points[places], other[None]).positions[0]
            positions.append(np.interp(found, np.arange(len(grid)), grid))
    return taken_at(motions, np.stack(positions)), reference.times[places]


def taken_at(motions: list[CleanMotion], positions: Floats) -> Correspondence:
    """Return the motions at fractional sample positions (u, n); NaN positions give NaN."""
    points, times, triggers, orientations = [], [], [], []
    for motion, where in zip(motions, positions, strict=True):
        index = np.arange(len(motion.times), dtype=np.float64)
        known = np.interp(where, index, motion.known.astype(np.float64)) > 0.5
        blank = np.where(known & np.isfinite(where), 0.0, np.nan)
        points.append(at(where, index, motion.points) + blank[:, None])
        times.append(np.interp(where, index, motion.times) + blank)
        triggers.append(np.interp(where, index, motion.triggers.astype(np.float64)) + blank)
        if motion.orientations is not None:
            orientations.append(at(where, index, motion.orientations) + blank[:, None])
    carried = np.stack(orientations) if len(orientations) == len(motions) else None
    return Correspondence(np.stack(points), np.stack(times), np.stack(triggers), carried)
