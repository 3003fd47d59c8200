"""Time laws: never faster than what the joints can do, at rest where they should be, exact at the end."""

from pathlib import Path

import numpy as np
import pytest
from drawn_motion import DrawnMotion
from hypothesis import given, settings
from hypothesis import strategies as st

from sim import arms
from sim.arm import PathLimits
from sim.kinematics import kinematics
from sim.path import ToolPath
from sim.timing import JointPath, fastest, joint_move, s_curve, steady

BOUNDS = PathLimits(0.5, 2.0, 100.0, "")


@settings(deadline=None, max_examples=40)
@given(length=st.floats(0.005, 1.0), speed=st.floats(0.002, 0.4), step=st.sampled_from([0.001, 0.004, 0.02]))
def test_a_steady_law_is_even_on_the_path_and_takes_whole_steps(length, speed, step):
    law = steady(length, speed, step, BOUNDS)
    assert law.speed <= speed * (1 + 1e-9)
    assert law.ramp / step == pytest.approx(round(law.ramp / step), abs=1e-6)
    rows = round(length / law.speed / step)
    inside = law.ramp + step * np.arange(rows + 1)
    assert np.allclose(law.lengths(inside), np.linspace(0.0, length, rows + 1), atol=1e-12)
    assert np.allclose(law.speeds(inside), law.speed)
    times = np.linspace(0.0, 1.5 * law.ramp, 4001)
    speeds, pushes, jolts = law.derivatives(times)
    assert np.allclose(np.gradient(law.lengths(times), times)[1:-1], speeds[1:-1], atol=1e-4 * speed)
    assert np.abs(pushes).max() <= BOUNDS.acceleration * (1 + 1e-9)
    assert np.abs(jolts).max() <= BOUNDS.jerk * (1 + 1e-9)
    assert law.lengths(np.array([0.0, law.duration])) == pytest.approx([law.start, law.end], abs=1e-12)


def test_a_straight_way_keeps_speed_acceleration_and_jerk():
    law = s_curve(0.0, 0.2, 0.1, BOUNDS)
    times = np.linspace(0.0, law.duration, 3000)
    lengths = law.lengths(times)
    assert (np.diff(lengths) >= 0.0).all()
    assert lengths[[0, -1]].tolist() == [0.0, 0.2]
    assert law.speeds(times).max() <= 0.1 * 1.001


def test_a_joint_move_starts_and_ends_at_rest_where_it_should(model):
    start, end = np.array(model.home), np.array(model.home) + np.linspace(-0.4, 0.5, model.dof)
    duration, positions = joint_move(start, end, model.limits, 0.5)
    times = np.linspace(0.0, duration, 2001)
    values = positions(times)
    rates = np.gradient(values, times, axis=0)
    assert np.allclose(values[[0, -1]], [start, end], atol=1e-9)
    assert (np.abs(rates).max(axis=0) <= 0.5 * np.array(model.limits.velocity) * 1.001).all()
    assert np.abs(rates[[0, -1]]).max() < 0.01


@pytest.mark.parametrize("radius", [0.003, 0.001])
def test_the_fastest_law_keeps_every_joint_limit_and_uses_what_there_is(model, radius):
    path = ToolPath(DrawnMotion(radius=radius), model.part_frame, 0.001)
    lengths = np.linspace(0.0, path.length, len(path.lengths))
    arm = kinematics(model)
    joint_path = JointPath(lengths, arm.inverse(path.points(lengths), arm.seed_rotation).joints)
    ceiling = joint_path.ceiling(model.limits)
    law, _ = fastest(joint_path, model.limits, model.path_limits, np.full(len(lengths), np.inf), ceiling)
    times = np.linspace(0.0, law.duration, 20_001)
    _, factor = joint_path.excess(law, model.limits, times)
    assert factor.max() <= 1.001
    assert law.speeds(times).max() <= model.path_limits.speed * 1.001
    assert law.lengths(np.array([0.0, law.duration])).tolist() == [0.0, path.length]
    at_half_speed = fastest(joint_path, model.limits, model.path_limits, np.full(len(lengths), 0.02), ceiling)[0]
    assert at_half_speed.duration > 2.0 * law.duration


def test_ruckig_is_never_given_waypoints_which_would_leave_the_machine():
    for file in Path(arms.__file__).parents[1].glob("**/*.py"):
        assert "intermediate_positions" not in file.read_text("utf-8"), file
