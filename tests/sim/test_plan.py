"""Plans: what is asked for, checked, exact at its ends, told where it is slowed, refused where it is impossible."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from drawn_motion import DrawnMotion
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from models.learning import learn
from models.synthetic import simulated_people
from sim import robots
from sim.findings import MotionRefused
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.kinematics import kinematics
from sim.planning.planner import plan_home, plan_motion


def refused(order, motion=None, arm="panda", **more):
    with pytest.raises(MotionRefused) as caught:
        plan_motion(motion or DrawnMotion(), order, robots.load(arm), **more)
    return caught.value


def on_path(plan: MotionPlan) -> slice:
    return slice(plan.path_rows[0], plan.path_rows[1] + 1)


TIMINGS = [
    MotionOrder(time_step=0.001, timing="constant_speed", speed=0.03),
    MotionOrder(time_step=0.008, timing="constant_speed", speed=0.02, blend_radius=0.002),
    MotionOrder(time_step=0.004),
    MotionOrder(time_step=0.02, duration=12.0),
    MotionOrder(time_step=0.0035, speed=0.025),
    MotionOrder(time_step=0.004, timing="time_optimal"),
    MotionOrder(time_step=0.008, timing="constant_speed", speed=0.12, corners="slow"),
    MotionOrder(time_step=0.008, speed_override=0.5, speed_fraction=0.25),
]


@pytest.mark.parametrize("order", TIMINGS, ids=lambda order: f"{order.timing}-{order.time_step}-{order.blend_radius}")
def test_every_plan_keeps_the_laws_of_plans(model, order, planned):
    plan = planned(order, model.name)
    motion, step = DrawnMotion(), order.time_step
    low, high = np.array(model.limits.lower), np.array(model.limits.upper)
    assert np.allclose(plan.times, np.arange(plan.samples) * step)
    assert np.array_equal(plan.joints[0], model.home)
    assert np.array_equal(plan.joints[-1], model.home)
    assert not plan.velocities[[0, -1]].any()
    assert ((plan.joints >= low) & (plan.joints <= high)).all()
    assert (np.abs(plan.velocities) <= model.limits.velocity).all()
    acceleration = np.diff(plan.velocities, axis=0) / step
    assert (np.abs(acceleration).max(axis=0) <= np.array(model.limits.acceleration) * 1.02).all()
    assert np.abs(kinematics(model).forward(plan.joints)[0] - plan.tool).max() < 1e-9
    path = plan.tool[on_path(plan)] - model.part_frame[:3]
    assert np.allclose(path[[0, -1], :2], motion.points_at(np.array([0.0, 1.0])), atol=1e-9)
    assert np.allclose(path[:, 2], order.standoff, atol=1e-9)
    assert plan.phases[list(plan.path_rows)] == pytest.approx([0.0, 1.0], abs=1e-9)
    if not order.blend_radius:
        assert np.allclose(path[:, :2], motion.points_at(plan.phases[on_path(plan)]), atol=1e-9)
        assert plan.path_error[1] <= order.chord_tolerance * 1.03
    assert plan.segments[0].stage == "travel"
    assert plan.segments[-1].last == plan.samples - 1
    assert all(a.last == b.first for a, b in zip(plan.segments, plan.segments[1:], strict=False))
    assert plan.digest == plan.content_digest()


def test_constant_speed_is_within_one_percent_on_every_sample_of_the_path(model):
    order = MotionOrder(time_step=0.004, timing="constant_speed", speed=0.03)
    plan = plan_motion(DrawnMotion(), order, model)
    steps = np.sqrt((np.diff(plan.tool[on_path(plan)], axis=0) ** 2).sum(axis=1)) / order.time_step
    assert np.abs(steps / 0.03 - 1.0).max() < 0.01


def test_a_duration_is_met_to_one_step_and_a_speed_scales_the_people_s_timing(planned):
    asked = planned(MotionOrder(time_step=0.004, duration=15.0))
    assert asked.report["path_duration"] == pytest.approx(15.0, rel=2e-3)
    mean = planned(MotionOrder(time_step=0.004, speed=0.02))
    assert mean.report["length"] / mean.report["path_duration"] == pytest.approx(0.02, rel=2e-3)
    learned = planned(MotionOrder(time_step=0.004))
    assert learned.report["path_duration"] == pytest.approx(DrawnMotion().duration, rel=2e-3)


def test_test_mode_takes_four_times_as_long_on_every_segment(planned):
    full, slow = (planned(MotionOrder(time_step=0.004, speed_fraction=f)) for f in (1.0, 0.25))
    for fast, quarter in zip(full.segments, slow.segments, strict=True):
        assert quarter.last - quarter.first >= 4 * (fast.last - fast.first) - 4
    assert slow.report["speed_max"] <= 0.25 * full.report["speed_max"] * 1.01


def test_time_optimal_is_faster_than_shown_and_within_limits(planned):
    assert planned(MotionOrder(timing="time_optimal")).report["path_duration"] < 4.0


def test_a_slowed_corner_is_told_with_its_place(planned):
    plan = planned(MotionOrder(timing="constant_speed", speed=0.12))
    (told,) = plan.findings
    assert (told.code, told.fatal) == ("SpeedLimit", False)
    assert 0.0 < told.phase < 1.0
    assert "slowed from 120 to" in told.text
    assert plan.report["speed_min"] < 0.11


def test_sharp_corners_shown_by_people_are_slowed_down_visibly(model):
    plan = plan_motion(DrawnMotion(radius=0.0), MotionOrder(time_step=0.004), model)
    assert any("slowed" in finding.text for finding in plan.findings)


def test_the_valve_opens_and_closes_by_arc_length_with_its_lead():
    motion = DrawnMotion(dispense=((0.25, 0.75),))
    order = MotionOrder(time_step=0.001, timing="constant_speed", speed=0.03, dispense_lead=0.05)
    plan = plan_motion(motion, order, robots.load())
    opens, closes = plan.valve_events
    assert (opens.opens, closes.opens) == (True, False)
    assert opens.arc_length == pytest.approx(0.25 * plan.report["length"], rel=1e-3)
    early = int(np.argmax(plan.dispense))
    reached = int(np.argmax(plan.phases >= 0.25))
    assert (reached - early) * order.time_step == pytest.approx(0.05, abs=2e-3)
    assert plan.dispense.sum() * order.time_step == pytest.approx(closes.time - opens.time, abs=2e-3)


@settings(deadline=None, max_examples=10)
@given(turn=st.floats(-3.1, 3.1), tilt=st.floats(-0.15, 0.15))
def test_a_turned_or_tilted_part_is_followed_with_the_nozzle_against_its_normal(turn, tilt):
    rotation = Rotation.from_euler("zx", [turn, tilt])
    order = MotionOrder(time_step=0.02, frame=(0.45, 0.0, 0.12, *rotation.as_quat()), chord_tolerance=1e-3)
    motion = DrawnMotion(corners=((-0.03, -0.02), (0.03, -0.02), (0.03, 0.02)))
    plan = plan_motion(motion, order, robots.load())
    rows = kinematics(robots.load()).forward(plan.joints[on_path(plan)])[1]
    assert np.abs(rows[:, :, 2] + rotation.as_matrix()[:, 2]).max() < 1e-9


def test_a_learned_skill_runs_unchanged_on_all_three_arms(model):
    motion = learn(simulated_people(4, 0)[0]).motion
    plan = plan_motion(motion, MotionOrder(time_step=0.004, timing="constant_speed", speed=0.02), model)
    part = plan.tool[on_path(plan)] - model.part_frame[:3]
    assert np.abs(part[:, :2] - motion.points_at(plan.phases[on_path(plan)])).max() < 1e-9


def test_the_same_order_gives_the_same_plan_and_any_other_another_digest(planned):
    order = MotionOrder(time_step=0.004)
    arm = robots.load()
    again = plan_motion(DrawnMotion(), order, arm, skill_digest="ab" * 32, recipe_id="r1")
    assert again.digest == planned(order).digest
    others = [
        planned(replace(order, standoff=0.002)),
        planned(order, "iiwa14"),
        plan_motion(DrawnMotion(), order, arm, skill_digest="cd" * 32, recipe_id="r1"),
        plan_motion(DrawnMotion(), order, arm, skill_digest="ab" * 32, recipe_id="r2"),
    ]
    assert len({again.digest, *(plan.digest for plan in others)}) == 5


def test_a_plan_crosses_processes_whole(planned):
    plan = planned()
    copy = pickle.loads(pickle.dumps(plan))
    assert copy.digest == copy.content_digest() == plan.digest


def test_a_refusal_crosses_processes_whole():
    error = refused(MotionOrder(time_step=0.0))
    copy = pickle.loads(pickle.dumps(error))
    assert (str(copy), copy.failure) == (str(error), error.failure)


def test_a_plans_arrays_cannot_be_written(planned):
    with pytest.raises(ValueError, match="read-only"):
        planned().joints[0, 0] = 1.0


def test_a_part_upside_down_is_refused():
    error = refused(MotionOrder(frame=(0.42, 0, 0.1, 1, 0, 0, 0)))
    assert error.failure in {"NoIkSolution", "JointLimit", "Singularity", "Collision"}


def test_a_sharp_corner_at_constant_speed_is_refused():
    error = refused(MotionOrder(timing="constant_speed", speed=0.05), DrawnMotion(radius=0.0))
    assert error.failure == "SpeedLimit"
    assert "blend radius" in str(error)


def test_a_blend_radius_makes_the_same_corner_possible(panda):
    order = MotionOrder(timing="constant_speed", speed=0.04, blend_radius=0.002)
    plan = plan_motion(DrawnMotion(radius=0.0), order, panda)
    assert plan.report["speed_min"] > 0.0399
    assert 3e-4 < plan.path_error[1] < 9e-4


def test_a_time_step_that_is_too_long_for_a_corner_slows_it_down_or_is_refused_where_it_must_not(panda):
    order = MotionOrder(timing="constant_speed", speed=0.05, time_step=0.02)
    plan = plan_motion(DrawnMotion(radius=0.001), order, panda)
    (told,) = plan.findings
    assert told.limit < 50.0 == told.asked
    assert told.place == pytest.approx(told.phase * plan.report["length"], rel=1e-3)
    assert "a time step of 20 ms allows" in told.text
    assert plan.report["chord_error"] <= order.chord_tolerance * 1.02
    never = refused(replace(order, corners="refuse"), DrawnMotion(radius=0.001))
    assert never.failure == "SpeedLimit"
    assert never.findings[0].limit < 50.0


@pytest.mark.parametrize("aside", [1e-5, 8.7e-5, 3e-4])
def test_a_kink_however_short_costs_no_more_than_a_corner(panda, aside):
    order = MotionOrder(time_step=0.008, timing="time_optimal", frame=panda.part_frame)
    times = []
    for step in (aside, 1e-3):
        corners = ((0.0, 0.0), (0.0, 0.04), (step, 0.04), (step, 0.08))
        kinked = plan_motion(DrawnMotion(corners=corners, radius=0.0), order, panda)
        times.append(kinked.report["path_duration"])
    assert times[0] <= 1.1 * times[1]


def test_a_motion_that_stands_still_is_refused(panda):
    point = DrawnMotion(corners=((0.0, 0.0), (1e-7, 0.0)))
    assert refused(MotionOrder(), point).failure == "ParameterInvalid"


def test_the_way_home_lifts_first_and_ends_at_rest_at_home(model, planned):
    plan = planned(MotionOrder(time_step=0.008, timing="constant_speed", speed=0.02), model.name)
    low = plan.joints[sum(plan.path_rows) // 2]
    home = plan_home(model, low)
    assert np.allclose(home.joints[0], low, atol=1e-12)
    assert np.array_equal(home.joints[-1], model.home)
    lift = home.segments[0]
    assert lift.stage == "retract"
    rise = home.tool[: lift.last + 1]
    assert np.abs(rise[:, :2] - rise[0, :2]).max() < 1e-5
    assert rise[-1, 2] - rise[0, 2] == pytest.approx(0.05, abs=1e-3)


def test_the_way_home_from_home_is_a_moment_of_standing(model):
    plan = plan_home(model, model.home)
    assert np.array_equal(plan.joints, np.tile(model.home, (2, 1)))


def test_no_way_home_from_joints_that_are_no_numbers(panda):
    with pytest.raises(MotionRefused, match="7 finite numbers"):
        plan_home(panda, (math.nan,) * 7)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_learned_corner_sharper_than_the_grid_is_slowed_not_refused(seed: int) -> None:
    model = robots.load("panda")
    motion = learn(simulated_people(20, seed)[0], compare=False).motion
    order = MotionOrder(time_step=0.004, timing="constant_speed", speed=0.025, frame=model.part_frame)
    plan = plan_motion(motion, order, model)
    assert plan.findings
    assert plan.duration < 20.0
