"""How components hand over to each other, and the lines that fit a path given the hand-over.

Each component lives around a place on the clock, with an extent: both are stored as its mean and covariance there, and
the regression (equations 4 to 6) weighs its line by them. Two that lie far apart beside their extents hand over
sharply, as at a corner; two that lie near each other widely, as along a curve.
"""

from dataclasses import dataclass

import numpy as np

from models.demonstration import Floats
from models.mixture.gmr import activations
from models.yardstick import MeanPath, heading, retimed

RIDGE = 1e-4  # of a component's share of the path: a line that hardly shows keeps near its own stretch
ALONG = 0.003  # of what counts across: where along the path a point lies hardly matters


@dataclass(frozen=True, slots=True, eq=False)
class Handover:
    """Where on the clock (0..1) each of K components lives: ``centres`` (K,) and ``extents`` (K,), standard
    deviations.
    """

    centres: Floats
    extents: Floats

    def basis(self, clock: Floats) -> Floats:
        """Return the 2 K functions (n, 2 K) that the path is a sum of: h_k(s), and h_k(s) (s - centre_k) / extent_k."""
        covariances = (self.extents**2)[:, None, None]
        weights = activations(self.centres[:, None], covariances, clock)
        return np.concatenate([weights, weights * (clock[:, None] - self.centres) / self.extents], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A hand-over and the lines ``coefficients`` (2 K, d) under it."""

    handover: Handover
    coefficients: Floats


def lines(handover: Handover, values: Floats) -> Floats:
    """Return coefficients (2 K, m) so that the outputs are nearest to values (n, m) at even clock steps, and equal
    at both ends.
    """
    clock = np.linspace(0.0, 1.0, len(values))
    basis = handover.basis(clock)
    usual = local_lines(handover, clock, values)
    matrix = basis.T @ basis / len(basis)
    matrix[np.diag_indices(len(matrix))] += RIDGE
    right = basis.T @ (values - basis @ usual) / len(basis)
    ends = basis[[0, -1]]
    return usual + _constrained(matrix, right, ends, values[[0, -1]] - ends @ usual)


def local_lines(handover: Handover, clock: Floats, values: Floats) -> Floats:
    """Return the coefficients (2 K, m) of each component on its own: the value at its centre, the slope over its
    extent.
    """
    low, high = np.clip(handover.centres - handover.extents, 0, 1), np.clip(handover.centres + handover.extents, 0, 1)
    share = handover.extents / np.maximum(high - low, 1e-12)
    rows = [
        np.column_stack([np.interp(handover.centres, clock, column) for column in values.T]),
        np.column_stack(
            [share * (np.interp(high, clock, column) - np.interp(low, clock, column)) for column in values.T]
        ),
    ]
    return np.concatenate(rows)


def held(people: MeanPath, fit: Fit) -> Fit:
    """Return the fit with its lines moved to where the people's mean lies across the path, both ends held exactly."""
    mean = people.points
    count, dimension = mean.shape
    clock, index = np.linspace(0.0, 1.0, count), np.arange(count, dtype=np.float64)
    basis = fit.handover.basis(clock)
    coefficients = fit.coefficients[:, :dimension]
    path = basis @ coefficients
    where = retimed(path, mean)
    goal = np.column_stack([np.interp(where, index, column) for column in mean.T])
    sure = np.interp(where, index, people.errors) ** -2.0
    ahead = heading(path)
    across = np.eye(dimension)[None] - (1.0 - ALONG) * ahead[:, :, None] * ahead[:, None, :]
    across *= (sure / sure.mean())[:, None, None]
    width = basis.shape[1]
    matrix = np.empty((width, dimension, width, dimension))
    for i in range(dimension):
        for j in range(i + 1):
            matrix[:, i, :, j] = matrix[:, j, :, i] = (basis * across[:, i, j, None]).T @ basis / count
    square = matrix.reshape(width * dimension, width * dimension)
    square[np.diag_indices(len(square))] += RIDGE / (width // 2)
    missing = (across * (goal - path)[:, None, :]).sum(axis=2)
    right = (basis.T @ missing / count).reshape(-1, 1)
    ends = basis[[0, -1]]
    blocks = np.asarray(np.kron(ends, np.eye(dimension)), dtype=np.float64)
    moved = _constrained(square, right, blocks, (mean[[0, -1]] - path[[0, -1]]).reshape(-1, 1))
    return Fit(fit.handover, coefficients + moved.reshape(width, dimension))


def _constrained(matrix: Floats, right: Floats, ends: Floats, values: Floats) -> Floats:
    """Return x with least x' matrix x / 2 - right' x that keeps ends @ x = values."""
    size, extra = len(matrix), len(ends)
    whole = np.zeros((size + extra, size + extra))
    whole[:size, :size], whole[:size, size:], whole[size:, :size] = matrix, ends.T, ends
    whole[np.arange(size, size + extra), np.arange(size, size + extra)] = -1e-12
    return np.asarray(np.linalg.solve(whole, np.concatenate([right, values]))[:size], dtype=np.float64)
