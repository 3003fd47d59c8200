"""Whether people drew in one place: two groups of them, one who is elsewhere, two of whom nobody knows who is right.

Asked of where each drawing lies on average, against how far these places scatter and how far hands waver.
"""

from dataclasses import dataclass

import numpy as np

from models.alignment.procrustes import laid_upon
from models.demonstration import Floats
from models.geometry import diagonal, middle, norms

CHANCE = (7.0, 1.6)
BANDS = 3.0
FAR = 3.5
LEAST = 0.03
WINDOW = 0.05


@dataclass(frozen=True, slots=True)
class TwoPlaces:
    """Two groups of rows, the larger one first, ``size`` m apart; ``apart``: their bands do not overlap."""

    most: tuple[int, ...]
    others: tuple[int, ...]
    size: float
    apart: bool


@dataclass(frozen=True, slots=True)
class Apart:
    """Two drawings that disagree by ``size`` m at ``place`` 0..1 of the path; None: all along it."""

    place: float | None
    size: float


def places(points: Floats) -> tuple[Floats, float]:
    """Return where each of the aligned motions (u, n, d) lies on average from the median one (u, d), in m, and how far
    hands waver beside that, root mean square.
    """
    usual = middle(points.transpose(1, 0, 2))
    offsets = points - usual
    where = np.nanmean(offsets, axis=1)
    rest = offsets - where[:, None]
    return where, float(np.sqrt(np.nanmean((rest * rest).sum(axis=2))))


def two_places(where: Floats, waver: float) -> TwoPlaces | None:
    """Return the two groups in which motions lie, None if they may well be one, by their ``places``: (u, d) and m.

    They are two if the likelihood of two places, against one, is greater than chance makes it once in 500 groups of
    normally scattered people: 7 + 1.6 u, simulated for 4 to 40 people whose places scatter 1.7 times as far as their
    hands waver (real ones: 0.6 to 1.7 times). Nobody is a group alone.
    """
    count, dimension = where.shape
    if count < 4:
        return None
    centred = where - where.mean(axis=0)
    line = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    order = np.argsort(line, kind="stable")
    along = line[order]
    rests = [
        float(((along[:k] - along[:k].mean()) ** 2).sum() + ((along[k:] - along[k:].mean()) ** 2).sum())
        for k in range(2, count - 1)
    ]
    split = 2 + int(np.argmin(rests))
    rest = min(rests) + waver * waver / dimension
    total = float((along * along).sum())
    if total <= rest or count * np.log(total / max(rest, 1e-300)) < CHANCE[0] + CHANCE[1] * count:
        return None
    groups = sorted((order[:split].tolist(), order[split:].tolist()), key=lambda group: -len(group))
    one, other = (where[group].mean(axis=0) for group in groups)
    inside = sum(float(((where[group] - where[group].mean(axis=0)) ** 2).sum()) for group in groups)
    band = np.sqrt((inside / (count - 2) + waver * waver) / dimension)
    size = float(norms(one - other))
    return TwoPlaces(tuple(sorted(groups[0])), tuple(sorted(groups[1])), size, bool(size > BANDS * 2.0 * band))


def elsewhere(where: Floats, waver: float) -> dict[int, Floats]:
    """Return who of three motions or more draws in another place than the others, by their ``places``, and how far from
    them (d,), in m: seven times as far from the middle as is usual among them and as hands waver, taken together.
    """
    count = len(where)
    if count < 3:
        return {}
    away = norms(where - middle(where))
    usual = float(np.hypot(np.median(away), waver))
    far = [int(row) for row in np.argsort(-away, kind="stable")[: (count - 1) // 2] if away[row] > 2.0 * FAR * usual]
    kept = [row for row in range(count) if row not in far]
    return {row: where[row] - where[kept].mean(axis=0) for row in far}


def disagreement(points: Floats) -> Apart | None:
    """Return where and by how much two motions (2, n, d) disagree, None if no more than hands waver.

    They do if their places are 3.5 times as far apart as they waver beside that, or if they are somewhere, once laid
    upon each other, 3.5 times as far apart as usual; and by 3 % of the drawing.
    """
    size = diagonal(np.nanmean(points, axis=0))
    difference = points[1] - points[0]
    known = np.isfinite(difference[:, 0])
    offset = difference[known].mean(axis=0)
    rest = float(np.sqrt(((difference[known] - offset) ** 2).sum(axis=1).mean()))
    away = float(norms(offset))
    if away > FAR * rest and away > LEAST * size:
        return Apart(None, away)
    one, other = laid_upon(points, np.nanmean(points, axis=0))
    distances = np.nan_to_num(norms(other - one))
    width = max(1, round(WINDOW * len(distances)))
    windows = np.convolve(distances, np.full(width, 1.0 / width), mode="valid")
    worst = int(windows.argmax())
    if windows[worst] > FAR * float(np.median(windows)) and windows[worst] > LEAST * size:
        peak = worst + int(distances[worst : worst + width].argmax())
        return Apart(peak / (len(distances) - 1), float(norms(difference[peak])))
    return None
