"""From a recording to a clean motion: what is taken out, and what must not be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.demonstration import Demonstration
from models.errors import UnusableDemonstration
from models.preprocessing.despiking import reflections
from models.preprocessing.filtering import clean, continuous, moving_average

LAWS = settings(deadline=None, max_examples=40)
NOBODY: frozenset[int] = frozenset()


def drawn(rate: float = 100.0, seconds: float = 6.0, dimension: int = 2) -> Demonstration:
    """Return a slow loop on the plate, drawn at an even pace."""
    times = np.arange(round(rate * seconds)) / rate
    turn = 2.0 * np.pi * times / seconds
    axes = [0.03 * np.cos(turn), 0.04 * np.sin(2.0 * turn), 0.01 * np.sin(turn)][:dimension]
    return Demonstration("one", times, np.column_stack(axes), np.ones(len(times), dtype=bool))


def with_points(demonstration: Demonstration, points: np.ndarray) -> Demonstration:
    """Return the same recording with other positions."""
    return Demonstration("one", demonstration.times, points, demonstration.triggers)


@LAWS
@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.integers(1, 80))
def test_a_moving_average_keeps_lines_ends_and_the_mean_of_steps(seed: int, samples: int, window: int) -> None:
    generator = np.random.default_rng(seed)
    line = np.linspace(generator.normal(size=2), generator.normal(size=2), samples)
    np.testing.assert_allclose(moving_average(line, window), line, atol=1e-12)
    points = generator.normal(size=(samples, 2))
    smooth = moving_average(points, window)
    assert smooth.shape == points.shape
    np.testing.assert_allclose(smooth[[0, -1]], points[[0, -1]], atol=1e-12)


@pytest.mark.parametrize("rate", [50.0, 100.0, 250.0, 1000.0])
@pytest.mark.parametrize("dimension", [2, 3])
def test_reflections_are_found_at_any_rate_of_the_cameras(rate: float, dimension: int) -> None:
    whole = drawn(rate, dimension=dimension)
    points = whole.points.copy()
    thrown = [slice(round(0.3 * len(points)), round(0.3 * len(points)) + max(1, round(0.03 * rate)))]
    thrown.append(slice(round(0.7 * len(points)), round(0.7 * len(points)) + 1))
    for place in thrown:
        points[place] += 0.05
    found = clean(with_points(whole, points), NOBODY, 0.07, despiking=True)
    for place in thrown[:1]:
        assert not found.used[place].any()
    untouched = clean(whole, NOBODY, 0.07, despiking=True)
    assert np.abs(found.points - untouched.points).max() < 1.5e-3


@LAWS
@given(st.integers(0, 2**32 - 1), st.sampled_from([60.0, 100.0, 200.0]))
def test_a_clean_recording_loses_hardly_anything(seed: int, rate: float) -> None:
    whole = drawn(rate)
    noise = np.random.default_rng(seed).normal(0.0, 0.2e-3, whole.points.shape)
    found = clean(with_points(whole, whole.points + noise), NOBODY, 0.07, despiking=True)
    assert found.used.mean() > 0.99
    index = np.interp(found.times, whole.times, np.arange(len(whole.times)))
    truth = np.column_stack([np.interp(index, np.arange(len(whole.times)), column) for column in whole.points.T])
    assert np.sqrt(((found.points - truth) ** 2).sum(axis=1)).mean() < 0.3e-3


def test_the_order_in_memory_changes_no_bit() -> None:
    whole = drawn()
    one = clean(whole, NOBODY, 0.07, despiking=True)
    other = clean(with_points(whole, np.asfortranarray(whole.points)), NOBODY, 0.07, despiking=True)
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.times, other.times)


def test_a_short_gap_is_bridged_and_a_long_one_is_told() -> None:
    whole = drawn()
    short, long = whole.points.copy(), whole.points.copy()
    short[200:215] = np.nan
    long[200:320] = np.nan
    bridged = clean(with_points(whole, short), NOBODY, 0.07, despiking=True)
    assert bridged.known.all()
    assert bridged.gap == 0.0
    broken = clean(with_points(whole, long), NOBODY, 0.07, despiking=True)
    assert broken.gap == pytest.approx(1.21, abs=0.02)
    inside = (broken.times > 2.02) & (broken.times < 3.17)
    assert not broken.known[inside].any()
    assert broken.known[~inside].mean() > 0.95


def test_struck_samples_are_not_used() -> None:
    whole = drawn()
    points = whole.points.copy()
    points[100:110] += 0.004
    struck = frozenset(range(100, 110))
    found = clean(with_points(whole, points), struck, 0.07, despiking=False)
    assert not found.used[100:110].any()
    assert np.abs(found.points - clean(whole, NOBODY, 0.07, despiking=False).points).max() < 0.5e-3


@pytest.mark.parametrize("frames", [15, 30, 40])
@pytest.mark.parametrize("place", [0.1, 0.4, 0.85])
def test_places_that_a_tracker_told_again_are_lost_and_what_follows_is_kept(place: float, frames: int) -> None:
    whole = drawn()
    points = whole.points.copy()
    first = round(place * len(points))
    points[first : first + frames] = points[first]
    found = clean(with_points(whole, points), NOBODY, 0.07, despiking=True)
    assert found.used[: first + 1].all()
    assert found.used[first + frames :].all()
    seen = clean(whole, NOBODY, 0.07, despiking=True)
    bridged = (found.times < whole.times[first] - 0.1) | (found.times > whole.times[first + frames] + 0.1)
    assert np.abs(found.points - seen.points)[bridged].max() < 1e-3


@pytest.mark.parametrize("quantum", [0.5e-3, 1e-3, 2e-3])
def test_positions_told_in_coarse_steps_by_a_slow_hand_are_no_reflections(quantum: float) -> None:
    slow = drawn(seconds=15.0)
    found = clean(with_points(slow, np.round(slow.points / quantum) * quantum), NOBODY, 0.07, despiking=True)
    assert found.used.all()


@pytest.mark.parametrize("place", [0.2, 0.4, 0.8])
def test_frames_lost_without_a_gap_in_the_stamps_cost_no_part_of_the_task(place: float) -> None:
    whole = drawn()
    first = round(place * len(whole.points))
    points = np.delete(whole.points, slice(first, first + 40), axis=0)
    short = Demonstration("one", whole.times[: len(points)], points, whole.triggers[: len(points)])
    assert clean(short, NOBODY, 0.07, despiking=True).used.all()


def test_a_lost_marker_and_a_still_hand_are_refused_with_what_to_do() -> None:
    whole = drawn()
    lost = np.full_like(whole.points, np.nan)
    lost[:3] = 0.0
    with pytest.raises(UnusableDemonstration, match="check the cameras"):
        clean(with_points(whole, lost), NOBODY, 0.07, despiking=True)
    with pytest.raises(UnusableDemonstration, match="nothing moves"):
        clean(with_points(whole, np.full_like(whole.points, 0.5)), NOBODY, 0.07, despiking=True)


@LAWS
@given(st.integers(0, 2**32 - 1))
def test_hands_on_a_table_far_away_are_despiked_the_same(seed: int) -> None:
    whole = drawn()
    points = whole.points + np.random.default_rng(seed).normal(0.0, 0.1e-3, whole.points.shape)
    points[300:303] += 0.03
    near, far = (reflections(whole.times, points + offset, 0.07, 0.12) for offset in (0.0, 4.0))
    np.testing.assert_array_equal(near, far)
    assert near[300:303].all()


@LAWS
@given(st.integers(0, 2**32 - 1))
def test_quaternions_of_either_sign_become_one_track(seed: int) -> None:
    generator = np.random.default_rng(seed)
    angle = np.linspace(0.0, 1.0, 50)
    track = np.column_stack([np.sin(angle), np.zeros(50), np.zeros(50), np.cos(angle)])
    flipped = track * generator.choice([-1.0, 1.0], 50)[:, None]
    found = continuous(flipped)
    np.testing.assert_allclose(found, track * np.sign((found[0] * track[0]).sum()), atol=1e-12)
