"""The Gaussian mixture, and why its means and covariances are the whole of it.

Column 0 of a sample is the clock. A component that covers a stretch of length L of an evenly sampled clock has weight L
and standard deviation L/sqrt(12), so its prior is known from its covariance: w_k = sqrt(Sigma_11,k) / sum. What
``models.mixture.gating`` finds is a mixture with these priors, so nothing is lost by storing two arrays. ``fit_free``
is expectation maximisation as published, through scikit-learn, for the paper's preset; its priors are dropped and the
formula puts others in their place.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from models.demonstration import Floats
from models.errors import TooManyComponents

REGULARISATION = 1e-6
TOLERANCE = 1e-5
ITERATIONS = 200


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """``means`` (K, D) and ``covariances`` (K, D, D); column 0 is the clock. The priors follow from them."""

    means: Floats
    covariances: Floats


def priors(covariances: Floats) -> Floats:
    """Return the priors (K,) that belong to covariances (K, D, D): w_k = sqrt(Sigma_11,k) / sum."""
    extents = np.sqrt(covariances[:, 0, 0])
    return extents / extents.sum()


def in_bins(samples: Floats, edges: Floats) -> Mixture:
    """Return the mixture of the samples (n, D) between each two of the rising clock values ``edges`` (K + 1,)."""
    component = np.clip(np.searchsorted(edges, samples[:, 0], side="right") - 1, 0, len(edges) - 2)
    responsibilities = (component[:, None] == np.arange(len(edges) - 1)).astype(np.float64)
    return _maximise(samples, responsibilities, _floor(samples))


def fit_free(samples: Floats, start: Mixture) -> Mixture:
    """Return means and covariances of samples (n, D) by free expectation maximisation (scikit-learn) from ``start``.

    Samples are scaled to unit deviation first, so that scikit-learn's regularisation means the same in every column.
    One thread: the result must not depend on how many there are. Where it has not settled after 200 steps, the last
    one counts.
    """
    from sklearn import config_context
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.mixture import GaussianMixture

    centre, scale = samples.mean(axis=0), np.maximum(samples.std(axis=0), 1e-12)
    scaling = scale[:, None] * scale[None, :]
    model = GaussianMixture(
        n_components=len(start.means),
        covariance_type="full",
        tol=TOLERANCE,
        reg_covar=REGULARISATION,
        max_iter=ITERATIONS,
        weights_init=priors(start.covariances),
        means_init=(start.means - centre) / scale,
        precisions_init=np.linalg.inv(start.covariances / scaling),
        random_state=0,
    )
    trusted = config_context(assume_finite=True, skip_parameter_validation=True)
    with threadpool_limits(limits=1), trusted, warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        try:
            model.fit((samples - centre) / scale)
        except ValueError as error:
            raise TooManyComponents(len(start.means)) from error
    means, covariances = np.asarray(model.means_), np.asarray(model.covariances_)
    order = np.argsort(means[:, 0], kind="stable")
    return Mixture(means[order] * scale + centre, covariances[order] * scaling)


def _floor(samples: Floats) -> Floats:
    """Return what is added to the diagonal (D,), so that samples on one line still have a density."""
    return REGULARISATION * np.maximum(samples.var(axis=0), 1e-12)


def _maximise(samples: Floats, responsibilities: Floats, floor: Floats) -> Mixture:
    """Return the mixture that the responsibilities (n, K) ask for. The priors need no step: they are tied."""
    mass = responsibilities.sum(axis=0) + 1e-12
    components, width = responsibilities.shape[1], samples.shape[1]
    means = np.empty((components, width))
    covariances = np.empty((components, width, width))
    for k in range(components):
        share = responsibilities[:, k]
        means[k] = (share[:, None] * samples).sum(axis=0) / mass[k]
        deviation = (samples - means[k]).T.copy()
        for row in range(width):
            weighted = share * deviation[row]
            for column in range(row + 1):
                covariances[k, row, column] = covariances[k, column, row] = (weighted * deviation[column]).sum() / mass[
                    k
                ]
        covariances[k, np.arange(width), np.arange(width)] += floor
    return Mixture(means, covariances)
