"""Where a drawing lies is the hand's to say: reflections, lost markers and lines never turn, shift or scale it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from library.errors import InvalidValue
from library.readers import common_plane, fit_to_plate, onto_plane, read_all
from library.readers.lost import without_placeholders
from library.readers.plain_csv import write
from models.demonstration import Demonstration

Spike = tuple[int, float, float, float]
"""Of which person which share of the samples, and how far it is off, in mm, along x, y and z."""


def seams(
    people: int = 5, count: int = 240, depth: float = 4.0, noise: float = 0.1, spikes: Sequence[tuple[int, Spike]] = ()
) -> list[Demonstration]:
    """Return a shallow arc of 120 mm on a level table as ``people`` draw it; ``spikes``: person, and what is off."""
    generator = np.random.default_rng(3)
    along = np.linspace(0.0, 1.0, count)
    found: list[Demonstration] = []
    for person in range(people):
        points = np.column_stack([400 + 120 * along, 300 + depth * np.sin(np.pi * along), 700 + 0 * along])
        points += generator.normal(0.0, noise, points.shape)
        for who, (place, *off) in spikes:
            if who == person:
                points[place % count] += off
        found.append(Demonstration(f"p{person}", np.arange(count) / 100, points / 1000, np.ones(count, dtype=bool)))
    return found


def turned_by(found: list[Demonstration]) -> float:
    """Return the angle in degrees between the plane and the level table."""
    normal = np.cross(*common_plane(found).axes)
    return float(np.degrees(np.arccos(min(1.0, abs(normal[2])))))


BURST = [(2, (place, 0.0, 0.0, 100.0)) for place in range(100, 130)]


@pytest.mark.parametrize(
    ("people", "count", "spikes"),
    [
        (5, 240, [(2, (100, 0.0, 0.0, 100.0))]),
        (5, 240, [(2, (0, 0.0, 0.0, 100.0)), (1, (-1, 0.0, 0.0, -300.0)), (0, (-2, 0.0, 50.0, 100.0))]),
        (5, 240, BURST),
        (1, 240, [(0, spike) for _, spike in BURST]),
        (3, 240, [(person, (17 * k, 0.0, 0.0, 40.0 + k)) for person in range(3) for k in range(14)]),
        (2, 12, [(0, (0, 0.0, 0.0, 100.0)), (1, (-1, 0.0, 0.0, 100.0))]),
        (1, 12, [(0, (5, 0.0, 0.0, 100.0))]),
    ],
)
def test_reflections_do_not_turn_a_shallow_seam(people: int, count: int, spikes: list[tuple[int, Spike]]) -> None:
    found = seams(people, count, spikes=spikes)
    assert turned_by(found) < 2.0
    plane = common_plane(found)
    assert plane.left_out >= len(spikes)
    assert plane.deviation < 0.2e-3 and plane.farthest > 0.03
    clean = common_plane(seams(people, count))
    assert np.linalg.norm((plane.origin - clean.origin) @ np.cross(*clean.axes)) < 0.1e-3


spike = st.tuples(st.integers(0, 4), st.tuples(st.integers(0, 239), *[st.floats(-500, 500)] * 3))


@given(spikes=st.lists(spike, max_size=20))
@settings(deadline=None, max_examples=15)
def test_a_spike_changes_nothing_but_itself(spikes: list[tuple[int, Spike]]) -> None:
    clean, spoilt = seams(), seams(spikes=spikes)
    before, after = (onto_plane(found, common_plane(found)) for found in (clean, spoilt))
    for person, (one, other) in enumerate(zip(before, after, strict=True)):
        honest = np.ones(240, dtype=bool)
        honest[[place for who, (place, *_) in spikes if who == person]] = False
        # The origin is the mean of what is left: it may move by what a few samples weigh, alike for everybody.
        shift = other.points[honest] - one.points[honest]
        assert np.abs(shift - shift[0]).max() < 0.1e-3
        assert np.abs(shift[0]).max() < 5e-3


@given(seed=st.integers(0, 10**6), shift=st.tuples(*[st.floats(-5, 5)] * 3))
@settings(deadline=None, max_examples=12)
def test_what_is_laid_flat_is_the_same_wherever_it_was_drawn(seed: int, shift: tuple[float, float, float]) -> None:
    found = seams(spikes=[(2, (100, 0.0, 0.0, 100.0))])
    turn = Rotation.random(rng=np.random.default_rng(seed))
    moved = [replace(one, points=turn.apply(one.points) + shift) for one in found]
    flat = np.concatenate([one.points for one in onto_plane(found, common_plane(found))])
    again = np.concatenate([one.points for one in onto_plane(moved, common_plane(moved))])
    away = np.linalg.norm(flat[:, None] - flat[None, ::97], axis=2)
    np.testing.assert_allclose(np.linalg.norm(again[:, None] - again[None, ::97], axis=2), away, atol=1e-8)


@pytest.mark.parametrize("people", [1, 2, 5])
def test_a_straight_seam_has_no_plane_of_its_own(people: int) -> None:
    with pytest.raises(InvalidValue, match=r"on one line, about which it may be turned by \d+ degrees; show a wider"):
        common_plane(seams(people, depth=0.0))
    with pytest.raises(InvalidValue, match="on one line"):
        common_plane(seams(people, depth=0.0, noise=0.0))


def test_a_plate_is_filled_by_the_drawing_and_not_by_a_reflection() -> None:
    angle = np.linspace(0, 6, 300)
    points = np.column_stack([np.cos(angle), np.sin(angle)]) * 0.1
    whole = Demonstration("a", angle, points, np.ones(300, dtype=bool))
    spoilt = points.copy()
    spoilt[[0, 100, 299]] += 3.0
    (placed,), (wanted,) = fit_to_plate([replace(whole, points=spoilt)]), fit_to_plate([whole])
    np.testing.assert_allclose(placed.points[1:100], wanted.points[1:100], atol=0.2e-3)


def file_of(folder: Path, name: str, points: np.ndarray) -> Path:
    times = np.arange(len(points)) / 100
    write(folder / name, Demonstration(name, times, points, np.ones(len(points), dtype=bool)))
    return folder / name


@pytest.mark.parametrize("written", [0.0, 9999.0, -1.0, 1e30])
@pytest.mark.parametrize("share", [0.02, 0.3])
def test_a_lost_marker_is_a_gap_however_it_is_written(tmp_path: Path, written: float, share: float) -> None:
    generator = np.random.default_rng(5)
    lost = [generator.random(240) < share for _ in range(3)]
    lost[0][:30] = lost[1][-30:] = lost[2][100:150] = True
    files: list[Path] = []
    for person, (one, gone) in enumerate(zip(seams(3), lost, strict=True)):
        points = one.points.copy()
        points[gone] = written
        files.append(file_of(tmp_path, f"p{person}.csv", points))
    found = read_all(files)
    for one, gone in zip(found, lost, strict=True):
        assert np.array_equal(np.isnan(one.points).all(axis=1), gone)
    assert turned_by(found) < 0.5


@given(count=st.integers(4, 60), rest=st.integers(0, 200), diagonal=st.booleans())
@settings(deadline=None, max_examples=100)
def test_a_hand_that_is_at_the_origin_was_seen_there(count: int, rest: int, diagonal: bool) -> None:
    along = np.linspace(0.0, 0.1, count)
    way = np.column_stack([along, along if diagonal else np.sin(20 * along) * 0.02])
    points = np.concatenate([np.zeros((rest, 2)), way, way[::-1], np.zeros((rest, 2))])
    times = np.arange(len(points)) * 0.01
    assert np.isfinite(without_placeholders(times, points)).all()
