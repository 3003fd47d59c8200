"""Lengths, sizes and ranks of many small arrays: numpy's own sum over a short last axis, and its quantiles, cost
several times as much.
"""

import math

import numpy as np

from models.demonstration import Floats


def norms(vectors: Floats) -> Floats:
    """Return the Euclidean norms (...,) of vectors (..., d)."""
    squares = vectors[..., 0] * vectors[..., 0]
    for axis in range(1, vectors.shape[-1]):
        squares = squares + vectors[..., axis] * vectors[..., axis]
    return np.sqrt(squares)


def diagonal(points: Floats) -> float:
    """Return the diagonal in m of the box around points (..., d); NaN if one of them is."""
    axes = [points[..., axis] for axis in range(points.shape[-1])]
    return math.hypot(*(float(axis.max() - axis.min()) for axis in axes))


def ranked(values: Floats, share: float) -> Floats:
    """Return the value (...) that this share of values (n, ...) does not exceed, one of them: 0.5 is the lower
    median.
    """
    place = int(share * (len(values) - 1))
    return np.asarray(np.partition(values, place, axis=0)[place])
