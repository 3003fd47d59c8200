"""Corner meets corner to the sample: where each drawing's own tip is, and all laid upon each other there.

A warp matches corners to about a point of the resampled drawings. Where a path turns back on itself, the mean of
drawings that are a point apart is short by as much. So at each sharp corner of the common shape every drawing lies with
its own outermost sample, and passes from there evenly, by its own length, to where the warp counts again.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from models.alignment.registration import skips, touched
from models.demonstration import Bools, Floats
from models.geometry import diagonal
from models.phase import corners, from_chord
from models.preprocessing.filtering import CleanMotion

CORNER = 0.02
SHARP = np.deg2rad(60.0)
REACH = 0.04
BESIDE = 0.05
LEAST_EDGE = 0.015
LEAST_SAMPLES = 4
OUTERMOST = 0.85
LEAST_DEPTH = 0.5


class SharpCorner(NamedTuple):
    """A corner of a shape and where what turns there begins and ends, as indices of the shape; ``depth`` in m is how
    far the tip is from the straight line between those.
    """

    before: int
    tip: int
    after: int
    depth: float


def sharp_corners(shape: Floats) -> tuple[SharpCorner, ...]:
    """Return the corners of a shape (n, d) at which it turns by 60 degrees or more within 4 % of its points.

    Where an edge beside a corner is shorter than 1.5 % of it all, hands differ by as much as the edge is long, and the
    warp knows better than a tip.
    """
    found = corners(shape, CORNER * diagonal(shape))
    reach = round(REACH * len(shape))
    sharp: list[SharpCorner] = []
    for before, tip, after in zip(found, found[1:], found[2:], strict=False):
        if min(tip - before, after - tip) < LEAST_EDGE * len(shape):
            continue
        low, high = max(before, tip - reach), min(after, tip + reach)
        there, back = shape[tip] - shape[low], shape[high] - shape[tip]
        turned = (there * back).sum() / max(float(np.sqrt((there * there).sum() * (back * back).sum())), 1e-300)
        if turned <= np.cos(SHARP):
            sharp.append(SharpCorner(low, tip, high, float(from_chord(shape[low : high + 1])[tip - low])))
    return tuple(sharp)


def laid_at_tips(
    motions: Sequence[CleanMotion], places: Floats, positions: Floats, sharp: Sequence[SharpCorner]
) -> Floats:
    """Return positions (u, n) of drawings with their own tips where the common shape's sharp corners are.

    ``places`` (u, n): the fractional sample of each motion at each position. A tip is the middle one of the samples
    furthest, within 15 %, from the straight line between those where the turn begins and ends: hands rest at corners,
    and tremble there. Who has not drawn all of it, or more than it, keeps the warp's positions.
    """
    if not sharp:
        return positions
    positions, count = positions.copy(), positions.shape[1]
    skipped = skips(positions, count)
    borders = [0, *(corner.tip for corner in sharp), count - 1]
    beside = round(BESIDE * count)
    for corner, earlier, later in zip(sharp, borders, borders[2:], strict=False):
        left, right = max(earlier, corner.tip - beside), min(later, corner.tip + beside)
        stretch = positions[:, left : right + 1]
        whole: Bools = np.asarray(np.isfinite(stretch).all(axis=1) & ~touched(skipped, count, left, right))
        turns = positions[:, [max(left, corner.before), min(right, corner.after)]]
        tips = np.full(len(positions), np.nan)
        for row, motion in enumerate(motions):
            if whole[row]:
                tips[row] = _tip(motion, places[row], turns[row], LEAST_DEPTH * corner.depth)
        known = np.isfinite(tips)
        into = np.linspace(stretch[known, 0], tips[known], corner.tip - left + 1, axis=1)
        out_of = np.linspace(tips[known], stretch[known, -1], right - corner.tip + 1, axis=1)
        stretch[known] = np.concatenate([into, out_of[:, 1:]], axis=1)
    return positions


def _tip(motion: CleanMotion, places: Floats, turn: Floats, least: float) -> float:
    """Return the position of the tip between the positions at which a turn begins and ends; NaN if hardly a sample is
    there, or none ``least`` m from the straight line between them: then the tip is hardly inside.
    """
    index = np.arange(len(places), dtype=np.float64)
    begun, ended = np.interp(turn, index, places)
    first, last = int(np.ceil(begun)), int(ended)
    if last - first + 1 < LEAST_SAMPLES:
        return float("nan")
    away = from_chord(motion.points[first : last + 1])
    if away.max() < least:
        return float("nan")
    outermost = np.flatnonzero(away >= OUTERMOST * away.max())
    middle = first + 0.5 * (outermost[(len(outermost) - 1) // 2] + outermost[len(outermost) // 2])
    return float(np.interp(middle, places, index))
