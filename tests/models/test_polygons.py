"""The best polygons of a path are the best."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from models.demonstration import Floats
from models.mixture.segmentation import best_polygons

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
