"""What cannot be run is refused by name, with place and size, on every arm, before anything moves."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from drawn_motion import DrawnMotion

from sim.arm import ArmMode, StartRefused
from sim.drivers.kinematic.arm import KinematicArm
from sim.findings import MotionRefused
from sim.order import MotionOrder
from sim.planning.clearance import Box, Cell
from sim.planning.planner import plan_home, plan_motion
from sim.testing.conformance import line_plan, refusal

NOWHERE, NAN = math.inf, math.nan
STEADY = MotionOrder(timing="constant_speed", speed=0.03)
ORDERS = [
    ("a time step of 0", {"time_step": 0.0}, "time step is 0.0 s"),
    ("a time step of 1 s", {"time_step": 1.0}, "from 0.001 s to 0.020 s"),
    ("a time step that is no number", {"time_step": NAN}, "time step is nan s"),
    ("a time step below zero", {"time_step": -0.004}, "time step is -0.004 s"),
    ("a negative speed", {"speed": -0.05}, "speed is -0.05"),
    ("no speed for constant speed", {"timing": "constant_speed"}, "more than 0 m/s"),
    ("a timing law nobody knows", {"timing": "soon"}, "timing is 'soon'"),
    ("a negative duration", {"duration": -1.0}, "duration is -1.0"),
    ("an endless duration", {"duration": NOWHERE}, "duration is inf"),
    ("override 0", {"speed_override": 0.0}, "speed override is 0.0"),
    ("override 200 %", {"speed_override": 2.0}, "speed override is 2.0"),
    ("NaN in the frame", {"frame": (NAN, 0, 0.1, 0, 0, 0, 1)}, "seven finite numbers"),
    ("infinity in the frame", {"frame": (0.42, NOWHERE, 0.1, 0, 0, 0, 1)}, "seven finite numbers"),
    ("NaN in the quaternion", {"frame": (0.42, 0, 0.1, NAN, 0, 0, 1)}, "seven finite numbers"),
    ("a quaternion of zero", {"frame": (0.42, 0, 0.1, 0, 0, 0, 0)}, "quaternion is of length 0"),
    ("a quaternion of length 2", {"frame": (0.42, 0, 0.1, 0, 0, 0, 2)}, "quaternion is of length 2"),
    ("a frame of six numbers", {"frame": (0.42, 0, 0.1, 0, 0, 1)}, "seven finite numbers"),
    ("a standoff into the part", {"standoff": -0.001}, "standoff is -0.001"),
    ("an approach from the ceiling", {"approach_height": 5.0}, "approach height is 5.0"),
    ("a retract below the part", {"retract_height": -0.01}, "retract height is -0.01"),
    ("a valve lead of a minute", {"dispense_lead": 60.0}, "dispense lead is 60.0"),
    ("a negative deviation", {"max_deviation": -1.0}, "largest deviation is -1.0"),
    ("a tube of NaN", {"tube_sigmas": NAN}, "tube is nan"),
    ("a chord tolerance of 0", {"chord_tolerance": 0.0}, "chord tolerance is 0.0"),
]


def refused(model, order, motion=None, **more) -> MotionRefused:
    with pytest.raises(MotionRefused) as caught:
        plan_motion(motion or DrawnMotion(), order, model, **more)
    assert caught.value.findings[0].text.strip() == str(caught.value).split(" (and ")[0]
    return caught.value


@pytest.mark.parametrize(("changes", "words"), [row[1:] for row in ORDERS], ids=[row[0] for row in ORDERS])
def test_an_order_out_of_range_is_refused_with_field_value_and_range(changes, words, model):
    error = refused(model, MotionOrder(**changes))
    assert error.failure == "ParameterInvalid"
    assert words in str(error)


def test_a_plate_out_of_reach_is_refused_with_the_point_and_the_miss_in_millimetres(model):
    error = refused(model, MotionOrder(frame=(1.2, 0, 0.1, 0, 0, 0, 1)))
    finding = error.findings[0]
    assert error.failure == "NoIkSolution"
    assert "(point 0)" in str(error)
    assert finding.unit == "mm"
    # No arm here reaches beyond 0.95 m; a miss of the whole way would not be the nearest.
    assert 150.0 < finding.size < 700.0
    assert f"{finding.size:.1f} mm" in str(error)


def test_a_plate_half_out_of_reach_names_the_first_point_that_is_missed(model):
    reach = {"panda": 0.78, "xarm6": 0.66, "iiwa14": 0.81}[model.name]
    away = DrawnMotion(((0.0, 0.0), (0.08, 0.0)))
    finding = refused(model, MotionOrder(frame=(reach - 0.04, 0, 0.1, 0, 0, 0, 1)), away).findings[0]
    assert finding.code in {"NoIkSolution", "WorkspaceLimit", "JointLimit"}
    assert 0.0 < finding.phase < 1.0
    assert re.search(r"at \d\.\d\d s, \d+\.\d % of the path", finding.text)


def test_a_path_beside_the_cell_is_refused_with_where_it_leaves_it(model):
    error = refused(model, MotionOrder(frame=(0.42, 0.44, 0.1, 0, 0, 0, 1)))
    assert error.failure == "WorkspaceLimit"
    assert re.search(r"at x 420\.\d y \d+\.\d z 101\.0 mm, by up to \d+\.\d mm", str(error))


def test_a_joint_limit_half_way_names_joint_and_place(model):
    order = MotionOrder(time_step=0.008)
    reaching = plan_motion(DrawnMotion(), order, model)
    rows = slice(reaching.path_rows[0], reaching.path_rows[1] + 1)
    joint = int(np.ptp(reaching.joints[rows], axis=0).argmax())
    # No room for another posture, nor for an elbow elsewhere.
    lower, upper = reaching.joints.min(axis=0) - 0.02, reaching.joints.max(axis=0) + 0.02
    upper[joint] = float(np.median(reaching.joints[rows, joint]))
    narrow = replace(model, limits=replace(model.limits, lower=tuple(lower), upper=tuple(upper)))
    error = refused(narrow, order)
    assert error.failure == "JointLimit"
    assert f"joint {joint + 1} of {model.name}" in str(error)
    assert 0.0 <= error.findings[0].phase < 1.0
    assert error.findings[0].size > 0.0
    assert error.findings[0].joint == joint + 1
    assert error.findings[0].limit == pytest.approx(math.degrees(upper[joint]))


def test_a_corner_at_an_impossible_speed_is_refused_with_the_speed_it_allows(model):
    error = refused(model, replace(STEADY, speed=0.2, corners="refuse"))
    assert error.failure == "SpeedLimit"
    assert re.search(r"a corner allows \d+ mm/s", str(error))
    assert 0.0 < error.findings[0].phase < 1.0


def test_a_speed_no_nozzle_has_and_a_time_no_arm_can_do_are_refused(model):
    assert "500 mm/s at most" in str(refused(model, replace(STEADY, speed=0.9)))
    assert "cannot be run in 0.2 s" in str(refused(model, MotionOrder(duration=0.2)))


def test_a_fixture_in_the_way_is_refused_and_one_beside_it_is_not(model):
    def post(y):
        return Cell((Box("clamp", (0.44, y, 0.16, 0.0, 0.0, 0.0, 1.0), (0.02, 0.02, 0.10)),))

    error = refused(model, MotionOrder(), cell=post(0.04))
    assert error.failure == "Collision"
    assert "the clamp" in str(error)
    assert error.findings[0].size > 0.0
    plan = plan_motion(DrawnMotion(), MotionOrder(), model, cell=post(0.3))
    assert plan.report["smallest_clearance"] > 0.005


async def test_an_arm_that_is_not_at_its_start_asks_to_be_brought_home(model):
    arm = KinematicArm(model, realtime=False)
    await arm.open()
    plan = line_plan(model, 0.03)
    run_out = plan_home(model, tuple(plan.joints[plan.path_rows[0]]))
    elsewhere = await refusal(arm.run(run_out, lambda _: None))
    assert isinstance(elsewhere, StartRefused)
    assert elsewhere.failure == "ParameterInvalid"
    assert re.search(r"joint \d is \d+\.\d\d degrees away: move it home first", elsewhere.text)
    assert (arm.state().mode, arm.state().joints) == (ArmMode.IDLE, model.home)
    await arm.run(plan, lambda _: None)  # and is as good as before
