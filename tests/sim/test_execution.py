"""A plan being run: whatever is commanded when, the arm stays on its path, within its limits, and never goes back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim import arms
from sim.conformance import left_path, line_plan
from sim.execution import Execution, Phase, Recorder

PLAN = line_plan(arms.load(), 0.03)
COMMANDS = st.lists(
    st.tuples(st.integers(0, 900), st.sampled_from(["pause", "resume", 0.05, 0.3, 0.77, 1.0])), max_size=8
)


def played(commands, plan=PLAN, *, stop_at=None):
    """Return the joints at every tick, the execution and its trace; commands wait the given number of ticks."""
    execution = Execution(plan, arms.load(plan.arm))
    recorder = Recorder(arms.load(plan.arm), "a test")
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
    model = arms.load()
    rates = np.diff(joints, axis=0) / execution.dt
    assert (np.diff(trace.path_times) >= 0.0).all()
    assert trace.path_times[-1] == PLAN.duration
    assert left_path(trace, PLAN) < 1e-5
    assert (np.abs(rates) <= np.array(model.limits.velocity)).all()
    assert (np.abs(np.diff(rates, axis=0)) / execution.dt <= np.array(model.limits.acceleration)).all()


@settings(deadline=None, max_examples=8)
@given(commands=COMMANDS, stop_at=st.integers(1, 3000))
def test_a_stop_at_any_moment_ends_at_rest_on_the_path_within_the_limits(commands, stop_at):
    joints, execution, trace = played(commands, stop_at=stop_at)
    rates = np.diff(joints, axis=0) / execution.dt
    assert (np.abs(np.diff(rates, axis=0)) / execution.dt <= np.array(arms.load().limits.acceleration)).all()
    assert left_path(trace, PLAN) < 1e-5
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


def test_the_valve_is_closed_while_paused_and_open_again_afterwards():
    _, _, trace = played([(1700, "pause"), (400, "resume")])
    resting = trace.override == 0.0
    first, last = (PLAN.times[row] for row in PLAN.path_rows)
    middle = (trace.path_times > first) & (trace.path_times < last - 2e-3)
    assert resting.any()
    assert not trace.dispense[resting].any()
    assert trace.dispense[middle & ~resting].all()
