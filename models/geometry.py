"""Lengths, sizes and ranks of many small arrays: numpy's own sum over a short last axis, and its quantiles, cost
several times as much.
"""

# numpy leaves many results untyped: what leaves a function here is typed by its signature.
import math

import numpy as np

from models.demonstration import Bools, Floats

MIDDLE_STEPS = 12  # each takes most of the rest away; a reflection among ten is left with a thousandth of its pull
MIDDLE_FLOOR = 1e-3  # of the furthest point: nearer ones do not pull harder
PARTED = (
    7.0  # deviations within groups: of normal scatter four groups in 1,000 are parted where hands waver half as far
)


def norms(vectors: Floats) -> Floats:
    """Return the Euclidean norms (...,) of vectors (..., d)."""
    squares = vectors[..., 0] * vectors[..., 0]
    for axis in range(1, vectors.shape[-1]):
        squares = squares + vectors[..., axis] * vectors[..., axis]
    return np.sqrt(squares)


def dots(ones: Floats, others: Floats) -> Floats:
    """Return the scalar products (...,) of vectors (..., d)."""
    products = ones[..., 0] * others[..., 0]
    for axis in range(1, ones.shape[-1]):
        products = products + ones[..., axis] * others[..., axis]
    return products


def diagonal(points: Floats) -> float:
    """Return the size in m of points (..., d): the length of the straight line that is as spread out as they are.

    The root mean square distance from their middle, times √12: for a drawing that fills its box about the box's
    diagonal, and the same however it lies. NaN if one of them is.
    """
    squares = 0.0
    for axis in range(points.shape[-1]):
        values = points[..., axis]
        away = values - np.add.reduce(values, axis=None) / values.size
        away *= away
        squares += float(np.add.reduce(away, axis=None) / values.size)
    return math.sqrt(12.0 * squares)


def usual_size(points: Floats) -> float:
    """Return the size in m of points (n, d) of which one in ten may be anywhere: twice the distance from their middle
    that nine in ten keep.
    """
    return 2.0 * float(ranked(norms(points - middle(points)), 0.9))


def middle(points: Floats) -> Floats:
    """Return the geometric median (..., d) of points (..., n, d): the place from which they are nearest in all.

    Unlike medians of single axes it turns with the points. Weiszfeld's steps from the mean; two points have theirs
    halfway. A point that is not finite does not count; NaN where none is.
    """
    last = points.ndim - 1
    axes = np.ascontiguousarray(points.transpose(last, last - 1, *range(last - 1)), dtype=np.float64)
    known: Bools = np.logical_and.reduce(np.isfinite(axes), axis=0)
    whole = bool(known.all())
    counted = np.concatenate([axes if whole else np.where(known, axes, 0.0), known[None]])
    gaps, away = np.empty_like(axes), np.empty(axes.shape[1:])
    with np.errstate(invalid="ignore"):
        sums = np.add.reduce(counted, axis=1)
        # who does not count is put into the middle of the others: nowhere is he the furthest
        axes = counted[:-1] if whole else np.where(known, axes, (sums[:-1] / sums[-1])[:, None])
        for _ in range(MIDDLE_STEPS):
            np.subtract(axes, (sums[:-1] / sums[-1])[:, None], out=gaps)
            np.multiply(gaps, gaps, out=gaps)
            np.add.reduce(gaps, axis=0, out=away)
            np.sqrt(away, out=away)
            np.maximum(away, MIDDLE_FLOOR * np.maximum.reduce(away, axis=0) + 1e-300, out=away)
            np.divide(1.0, away, out=away)
            sums = counted @ away if away.ndim == 1 else np.add.reduce(counted * away, axis=1)
        found = sums[:-1] / sums[-1]
    return np.stack(list(found), axis=-1)


def ranked(values: Floats, share: float) -> Floats:
    """Return the value (...) that this share of values (n, ...) does not exceed, one of them: 0.5 is the lower
    median.
    """
    place = int(share * (len(values) - 1))
    return np.asarray(np.partition(values, place, axis=0)[place])


def parted(values: Floats, waver: float) -> Bools:
    """Return which of the values (u,) belong to the greater ones, if they are two groups with nobody between; nobody
    does, (u,), if they may well be one.

    They are two if their means are seven times as far apart as the values of a group are from its own mean, and as
    ``waver``, in the same unit: root mean square, and the split that parts them best.
    """
    order = np.argsort(values, kind="stable")
    greater, furthest = np.zeros(len(values), dtype=bool), PARTED
    for cut in range(1, len(values)):
        groups = values[order[:cut]], values[order[cut:]]
        square = sum(float(((group - group.mean()) ** 2).sum()) for group in groups)
        within = max(float(np.sqrt(square / max(len(values) - 2, 1))), waver, 1e-12)
        apart = float(groups[1].mean() - groups[0].mean()) / within
        if apart > furthest:
            furthest = apart
            greater = np.isin(np.arange(len(values)), order[cut:])
    return greater
