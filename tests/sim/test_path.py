"""The nozzle's way: regression at every arc length, exact ends, corners rounded when asked."""

import itertools

import numpy as np
import pytest
from drawn_motion import ZIGZAG, DrawnMotion
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from models.learning import learn
from models.synthetic import simulated_people
from sim.planning.path import ToolPath
from sim.testing.conformance import straight_line

FRAME = (0.42, 0.0, 0.10, 0.0, 0.0, 0.0, 1.0)


def test_arc_length_is_the_drawn_length_and_speed_along_it_is_even():
    motion = DrawnMotion(radius=0.003)
    path = ToolPath(motion, FRAME, 0.0)
    assert path.length == pytest.approx(motion.length, rel=2e-4)
    points = path.points(np.linspace(0.0, path.length, 20_001))
    steps = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    assert np.abs(steps / steps.mean() - 1.0).max() < 2e-3


@settings(deadline=None, max_examples=15)
@given(
    turn=st.floats(-3.0, 3.0),
    tilt=st.floats(-1.0, 1.0),
    x=st.floats(-1.0, 1.0),
    standoff=st.floats(0.0, 0.02),
)
def test_a_frame_moves_the_path_as_a_rigid_body(turn, tilt, x, standoff):
    motion = DrawnMotion()
    rotation = Rotation.from_euler("zy", [turn, tilt])
    path = ToolPath(motion, (x, 0.2, 0.1, *rotation.as_quat()), standoff)
    phases = np.linspace(0.0, 1.0, 50)
    part = np.column_stack([motion.points_at(phases), np.full(50, standoff)])
    assert np.allclose(path.exact(phases), rotation.apply(part) + np.array([x, 0.2, 0.1]), atol=1e-12)


def test_the_path_meets_its_ends_exactly_and_goes_straight_on_beyond_them():
    motion = DrawnMotion()
    path = ToolPath(motion, FRAME, 0.001)
    ends = path.exact(np.array([0.0, 1.0]))
    points = path.points(np.array([-0.01, 0.0, path.length, path.length + 0.01]))
    assert np.array_equal(points[1:3], ends)
    assert np.allclose(points[0], ends[0] - [0.0, 0.01, 0.0], atol=1e-9)
    assert np.allclose(points[3], ends[1] - [0.0, 0.01, 0.0], atol=1e-9)


def test_a_learned_motion_is_evaluated_by_regression_not_between_samples():
    learned = learn(simulated_people(4, 0)[0]).motion
    path = ToolPath(learned, FRAME, 0.0)
    at = np.linspace(0.0, path.length, 733)
    part = path.points(at)[:, :2] - FRAME[:2]
    assert np.abs(part - learned.points_at(path.phases_at(at))).max() < 1e-15


def test_phase_rises_with_arc_length():
    path = ToolPath(DrawnMotion(radius=0.0), FRAME, 0.0)
    phases = path.phases_at(np.linspace(0.0, path.length, 5001))
    assert (np.diff(phases) > 0.0).all()
    assert phases[[0, -1]].tolist() == [0.0, 1.0]


@pytest.mark.parametrize("blend", [0.001, 0.002, 0.004])
def test_a_blend_begins_at_its_radius_before_the_corner_and_keeps_straights_and_ends(blend):
    sharp, round_ = (ToolPath(DrawnMotion(radius=0.0), FRAME, 0.0, radius) for radius in (0.0, blend))
    points = round_.points(np.linspace(0.0, round_.length, 2001))
    away = from_edges(points)
    corner = np.array([*ZIGZAG[1], 0.0]) + FRAME[:3]
    from_corner = np.sqrt(((points - corner) ** 2).sum(axis=1))
    assert away.max() < 0.45 * blend
    assert away[from_corner < 0.5 * blend].max() > 0.1 * blend
    assert away[np.abs(points[:, 1] - 0.04) < 0.03].max() < 1e-8
    assert np.array_equal(round_.points(np.array([0.0, round_.length])), sharp.points(np.array([0.0, sharp.length])))


def from_edges(points):
    """Return the distance of points from the nearest edge of the zigzag in its frame."""
    corners = np.column_stack([np.array(ZIGZAG), np.zeros(len(ZIGZAG))]) + FRAME[:3]
    gaps = []
    for start, end in itertools.pairwise(corners):
        part = np.clip((points - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
        gaps.append(np.sqrt(((points - start - part[:, None] * (end - start)) ** 2).sum(axis=1)))
    return np.min(gaps, axis=0)


def test_a_blended_corner_turns_without_jumps_in_curvature():
    path = ToolPath(DrawnMotion(radius=0.0), FRAME, 0.0, 0.002)
    at = np.linspace(0.0, path.length, 7001)
    bend = np.diff(path.points(at), 2, axis=0) / (at[1] - at[0]) ** 2
    curvature = np.sqrt((bend**2).sum(axis=1))
    assert curvature.max() < 1500.0
    assert np.abs(np.diff(curvature)).max() < 0.15 * curvature.max()


def test_dwelling_takes_no_arc_length():
    motion = straight_line()

    class Dwelling:
        dimension, duration, dispense = 2, motion.duration, ()

        def points_at(self, phases):
            return motion.points_at(np.interp(phases, [0.0, 0.4, 0.6, 1.0], [0.0, 0.5, 0.5, 1.0]))

    path = ToolPath(Dwelling(), FRAME, 0.0)
    points = path.points(np.linspace(0.0, path.length, 1001))
    steps = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    assert steps.max() < 1.2 * steps.mean()
    assert path.length == pytest.approx(0.03, rel=1e-3)


def test_covariances_turn_with_the_part():
    quarter = Rotation.from_euler("z", 90, degrees=True).as_quat()
    path = ToolPath(straight_line(), (0.4, 0.0, 0.1, *quarter), 0.0)
    spread = path.covariances(np.array([0.5]))[0]
    part = straight_line().at_phases(np.array([0.5]))[1][0]
    assert np.allclose(spread[:2, :2], [[part[1, 1], -part[1, 0]], [-part[0, 1], part[0, 0]]], atol=1e-18)
    assert np.allclose(spread[2], 0.0)
