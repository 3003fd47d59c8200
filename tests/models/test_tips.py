"""Corners of a learned path are as far out as people drew them, however they turn back there."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.alignment.corners import laid_at_tips, sharp_corners
from models.demonstration import Demonstration
from models.evaluation import resampled
from models.geometry import norms
from models.learning import learn
from models.preprocessing.filtering import CleanMotion
from models.synthetic import ZIGZAG, raster

RATE = 100.0


def drawn(corners: list[tuple[float, float]], name: str, seconds: float = 5.0) -> Demonstration:
    """Return a drawing of the polyline through corners in mm, at even speed, without noise."""
    count = round(seconds * RATE)
    points = resampled(np.array(corners) * 1e-3, count)
    return Demonstration(name, np.arange(count) / RATE, points, np.ones(count, dtype=bool))


def motion(points: np.ndarray) -> CleanMotion:
    count = len(points)
    everywhere = np.ones(count, dtype=bool)
    return CleanMotion("p", np.arange(count) / RATE, points, everywhere, everywhere, None, everywhere, 0.0, 0.05)


@pytest.mark.parametrize("apart", [0.5, 8.0, 25.0])
def test_the_tip_of_a_hairpin_is_as_deep_as_people_drew_it_on_average(apart: float) -> None:
    """Seven people go down a stroke and up again, each to another depth, the two legs ``apart`` mm from each other.

    The path keeps within two standard errors of what they drew on average, here 1.6 mm.
    """
    depths = np.array([7.0, 8.5, 9.0, 10.0, 11.0, 12.5, 13.0])
    people = [
        drawn([(10.0, 80.0), (10.0 + apart / 2, depth), (10.0 + apart, 80.0), (60.0, 80.0)], f"p{i}", 4.0 + 0.5 * i)
        for i, depth in enumerate(depths)
    ]
    path = learn(people, compare=False).motion.points_at(np.linspace(0.0, 1.0, 4000))
    sure = depths.std(ddof=1) / np.sqrt(len(depths))
    assert 1e3 * path[:, 1].min() == pytest.approx(depths.mean(), abs=2.0 * sure)


def test_a_zigzags_corners_are_sharp_and_a_curves_are_not() -> None:
    zigzag = resampled(ZIGZAG, 256)
    found = sharp_corners(zigzag)
    assert [corner.tip for corner in found] == pytest.approx([64, 128, 191], abs=1)
    assert norms(zigzag[[corner.tip for corner in found]] - ZIGZAG[1:-1]).max() < 1e-3
    turns = np.linspace(0.0, 2.0 * np.pi, 256)
    assert sharp_corners(np.column_stack([np.cos(turns), np.sin(turns)]) * 0.03) == ()
    assert sharp_corners(np.column_stack([turns, np.sin(2.0 * turns)]) * 0.01) == ()


def test_corners_beside_an_edge_as_short_as_hands_differ_are_left_to_the_warp() -> None:
    assert len(sharp_corners(resampled(raster(6), 512))) == 10
    assert sharp_corners(resampled(raster(14), 512)) == ()


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(2, 5), st.booleans())
def test_positions_rise_and_meet_the_tips(seed: int, people: int, open_end: bool) -> None:
    """A tip that a warp missed by more than half of the turn is left to the warp."""
    generator = np.random.default_rng(seed)
    shape = resampled(ZIGZAG, 256)
    index = np.arange(256.0)
    own_corners = ZIGZAG + generator.normal(0.0, 1.5e-3, (people, *ZIGZAG.shape))
    motions = [motion(resampled(own, 400)) for own in own_corners]
    places = np.broadcast_to(np.linspace(0.0, 399.0, 256), (people, 256))
    positions = np.sort(np.clip(index + generator.normal(0.0, 2.0, (people, 1)), 0.0, 255.0), axis=1)
    if open_end:
        positions[0, 170:] = np.nan
    sharp = sharp_corners(shape)
    laid = laid_at_tips(motions, places, positions, sharp)
    assert (np.diff(laid, axis=1)[np.isfinite(np.diff(laid, axis=1))] >= -1e-9).all()
    np.testing.assert_array_equal(np.isfinite(laid), np.isfinite(positions))
    for corner, tips in zip(sharp, own_corners.transpose(1, 0, 2)[1:-1], strict=True):
        for own, before, one, tip in zip(laid, positions, motions, tips, strict=True):
            if np.isfinite(before).all():
                there, warped = (
                    one.points[round(float(np.interp(where[corner.tip], index, places[0])))] for where in (own, before)
                )
                assert norms(there - tip) < 1e-3 or norms(warped - tip) > 4e-3
