"""Where the path begins and ends when hands do not: as far as enough of them drew, and whoever differs is told."""

import numpy as np
import pytest

from models.demonstration import Demonstration, Floats
from models.geometry import parted
from models.learning import LearnedMotion, learn
from models.phase import arc_lengths

ZIGZAG = np.array([[0.0, 0.0], [65.0, 15.0], [0.0, 30.0], [65.0, 45.0], [0.0, 60.0], [65.0, 75.0], [0.0, 90.0]]) * 1e-3
SEAM = np.array([[0.0, 0.0], [0.2, 0.0]])
RASTER = np.array([[0.1 * (k % 4 in (1, 2)), 0.008 * (k // 2)] for k in range(12)])
SHAPES = {"zigzag": ZIGZAG, "seam": SEAM, "raster": RASTER}
WAVER = 0.0004
SURE = 0.003


def along(shape: Floats, share: float, seed: int) -> Demonstration:
    """Return one hand's drawing of a polyline (n, 2), up to a share of its way: 0.4 mm off, 50 mm/s, 100 times a s."""
    generator = np.random.default_rng(seed)
    way = arc_lengths(shape)
    gone: Floats = np.arange(0.0, share * way[-1], 5e-4)
    points = np.stack([np.interp(gone, way, axis) for axis in shape.T], axis=1)
    slow = generator.normal(0.0, WAVER, (12, 2))
    points += np.stack([np.interp(gone, np.linspace(0.0, way[-1], 12), axis) for axis in slow.T], axis=1)
    points += generator.normal(0.0, 5e-5, points.shape)
    return Demonstration(f"p{seed}", gone * 20.0, points, np.ones(len(gone), dtype=bool))


def from_its_end(one: Demonstration) -> Demonstration:
    return Demonstration(one.demonstration_id, one.times, one.points[::-1].copy(), one.triggers)


def codes(learned: LearnedMotion) -> dict[str, str]:
    return {verdict.demonstration_id: verdict.code for verdict in learned.verdicts if verdict.code}


def missing(learned: LearnedMotion, shape: Floats, share: float) -> float:
    """Return how far in m the path's end is from where the shape, up to a share of its way, ends."""
    way = arc_lengths(shape)
    end = np.array([np.interp(share * way[-1], way, axis) for axis in shape.T])
    return float(np.linalg.norm(learned.motion.points_at(np.array([1.0]))[0] - end))


@pytest.mark.parametrize("share", [0.95, 0.6])
@pytest.mark.parametrize("short", [1, 3, 4])
@pytest.mark.parametrize("shape", list(SHAPES))
def test_as_many_may_stop_early_as_not_and_the_path_goes_to_the_end(shape: str, short: int, share: float) -> None:
    hands = [along(SHAPES[shape], share if seed < short else 1.0, seed) for seed in range(6)]
    learned = learn(hands, compare=False)
    assert codes(learned) == {f"p{seed}": "let-go-early" for seed in range(short)}
    assert missing(learned, SHAPES[shape], 1.0) < SURE
    told = [(finding.code, finding.people) for finding in learned.report.findings]
    few = ("end-guessed", tuple(f"p{seed}" for seed in range(short)))
    assert told == ([few] if short >= 3 else [])


@pytest.mark.parametrize("shape", list(SHAPES))
def test_who_alone_goes_on_is_used_up_to_where_the_others_end(shape: str) -> None:
    hands = [along(SHAPES[shape], 0.8 if seed else 1.0, seed) for seed in range(6)]
    learned = learn(hands, compare=False)
    assert codes(learned) == {"p0": "went-on"}
    assert missing(learned, SHAPES[shape], 0.8) < SURE
    (verdict,) = (verdict for verdict in learned.verdicts if verdict.code)
    past = 0.2 * arc_lengths(SHAPES[shape])[-1]
    assert verdict.size == pytest.approx(past, rel=0.2)
    assert "past where the others end" in verdict.reason


def test_a_beginning_is_asked_as_an_end_is() -> None:
    hands = [from_its_end(along(ZIGZAG, 0.8 if seed < 3 else 1.0, seed)) for seed in range(6)]
    learned = learn(hands, compare=False)
    assert set(codes(learned).values()) == {"started-late"}
    assert [finding.code for finding in learned.report.findings] == ["start-guessed"]
    before = [from_its_end(along(ZIGZAG, 0.8 if seed else 1.0, seed)) for seed in range(6)]
    assert codes(learn(before, compare=False)) == {"p0": "began-before"}


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_the_longer_is_the_path_in_whatever_order_and_it_is_told(order: int) -> None:
    hands = [along(SEAM, 0.8, 0), along(SEAM, 1.0, 1)][::order]
    learned = learn(hands, compare=False)
    assert codes(learned) == {"p0": "let-go-early"}
    assert [finding.code for finding in learned.report.findings] == ["end-guessed"]


@pytest.mark.parametrize("shape", list(SHAPES))
@pytest.mark.parametrize("people", [2, 3, 5, 8])
def test_hands_that_end_where_hands_do_are_not_remarked_on(shape: str, people: int) -> None:
    generator = np.random.default_rng(people)
    hands = [along(SHAPES[shape], 1.0 - 0.004 * abs(generator.standard_normal()), seed) for seed in range(people)]
    learned = learn(hands, compare=False)
    assert not codes(learned)
    assert not {"end-guessed", "start-guessed"} & {finding.code for finding in learned.report.findings}


def test_normal_scatter_is_not_parted() -> None:
    generator = np.random.default_rng(0)
    parted_ones = [
        count for count in (4, 6, 10, 20) for _ in range(250) if parted(generator.standard_normal(count), 0.5).any()
    ]
    assert len(parted_ones) <= 4


def test_two_groups_are_parted_wherever_zero_is() -> None:
    values = np.array([5.0, 0.1, 5.2, -0.1, 0.0])
    for shift in (-100.0, 0.0, 3.0):
        assert parted(values + shift, 0.1).tolist() == [True, False, True, False, False]


def test_a_shape_drawn_twice_is_not_called_going_on() -> None:
    once = [along(SEAM, 1.0, seed) for seed in range(4)]
    there_and_back = np.concatenate([SEAM, SEAM[:1], SEAM[1:]])
    learned = learn([*once, along(there_and_back, 1.0, 9)], compare=False)
    assert codes(learned) == {"p9": "drawn-twice"}
