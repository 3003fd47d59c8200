"""What the report tells: how a version compares to the one before and to the paper's preset, and verdicts in words."""

from dataclasses import replace

import numpy as np
import pytest

from models.comparison import distance
from models.demonstration import Demonstration, Edits
from models.errors import MixedDemonstrations, OptionOutOfRange
from models.learning import LearnedMotion, LearningOptions, VerdictKind, learn
from models.report import Previous, mean_repeatability
from models.screening.messages import what_it_did
from models.synthetic import simulated_people

PEOPLE, TRUTH = simulated_people(6, 0)
FRAME = np.array([[0.005, 0.005], [0.06, 0.005], [0.06, 0.085], [0.005, 0.085]])
LINE = np.array([[0.005, 0.005], [0.06, 0.085]])


@pytest.fixture(scope="module")
def first() -> LearnedMotion:
    """What six people have in common."""
    return learn(PEOPLE)


def before(learned: LearnedMotion, version: int = 1) -> Previous:
    return Previous(version, learned.motion, mean_repeatability(learned.report.as_dict()))


def drawn(corners: np.ndarray, number: int, name: str, seed: int = 1) -> list[Demonstration]:
    """Return people who draw this polygon, their ids beginning with ``name``."""
    people, _ = simulated_people(number, seed, corners=corners)
    return [replace(one, demonstration_id=f"{name}-{index}") for index, one in enumerate(people)]


def test_comparing_changes_nothing_of_what_is_learned(first: LearnedMotion) -> None:
    again = learn(PEOPLE, previous=before(learn(PEOPLE[:4])))
    assert again.motion.means.tobytes() == first.motion.means.tobytes()
    assert again.motion.covariances.tobytes() == first.motion.covariances.tobytes()
    assert first.report.previous is None
    assert again.report.previous is not None


def test_a_version_lies_on_itself(first: LearnedMotion) -> None:
    again = learn(PEOPLE, previous=before(first, 7)).report.previous
    assert again is not None
    assert again["version"] == 7
    assert again["distance"]["max"] < 1e-4
    for name in ("duration", "length", "components", "repeatability", "smoothness"):
        assert again[name]["before"] == again[name]["now"]


def test_the_distance_to_the_version_before_is_told_with_its_place(first: LearnedMotion) -> None:
    moved = []
    for one in PEOPLE:
        near_the_end = np.clip((one.points[:, 1] - 0.065) / 0.02, 0.0, 1.0)
        moved.append(replace(one, points=one.points + 0.004 * near_the_end[:, None] * [-1.0, 0.0]))
    told = learn(moved, previous=before(first)).report.previous
    assert told is not None
    assert 0.003 < told["distance"]["max"] < 0.005
    assert 0.002 < told["distance"]["frechet"] < 0.005
    assert told["distance"]["rms"] < told["distance"]["max"]
    assert told["distance"]["place"] > 0.9
    assert told["distance"]["point"][1] == pytest.approx(0.085, abs=0.004)


def test_another_dimension_is_told_not_compared(first: LearnedMotion) -> None:
    deep = [replace(one, points=np.column_stack([one.points, 0.0 * one.times])) for one in PEOPLE]
    told = learn(deep, previous=before(first)).report.previous
    assert told == {"version": 1, "note": "version 1 has 2 dimensions, this one 3"}


def test_the_distance_of_known_paths() -> None:
    line = np.linspace([0.0, 0.0], [0.1, 0.0], 1000)
    bump = line + np.column_stack([np.zeros(1000), 0.01 * np.exp(-(((line[:, 0] - 0.075) / 0.005) ** 2))])
    found = distance(bump, line)
    assert found.max == pytest.approx(0.01, abs=1e-5)
    assert found.place == pytest.approx(0.75, abs=0.01)
    assert found.point == pytest.approx((0.075, 0.01), abs=1e-3)
    assert distance(line, line[::-1]).frechet == pytest.approx(0.1, abs=1e-3)
    missing = distance(line[:800], line)
    assert missing.max == pytest.approx(0.02, abs=1e-3)
    assert missing.place == 1.0


def test_the_paper_s_preset_is_told_as_it_would_have_done(first: LearnedMotion) -> None:
    real = learn(PEOPLE, options=LearningOptions(preset="paper"))
    told = first.report.paper
    assert told is not None
    assert told["components"] == 4
    assert told["demonstrations"] == 6
    assert told["path_error"]["rms"] == pytest.approx(real.report.path_error["rms"], rel=0.15)
    assert told["end_error"]["end"] == pytest.approx(real.report.end_error["end"], rel=0.15)
    assert told["length"] == pytest.approx(real.report.length, rel=0.05)
    phases = np.linspace(0.0, 1.0, 1000)
    apart = distance(first.motion.points_at(phases), real.motion.points_at(phases))
    assert told["distance"]["frechet"] == pytest.approx(apart.frechet, rel=0.15)
    assert real.report.paper is None
    assert max(first.report.end_error.values()) < 0.1 * min(told["end_error"].values())


def test_excluded_demonstrations_are_not_the_paper_s_either() -> None:
    told = learn(PEOPLE, Edits(frozenset({PEOPLE[0].demonstration_id}))).report.paper
    assert told is not None
    assert told["demonstrations"] == 5


def test_what_is_no_recording_is_not_the_paper_s_either() -> None:
    tiny = replace(PEOPLE[0], demonstration_id="in another unit", points=1000.0 * PEOPLE[0].points)
    told = learn([tiny, *PEOPLE]).report.paper
    assert told is not None
    assert told["demonstrations"] == 6
    assert told["distance"]["max"] < 0.03


