"""Many small turns: neither the filter nor the alignment may take them for trembling."""

import numpy as np
import pytest

from models.demonstration import Demonstration, Floats
from models.geometry import norms
from models.learning import learn
from models.phase import edges
from models.preprocessing.filtering import clean
from tests.models.test_extent import ZIGZAG, along
from tests.models.test_resting import apart

WAVER = 0.00045
"""In m: of six hands that are 0.4 mm off and 0.1 mm of the filter; half of the places are nearer."""


def weave(width: float, period: float, length: float) -> Floats:
    """Return a seam of this length, woven ``width`` to either side, all in mm; shape (n, 2) in m."""
    ahead = np.linspace(0.0, length, round(length / period) * 40)
    return np.column_stack([ahead, width * np.sin(2.0 * np.pi * ahead / period)]) * 1e-3


@pytest.mark.parametrize(
    ("width", "period", "length"), [(3, 10, 200), (3, 8, 200), (4, 10, 300), (6, 20, 200), (3, 8, 120)]
)
def test_a_weave_is_as_wide_as_it_was_shown_and_no_turn_is_laid_upon_another(
    width: float, period: float, length: float
) -> None:
    truth = weave(width, period, length)
    learned = learn([along(truth, 1.0, seed) for seed in range(6)], compare=False)
    path = learned.motion.points_at(np.linspace(0.0, 1.0, 6000))
    assert apart(truth, path) < 3.0 * WAVER
    assert apart(path, truth) < 3.0 * WAVER
    distances = norms(truth[:, None] - path[None, ::4]).min(axis=1)
    assert float(np.median(distances)) < WAVER
    highest, lowest = np.percentile(path[:, 1], [97, 3])
    shown = np.percentile(truth[:, 1], [97, 3])
    assert highest - lowest == pytest.approx(shown[0] - shown[1], rel=0.1)


def test_edges_are_counted_where_turns_are_small_and_not_where_curves_are_smooth() -> None:
    assert edges(ZIGZAG) == 6
    assert edges(np.array([[0.0, 0.0], [0.05, 0.0], [0.2, 0.0]])) == 1
    assert edges(weave(3, 8, 200)) == pytest.approx(50, abs=3)
    turn = np.linspace(0.0, 2.0 * np.pi, 400)
    assert edges(np.column_stack([np.cos(turn), np.sin(turn)])) <= 16


@pytest.mark.parametrize("factor", [1e-2, 1.0, 30.0])
def test_the_filter_of_a_drawing_without_small_turns_is_as_long_as_the_hand_needs_for_a_fiftieth_of_it(
    factor: float,
) -> None:
    one = along(ZIGZAG, 1.0, 0)
    scaled = Demonstration("p", one.times, one.points * factor, one.triggers)
    cleaned = clean(scaled, frozenset(), 0.0, True)
    given = clean(scaled, frozenset(), cleaned.crossing, True)
    np.testing.assert_array_equal(given.points, cleaned.points)
