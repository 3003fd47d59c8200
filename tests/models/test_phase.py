"""The clock is the path: lengths, corners, and how much of the way is gone."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from models.demonstration import Demonstration
from models.geometry import diagonal, norms
from models.phase import arc_lengths, corners
from models.preprocessing.filtering import clean, travelled

LAWS = settings(deadline=None, max_examples=60)
seeds = st.integers(0, 2**32 - 1)


@LAWS
@given(seeds, st.lists(st.integers(1, 5), min_size=1, max_size=3), st.integers(1, 7))
def test_norms_are_numpys_in_any_shape(seed: int, shape: list[int], dimension: int) -> None:
    vectors = np.random.default_rng(seed).normal(size=(*shape, dimension))
    np.testing.assert_allclose(norms(vectors), np.linalg.norm(vectors, axis=-1), rtol=1e-14)


@LAWS
@given(seeds, st.integers(1, 3))
def test_the_size_is_that_of_a_line_as_spread_out_and_the_same_however_it_lies(seed: int, dimension: int) -> None:
    generator = np.random.default_rng(seed)
    points = generator.normal(size=(4, 9, dimension))
    turned = points @ np.linalg.qr(generator.normal(size=(dimension, dimension)))[0]
    np.testing.assert_allclose(diagonal(turned), diagonal(points))
    line = np.linspace(0.0, 1.0, 4001)[:, None] * points[0, 0]
    np.testing.assert_allclose(diagonal(line), np.linalg.norm(points[0, 0]), rtol=1e-3)
    assert np.isnan(diagonal(np.array([[0.0, np.nan]])))


@LAWS
@given(seeds, st.integers(2, 40))
def test_the_length_of_a_path_does_not_depend_on_how_it_lies(seed: int, samples: int) -> None:
    generator = np.random.default_rng(seed)
    path = generator.normal(size=(samples, 2))
    angle = generator.uniform(0.0, 2.0 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    lengths = arc_lengths(path)
    assert lengths[0] == 0.0
    assert (np.diff(lengths) >= 0).all()
    np.testing.assert_allclose(arc_lengths(path @ turn.T + 3.0), lengths, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(arc_lengths(path[::-1])[-1], lengths[-1])


@LAWS
@given(seeds, st.integers(1, 7))
def test_every_point_is_within_the_tolerance_of_the_polygon_of_corners(seed: int, edges: int) -> None:
    generator = np.random.default_rng(seed)
    knots = generator.uniform(0.0, 0.1, (edges + 1, 2))
    path = np.column_stack([np.interp(np.linspace(0, edges, 150), np.arange(edges + 1), axis) for axis in knots.T])
    path += generator.normal(0.0, 1e-4, path.shape)
    found = corners(path, 2e-3)
    assert found[0] == 0
    assert found[-1] == 149
    for first, last in itertools.pairwise(found):
        chord = path[last] - path[first]
        share = np.clip(((path[first : last + 1] - path[first]) * chord).sum(axis=1) / (chord @ chord), 0.0, 1.0)
        assert norms(path[first : last + 1] - path[first] - share[:, None] * chord).max() <= 2e-3


def test_waiting_is_no_way() -> None:
    times = np.arange(600) / 100.0
    way = np.interp(times, [0.0, 2.0, 4.0, 6.0], [0.0, 0.5, 0.5, 1.0])
    trembling = np.random.default_rng(0).normal(0.0, 0.05e-3, (600, 2))
    points = np.column_stack([0.1 * way, np.zeros(600)]) + trembling
    recording = Demonstration("one", times, points, np.ones(600, dtype=bool))
    motion = clean(recording, frozenset(), 0.07, despiking=True)
    gone = travelled(motion)
    assert gone[0] == 0.0
    assert gone[-1] == 1.0
    assert (np.diff(gone) > 0).all()
    there = np.interp([2.2, 3.8], motion.times, gone)
    assert there[1] - there[0] < 0.03
