"""Time laws: never faster than what the joints can do, at rest where they should be, exact at the end."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawn_motion import DrawnMotion
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from sim import robots
from sim.arm_model import PathLimits
from sim.planning.kinematics import kinematics
from sim.planning.path import ToolPath
from sim.planning.rates import eased, rates, spline_velocities
from sim.planning.timing import JointPath, fastest, joint_move, law_speed, time_at

BOUNDS = PathLimits(0.5, 2.0, 100.0, "")


def on_a_line(length: float) -> JointPath:
    """Return a way of three joints along a straight line on which each moves evenly."""
    lengths = np.linspace(0.0, length, 801)
    return JointPath(lengths, lengths[:, None] * np.array([1.5, -2.0, 0.5]))


def jolts(path, law, step=1e-3):
    times = np.arange(0.0, law.duration + 6 * step, step)
    joints = path.spline(law.lengths(times))
    return rates(joints, spline_velocities(joints, step), step)


@settings(deadline=None, max_examples=40)
@example(length=8.7e-5, dips=[], speed=0.1)
@example(length=5e-6, dips=[(0.5, 0.5, 0.2)], speed=0.1)
@given(
    length=st.one_of(st.floats(0.005, 0.5), st.floats(5e-6, 5e-3)),
    dips=st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.02, 1.0), st.floats(1e-3, 0.2)), max_size=4),
    speed=st.floats(0.005, 0.4),
)
def test_a_law_stays_below_its_ceiling_and_keeps_the_jerk_wherever_the_ceiling_dips(length, dips, speed):
    path, limits = on_a_line(length), replace(robots.load("xarm6").limits, jerk=(200.0,) * 6)
    limits = replace(limits, **{row: getattr(limits, row)[:3] for row in ("velocity", "acceleration", "jerk")})
    top = np.full(len(path.lengths), speed)
    for place, share, width in dips:
        top[np.abs(path.lengths / length - place) < 0.5 * width] *= share
    assume(length / top.min() < 600.0)  # a law has so many ticks; a longer one has coarser ones
    law = fastest(path, limits, BOUNDS, top)
    assert law.lengths(np.array([0.0, law.duration])).tolist() == [0.0, path.lengths[-1]]
    # However short the way, it is not crept along: a ramp takes well below half a second.
    assert law.duration <= length / top.min() + 1.0 + len(dips)
    times = np.linspace(0.0, law.duration, 20_001)
    inside = (law.lengths(times) > 0.0) & (law.lengths(times) < length)
    ceiling = np.interp(law.lengths(times), path.lengths, top)
    assert (law.speeds(times) <= ceiling * 1.02 + 1e-3)[inside].all()
    assert (np.diff(law.lengths(times)) >= 0.0).all()
    assert max(share.max() for share in jolts(path, law).shares(limits)) < 1.0


def test_an_even_ceiling_is_reached_and_kept_to_the_last_digit():
    path = on_a_line(0.1)
    limits = robots.load("iiwa14").limits
    limits = replace(limits, **{row: getattr(limits, row)[:3] for row in ("velocity", "acceleration", "jerk")})
    law = fastest(path, limits, BOUNDS, np.full(len(path.lengths), 0.05))
    assert np.allclose(law_speed(law, np.linspace(0.03, 0.07, 50)), 0.05, rtol=1e-6)
    assert law.lengths(np.array([time_at(law, 0.04)]))[0] == pytest.approx(0.04, abs=1e-12)


@settings(deadline=None, max_examples=30)
@given(rows=st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 2), min_size=5, max_size=80), step=st.floats(1e-3, 20e-3))
def test_eased_samples_begin_and_end_without_speed_and_acceleration(rows, step):
    joints = eased(np.array(rows), step)
    assert np.array_equal(joints[[0, *range(2, len(rows) - 2), -1]], np.array(rows)[[0, *range(2, len(rows) - 2), -1]])
    velocities = spline_velocities(joints, step)
    assert not velocities[[0, -1]].any()
    for start, way, end in ((0, 1, 1), (-1, -1, -2)):
        push = (
            6.0 * way * (joints[end] - joints[start]) / step - 4.0 * velocities[start] - 2.0 * velocities[end]
        ) / step
        assert np.abs(push).max() < 1e-6 / step**2


def test_rates_between_samples_are_the_cubics_own(panda):
    step = 0.01
    joints = np.random.default_rng(3).normal(size=(12, panda.dof)).cumsum(axis=0)
    velocities = spline_velocities(joints, step)
    found = rates(joints, velocities, step)
    fine = np.linspace(0.0, 1.0, 2001)[:, None]
    for k in range(len(joints) - 1):
        a, b, v, w = joints[k], joints[k + 1], velocities[k] * step, velocities[k + 1] * step
        third, second = 2 * (a - b) + v + w, 3 * (b - a) - 2 * v - w
        speed = np.abs(3 * third * fine**2 + 2 * second * fine + v).max(axis=0) / step
        push = np.abs(6 * third * fine + 2 * second).max(axis=0) / step**2
        assert np.allclose(found.velocity[k], speed, rtol=1e-5)
        assert np.allclose(found.acceleration[k], push, rtol=1e-9)
        assert np.allclose(found.jerk[k], np.abs(6 * third) / step**3, rtol=1e-9)


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
    ceiling = joint_path.ceiling(model.limits, even=False)
    law = fastest(joint_path, model.limits, model.path_limits, ceiling)
    for name, share in zip(("speed", "acceleration"), jolts(joint_path, law).shares(model.limits), strict=False):
        assert share.max() <= 1.0, name
    assert law.speeds(np.linspace(0.0, law.duration, 20_001)).max() <= model.path_limits.speed * 1.001
    assert law.lengths(np.array([0.0, law.duration])).tolist() == [0.0, path.length]
    at_half_speed = fastest(joint_path, model.limits, model.path_limits, np.minimum(ceiling, 0.02))
    assert at_half_speed.duration > 2.0 * law.duration


def test_ruckig_is_never_given_waypoints_which_would_leave_the_machine():
    for file in Path(robots.__file__).parents[1].glob("**/*.py"):
        assert "intermediate_positions" not in file.read_text("utf-8"), file
