"""Whatever comes in: a right answer, or a LearningError that says what to do. Never another exception, never NaN."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from models.demonstration import Demonstration, Edits
from models.errors import LearningError
from models.learning import LearnedMotion, LearningOptions, learn
from models.synthetic import simulated_people

PEOPLE, TRUTH = simulated_people(4, 0)
RELAXED = settings(deadline=None, max_examples=16, suppress_health_check=list(HealthCheck))


def drawn(points: np.ndarray, name: str = "one", duration: float = 5.0) -> Demonstration:
    """Return a demonstration of these points at an even pace."""
    times = np.linspace(0.0, duration, len(points)) if len(points) > 1 else np.zeros(len(points))
    return Demonstration(name, times, np.asarray(points, dtype=float), np.ones(len(points), dtype=bool))


def learned_or_refused(
    demonstrations: list[Demonstration], options: LearningOptions | None = None
) -> LearnedMotion | None:
    """Return what was learned, checked to be sound, or None where it was refused with a reason."""
    try:
        learned = learn(demonstrations, options=options)
    except LearningError as refused:
        assert len(str(refused)) > 20
        return None
    path = learned.motion.as_learned()
    for values in (path.times, path.points, path.covariances, path.phases):
        assert np.isfinite(values).all()
    assert (np.diff(path.times) > 0).all()
    assert (np.diff(path.phases) >= 0).all()
    everything = np.concatenate(
        [one.points[np.isfinite(one.points).all(axis=1)] for one in demonstrations if len(one.points)]
    )
    size = np.sqrt((np.ptp(everything, axis=0) ** 2).sum())
    assert (path.points >= everything.min(axis=0) - 0.3 * size).all()
    assert (path.points <= everything.max(axis=0) + 0.3 * size).all()
    assert len(learned.verdicts) == len(demonstrations)
    return learned


def test_all_identical_gives_that_path() -> None:
    same = [Demonstration(f"copy-{i}", PEOPLE[0].times, PEOPLE[0].points, PEOPLE[0].triggers) for i in range(4)]
    learned = learned_or_refused(same)
    assert learned is not None
    assert learned.report.path_error["rms"] < 1e-3


@pytest.mark.parametrize("preset", ["recommended", "paper"])
def test_two_identical_straight_lines_do_not_break_the_mixture(preset: str) -> None:
    line = np.linspace([0.0, 0.0], [0.05, 0.02], 200)
    learned = learned_or_refused(
        [drawn(line, "a"), drawn(line, "b")],
        LearningOptions(preset=preset),  # type: ignore[arg-type]
    )
    assert learned is not None
    np.testing.assert_allclose(learned.motion.points_at(np.array([0.0, 1.0])), line[[0, -1]], atol=1e-3)


@pytest.mark.parametrize("preset", ["recommended", "paper"])
def test_movement_along_one_axis_in_space_is_learned(preset: str) -> None:
    deep = np.zeros((300, 3))
    deep[:, 2] = np.linspace(0.0, 0.1, 300)
    options = LearningOptions(preset=preset)  # type: ignore[arg-type]
    assert learned_or_refused([drawn(deep, str(i)) for i in range(3)], options) is not None


@pytest.mark.parametrize(
    "demonstrations",
    [
        [],
        [PEOPLE[0]],
        [drawn(np.zeros((50, 2)), str(i)) for i in range(3)],
        [drawn(np.full((50, 2), np.nan), str(i)) for i in range(3)],
        [drawn(np.full((50, 2), np.inf), str(i)) for i in range(3)],
        [drawn(np.ones((0, 2)), str(i)) for i in range(3)],
        [drawn(np.array([[0.0, 0.0], [0.1, 0.1]]), str(i)) for i in range(3)],
        [drawn(np.zeros((50, 4)), str(i)) for i in range(3)],
        [drawn(np.zeros((50, 1)), str(i)) for i in range(3)],
        [PEOPLE[0], PEOPLE[0]],
    ],
    ids=["none", "one", "still", "NaN", "infinite", "empty", "two points", "four columns", "one column", "same id"],
)
def test_what_cannot_be_learned_is_refused(demonstrations: list[Demonstration]) -> None:
    with pytest.raises(LearningError):
        learn(demonstrations)


def test_times_that_stand_still_or_run_back_are_a_verdict() -> None:
    times = PEOPLE[0].times.copy()
    times[50] = times[49]
    twice = Demonstration("twice", times, PEOPLE[0].points, PEOPLE[0].triggers)
    learned = learn([twice, *PEOPLE[1:]])
    assert learned.verdicts[0].fault == "invalid"
    assert "times" in learned.verdicts[0].reason


def test_lengths_that_disagree_are_a_verdict() -> None:
    short = Demonstration("short", PEOPLE[0].times[:-3], PEOPLE[0].points, PEOPLE[0].triggers)
    learned = learn([short, *PEOPLE[1:]])
    assert learned.verdicts[0].fault == "invalid"


@pytest.mark.parametrize("turns", [1.0, 2.0])
def test_closed_loops_are_learned_whole(turns: float) -> None:
    generator = np.random.default_rng(0)
    angle = np.linspace(0.0, 2.0 * np.pi * turns, 600)
    loops = [
        drawn(0.03 * np.column_stack([np.cos(angle), np.sin(angle)]) + generator.normal(0, 1e-3, 2), f"p{i}")
        for i in range(5)
    ]
    learned = learned_or_refused(loops)
    assert learned is not None
    assert learned.report.length == pytest.approx(2.0 * np.pi * turns * 0.03, rel=0.03)


def test_paths_that_cross_themselves_are_learned() -> None:
    generator = np.random.default_rng(1)
    angle = np.linspace(0.0, 2.0 * np.pi, 500)
    eight = 0.03 * np.column_stack([np.sin(angle), np.sin(2.0 * angle)])
    learned = learned_or_refused([drawn(eight + generator.normal(0, 5e-4, 2), f"p{i}") for i in range(5)])
    assert learned is not None
    middle = learned.motion.points_at(np.array([0.5]))[0]
    np.testing.assert_allclose(middle, 0.0, atol=2e-3)


@pytest.mark.parametrize("preset", ["recommended", "paper"])
@pytest.mark.parametrize("components", [1, 2, 5, 30, 64])
def test_any_number_of_components_gives_a_sound_path(preset: str, components: int) -> None:
    options = LearningOptions(preset=preset, components=components)  # type: ignore[arg-type]
    learned = learned_or_refused(PEOPLE, options)
    if learned is not None:
        assert learned.report.components == components


@pytest.mark.parametrize("clock", ["path", "time"])
@pytest.mark.parametrize("alignment", ["dtw", "fastdtw"])
@pytest.mark.parametrize("preset", ["recommended", "paper"])
def test_every_combination_of_options_learns(preset: str, alignment: str, clock: str) -> None:
    options = LearningOptions(preset=preset, alignment=alignment, clock=clock, time_step=0.02)  # type: ignore[arg-type]
    learned = learned_or_refused(PEOPLE, options)
    assert learned is not None
    assert learned.motion.clock == clock
    assert learned.motion.time_step == 0.02


def test_shapes_half_and_half_are_not_averaged_silently() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 500)
    circles = [
        drawn(0.03 * np.column_stack([np.cos(angle), np.sin(angle)]) + 0.04 + 0.001 * i, f"circle-{i}")
        for i in range(3)
    ]
    with pytest.raises(LearningError, match="different shapes"):
        learn([*circles, *PEOPLE[:3]])


@pytest.mark.slow
def test_a_million_points_are_learned_as_well() -> None:
    people, _ = simulated_people(2, 3, rate=60_000.0)
    learned = learned_or_refused(people)
    assert learned is not None
    assert sum(len(one.times) for one in people) > 500_000


def test_striking_nearly_everything_is_a_verdict() -> None:
    edits = Edits().with_struck("person-01", frozenset(range(len(PEOPLE[0].times) - 2)))
    learned = learn(PEOPLE, edits)
    assert learned.verdicts[0].fault == "invalid"


@given(
    hnp.arrays(
        np.float64,
        st.tuples(st.integers(0, 60), st.integers(2, 3)),
        elements=st.floats(-1.0, 1.0, width=32) | st.sampled_from([math.nan, math.inf, 0.0, 0.0]),
    ),
    st.floats(0.01, 100.0),
)
@RELAXED
def test_any_points_among_good_ones_leave_a_sound_path(points: np.ndarray, duration: float) -> None:
    base = PEOPLE
    if points.shape[1] == 3:
        base = [
            Demonstration(
                one.demonstration_id, one.times, np.column_stack([one.points, one.points[:, 0]]), one.triggers
            )
            for one in PEOPLE
        ]
    learned_or_refused([drawn(points, "odd", duration), *base[:3]])


@pytest.mark.parametrize("length", [0.1, 10.0])
def test_a_seam_as_long_as_a_gantry_is_learned_with_its_people_s_scatter(length: float) -> None:
    along = np.linspace(0.0, 1.0, 600)
    people = []
    for index, (slow, wide) in enumerate([(3.0, 0.0), (5.0, 0.006), (8.0, -0.004)]):
        points = length * np.column_stack([along * (1.0 + wide), 0.01 * np.sin(np.pi * along) ** 2 + wide])
        people.append(drawn(points + length * wide, f"seam-{index}", 12.0 + slow))
    learned = learned_or_refused(people)
    assert learned is not None
    assert abs(learned.motion.as_learned().points[:, 0].max() - length) < 0.01 * length


def test_one_place_and_a_sample_thrown_off_it_is_refused_by_a_reason() -> None:
    still = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 1.0], [1.0, 1.0], [1.0, 1.0]])
    learned = learned_or_refused([drawn(still, "still"), *PEOPLE[:3]])
    assert learned is not None
    assert learned.verdicts[0].fault == "invalid"


@given(
    hnp.arrays(np.float64, (4, 40, 2), elements=st.floats(0.0, 0.25, width=32)),
    st.sampled_from(["recommended", "paper"]),
)
@RELAXED
def test_any_four_scribbles_give_a_sound_path_or_a_reason(scribbles: np.ndarray, preset: str) -> None:
    options = LearningOptions(preset=preset)  # type: ignore[arg-type]
    learned_or_refused([drawn(points, f"p{i}") for i, points in enumerate(scribbles)], options)


@given(st.integers(2, 9), st.integers(0, 10_000), st.integers(3, 7))
@RELAXED
def test_people_drawing_any_polyline_are_understood(number: int, seed: int, edges: int) -> None:
    corners = np.random.default_rng(seed).uniform(0.0, 0.09, (edges + 1, 2))
    people, _ = simulated_people(number, seed, True, number // 5, corners=corners)
    learned_or_refused(people)


@given(st.sets(st.integers(0, 400), max_size=300), st.integers(0, 3))
@RELAXED
def test_any_samples_struck_leave_a_sound_path(indices: set[int], person: int) -> None:
    name = PEOPLE[person].demonstration_id
    learned = learn(PEOPLE, Edits().with_struck(name, frozenset(indices)))
    assert np.isfinite(learned.motion.as_learned().points).all()
