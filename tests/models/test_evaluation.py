"""How good a path is, by two routes: as the product measures it, and as the definitions say."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.evaluation import corner_error, end_error, frechet, path_rms, resampled, smoothness

LAWS = settings(deadline=None, max_examples=30)
seeds = st.integers(0, 2**32 - 1)


def walk(seed: int, samples: int = 20) -> np.ndarray:
    """Return a random walk (samples, 2)."""
    return np.cumsum(np.random.default_rng(seed).normal(0.0, 1e-2, (samples, 2)), axis=0)


@LAWS
@given(seeds, seeds)
def test_the_frechet_distance_is_the_recursions(one: int, other: int) -> None:
    a, b = resampled(walk(one), 25), resampled(walk(other), 25)

    @cache
    def leash(i: int, j: int) -> float:
        away = float(np.sqrt(((a[i] - b[j]) ** 2).sum()))
        if i == 0 and j == 0:
            return away
        before = [leash(x, y) for x, y in ((i - 1, j), (i, j - 1), (i - 1, j - 1)) if x >= 0 and y >= 0]
        return max(away, min(before))

    np.testing.assert_allclose(frechet(walk(one), walk(other), 25), leash(24, 24))


@LAWS
@given(seeds, seeds)
def test_distances_are_symmetric_and_zero_only_for_the_same_path(one: int, other: int) -> None:
    a, b = walk(one), walk(other)
    np.testing.assert_allclose(frechet(a, b, 60), frechet(b, a, 60))
    np.testing.assert_allclose(path_rms(a, b, 200), path_rms(b, a, 200))
    assert frechet(a, a, 60) == 0.0
    assert path_rms(a, a, 200) == 0.0
    assert path_rms(a, b, 200) <= frechet(a, b, 200) + 1e-3


@LAWS
@given(seeds, st.floats(0.1, 10.0), st.floats(-5.0, 5.0))
def test_smoothness_does_not_depend_on_size_and_place(seed: int, scale: float, offset: float) -> None:
    path = resampled(walk(seed), 300)
    np.testing.assert_allclose(smoothness(path * scale + offset), smoothness(path), atol=1e-6)


def test_a_trembling_path_is_less_smooth() -> None:
    turn = np.linspace(0.0, np.pi, 300)
    arc = np.column_stack([np.cos(turn), np.sin(turn)])
    trembling = arc + np.random.default_rng(0).normal(0.0, 1e-4, arc.shape)
    assert smoothness(trembling) < smoothness(arc) - 3.0


def test_a_moved_path_is_off_by_that_much_everywhere() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    moved = square + np.array([0.0, 0.25])
    assert end_error(moved, square) == pytest.approx(0.25)
    assert corner_error(moved, square[1:2]) == pytest.approx(0.25, abs=1e-3)
    assert frechet(moved, square) == pytest.approx(0.25, abs=1e-6)
