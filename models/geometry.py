"""Lengths and sizes in any number of dimensions, axis by axis: numpy's own sum over a short last axis costs several
times as much.
"""

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
    reach = np.array([float(np.ptp(points[..., axis])) for axis in range(points.shape[-1])])
    return float(norms(reach))
