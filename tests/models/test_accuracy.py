"""How near the learned path comes to the truth, and which demonstrations are found out."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from models.demonstration import Demonstration, Floats
from models.evaluation import corner_error, end_error, frechet, path_rms, resampled, smoothness
from models.learning import LearnedMotion, LearningOptions, VerdictKind, learn
from models.phase import arc_lengths
from models.synthetic import ZIGZAG_IN_SPACE, raster, simulated_group, simulated_people, true_orientations

EVEN = np.linspace(0.0, 1.0, 2001)
SEEDS = (0, 1, 2)


def size_of(learned: LearnedMotion) -> float:
    return float(np.sqrt((np.ptp(learned.motion.points_at(EVEN), axis=0) ** 2).sum()))


def kinds(learned: LearnedMotion) -> list[VerdictKind]:
    return [verdict.kind for verdict in learned.verdicts]


def errors_mm(learned: LearnedMotion, truth: np.ndarray) -> np.ndarray:
    path = learned.motion.points_at(EVEN)
    return 1e3 * np.array(
        [path_rms(path, truth), frechet(path, truth), corner_error(path, truth[1:-1]), end_error(path, truth)]
    )


@pytest.mark.parametrize("reflections", [False, True])
@pytest.mark.parametrize("early_release", [0, 4])
def test_twenty_sloppy_people_make_a_path_near_the_truth(reflections: bool, early_release: int) -> None:
    found = []
    for seed in SEEDS:
        people, truth = simulated_people(20, seed, reflections, early_release)
        learned = learn(people)
        assert learned.report.components == 4
        found.append(errors_mm(learned, truth))
    rms, furthest, corners, ends = np.mean(found, axis=0)
    assert rms <= 0.48
    assert furthest <= 1.15
    assert corners <= 0.58
    assert ends <= 0.65


def test_the_paper_preset_misses_the_ends_and_is_thrown_off_by_reflections() -> None:
    people, truth = simulated_people(20, 0)
    clean = errors_mm(learn(people, options=LearningOptions(preset="paper")), truth)
    people, truth = simulated_people(20, 0, reflections=True)
    spiked = errors_mm(learn(people, options=LearningOptions(preset="paper")), truth)
    assert clean[3] > 3.0
    assert spiked[0] > clean[0]


def test_paths_in_space_are_as_near_to_the_truth_as_people_let_them_be() -> None:
    found = []
    for seed in SEEDS:
        people, truth = simulated_people(20, seed, True, 4, corners=ZIGZAG_IN_SPACE)
        found.append(errors_mm(learn(people), truth))
    rms, furthest, corners, ends = np.mean(found, axis=0)
    assert rms <= 0.54
    assert furthest <= 1.35
    assert corners <= 1.0
    assert ends <= 0.7


def test_the_tool_is_held_as_it_was_meant() -> None:
    angles: list[np.ndarray] = []
    for seed in range(3):
        people, _ = simulated_people(20, seed, True, 2, corners=ZIGZAG_IN_SPACE, orientation=True)
        flipped = [
            Demonstration(one.demonstration_id, one.times, one.points, one.triggers, orientations=-one.orientations)
            if index % 2 and one.orientations is not None
            else one
            for index, one in enumerate(people)
        ]
        motion = learn(flipped, compare=False).motion
        phases = np.linspace(0.0, 1.0, 501)
        held = motion.orientations_at(phases)
        np.testing.assert_allclose((held * held).sum(axis=1), 1.0, atol=1e-12)
        agreement = np.abs((held * true_orientations(phases)).sum(axis=1))
        angles.append(np.rad2deg(2.0 * np.arccos(np.minimum(agreement, 1.0))))
    assert np.mean([np.sqrt((own**2).mean()) for own in angles]) <= 0.8
    assert np.mean([own.max() for own in angles]) <= 1.5


def test_all_early_releases_are_found_and_hardly_any_false_one() -> None:
    missed, false = 0, 0
    for seed in range(4):
        people, _ = simulated_people(20, seed, True, 4)
        whole, _ = simulated_people(20, seed)
        cut = [len(one.times) < len(other.times) for one, other in zip(people, whole, strict=True)]
        part = [kind == VerdictKind.USED_IN_PART for kind in kinds(learn(people))]
        missed += sum(was and not found for was, found in zip(cut, part, strict=True))
        false += sum(found and not was for was, found in zip(cut, part, strict=True))
    assert missed == 0
    assert false <= 2


def changed(one: Demonstration, points: np.ndarray, times: np.ndarray | None = None) -> Demonstration:
    times = one.times if times is None else times
    return Demonstration(one.demonstration_id, times, points, np.ones(len(times), dtype=bool))


def test_a_late_start_is_found_and_the_start_kept() -> None:
    people, truth = simulated_people(12, 2)
    late = [changed(one, one.points[300:], one.times[300:] - one.times[300]) for one in people[:2]]
    learned = learn([*late, *people[2:]])
    assert [verdict.kind for verdict in learned.verdicts[:2]] == [VerdictKind.USED_IN_PART] * 2
    assert all("started at" in verdict.reason for verdict in learned.verdicts[:2])
    assert errors_mm(learned, truth)[3] <= 1.5


def test_one_odd_demonstration_does_not_bend_the_path() -> None:
    people, _ = simulated_people(7, 3)
    plain = learn(people[1:]).motion.points_at(EVEN)
    bent = people[0].points.copy()
    bump = np.exp(-(((np.arange(len(bent)) / len(bent)) - 0.4) ** 2) / 0.004)
    bent[:, 1] += 0.03 * bump
    learned = learn([changed(people[0], bent), *people[1:]])
    verdict = learned.verdicts[0]
    assert verdict.kind == VerdictKind.LEFT_OUT
    assert verdict.fault == "odd"
    assert verdict.place is not None and abs(verdict.place - 0.4) < 0.2
    assert verdict.size is not None and verdict.size > 0.01
    assert "mm above the others" in verdict.reason
    np.testing.assert_allclose(learned.motion.points_at(EVEN), plain, atol=1e-9)


@pytest.mark.parametrize(("scale", "shift"), [(1.1, 0.0), (0.9, 0.0), (1.0, 6e-3), (1.06, -4e-3)])
def test_who_draws_the_same_shape_larger_or_beside_is_no_odd_one(scale: float, shift: float) -> None:
    people, truth = simulated_people(7, 3)
    centre = truth.mean(axis=0)
    other = (people[0].points - centre) * scale + centre + shift
    learned = learn([changed(people[0], other), *people[1:]])
    assert VerdictKind.LEFT_OUT not in kinds(learned)


def test_who_draws_far_beside_the_others_is_left_out() -> None:
    people, _ = simulated_people(7, 3)
    learned = learn([changed(people[0], people[0].points + 0.02), *people[1:]])
    assert learned.verdicts[0].fault == "odd"
    assert VerdictKind.LEFT_OUT not in kinds(learned)[1:]


def test_real_people_are_all_used_and_the_path_is_smooth_and_near_their_mean(lasa_shape: list[Demonstration]) -> None:
    learned = learn(lasa_shape)
    assert kinds(learned) == [VerdictKind.USED] * len(lasa_shape)
    sure = np.sqrt(np.mean(np.square(learned.report.repeatability)) / len(lasa_shape))
    assert learned.report.path_error["rms"] <= 0.75 * sure
    assert learned.report.path_error["max"] <= 2.5 * sure
    assert learned.report.components <= 6
    assert smoothness(learned.motion.points_at(np.linspace(0.0, 1.0, 300))) >= -14.0


def test_an_odd_one_is_kept_when_rejection_is_switched_off() -> None:
    people, _ = simulated_people(7, 3)
    bent = people[0].points + np.array([0.0, 0.03]) * (np.arange(len(people[0].points)) > 400)[:, None]
    learned = learn([changed(people[0], bent), *people[1:]], options=LearningOptions(reject_outliers=False))
    assert VerdictKind.LEFT_OUT not in kinds(learned)


def test_drawing_backwards_is_recognised() -> None:
    people, truth = simulated_people(6, 4)
    learned = learn([changed(people[0], people[0].points[::-1].copy()), *people[1:]])
    assert learned.verdicts[0].kind == VerdictKind.LEFT_OUT
    assert "opposite direction" in learned.verdicts[0].reason
    assert errors_mm(learned, truth)[0] < 1.5


def test_drawing_twice_is_recognised_and_the_first_time_used() -> None:
    people, truth = simulated_people(6, 5)
    one = people[0]
    back = np.linspace(one.points[-1], one.points[0], 100)
    points = np.concatenate([one.points, back, one.points])
    times = np.arange(len(points)) * 0.01
    learned = learn([changed(one, points, times), *people[1:]])
    assert learned.verdicts[0].kind == VerdictKind.USED_IN_PART
    assert "more than once" in learned.verdicts[0].reason
    assert errors_mm(learned, truth)[0] < 1.5


def test_another_shape_among_them_is_left_out() -> None:
    people, _ = simulated_people(8, 6)
    angle = np.linspace(0.0, 2.0 * np.pi, 800)
    circle = 0.03 * np.column_stack([np.cos(angle), np.sin(angle)]) + np.array([0.035, 0.045])
    other = Demonstration("circle", np.arange(800) * 0.01, circle, np.ones(800, dtype=bool))
    learned = learn([other, *people])
    assert learned.verdicts[0].fault == "odd"
    assert learned.report.components == 4


def test_a_pause_changes_the_timing_and_not_the_path() -> None:
    people, truth = simulated_people(6, 7)
    one = people[0]
    points = np.concatenate([one.points[:400], np.repeat(one.points[400:401], 300, axis=0), one.points[400:]])
    learned = learn([changed(one, points, np.arange(len(points)) * 0.01), *people[1:]])
    assert learned.verdicts[0].kind == VerdictKind.USED
    assert errors_mm(learned, truth)[0] < 1.3


def test_people_who_draw_at_other_places_and_sizes_do_not_make_a_limp_shape() -> None:
    people, truth = simulated_people(10, 8)
    generator = np.random.default_rng(0)
    spread = [
        changed(one, (one.points - truth.mean(axis=0)) * generator.uniform(0.7, 1.3) + generator.normal(0, 0.01, 2))
        for one in people
    ]
    learned = learn(spread)
    path = learned.motion.points_at(EVEN)
    assert learned.report.components == 4
    edges = np.array([np.ptp(path[:, 0]), np.ptp(path[:, 1])]) / np.ptp(truth, axis=0)
    np.testing.assert_allclose(edges, 1.0, atol=0.12)


def test_placed_freely_they_are_laid_upon_each_other() -> None:
    people, truth = simulated_people(8, 9)
    generator = np.random.default_rng(1)
    spread = []
    for one in people:
        angle = generator.normal(0.0, 0.5)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        centred = (one.points - truth.mean(axis=0)) @ turn.T
        spread.append(changed(one, centred * generator.uniform(0.6, 1.5) + generator.normal(0, 0.05, 2)))
    learned = learn(spread, options=LearningOptions(place="free"))
    path = learned.motion.points_at(EVEN)
    size = np.sqrt((np.ptp(path, axis=0) ** 2).sum())
    assert max(learned.report.repeatability) < 0.05 * size
    assert 4 <= learned.report.components <= 6


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("people", [3, 5, 20])
def test_chance_waves_of_few_hands_are_no_part_of_a_short_stroke(people: int, seed: int) -> None:
    truth = np.array([[5.0, 5.0], [45.0, 18.0], [38.0, 50.0]]) * 1e-3
    learned = learn(simulated_people(people, seed, corners=truth)[0], compare=False)
    assert 2 <= learned.report.components <= 4
    assert path_rms(learned.motion.points_at(np.linspace(0.0, 1.0, 500)), truth) < 4.0e-3 / np.sqrt(people)


def shaken(truth: Floats, people: int, wave: float = 0.0) -> list[Demonstration]:
    """Return people who draw the points of ``truth`` (n, 2), each beside the others and waving by ``wave`` in m."""
    generator = np.random.default_rng(4)
    ways = np.linspace(0.0, 1.0, len(truth))
    shown: list[Demonstration] = []
    for index in range(people):
        beside, waves = generator.normal(0.0, 0.7e-3, 2), generator.uniform(0.0, 2.0 * np.pi, (2, 3))
        waving = wave * np.sin(2.0 * np.pi * np.array([1.3, 2.9, 4.1]) * ways[:, None] + waves[:, None]).sum(axis=2).T
        shown.append(
            Demonstration(f"person-{index}", 8.0 * ways, truth + beside + waving, np.ones(len(truth), dtype=bool))
        )
    return shown


@pytest.mark.parametrize("people", [5, 20])
def test_a_shallow_arc_that_all_draw_stays_an_arc(people: int) -> None:
    turn = np.linspace(-0.35, 0.35, 800)
    truth = 0.06 * np.column_stack([np.sin(turn), np.cos(turn)])
    learned = learn(shaken(truth, people, 0.4e-3), compare=False)
    middle = learned.motion.points_at(np.array([0.0, 0.5, 1.0]))
    sagitta = np.sqrt(((middle[1] - 0.5 * (middle[0] + middle[2])) ** 2).sum())
    assert sagitta == pytest.approx(0.06 * (1.0 - np.cos(0.35)), rel=0.15)


def mean_of_whole(learned: LearnedMotion) -> Floats:
    """Return the mean (n, d) of those who drew all of it."""
    return np.mean([one.points for one in learned.aligned if np.isfinite(one.points).all()], axis=0)


@pytest.mark.parametrize(("lines", "people"), [(4, 3), (6, 6), (8, 3), (8, 5), (8, 20)])
def test_a_raster_has_a_component_for_each_line_and_no_path_bulges_at_its_joints(lines: int, people: int) -> None:
    """Many hands are sure of the corners of its joints too; few are not."""
    group = simulated_group(people, 3, reflections=True, corners=raster(lines))
    learned = learn(group.people, compare=False)
    assert lines <= learned.report.components <= 2 * lines
    path = learned.motion.points_at(np.linspace(0.0, 1.0, 2000))
    away = cKDTree(resampled(mean_of_whole(learned), 4000)).query(path)[0]
    assert away.max() < 1.3e-3
    assert path_rms(path, group.truth) < 1.35 * path_rms(group.agreed, group.truth)


def test_a_long_raster_is_followed_closely_though_its_joints_are_hardly_longer_than_a_hand_s_error() -> None:
    group = simulated_group(12, 0, reflections=True, corners=raster(12))
    learned = learn(group.people, compare=False)
    path = learned.motion.points_at(np.linspace(0.0, 1.0, 3000))
    assert len(learned.aligned[0].times) > 450, "a long way has more instants"
    assert corner_error(path, group.truth[1:-1]) < 1.6 * corner_error(group.agreed, group.truth[1:-1])
    steps = np.diff(resampled(path, round(arc_lengths(path)[-1] / 0.6e-3)), axis=0)
    lengths = np.sqrt((steps * steps).sum(axis=1))
    cosines = (steps[1:] * steps[:-1]).sum(axis=1) / (lengths[1:] * lengths[:-1])
    assert (cosines > -0.5).all(), "a joint is a corner, nowhere a needle"


def test_a_path_of_many_turns_is_followed() -> None:
    turns = np.linspace(0.0, 1.0, 800)
    people = shaken(np.column_stack([0.09 * turns, 0.01 * np.sin(16.0 * np.pi * turns)]), 5)
    learned = learn(people, compare=False)
    mean = np.mean([one.points for one in people], axis=0)
    assert frechet(learned.motion.points_at(np.linspace(0.0, 1.0, 2000)), mean) < 0.6e-3
