"""A hand that rests longer than the task takes: the path is the one it would have drawn without."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

from models.demonstration import Demonstration, Floats
from models.learning import VerdictKind, learn
from models.preprocessing.filtering import clean
from models.preprocessing.resting import waiting, without
from tests.models.test_extent import SEAM, ZIGZAG, along

WAVE = np.array([[0.1 * u, 0.025 * np.sin(2.0 * np.pi * u)] for u in np.linspace(0.0, 1.0, 60)])
SHAPES = {"zigzag": ZIGZAG, "seam": SEAM, "wave": WAVE}


def resting(
    one: Demonstration, rests: list[tuple[float, float]], seed: int = 0, trembling: float = 3e-4
) -> Demonstration:
    """Return a recording with rests put in: at which share of its samples, and for how many s."""
    generator = np.random.default_rng(seed)
    step = float(one.times[1] - one.times[0])
    borders = [0, *(int(share * (len(one.times) - 1)) + 1 for share, _ in rests), len(one.times)]
    parts: list[Floats] = []
    for (first, after), (_, seconds) in zip(pairwise(borders), [*rests, (1.0, 0.0)], strict=True):
        parts.append(one.points[first:after])
        count = round(seconds / step)
        slow = generator.normal(0.0, 3e-4, (max(2, round(2.0 * seconds)), one.points.shape[1]))
        even = np.linspace(0.0, len(slow) - 1.0, count)
        tremble = np.stack([np.interp(even, np.arange(len(slow)), axis) for axis in slow.T], axis=1)
        parts.append(one.points[max(after - 1, 0)] + tremble + generator.normal(0.0, 5e-5, tremble.shape))
    points = np.concatenate(parts)
    times = np.arange(len(points), dtype=np.float64) * step
    return Demonstration(one.demonstration_id, times, points, np.ones(len(times), dtype=bool))


def path_of(hands: list[Demonstration]) -> tuple[Floats, list[str]]:
    learned = learn(hands, compare=False)
    assert all(verdict.kind is VerdictKind.USED for verdict in learned.verdicts)
    assert not learned.report.findings
    return learned.motion.points_at(np.linspace(0.0, 1.0, 3000)), [verdict.code for verdict in learned.verdicts]


def apart(one: Floats, other: Floats) -> float:
    """Return how far in m any point of one path is from the other."""
    return float(cKDTree(other).query(one[:: max(1, len(one) // 300)])[0].max())


@pytest.mark.parametrize("who", [1, 6])
@pytest.mark.parametrize("rests", [[(0.37, 20.0)], [(0.2, 60.0), (0.7, 60.0)], [(0.0, 30.0)], [(1.0, 30.0)]])
@pytest.mark.parametrize("shape", list(SHAPES))
def test_rests_longer_than_the_task_leave_the_path_as_it_is(
    shape: str, rests: list[tuple[float, float]], who: int
) -> None:
    hands = [along(SHAPES[shape], 1.0, seed) for seed in range(6)]
    alone, _ = path_of(hands)
    rested, codes = path_of([resting(one, rests, k) if k < who else one for k, one in enumerate(hands)])
    assert apart(rested, alone) < 6e-4
    assert apart(alone, rested) < 6e-4
    assert codes == [{0.0: "waited", 1.0: "waited"}.get(rests[0][0], "paused") if who == 1 else ""] + [""] * 5


@settings(deadline=None, max_examples=25)
@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(3.0, 80.0)), min_size=1, max_size=5), st.integers(0, 1000))
def test_whatever_rests_there_are_what_is_left_is_the_task(rests: list[tuple[float, float]], seed: int) -> None:
    one = along(ZIGZAG, 1.0, 0)
    rested = resting(one, sorted(rests), seed)
    waits = waiting(rested.times, rested.points)
    if sum(seconds for _, seconds in rests) > 1.5 * one.times[-1]:
        left = without(rested.times, waits)
        assert 0.9 * one.times[-1] < left[-1] < 2.0 * one.times[-1]
        assert np.all(np.diff(left) > 0.0)
    assert apart(one.points, rested.points[~waits]) < 2.5e-3


def test_a_hand_that_never_rests_that_long_never_waits() -> None:
    for shape in SHAPES.values():
        one = along(shape, 1.0, 1)
        assert not waiting(one.times, one.points).any()
        shortly = resting(one, [(0.5, 0.5 * float(one.times[-1]))])
        assert not waiting(shortly.times, shortly.points).any()


def test_reflections_at_rest_and_on_the_way_are_still_taken_out() -> None:
    generator = np.random.default_rng(4)
    rested = resting(along(ZIGZAG, 1.0, 0), [(0.4, 40.0)])
    points = rested.points.copy()
    thrown = generator.random(len(points)) < 0.03
    points[thrown] += generator.normal(0.0, 0.3, (int(thrown.sum()), 2))
    cleaned = clean(Demonstration("p", rested.times, points, rested.triggers), frozenset(), 0.0, True)
    without_them = clean(rested, frozenset(), 0.0, True)
    assert apart(cleaned.points, without_them.points) < 1e-3


def test_the_clock_of_a_recording_is_kept_over_its_rests() -> None:
    one = along(ZIGZAG, 1.0, 0)
    cleaned = clean(resting(one, [(0.5, 40.0)]), frozenset(), 0.0, True)
    assert cleaned.times[-1] == pytest.approx(one.times[-1] + 40.0, abs=0.1)
    half = float(one.times[-1]) / 2.0
    still = (cleaned.times > half + 1.0) & (cleaned.times < half + 39.0)
    assert np.ptp(cleaned.points[still], axis=0).max() < 1e-3
    late = np.interp(half + 40.0 + 0.25 * half, cleaned.times, cleaned.points[:, 0])
    assert late == pytest.approx(float(np.interp(1.25 * half, one.times, one.points[:, 0])), abs=2e-3)
