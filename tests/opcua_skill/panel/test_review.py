"""Edits under way, which samples are meant by a click, and where the path would go."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.demonstration import Demonstration, Edits
from models.learning import learn
from models.synthetic import simulated_people
from opcua_skill.client import Path
from opcua_skill.panel.review import (
    Draft,
    Material,
    edits_of,
    instants_struck,
    largest_change,
    raw_samples,
    samples_between,
)

NAMES = ("a", "b", "c")
samples = st.dictionaries(st.sampled_from(NAMES), st.frozensets(st.integers(0, 30), min_size=1, max_size=6), min_size=1)
steps = st.lists(
    st.one_of(
        st.tuples(st.just("strike"), samples),
        st.tuples(st.just("include"), st.tuples(st.sampled_from(NAMES), st.booleans())),
    ),
    max_size=12,
)


def take(draft: Draft, step: tuple[str, object]) -> None:
    kind, given_ = step
    if kind == "strike":
        draft.strike(given_)  # type: ignore[arg-type]
    else:
        draft.include(*given_)  # type: ignore[misc]


@given(steps)
@settings(deadline=None)
def test_undoing_everything_gives_what_was_learned_and_redoing_everything_the_end(taken: list) -> None:
    draft = Draft(Edits())
    for step in taken:
        take(draft, step)
    end = draft.edits
    while draft.can_undo:
        draft.undo()
    assert draft.edits == Edits()
    assert not draft.changed
    while draft.can_redo:
        draft.redo()
    assert draft.edits == end


@given(samples)
@settings(deadline=None)
def test_striking_the_same_samples_again_restores_them(struck: dict) -> None:
    draft = Draft(Edits())
    draft.strike(struck)
    assert draft.struck_count == sum(len(one) for one in struck.values())
    draft.strike(struck)
    assert draft.edits == Edits()


def test_edits_come_back_from_a_version() -> None:
    assert edits_of({"excluded": ["a"], "struck": {"b": [3, 1]}}) == Edits(frozenset({"a"}), {"b": frozenset({1, 3})})
    assert edits_of({}) == Edits()


@pytest.fixture(scope="module")
def material() -> Material:
    people, _ = simulated_people(6, seed=3)
    learned = learn(people)
    path = learned.motion.as_learned()
    aligned = [
        Demonstration(one.demonstration_id, one.times, one.points, np.ones(len(one.times), dtype=bool))
        for one in learned.aligned
    ]
    return Material.of(people, aligned, Path(path.times, path.points, path.covariances, path.dispense))


def test_an_instant_means_the_sample_that_lies_there(material: Material) -> None:
    for name, one in material.aligned.items():
        found = material.samples[name]
        known = found >= 0
        away = np.sqrt(((material.raw[name].points[found[known]] - one.points[known]) ** 2).sum(axis=1))
        assert np.median(away) < 0.001, name
        assert (np.diff(found[known]) >= 0).all()


@given(st.integers(0, 290), st.integers(0, 60))
@settings(deadline=None, max_examples=60)
def test_neighbouring_stretches_share_no_sample_and_miss_none(material: Material, first: int, more: int) -> None:
    found = next(iter(material.samples.values()))
    last = min(first + more, len(found) - 2)
    first = min(first, last)
    whole = samples_between(found, first, len(found) - 1)
    left, right = samples_between(found, first, last), samples_between(found, last + 1, len(found) - 1)
    assert left | right == whole
    if found[last] < found[last + 1]:
        assert not left & right


def test_what_is_struck_is_shown_struck(material: Material) -> None:
    name = next(iter(material.aligned))
    indices = material.picked(name, 100, 140, "aligned")
    assert set(range(100, 141)) <= set(instants_struck(material.samples[name], indices))
    assert material.picked(name, 100, 140, "raw") == frozenset(range(100, 141))


def test_striking_along_the_path_strikes_every_demonstration_there(material: Material) -> None:
    middle = len(material.path.times) // 2
    found = material.picked_everywhere(middle - 5, middle + 5)
    assert set(found) == set(material.aligned)
    target = material.path.points[middle]
    for name, indices in found.items():
        points = material.raw[name].points[sorted(indices)]
        assert np.sqrt(((points - target) ** 2).sum(axis=1)).min() < 0.02


def test_the_path_is_expected_to_move_away_from_what_is_left_out(material: Material) -> None:
    saved = Edits()
    assert np.array_equal(material.expected(saved, saved), material.path.points)
    name = next(iter(material.aligned))
    moved = material.expected(saved, Edits(frozenset({name}))) - material.path.points
    clock = material.aligned[name].times
    away = material.aligned[name].points - material.mean(saved)
    there = np.stack([np.interp(material.path.times, clock, np.nan_to_num(away[:, k])) for k in range(2)], axis=1)
    assert (moved * there).sum() < 0


def test_no_aligned_demonstration_leaves_the_path_alone() -> None:
    path = Path(np.array([0.0, 1.0]), np.zeros((2, 2)), np.zeros((2, 2, 2)), np.ones(2, dtype=bool))
    bare = Material.of([], [], path)
    assert np.array_equal(bare.expected(Edits(), Edits()), path.points)
    assert bare.picked_everywhere(0, 1) == {}


def test_the_largest_change_is_found_where_it_is() -> None:
    share = np.linspace(0.0, 1.0, 201)
    line = np.stack([share, np.zeros(201)], axis=1)
    bent = line + np.stack([np.zeros(201), 0.01 * np.exp(-(((share - 0.7) / 0.05) ** 2))], axis=1)
    one, two = (Path(share, points, np.zeros((201, 2, 2)), np.ones(201, dtype=bool)) for points in (line, bent))
    away, where = largest_change(one, two)
    assert away == pytest.approx(0.01, rel=0.05)
    assert where == pytest.approx(0.7, abs=0.03)
    assert largest_change(one, one)[0] == 0.0


def test_a_recording_with_gaps_is_followed(material: Material) -> None:
    name = next(iter(material.aligned))
    raw = material.raw[name]
    points = raw.points.copy()
    points[200:230] = np.nan
    holed = Demonstration(name, raw.times, points, raw.triggers)
    found = raw_samples(holed, material.aligned[name])
    assert not set(range(200, 230)) & set(found.tolist())
