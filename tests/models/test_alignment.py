"""Warping is exact: what the sweep finds is what the textbook's recursion finds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.alignment.dtw import costs, fastdtw_is_compiled, medoid, warp, warp_fast
from models.alignment.procrustes import laid_upon, similarity

LAWS = settings(deadline=None, max_examples=60)


def walk(generator: np.random.Generator, samples: int, dimension: int) -> np.ndarray:
    """Return a random walk (samples, dimension) about a metre from the origin."""
    return np.cumsum(generator.normal(0.0, 1e-2, (samples, dimension)), axis=0) + 1.0


def cheapest(reference: np.ndarray, other: np.ndarray, open_start: bool = False, open_end: bool = False) -> float:
    """Return the least sum of distances along a warping path, by the recursion as it is written in textbooks."""
    table = np.full((len(reference) + 1, len(other) + 1), np.inf)
    table[0, 0] = 0.0
    if open_start:
        table[:, 0] = 0.0
    for i in range(len(reference)):
        for j in range(len(other)):
            away = float(np.sqrt(((reference[i] - other[j]) ** 2).sum()))
            table[i + 1, j + 1] = away + min(table[i, j], table[i, j + 1], table[i + 1, j])
    return float(table[1:, -1].min() if open_end else table[-1, -1])


motions = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 24), st.integers(1, 24), st.integers(1, 4))


@LAWS
@given(motions)
def test_the_sweep_costs_what_the_recursion_costs(drawn: tuple[int, int, int, int]) -> None:
    seed, n, m, dimension = drawn
    generator = np.random.default_rng(seed)
    references = np.stack([walk(generator, n, dimension) for _ in range(3)])
    others = np.stack([walk(generator, m, dimension) for _ in range(3)])
    wanted = [cheapest(one, other) for one, other in zip(references, others, strict=True)]
    np.testing.assert_allclose(costs(references, others), wanted, rtol=1e-5, atol=1e-7)


@LAWS
@given(motions, st.booleans(), st.booleans())
def test_the_path_found_costs_what_is_told(drawn: tuple[int, int, int, int], open_start: bool, open_end: bool) -> None:
    seed, n, m, dimension = drawn
    generator = np.random.default_rng(seed)
    reference, other = walk(generator, n, dimension), walk(generator, m, dimension)
    found = warp(reference, other[None], np.array([open_start]), np.array([open_end]))
    least = cheapest(reference, other, open_start, open_end)
    longest = n + m - 1
    assert least / longest * (1 - 1e-5) <= found.costs[0] <= least * (1 + 1e-5) + 1e-7
    known = np.flatnonzero(np.isfinite(found.positions[0]))
    assert (known == np.arange(found.first[0], found.last[0] + 1)).all()
    positions = found.positions[0, known]
    assert (np.diff(positions) >= 0).all()
    assert positions[0] >= 0
    assert positions[-1] <= m - 1
    assert open_start or found.first[0] == 0
    assert open_end or found.last[0] == n - 1


@LAWS
@given(st.integers(0, 2**32 - 1), st.integers(2, 40), st.integers(1, 6))
def test_a_motion_is_where_it_is(seed: int, samples: int, batch: int) -> None:
    motion = walk(np.random.default_rng(seed), samples, 2)
    found = warp(motion, np.stack([motion] * batch))
    np.testing.assert_allclose(found.costs, 0.0, atol=1e-9)
    np.testing.assert_array_equal(found.positions, np.broadcast_to(np.arange(samples), (batch, samples)))


@LAWS
@given(motions)
def test_a_warp_read_backwards_costs_the_same(drawn: tuple[int, int, int, int]) -> None:
    seed, n, m, dimension = drawn
    generator = np.random.default_rng(seed)
    one, other = walk(generator, n, dimension)[None], walk(generator, m, dimension)[None]
    np.testing.assert_allclose(costs(one, other), costs(other, one), rtol=1e-5)
    np.testing.assert_allclose(costs(one, other), costs(one[:, ::-1], other[:, ::-1]), rtol=1e-5)


def test_more_motions_than_a_batch_holds_are_warped_the_same() -> None:
    generator = np.random.default_rng(0)
    reference, others = walk(generator, 30, 2), np.stack([walk(generator, 40, 2) for _ in range(150)])
    together = warp(reference, others)
    for row in (0, 63, 64, 149):
        alone = warp(reference, others[row : row + 1])
        np.testing.assert_array_equal(together.positions[row], alone.positions[0])


def test_the_medoid_is_nearest_to_all_others() -> None:
    generator = np.random.default_rng(3)
    motions = np.stack([walk(generator, 20, 2) for _ in range(9)])
    sums = [sum(np.sqrt(cheapest(one, other)) for other in motions) for one in motions]
    assert medoid(motions) == int(np.argmin(sums))


def test_fastdtw_with_a_wide_radius_is_exact() -> None:
    assert fastdtw_is_compiled()
    generator = np.random.default_rng(1)
    reference, other = walk(generator, 60, 3), walk(generator, 50, 3)
    exact = warp(reference, other[None]).positions[0]
    np.testing.assert_allclose(warp_fast(reference, other, radius=60), exact, atol=1.0)


@pytest.mark.parametrize("side", ["start", "end"])
def test_an_open_side_leaves_out_what_was_not_drawn(side: str) -> None:
    reference = np.column_stack([np.linspace(0.0, 0.1, 100), np.zeros(100)])
    part = reference[30:] if side == "start" else reference[:70]
    openly = np.ones(1, dtype=bool)
    found = warp(reference, part[None], openly if side == "start" else None, openly if side == "end" else None)
    assert (int(found.first[0]), int(found.last[0])) == ((30, 99) if side == "start" else (0, 69))


@LAWS
@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_motions_are_laid_upon_a_target_wherever_they_are_known(seed: int, dimension: int) -> None:
    generator = np.random.default_rng(seed)
    target = walk(generator, 30, dimension)
    turn = np.linalg.qr(generator.normal(size=(dimension, dimension)))[0]
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    motions = np.stack([target @ turn.T * 1.7 + 0.4, target, target * 0.5])
    motions[2, 20:] = np.nan
    laid = laid_upon(motions, target)
    np.testing.assert_allclose(laid[:2], [target, target], atol=1e-9)
    np.testing.assert_allclose(laid[2, :20], target[:20], atol=1e-9)
    assert np.isnan(laid[2, 20:]).all()
    one = similarity(motions[0] + generator.normal(0.0, 1e-3, target.shape), target)
    np.testing.assert_allclose(one.turn @ one.turn.T, np.eye(dimension), atol=1e-9)
    assert np.linalg.det(one.turn) > 0
