"""Whatever is asked for: a plan that is made keeps every limit and ends at its end, and a refusal has a name."""

import math
from typing import get_args

import hypothesis
import numpy as np
import pytest
from drawn_motion import DrawnMotion
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim import robots
from sim.drivers.execution import Execution, Phase
from sim.findings import Code, MotionRefused
from sim.order import MotionOrder
from sim.planning.checks import TIMINGS
from sim.planning.kinematics import kinematics
from sim.planning.planner import plan_motion

CORNERS = st.lists(
    st.tuples(st.floats(-0.04, 0.04), st.floats(-0.04, 0.04), st.floats(0.0, 0.02)), min_size=2, max_size=5
)
ORDERS = st.builds(
    MotionOrder,
    time_step=st.floats(0.001, 0.02),
    timing=st.sampled_from(TIMINGS),
    duration=st.one_of(st.just(0.0), st.floats(0.5, 10.0)),
    speed=st.floats(0.005, 0.3),
    speed_override=st.floats(0.2, 1.0),
    blend_radius=st.one_of(st.just(0.0), st.floats(0.0005, 0.01)),
    corners=st.sampled_from(["slow", "refuse"]),
    chord_tolerance=st.sampled_from([5e-5, 1e-3]),
    approach_height=st.floats(0.0, 0.1),
    retract_height=st.floats(0.0, 0.1),
)
PLACES = st.tuples(st.floats(0.3, 0.75), st.floats(-0.3, 0.3), st.floats(0.05, 0.3), st.floats(-3.2, 3.2))
RADII = st.one_of(st.just(0.0), st.floats(1e-4, 0.004))
ZIGZAG = [(0.0, 0.0, 0.0), (0.0, 0.04, 0.01), (0.02, 0.04, 0.0), (0.02, 0.0, 0.0)]
HERE = (0.42, 0.0, 0.1, 0.0)


def drawable(corners, radius):
    """Return whether the edges have length and a circle of this radius fits into every corner."""
    points = np.array(corners)
    edges = np.diff(points, axis=0)
    sizes = np.sqrt((edges**2).sum(axis=1))
    if sizes.min() < 1e-3:
        return False
    if not radius:
        return True
    cosines = (edges[:-1] * edges[1:]).sum(axis=1) / (sizes[:-1] * sizes[1:])
    return bool((np.abs(cosines) < 0.95).all() and sizes.min() > 8.0 * radius)


@pytest.mark.slow
# A plan takes long enough that making a failing one smaller would take minutes: it is told as it was found.
@settings(deadline=None, max_examples=10, phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate))
@given(name=st.sampled_from(robots.names()), order=ORDERS, place=PLACES, corners=CORNERS, radius=RADII)
@example("panda", MotionOrder(time_step=0.0137), HERE, ZIGZAG, 0.0)
@example("iiwa14", MotionOrder(time_step=0.02, timing="time_optimal", chord_tolerance=1e-3), HERE, ZIGZAG, 0.002)
@example("xarm6", MotionOrder(time_step=0.0073, timing="constant_speed", speed=0.02), HERE, ZIGZAG, 0.003)
@example("xarm6", MotionOrder(time_step=0.001, timing="time_optimal"), HERE, ZIGZAG, 0.0)
def test_a_plan_keeps_every_limit_and_ends_at_its_end_or_is_refused_by_name(name, order, place, corners, radius):
    model = robots.load(name)
    x, y, z, turn = place
    frame = (x, y, z, *Rotation.from_euler("z", turn).as_quat())
    order = MotionOrder(**{**{key: getattr(order, key) for key in order.__dataclass_fields__}, "frame": frame})
    assume(drawable(corners, radius))
    motion = DrawnMotion(corners, radius)
    ends = motion.points_at(np.array([0.0, 1.0]))
    try:
        plan = plan_motion(motion, order, model)
    except MotionRefused as refusal:
        assert refusal.failure in get_args(Code)
        assert all(finding.fatal and finding.text for finding in refusal.findings)
        return
    step = order.time_step
    low, high = np.array(model.limits.lower), np.array(model.limits.upper)
    assert np.array_equal(plan.times, np.arange(plan.samples) * step)
    assert ((plan.joints >= low) & (plan.joints <= high)).all()
    assert (np.abs(plan.velocities) <= model.limits.velocity).all()
    assert np.array_equal(plan.joints[[0, -1]], [model.home, model.home])
    assert not plan.velocities[[0, -1]].any()
    at_ends = plan.tool[list(plan.path_rows)]
    local = Rotation.from_quat(frame[3:]).inv().apply(at_ends - np.array(frame[:3]))
    assert np.abs(local - ends - [0.0, 0.0, order.standoff]).max() < 1e-9
    assert np.abs(kinematics(model).forward(plan.joints)[0] - plan.tool).max() < 1e-9
    # As an arm runs it, tick by tick along the cubics between the samples.
    execution = Execution(plan, model)
    ticks = [plan.joints[0]]
    while execution.phase is not Phase.ENDED:
        ticks.append(execution.tick())
    rates = np.diff(np.array(ticks), axis=0) / execution.dt
    pushes = np.diff(rates, axis=0) / execution.dt
    assert (np.abs(rates) <= np.array(model.limits.velocity) * 1.001).all()
    assert (np.abs(pushes) <= np.array(model.limits.acceleration) * 1.01).all()
    assert np.abs(ticks[-1] - plan.joints[-1]).max() < 1e-12
    assert math.isclose(execution.path_time, plan.duration)
