"""A plan being run: whatever is commanded when, the arm stays on its path, within its limits, and never goes back."""

import random
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from drawn_motion import DrawnMotion
from hypothesis import given, settings
from hypothesis import strategies as st
from random_orders import own_arm

from sim import robots
from sim.drivers.execution import Execution, Phase, Recorder
from sim.order import MotionOrder
from sim.planning.planner import plan_motion
from sim.planning.rates import rates
from sim.testing.conformance import left_path, line_plan

PLAN = line_plan(robots.load(), 0.03)
COMMANDS = st.lists(
    st.tuples(st.integers(0, 900), st.sampled_from(["pause", "resume", 0.05, 0.3, 0.77, 1.0])), max_size=8
)


def played(commands, plan=PLAN, *, stop_at=None):
    """Return the joints at every tick, the execution and its trace; commands wait the given number of ticks."""
    execution = Execution(plan, robots.load(plan.arm))
    recorder = Recorder(robots.load(plan.arm), "a test")
    waiting, joints, ticks = list(commands), [plan.joints[0]], 0
    while execution.phase is not Phase.ENDED:
        if stop_at is not None and ticks >= stop_at:
            execution.stop("a test")
        if waiting and ticks >= waiting[0][0]:
            _, command = waiting.pop(0)
            ticks = 0
            if command == "pause":
                execution.pause()
            elif command == "resume":
                execution.resume()
            else:
                execution.set_override(command)
        if execution.phase is Phase.PAUSED and not waiting:
            execution.resume()
        ticks += 1
        joints.append(execution.tick())
        recorder.add(execution, joints[-1], joints[-1])
    return np.array(joints), execution, recorder.trace()


@settings(deadline=None, max_examples=8)
@given(commands=COMMANDS)
def test_no_sequence_of_commands_makes_the_arm_jump_go_back_or_leave_its_path(commands):
    joints, execution, trace = played(commands)
    model = robots.load()
    rates = np.diff(joints, axis=0) / execution.dt
    assert (np.diff(trace.path_times) >= 0.0).all()
    assert trace.path_times[-1] == PLAN.duration
    assert left_path(trace, PLAN, robots.load()) < 1e-5
    assert (np.abs(rates) <= np.array(model.limits.velocity)).all()
    assert (np.abs(np.diff(rates, axis=0)) / execution.dt <= np.array(model.limits.acceleration)).all()


@settings(deadline=None, max_examples=8)
@given(commands=COMMANDS, stop_at=st.integers(1, 3000))
def test_a_stop_at_any_moment_ends_at_rest_on_the_path_within_the_limits(commands, stop_at):
    joints, execution, trace = played(commands, stop_at=stop_at)
    rates = np.diff(joints, axis=0) / execution.dt
    assert (np.abs(np.diff(rates, axis=0)) / execution.dt <= np.array(robots.load().limits.acceleration)).all()
    assert left_path(trace, PLAN, robots.load()) < 1e-5
    assert np.abs(rates[-1]).max() < 0.02
    assert not execution.valve


def test_undisturbed_it_hits_every_sample_to_the_last_bit():
    joints, execution, _ = played([])
    assert np.abs(joints[:: execution.ticks_a_row] - PLAN.joints).max() < 1e-12
    assert len(joints) == (PLAN.samples - 1) * execution.ticks_a_row + 1


def test_an_even_pace_is_resumed_where_it_was_left():
    _, _, trace = played([(1500, "pause"), (200, "resume"), (300, "pause"), (10, "resume")])
    steps = np.diff(trace.path_times)
    assert steps.max() == pytest.approx(0.001, rel=1e-6)
    assert (steps >= 0.0).all()


def test_the_valve_closes_before_the_nozzle_slows_for_a_pause_and_opens_at_speed_again():
    _, _, trace = played([(1700, "pause"), (400, "resume")])
    slowed = trace.override < 1.0
    first, last = (PLAN.times[row] for row in PLAN.path_rows)
    middle = (trace.path_times > first) & (trace.path_times < last - 2e-3)
    assert (trace.override == 0.0).any()
    assert not trace.dispense[slowed].any()
    assert trace.dispense[middle & ~slowed].all()


