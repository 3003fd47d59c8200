"""Where a hand stood still, and what it drew that the others did not."""

import numpy as np
import pytest

from models.demonstration import Demonstration
from models.options import LearningOptions
from models.preprocessing.filtering import CleanMotion, clean
from models.presets.fit_result import FitResult
from models.presets.recommended import fit_recommended
from models.screening.pauses import pauses
from models.synthetic import simulated_people

PEOPLE, TRUTH = simulated_people(6, 3)
BRISK = np.linspace([0.0, 0.0], [0.06, 0.02], 400)


def drawn(points: np.ndarray, name: str = "person-01") -> Demonstration:
    return Demonstration(
        name, np.arange(len(points), dtype=np.float64) * 0.01, points, np.ones(len(points), dtype=bool)
    )


def cleaned(demonstration: Demonstration) -> CleanMotion:
    return clean(demonstration, frozenset(), 0.07, True)


def fitted(first: np.ndarray) -> FitResult:
    return fit_recommended([cleaned(one) for one in (drawn(first), *PEOPLE[1:])], LearningOptions(), lambda *_: None)


@pytest.mark.parametrize("trembling", [0.0, 0.3e-3])
@pytest.mark.parametrize("seconds", [0.8, 3.0])
def test_a_hand_that_stands_still_is_seen_where_it_does(seconds: float, trembling: float) -> None:
    waiting = np.repeat(BRISK[100:101], round(100 * seconds), axis=0)
    points = np.concatenate([BRISK[:100], waiting, BRISK[100:]])
    points = points + np.random.default_rng(0).normal(0.0, trembling, points.shape)
    (pause,) = pauses(cleaned(drawn(points)))
    assert pause.start == pytest.approx(1.0, abs=0.2)
    assert pause.duration == pytest.approx(seconds, abs=0.3)
    assert pause.place == pytest.approx(0.25, abs=0.03)


def test_waiting_before_and_after_is_at_the_ends() -> None:
    points = np.concatenate([np.repeat(BRISK[:1], 90, axis=0), BRISK, np.repeat(BRISK[-1:], 120, axis=0)])
    before, after = pauses(cleaned(drawn(points)))
    assert (before.place, after.place) == (0.0, pytest.approx(1.0, abs=0.02))


@pytest.mark.parametrize("seconds", [1.0, 5.0, 60.0])
def test_a_steady_hand_does_not_pause_however_slow(seconds: float) -> None:
    times = np.arange(400, dtype=np.float64) * (seconds / 400)
    assert pauses(cleaned(Demonstration("slow", times, BRISK, np.ones(400, dtype=bool)))) == ()


def test_a_pause_is_told_by_its_place_on_the_path() -> None:
    one = PEOPLE[0].points
    found = fitted(np.concatenate([one[:400], np.repeat(one[400:401], 300, axis=0), one[400:]]))
    longest = max(found.pauses[0], key=lambda pause: pause.duration)
    assert longest.duration > 2.5
    corner = found.aligned.points[0, round(longest.place * (len(found.phases) - 1))]
    assert np.sqrt(((corner - one[400]) ** 2).sum()) < 2e-3


@pytest.mark.parametrize(("first", "last"), [(0.3, 0.5), (0.1, 0.2), (0.4, 0.45)])
def test_a_stretch_drawn_again_is_seen_and_is_no_oddness(first: float, last: float) -> None:
    one = PEOPLE[0].points
    low, high = int(first * len(one)), int(last * len(one))
    found = fitted(np.concatenate([one[:high], one[low:high][::-2], one[low:]]))
    (extra,) = found.extras[0]
    way = np.sqrt((np.diff(one[low:high:10], axis=0) ** 2).sum(axis=1)).sum()
    assert extra.repeated
    assert extra.length == pytest.approx(2.0 * way, rel=0.35)
    assert extra.place == pytest.approx(0.5 * (first + last), abs=0.1)
    assert 0 not in found.left_out


def test_a_little_way_around_is_no_repetition() -> None:
    one = PEOPLE[0].points
    out = np.linspace([0.0, 0.0], [-0.015, 0.02], 60)
    found = fitted(np.concatenate([one[:500], one[500] + out, one[500] + out[::-1], one[500:]]))
    (extra,) = found.extras[0]
    assert not extra.repeated
    assert extra.away == pytest.approx(0.0142, abs=0.002)


def test_people_who_only_draw_the_shape_have_nothing_extra() -> None:
    assert fitted(PEOPLE[0].points).extras == {}
