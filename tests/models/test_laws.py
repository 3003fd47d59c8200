"""Laws of learning: how people lie on the plate, in which order and how quickly they draw changes nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from benchmarks.learning_groups import RINGS, hand, known_group, shape
from benchmarks.learning_laws import judged
from models.demonstration import Demonstration
from models.evaluation import resampled
from models.geometry import diagonal, middle
from models.learning import LearnedMotion, learn

LAWS = settings(deadline=None, max_examples=4, suppress_health_check=list(HealthCheck))
EVEN = np.linspace(0.0, 1.0, 801)


def group(name: str, number: int, seed: int, error: float = 0.6e-3) -> list[Demonstration]:
    """Return hands that err by ``error`` m on a shape."""
    generator = np.random.default_rng(seed)
    return [hand(generator, shape(name), f"p{index}", error) for index in range(number)]


FIRST = {name: (group(name, 4, 3), learn(group(name, 4, 3), compare=False)) for name in ("zigzag", "spiral")}


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest distance in m of a point of one path from the other path, both ways."""
    one, other = resampled(one, 3000), resampled(other, 3000)
    return float(max(cKDTree(one).query(other)[0].max(), cKDTree(other).query(one)[0].max()))


def check_the_same(learned: LearnedMotion, path: np.ndarray, first: LearnedMotion) -> None:
    expected = first.motion.points_at(EVEN)
    assert apart(path, expected) < 1e-3 * diagonal(expected)
    assert learned.report.components == first.report.components
    said = {one.demonstration_id: (one.kind, one.code) for one in learned.verdicts}
    assert said == {one.demonstration_id: (one.kind, one.code) for one in first.verdicts}


@given(st.sampled_from(sorted(FIRST)), st.floats(0.0, 6.3), st.booleans(), st.floats(0.3, 3.0), st.floats(-0.5, 0.5))
@LAWS
def test_a_plate_turned_mirrored_enlarged_and_moved_gets_the_same_path(
    name: str, angle: float, mirrored: bool, scale: float, shift: float
) -> None:
    people, first = FIRST[name]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn = scale * turn @ np.diag([-1.0 if mirrored else 1.0, 1.0])
    learned = learn([replace(one, points=one.points @ turn.T + shift) for one in people], compare=False)
    check_the_same(learned, (learned.motion.points_at(EVEN) - shift) @ np.linalg.inv(turn).T, first)


@given(st.sampled_from(sorted(FIRST)), st.floats(0.2, 5.0), st.permutations(range(4)))
@LAWS
def test_another_pace_and_order_change_only_times(name: str, slower: float, order: list[int]) -> None:
    people, first = FIRST[name]
    learned = learn([replace(people[index], times=slower * people[index].times) for index in order], compare=False)
    check_the_same(learned, learned.motion.points_at(EVEN), first)
    assert learned.motion.duration == pytest.approx(slower * first.motion.duration, rel=0.01)


@given(st.integers(0, 10_000), st.integers(2, 3), st.integers(1, 30))
@settings(deadline=None)
def test_a_middle_turns_with_its_points_and_a_few_far_ones_do_not_move_it(seed: int, width: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    points = generator.normal(size=(count, width))
    turn, _ = np.linalg.qr(generator.normal(size=(width, width)))
    np.testing.assert_allclose(middle(points @ turn.T), middle(points) @ turn.T, atol=1e-9)
    assert diagonal(points @ turn.T + 3.0) == pytest.approx(diagonal(points), rel=1e-9, abs=1e-9)
    far = np.concatenate([points, points, points, 1e3 + points[: max(1, count // 2)]])
    assert np.sqrt(((middle(far) - middle(points)) ** 2).sum()) < 4.0


@given(st.sampled_from(RINGS), st.integers(3, 6), st.integers(0, 10_000))
@LAWS
def test_a_ring_that_people_begin_anywhere_is_that_ring(name: str, number: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    ring = shape(name)
    people: list[Demonstration] = []
    for index in range(number):
        begun = np.roll(ring[:-1], -int(generator.integers(len(ring) - 1)), axis=0)
        people.append(hand(generator, np.concatenate([begun, begun[:1]]), f"p{index}", 0.5e-3))
    learned = learn(people, compare=False)
    assert apart(learned.motion.points_at(EVEN), ring) < 3e-3
    for finding in learned.report.findings:
        assert finding.code == "begun-elsewhere"
        assert 0 < len(finding.people) < number
    assert not any(verdict.code for verdict in learned.verdicts)


@pytest.mark.parametrize("seed", [1, 15, 2, 9, 16, 4, 5, 6])
def test_what_is_said_of_a_group_is_true(seed: int) -> None:
    assert judged(known_group(seed)) == ""


def test_a_button_that_chatters_is_one_press() -> None:
    people = group("wave", 3, 5)
    chattering = []
    for index, one in enumerate(people):
        triggers = one.triggers.copy()
        triggers[100 + 60 * index : 103 + 60 * index] = False
        chattering.append(replace(one, triggers=triggers))
    learned = learn(chattering, compare=False)
    path = learn(people, compare=False).motion.points_at(EVEN)
    assert apart(learned.motion.points_at(EVEN), path) < 5e-3 * diagonal(path)
    assert len(learned.motion.dispense) == 1


def test_who_pressed_less_often_than_the_others_is_left_out_and_told() -> None:
    generator, path = np.random.default_rng(6), shape("wave")
    apart_in_two = np.abs(np.arange(len(path)) / len(path) - 0.5) > 0.1
    people = [hand(generator, path, f"p{index}", 0.6e-3, apart_in_two) for index in range(3)]
    learned = learn([*people, hand(generator, path, "p3", 0.6e-3)], compare=False)
    assert [verdict.code for verdict in learned.verdicts] == ["", "", "", "other-beads"]
    assert len(learned.motion.dispense) == 2
