"""Where a path's corners are: the best polygons are the best, and a curve or a chance wave is none."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.demonstration import Floats
from models.polygons import best_polygons, edges_of

LAWS = settings(deadline=None, max_examples=40)
seeds = st.integers(0, 2**32 - 1)


def chord_squares(path: Floats, first: int, last: int) -> float:
    """Return the sum of squares of how far the points from first to last are from the line through both."""
    chord = path[last] - path[first]
    unit = chord / np.linalg.norm(chord)
    inner = path[first : last + 1] - path[first]
    return float(((inner - np.outer(inner @ unit, unit)) ** 2).sum())


def squares(path: Floats, corners: tuple[int, ...]) -> float:
    return sum(chord_squares(path, first, last) for first, last in itertools.pairwise(corners))


@LAWS
@given(seeds, st.integers(5, 9), st.integers(2, 3))
def test_no_polygon_with_as_many_edges_is_nearer(seed: int, points: int, dimension: int) -> None:
    path = np.random.default_rng(seed).normal(size=(points, dimension))
    for edges, found in enumerate(best_polygons(path, points - 2), start=1):
        assert (found[0], found[-1], len(found)) == (0, points - 1, edges + 1)
        inner = itertools.combinations(range(1, points - 1), edges - 1)
        least = min(squares(path, (0, *chosen, points - 1)) for chosen in inner)
        np.testing.assert_allclose(squares(path, found), least, rtol=1e-6, atol=1e-9)


@LAWS
@given(seeds, st.floats(1e-4, 1e3))
def test_the_best_polygons_do_not_depend_on_unit_place_or_turn(seed: int, scale: float) -> None:
    generator = np.random.default_rng(seed)
    path = np.cumsum(generator.normal(size=(40, 2)), axis=0)
    angle = generator.uniform(0.0, 2.0 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = scale * (path @ turn.T + generator.normal(size=2))
    one, other = list(best_polygons(path, 6)), list(best_polygons(moved, 6))
    for found, again in zip(one, other, strict=True):
        np.testing.assert_allclose(squares(path, again), squares(path, found), rtol=1e-6, atol=1e-9)


def drawn(knots: Floats, points: int = 300) -> Floats:
    """Return a polyline at even steps of its way."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    return np.column_stack([np.interp(np.linspace(0.0, lengths[-1], points), lengths, axis) for axis in knots.T])


def staircase(steps: int) -> Floats:
    return np.column_stack([np.repeat(np.arange(steps + 1), 2)[1:], np.repeat(np.arange(steps + 1), 2)[:-1]]) * 0.012


def comb(teeth: int) -> Floats:
    across = np.repeat(np.arange(2 * teeth + 1), 2)[:-1] * 0.006
    up = np.tile([0.0, 1.0, 1.0, 0.0], teeth + 1)[: len(across)] * 0.05
    return np.column_stack([across, up])


@pytest.mark.parametrize("wavering", [0.15e-3, 0.3e-3])
@pytest.mark.parametrize("knots", [staircase(3), staircase(6), comb(2), comb(4)], ids=["3", "6", "comb", "combs"])
def test_the_corners_of_short_edges_are_found_where_they_are(knots: Floats, wavering: float) -> None:
    path = drawn(knots) + np.random.default_rng(1).normal(0.0, 0.1e-3, (300, 2))
    found, polygon = edges_of(path, wavering)
    assert polygon
    assert len(found) == len(knots)
    assert np.linalg.norm(path[list(found)] - knots, axis=1).max() < 1.5e-3


@LAWS
@given(seeds, st.floats(1.2, 6.0), st.booleans(), st.sampled_from([0.0, 0.1e-3, 0.2e-3]))
def test_a_curve_is_no_polygon(seed: int, turned: float, back: bool, wavering: float) -> None:
    """An arc, or one that bends back in its second half, waving by as much as its mean is known to."""
    generator = np.random.default_rng(seed)
    heading = np.linspace(0.0, turned, 299)
    if back:
        heading = np.minimum(heading, turned - heading)
    steps = 0.0005 * np.column_stack([np.cos(heading), np.sin(heading)])
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    waves = np.sin(np.linspace(0.0, 20.0, 300)[:, None] * generator.uniform(0.3, 1.0, 2) + generator.uniform(0, 6, 2))
    found, polygon = edges_of(path + wavering * waves, wavering)
    assert not polygon or len(found) == 2 or (back and len(found) == 3)


def test_a_straight_line_has_two_corners() -> None:
    path = np.column_stack([np.linspace(0.0, 0.05, 300), np.zeros(300)])
    assert edges_of(path) == ((0, 299), True)