def test_long_recordings_are_compared_by_a_share_of_their_samples() -> None:
    dense, _ = simulated_people(3, 0, rate=1000.0)
    thin = [replace(one, times=one.times[::10], points=one.points[::10], triggers=one.triggers[::10]) for one in dense]
    ours, few = learn(dense).report.paper, learn(thin).report.paper
    assert ours is not None
    assert few is not None
    assert ours["path_error"]["rms"] == pytest.approx(few["path_error"]["rms"], rel=0.35)


def test_the_comparison_can_be_left_out(first: LearnedMotion) -> None:
    alone = learn(PEOPLE, compare=False)
    assert alone.report.paper is None
    assert alone.motion.means.tobytes() == first.motion.means.tobytes()


def paused(one: Demonstration, at: float, seconds: float) -> Demonstration:
    """Return the demonstration with a rest at this share of its samples."""
    index = int(at * len(one.times))
    count = int(seconds / float(np.median(np.diff(one.times))))
    step = float(np.median(np.diff(one.times)))
    still = np.random.default_rng(0).normal(0.0, 1e-4, (count, 2)) + one.points[index]
    later = one.times[index:] + count * step
    times = np.concatenate([one.times[:index], one.times[index] + step * np.arange(count), later])
    points = np.concatenate([one.points[:index], still, one.points[index:]])
    return replace(one, times=times, points=points, triggers=np.ones(len(times), dtype=bool))


def test_a_pause_is_named_with_its_length_and_place() -> None:
    learned = learn([paused(PEOPLE[0], 0.5, 2.5), *PEOPLE[1:]])
    verdict = learned.verdicts[0]
    assert verdict.kind is VerdictKind.USED
    assert verdict.reason.startswith("paused for 2.")
    assert f"at {verdict.place:.2f} of the path" in verdict.reason
    assert any(pause["demonstration_id"] == PEOPLE[0].demonstration_id for pause in learned.report.as_dict()["pauses"])


def test_nothing_is_said_of_who_did_as_the_others() -> None:
    assert what_it_did((), ()) is None
    assert [verdict.reason for verdict in learn(PEOPLE).verdicts] == [""] * len(PEOPLE)


def test_a_wrong_shape_among_good_ones_is_called_one_with_place_and_size() -> None:
    learned = learn([*PEOPLE, *drawn(FRAME, 1, "frame")])
    verdict = learned.verdicts[-1]
    assert verdict.kind is VerdictKind.LEFT_OUT
    assert verdict.reason.startswith("another shape than the others: ")
    assert verdict.place is not None
    assert verdict.size is not None
    assert 0.01 < verdict.size < 0.06


@pytest.mark.parametrize("corners", [FRAME, LINE], ids=["frame", "line"])
@pytest.mark.parametrize(("ours", "theirs"), [(1, 1), (3, 3), (10, 10)])
def test_two_shapes_half_and_half_are_refused_by_name(ours: int, theirs: int, corners: np.ndarray) -> None:
    mixed = drawn(TRUTH, ours, "zigzag", 2) + drawn(corners, theirs, "other")
    with pytest.raises(MixedDemonstrations) as refused:
        learn(mixed)
    assert "zigzag-0" in str(refused.value)
    assert "other-0" in str(refused.value)
    assert refused.value.argument == "demonstrations"


@pytest.mark.parametrize("corners", [FRAME, LINE], ids=["frame", "line"])
@pytest.mark.parametrize(("ours", "theirs"), [(6, 4), (8, 2), (4, 1)])
def test_of_two_shapes_the_clear_majority_is_learned(ours: int, theirs: int, corners: np.ndarray) -> None:
    for good, wrong in ((TRUTH, corners), (corners, TRUTH)):
        learned = learn(drawn(good, ours, "good", 2) + drawn(wrong, theirs, "wrong"))
        kinds = [verdict.kind is VerdictKind.LEFT_OUT for verdict in learned.verdicts]
        assert kinds == [False] * ours + [True] * theirs


def test_both_directions_half_and_half_are_refused_as_that() -> None:
    turned = [
        replace(one, demonstration_id=f"turned-{index}", points=one.points[::-1].copy())
        for index, one in enumerate(drawn(TRUTH, 4, "x"))
    ]
    with pytest.raises(MixedDemonstrations, match="drawn from one end") as refused:
        learn(drawn(TRUTH, 4, "zigzag", 2) + turned)
    assert "turned-0" in str(refused.value)


@pytest.mark.parametrize("early", [0, 4, 8])
def test_letting_go_early_is_not_another_shape(early: int) -> None:
    people, _ = simulated_people(16, 3, early_release=early, reflections=True)
    assert len(learn(people).motion.means) == 4


def test_the_paper_s_preset_knows_no_free_place() -> None:
    with pytest.raises(OptionOutOfRange, match="where they were drawn"):
        LearningOptions(preset="paper", place="free")


def test_a_preset_for_tasks_free_of_the_plate() -> None:
    spread = []
    for index, one in enumerate(PEOPLE):
        turn = 0.4 * index
        turned = one.points @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        spread.append(replace(one, points=(1.0 + 0.1 * index) * turned + 0.03 * index))
    free = learn(spread, options=LearningOptions(preset="free"))
    placed = learn(spread, options=LearningOptions(place="free"))
    assert free.motion.means.tobytes() == placed.motion.means.tobytes()
    assert free.report.preset == "free"
    assert len(free.motion.means) == 4
    assert max(free.report.repeatability) < 0.01
