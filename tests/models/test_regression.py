"""Equations 4 to 6 of the paper, by two routes: as the product computes them, and written out one sample at a time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.mixture.gmm import priors
from models.mixture.gmr import CovarianceRule, activations, conditional_covariances, regress, regress_mean

LAWS = settings(deadline=None, max_examples=60)
models_drawn = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(1, 7))


def model(seed: int, components: int, outputs: int) -> tuple[np.ndarray, np.ndarray]:
    """Return means (K, 1 + m) and covariances (K, 1 + m, 1 + m) of a random mixture over a clock of about 0 to 1."""
    generator = np.random.default_rng(seed)
    means = generator.uniform(0.0, 1.0, (components, 1 + outputs))
    roots = generator.normal(0.0, 0.1, (components, 1 + outputs, 1 + outputs))
    return means, roots @ roots.transpose(0, 2, 1) + 1e-3 * np.eye(1 + outputs)


def written_out(
    means: np.ndarray, covariances: np.ndarray, instant: float, rule: CovarianceRule
) -> tuple[np.ndarray, np.ndarray]:
    """Return E[x | s] and Cov[x | s] at one instant as the paper writes them, priors and densities included."""
    weights, centres, spreads = [], [], []
    for prior, mean, cover in zip(priors(covariances), means, covariances, strict=True):
        density = np.exp(-0.5 * (instant - mean[0]) ** 2 / cover[0, 0]) / np.sqrt(2.0 * np.pi * cover[0, 0])
        weights.append(prior * density)
        centres.append(mean[1:] + cover[1:, 0] / cover[0, 0] * (instant - mean[0]))
        spreads.append(cover[1:, 1:] - np.outer(cover[1:, 0], cover[0, 1:]) / cover[0, 0])
    share = np.array(weights) / sum(weights)
    centre = sum(h * x for h, x in zip(share, centres, strict=True))
    power = 2 if rule == "paper" else 1
    spread = sum(h**power * cover for h, cover in zip(share, spreads, strict=True))
    if rule == "full":
        spread = spread + sum(h * np.outer(x - centre, x - centre) for h, x in zip(share, centres, strict=True))
    return centre, spread


@LAWS
@given(models_drawn, st.sampled_from(["paper", "within", "full"]))
def test_the_regression_is_the_papers(drawn: tuple[int, int, int], rule: CovarianceRule) -> None:
    means, covariances = model(*drawn)
    clock = np.linspace(0.0, 1.0, 11)
    points, spread = regress(means, covariances, clock, slice(1, None), rule)
    for row, instant in enumerate(clock):
        centre, cover = written_out(means, covariances, float(instant), rule)
        np.testing.assert_allclose(points[row], centre, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(spread[row], cover, rtol=1e-6, atol=1e-9)


@LAWS
@given(models_drawn, st.sampled_from(["paper", "within", "full"]))
def test_covariances_are_symmetric_and_nowhere_negative(drawn: tuple[int, int, int], rule: CovarianceRule) -> None:
    means, covariances = model(*drawn)
    spread = regress(means, covariances, np.linspace(-1.0, 2.0, 50), slice(1, None), rule)[1]
    np.testing.assert_allclose(spread, spread.transpose(0, 2, 1), atol=1e-15)
    assert np.linalg.eigvalsh(spread).min() > -1e-12


@LAWS
@given(models_drawn)
def test_activations_share_one_far_from_every_component_too(drawn: tuple[int, int, int]) -> None:
    means, covariances = model(*drawn)
    share = activations(means, covariances, np.array([-1e6, -1.0, 0.5, 2.0, 1e6]))
    assert (share >= 0).all()
    np.testing.assert_allclose(share.sum(axis=1), 1.0)


@LAWS
@given(models_drawn)
def test_one_component_is_a_straight_line(drawn: tuple[int, int, int]) -> None:
    means, covariances = model(drawn[0], 1, drawn[2])
    points = regress_mean(means, covariances, np.linspace(0.0, 1.0, 9), slice(1, None))
    np.testing.assert_allclose(np.diff(points, n=2, axis=0), 0.0, atol=1e-12)


@pytest.mark.parametrize("samples", [1, 4095, 4096, 4097, 10_000])
def test_how_many_instants_are_asked_for_changes_no_bit(samples: int) -> None:
    means, covariances = model(5, 4, 3)
    clock = np.linspace(0.0, 1.0, samples)
    points, spread = regress(means, covariances, clock, slice(1, None), "within")
    for row in {0, samples // 2, samples - 1}:
        alone, cover = regress(means, covariances, clock[row : row + 1], slice(1, None), "within")
        np.testing.assert_array_equal(points[row], alone[0])
        np.testing.assert_array_equal(spread[row], cover[0])
    np.testing.assert_array_equal(points, regress_mean(means, covariances, clock, slice(1, None)))


@LAWS
@given(models_drawn)
def test_what_is_known_of_the_clock_takes_spread_away(drawn: tuple[int, int, int]) -> None:
    means, covariances = model(*drawn)
    taken = covariances[:, 1:, 1:] - conditional_covariances(covariances, slice(1, None))
    assert np.linalg.eigvalsh(taken).min() > -1e-12
    assert means.shape[0] == len(taken)