def test_a_valve_that_is_slow_to_close_has_its_lead_before_the_nozzle_slows():
    plan = replace(PLAN, order=replace(PLAN.order, dispense_lead=0.03))
    execution = Execution(plan, robots.load())
    while not execution.valve:
        execution.tick()
    for _ in range(100):
        execution.tick()
    execution.pause()
    assert not execution.valve
    asked = execution.clock
    while execution.rate == 1.0:
        execution.tick()
    assert execution.clock - asked == pytest.approx(0.03, abs=2.5 * execution.dt)


ZIGZAG = ((0.0, 0.0, 0.0), (0.0, 0.04, 0.01), (0.02, 0.04, 0.0), (0.02, 0.0, 0.0))
OWN = ("ur5e", "scara")
ORDERS = (
    MotionOrder(time_step=0.004, timing="time_optimal"),
    MotionOrder(time_step=0.0137),
    MotionOrder(time_step=0.008, timing="constant_speed", speed=0.05),
)


@lru_cache(maxsize=2)
def places(name):
    """Return an arm, shipped or not, and plans of a zigzag in space on it."""
    model = own_arm(name) if name in OWN else robots.load(name)
    plans = [
        plan_motion(DrawnMotion(ZIGZAG, radius=0.003), replace(order, frame=model.part_frame), model)
        for order in ORDERS
    ]
    return model, plans


def shares(joints, step, limits):
    """Return the largest share of velocity, acceleration and jerk in joints (n, dof), by differences alone."""
    resting = np.concatenate([np.repeat(joints[:1], 3, 0), joints, np.repeat(joints[-1:], 3, 0)])
    found = []
    for limit in (limits.velocity, limits.acceleration, limits.jerk):
        resting = np.diff(resting, axis=0) / step
        found.append(float(np.abs(resting / limit).max()))
    return found


def commanded(plan, model, rng):
    """Run a plan with commands at random moments, often while a ramp is under way, and a stop as the last of them.

    Return the joints (n, dof) at every tick, the tick in s, the number of commands, and how long the stop took in s.
    """
    execution = Execution(plan, model, rng.choice([1.0, 0.5]))
    joints, count, when = [plan.joints[0]], 0, rng.uniform(0.0, 0.9 * plan.duration)
    stopping, asked = False, 0.0
    while execution.phase is not Phase.ENDED:
        if not stopping and execution.clock >= when:
            count += 1
            when = execution.clock + rng.choice([0.005, 0.03, 0.1, 0.3]) * rng.uniform(0.5, 1.5)
            command = "stop" if count == 5 else rng.choice(["pause", "resume", "pause", "resume", 0.05, 0.3, 0.77, 1.0])
            if command == "stop":
                stopping, asked = True, execution.clock
                execution.stop("a test")
            elif command == "pause":
                execution.pause()
            elif command == "resume":
                execution.resume()
            else:
                execution.set_override(command)
        shut = execution.phase in {Phase.PAUSING, Phase.PAUSED, Phase.STOPPING}
        joints.append(execution.tick())
        assert not (execution.valve and (shut or execution.rate == 0.0))
        assert len(joints) < 60_000, "it never came to rest"
    return np.array(joints), execution.dt, count, execution.clock - asked if stopping else 0.0


@pytest.mark.parametrize("name", [*robots.names(), *OWN])
def test_pauses_stops_and_overrides_at_random_moments_keep_velocity_acceleration_and_jerk(name):
    model, plans = places(name)
    rng, count = random.Random(name), 0
    while count < 50:
        plan = rng.choice(plans)
        joints, dt, commands, stop = commanded(plan, model, rng)
        used = shares(joints, dt, model.limits)
        assert max(used) <= 1.0 + 1e-4, (plan.order, used)
        assert stop < 1.0, plan.order
        count += commands


def test_a_plan_that_leaves_nothing_of_any_limit_is_slowed_and_stopped_within_them_too():
    shipped, plans = places("panda")
    plan, rng = plans[0], random.Random(5)
    used = rates(plan.joints, plan.velocities, plan.order.time_step)
    largest = {name: tuple(getattr(used, name).max(axis=0)) for name in ("velocity", "acceleration", "jerk")}
    model = replace(shipped, limits=replace(shipped.limits, **largest))
    for _ in range(5):
        joints, dt, _, stop = commanded(plan, model, rng)
        assert max(shares(joints, dt, model.limits)) <= 1.0 + 1e-3
        assert stop < 1.5
