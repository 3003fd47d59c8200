"""The arm without a simulator does what every arm must."""

import asyncio
import time

import numpy as np
import pytest
from drawn_motion import DrawnMotion

from sim import robots
from sim.arm import Arm, ArmFault, ArmMode
from sim.drivers.kinematic.arm import KinematicArm
from sim.order import MotionOrder
from sim.planning.planner import plan_motion
from sim.testing.conformance import ArmConformance, line_plan, outcome
from sim.testing.disturbances import Imperfection
from sim.traces import to_csv


class TestKinematicPanda(ArmConformance):
    tracking = 0.0
    turning = 0.0
    name = "panda"

    def make_arm(self) -> Arm:
        return KinematicArm(robots.load(self.name), realtime=False)


class TestKinematicXArm6(TestKinematicPanda):
    name = "xarm6"


class TestKinematicIiwa14(TestKinematicPanda):
    name = "iiwa14"


async def ended(order: MotionOrder, imperfection: Imperfection | None, spread: float = 1e-3):
    """Return the arm, the plan and the trace or the exception with which its run ended."""
    model = robots.load()
    arm = KinematicArm(model, realtime=False, imperfection=imperfection)
    plan = plan_motion(DrawnMotion(spread=spread), order, model)
    await arm.open()
    run = asyncio.create_task(arm.run(plan, lambda _: None))
    await asyncio.wait({run})
    return arm, plan, run.result() if run.exception() is None else await outcome(run)


STEADY = MotionOrder(time_step=0.004, timing="constant_speed", speed=0.03)


async def test_an_imperfect_arm_is_labelled_and_stopped_when_it_strays_too_far():
    order = MotionOrder(time_step=0.004, timing="constant_speed", speed=0.03, max_deviation=5e-4)
    arm, _, fault = await ended(order, Imperfection(lag=0.02, backlash=2e-4, noise=1e-5))
    assert isinstance(fault, ArmFault)
    assert fault.failure == "ToleranceExceeded"
    assert "0.500 mm are allowed" in fault.text
    assert fault.trace is not None
    assert "imperfect on purpose" in fault.trace.source
    assert (arm.state().at_rest, arm.state().mode, arm.state().protective_stop) == (True, ArmMode.IDLE, False)


async def test_an_imperfect_arm_lags_as_much_as_it_was_told_to():
    _, _, trace = await ended(STEADY, Imperfection(lag=0.02))
    on_path = trace.dispense
    lagging = ((trace.tool_commanded - trace.tool_measured)[on_path] ** 2).sum(axis=1) ** 0.5
    assert lagging.max() == pytest.approx(0.02 * 0.03, rel=0.1)  # time constant times speed


async def test_an_imperfect_arm_still_comes_to_rest_at_the_plans_end():
    arm, plan, trace = await ended(STEADY, Imperfection(lag=0.05))
    assert len(trace.times) == plan.samples
    assert arm.state().joints == pytest.approx(plan.joints[-1], abs=1e-5)


@pytest.mark.parametrize(("policy", "stops"), [("flag", False), ("stop", True)])
async def test_leaving_the_skills_tube_is_told_or_stops_the_run(policy, stops):
    order = MotionOrder(time_step=0.004, timing="constant_speed", speed=0.03, tube_sigmas=3.0, tube_policy=policy)
    _, plan, end = await ended(order, Imperfection(lag=0.03), spread=1e-4)
    if stops:
        assert isinstance(end, ArmFault)
        assert end.failure == "ToleranceExceeded"
        assert "tube" in end.text
    else:
        assert len(end.times) == plan.samples
        assert any("tube" in text for _, text in end.events)


async def test_a_good_arm_stays_in_the_tube():
    order = MotionOrder(
        time_step=0.004, timing="constant_speed", speed=0.03, max_deviation=1e-6, tube_sigmas=0.5, tube_policy="stop"
    )
    _, _, trace = await ended(order, None, spread=1e-4)
    assert trace.events == ()


async def test_the_times_of_a_trace_are_the_clocks_and_a_pause_is_seen_in_them():
    arm = KinematicArm(robots.load(), realtime=True)
    await arm.open()
    plan = line_plan(arm.model, 0.06)
    began = time.monotonic()
    run = asyncio.create_task(arm.run(plan, lambda _: None))
    async with asyncio.timeout(60.0):
        while arm.state().mode is not ArmMode.RUNNING:
            await asyncio.sleep(0)
        await arm.pause("a look")
        paused = time.monotonic()
        while time.monotonic() < paused + 1.0:
            await asyncio.sleep(0.01)
        await arm.resume()
        trace = await run
    assert plan.duration + 1.0 <= trace.times[-1] <= time.monotonic() - began
    assert (np.diff(trace.times) >= 0.0).all()
    resting = np.flatnonzero(trace.override == 0.0)
    assert trace.times[resting[-1]] - trace.times[resting[0]] >= 1.0
    assert not trace.dispense[trace.override < 1.0].any()
    with_pause = np.loadtxt(to_csv(trace).splitlines(), comments="#", delimiter=",", skiprows=2)
    assert np.array_equal(with_pause[:, 0], trace.times)
