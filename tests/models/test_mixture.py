"""Means and covariances are the whole mixture: the priors follow from them, whatever it was fitted to."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from models.mixture.gmm import fit_free, in_bins, priors

LAWS = settings(deadline=None, max_examples=40)


def polyline(seed: int, edges: int, dimension: int, samples: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Return clock and position (n, 1 + d) of four noisy runs along a polyline, and where on the clock its corners
    are.
    """
    generator = np.random.default_rng(seed)
    knots = np.linspace(0.0, 1.0, edges + 1)
    corners = generator.uniform(0.0, 0.1, (edges + 1, dimension))
    clock = np.tile(np.linspace(0.0, 1.0, samples), 4)
    points = np.column_stack([np.interp(clock, knots, column) for column in corners.T])
    return np.column_stack([clock, points + generator.normal(0.0, 1e-3, points.shape)]), knots


drawings = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 4))


@LAWS
@given(drawings)
def test_priors_are_a_function_of_the_covariances(drawn: tuple[int, int, int]) -> None:
    samples, knots = polyline(*drawn)
    mixture = fit_free(samples, in_bins(samples, knots))
    weights = priors(mixture.covariances)
    assert (weights > 0).all()
    np.testing.assert_allclose(weights.sum(), 1.0)
    extents = np.sqrt(mixture.covariances[:, 0, 0])
    np.testing.assert_allclose(weights / weights[0], extents / extents[0])


@LAWS
@given(drawings)
def test_an_even_clock_gives_each_bin_its_share(drawn: tuple[int, int, int]) -> None:
    samples, knots = polyline(*drawn, samples=600)
    np.testing.assert_allclose(priors(in_bins(samples, knots).covariances), np.diff(knots), atol=0.02)


@LAWS
@given(drawings)
def test_covariances_are_symmetric_and_positive(drawn: tuple[int, int, int]) -> None:
    samples, knots = polyline(*drawn)
    for mixture in (in_bins(samples, knots), fit_free(samples, in_bins(samples, knots))):
        np.testing.assert_allclose(mixture.covariances, mixture.covariances.transpose(0, 2, 1), rtol=1e-12, atol=1e-18)
        assert np.linalg.eigvalsh(mixture.covariances).min() > 0


@LAWS
@given(drawings, st.floats(0.1, 10.0))
def test_another_unit_of_length_gives_the_same_model_in_that_unit(drawn: tuple[int, int, int], unit: float) -> None:
    samples, knots = polyline(*drawn)
    scale = np.array([1.0] + [unit] * (samples.shape[1] - 1))
    one = fit_free(samples, in_bins(samples, knots))
    other = fit_free(samples * scale, in_bins(samples * scale, knots))
    np.testing.assert_allclose(other.means, one.means * scale, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(other.covariances, one.covariances * np.outer(scale, scale), rtol=1e-5, atol=1e-12)
