"""The fewest components that say all that people agreed on: no gentle shape is flattened, no chance wave followed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.demonstration import Floats
from models.evaluation import frechet, resampled
from models.mixture.gating import JudgedFit, fit_handover
from models.synthetic import ZIGZAG, raster
from models.yardstick import SHARE, WORST, MeanPath, mean_path, retimed

LAWS = settings(deadline=None, max_examples=8)
seeds = st.integers(0, 2**32 - 1)


def people_of(truth: Floats, number: int, seed: int, hand: float = 1e-3) -> MeanPath:
    """Return the mean of people who each miss the truth (n, d) by a slow wave and a place of their own."""
    generator = np.random.default_rng(seed)
    way = np.linspace(0.0, 1.0, len(truth))
    points = np.repeat(truth[None], number, axis=0)
    for wave in range(4):
        phases, sizes = generator.uniform(0.0, 2.0 * np.pi, (2, number, 1, truth.shape[1]))
        points += 0.2 * hand * sizes * np.sin(np.pi * wave * way[:, None] + phases)
    return mean_path(points, np.ones(points.shape[:2]), None)


def path_of(found: JudgedFit) -> Floats:
    return found.fit.handover.basis(np.linspace(0.0, 1.0, 1001)) @ found.fit.coefficients


def components(found: JudgedFit) -> int:
    return len(found.fit.handover.centres)


@pytest.mark.parametrize("corners", [ZIGZAG, raster(4)])
def test_a_polygon_of_many_hands_has_a_component_for_each_edge(corners: Floats) -> None:
    found = fit_handover(people_of(resampled(corners, 300), 20, 1), 0)
    assert components(found) == len(corners) - 1
    assert frechet(path_of(found), corners) < 1.0e-3


@pytest.mark.parametrize(("length", "hand"), [(0.1, 0.1e-3), (5.0, 2e-3)])
def test_a_shallow_s_that_twenty_careful_hands_draw_is_no_straight_line(length: float, hand: float) -> None:
    way = np.linspace(0.0, 1.0, 300)
    truth = length * np.column_stack([way, 0.012 * np.sin(2.0 * np.pi * way)])
    people = people_of(truth, 20, 2, hand)
    found = fit_handover(people, 0)
    assert 1 < components(found) <= 4
    assert frechet(path_of(found), truth) < 1.1 * frechet(people.points, truth) + 1e-4 * length


def test_a_straight_seam_is_one_line_however_many_draw_it() -> None:
    truth = np.linspace([0.0, 0.0], [0.1, 0.02], 300)
    for number in (3, 20):
        generator = np.random.default_rng(number)
        points = truth + generator.normal(0.0, 1e-3, (number, 1, 2))
        points += generator.normal(0.0, 0.1e-3, points.shape)
        assert components(fit_handover(mean_path(points, np.ones(points.shape[:2]), None), 0)) == 1


@LAWS
@given(seeds, st.sampled_from([3, 6, 20]))
def test_what_is_chosen_says_all_that_the_people_agreed_on(seed: int, number: int) -> None:
    generator = np.random.default_rng(seed)
    way = np.linspace(0.0, np.pi, 300)[:, None]
    sizes = generator.normal(0.0, 0.02, (4, 2))
    truth = sum((sizes[wave] * np.cos(wave * way) for wave in range(4)), 0.1 * np.column_stack([way, way]))
    found = fit_handover(people_of(truth, number, seed), 0)
    assert found.misfit.share >= SHARE
    assert found.misfit.worst <= WORST


@LAWS
@given(seeds, st.floats(0.0, 2.0 * np.pi), st.floats(0.01, 100.0), st.booleans())
def test_neither_turn_nor_mirror_nor_unit_changes_what_is_chosen(
    seed: int, angle: float, scale: float, mirrored: bool
) -> None:
    way = np.linspace(0.0, 1.0, 300)[:, None]
    truth = 0.1 * np.concatenate([way, 0.3 * np.sin(5.0 * way)], axis=1)
    people = people_of(truth, 6, seed)
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    if mirrored:
        turn = turn @ np.diag([1.0, -1.0])
    moved = replace(
        people, points=people.points @ turn.T, ahead=people.ahead @ turn.T / scale, errors=scale * people.errors
    )
    one, other = fit_handover(people, 0), fit_handover(moved, 0)
    assert components(one) == components(other)
    np.testing.assert_allclose(path_of(other) / scale, path_of(one) @ turn.T / scale, atol=1e-4)


def test_a_stroke_gone_over_twice_is_not_taken_for_its_way_back() -> None:
    """Where the way back lies upon the way there, each point is nearest to both."""
    mean = resampled(np.array([[10.0, 80.0], [10.0, 10.0], [10.0, 80.0], [50.0, 80.0]]) * 1e-3, 300)
    beside = mean + np.array([0.1e-3, 0.0])
    assert np.abs(retimed(beside, mean) - np.arange(300)).max() < 1.0


@settings(deadline=None, max_examples=40)
@given(seeds, st.floats(-2.0, 2.0))
def test_a_path_ahead_of_its_mean_is_found_as_far_ahead(seed: int, ahead: float) -> None:
    generator = np.random.default_rng(seed)
    mean = resampled(ZIGZAG + generator.normal(0.0, 2e-3, ZIGZAG.shape), 300)
    index = np.arange(300.0)
    shown = np.clip(index + ahead * np.sin(np.pi * index / 299.0) ** 2, 0.0, 299.0)
    path = np.column_stack([np.interp(shown, index, column) for column in mean.T])
    found = retimed(path, mean)
    assert (np.diff(found) >= 0.0).all()
    assert np.abs(found - shown).max() < 0.1
