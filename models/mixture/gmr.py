"""Gaussian mixture regression: from a clock value to a mean and a covariance. Zimmer et al., equations 4 to 6.

The prior of a component is tied to its extent on the clock, w_k = sqrt(Sigma_11,k) / sum (see ``models.mixture``).
So w_k N(s; mu_1,k, Sigma_11,k) is exp(-z_k²/2) times a factor common to all components, z_k = (s - mu_1,k) /
sqrt(Sigma_11,k),
and the activations h_k(s) of equation 4 are the softmax of -z_k²/2. Means and covariances are all it takes.

Plain array arithmetic in a fixed order, no matrix library and no threads: the same numbers give the same bits.
"""

from typing import Literal

import numpy as np

from models.demonstration import Floats

CovarianceRule = Literal["paper", "within", "full"]
BLOCK = 4096


def activations(means: Floats, covariances: Floats, clock: Floats) -> Floats:
    """Return h_k(s) with shape (n, K): how much each component has to say at each clock value (n,). Equation 4."""
    offsets = (clock[:, None] - means[None, :, 0]) / np.sqrt(covariances[None, :, 0, 0])
    exponents = -0.5 * offsets * offsets
    exponents -= exponents.max(axis=1, keepdims=True)
    weights = np.exp(exponents)
    return weights / weights.sum(axis=1, keepdims=True)


def slopes(covariances: Floats, columns: slice) -> Floats:
    """Return Sigma_x1 / Sigma_11 of each component for the given output columns: shape (K, m)."""
    return covariances[:, columns, 0] / covariances[:, 0, 0][:, None]


def conditional_covariances(covariances: Floats, columns: slice) -> Floats:
    """Return Cov[x | s, k] of each component for the given output columns: shape (K, m, m)."""
    slope = slopes(covariances, columns)
    cross = covariances[:, 0, columns]
    within = covariances[:, columns, columns] - slope[:, :, None] * cross[:, None, :]
    return 0.5 * (within + within.transpose(0, 2, 1))


def regress_mean(means: Floats, covariances: Floats, clock: Floats, columns: slice) -> Floats:
    """Return E[x | s] for the output columns at clock values (n,): shape (n, m). Equation 5."""
    slope = slopes(covariances, columns)
    offset = means[:, columns] - slope * means[:, :1]
    result = np.empty((len(clock), offset.shape[1]))
    for start in range(0, len(clock), BLOCK):
        part = clock[start : start + BLOCK]
        weights = activations(means, covariances, part)
        result[start : start + BLOCK] = _mix(weights, offset) + _mix(weights, slope) * part[:, None]
    return result


def regress(
    means: Floats, covariances: Floats, clock: Floats, columns: slice, rule: CovarianceRule
) -> tuple[Floats, Floats]:
    """Return E[x | s] with shape (n, m) and Cov[x | s] with shape (n, m, m) for the output columns.

    ``rule``: ``paper`` is equation 6, sum h_k² Sigma_k, which shows about half of the real spread where components
    meet;
    ``within`` is sum h_k Sigma_k; ``full`` is the covariance of the whole mixture, the spread of the means included.
    """
    slope = slopes(covariances, columns)
    offset = means[:, columns] - slope * means[:, :1]
    within = conditional_covariances(covariances, columns)
    components, size = offset.shape
    points = np.empty((len(clock), size))
    spread = np.empty((len(clock), size, size))
    for start in range(0, len(clock), BLOCK):
        part = clock[start : start + BLOCK]
        weights = activations(means, covariances, part)
        mean = _mix(weights, offset) + _mix(weights, slope) * part[:, None]
        factors = weights * weights if rule == "paper" else weights
        cover = _mix(factors, within.reshape(components, size * size)).reshape(-1, size, size)
        if rule == "full":
            for k in range(components):
                deviation = offset[k] + slope[k] * part[:, None] - mean
                cover += weights[:, k, None, None] * deviation[:, :, None] * deviation[:, None, :]
        points[start : start + BLOCK] = mean
        spread[start : start + BLOCK] = cover
    return points, spread


def _mix(weights: Floats, values: Floats) -> Floats:
    """Return sum over k of weights (n, K) times values (K, m), component after component."""
    total = weights[:, :1] * values[0]
    for k in range(1, len(values)):
        total += weights[:, k : k + 1] * values[k]
    return total
