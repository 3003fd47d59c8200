"""The simulated arm: exact, repeatable, stoppable. One process an arm serves all tests here."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace

import numpy as np
import pytest
import pytest_asyncio
from drawn_motion import DrawnMotion
from scipy.spatial.transform import Rotation

from sim import robots
from sim.arm import ArmFault, ArmMode, Stopped
from sim.drivers.pybullet.arm import PyBulletArm
from sim.order import MotionOrder
from sim.planning.planner import plan_home, plan_motion
from sim.testing.conformance import away, left_path, line_plan, outcome
from sim.testing.disturbances import Imperfection

pytestmark = pytest.mark.asyncio(loop_scope="module")
SHORT = ((0.0, 0.0), (0.0, 0.03), (0.008, 0.03), (0.008, 0.0))
STEADY = MotionOrder(time_step=0.004, timing="constant_speed", speed=0.03)


class Arms:
    """Arms that are opened when first asked for and stay open; each is brought home before it is given again."""

    def __init__(self) -> None:
        self._open: dict[tuple[str, bool, Imperfection | None], PyBulletArm] = {}

    async def get(self, name="panda", *, realtime=False, imperfection=None) -> PyBulletArm:
        key = (name, realtime, imperfection)
        if key not in self._open:
            self._open[key] = PyBulletArm(robots.load(name), realtime=realtime, imperfection=imperfection)
            await self._open[key].open()
        arm = self._open[key]
        if away(arm, np.array(arm.model.home)) > 1e-3:
            await arm.run(plan_home(arm.model, arm.state().joints, speed_fraction=1.0), lambda _: None)
        return arm

    async def close(self) -> None:
        for arm in self._open.values():
            await arm.close()


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def pool() -> AsyncIterator[Arms]:
    there = Arms()
    yield there
    await there.close()


def short(order: MotionOrder, name: str = "panda", **more):
    return plan_motion(DrawnMotion(SHORT, **more), order, robots.load(name))


async def until(condition, limit=30.0):
    async with asyncio.timeout(limit):
        while not condition():
            await asyncio.sleep(0.002)


@pytest.mark.parametrize("name", robots.names())
async def test_the_nozzle_follows_within_five_micrometres_at_one_kilohertz(name, pool):
    arm = await pool.get(name)
    for speed in (0.02, 0.1):
        plan = short(MotionOrder(time_step=0.001, timing="constant_speed", speed=speed), name)
        trace = await arm.run(plan, lambda _: None)
        assert trace.tracking_error()[1] < 5e-6, speed
        assert trace.orientation_error()[1] < 1e-5


async def test_a_tilted_nozzle_is_held_as_well_as_an_upright_one(pool):
    class Tilted(DrawnMotion):
        has_orientation = True

        def orientations_at(self, phases):
            return Rotation.from_euler("yx", np.column_stack([0.4 + 0.3 * phases, 0.2 * phases])).as_quat()

    arm = await pool.get("xarm6")
    corners = tuple((x, y, 0.3 * y) for x, y in SHORT)
    plan = plan_motion(Tilted(corners), MotionOrder(time_step=0.002, duration=3.0), arm.model)
    trace = await arm.run(plan, lambda _: None)
    assert plan.report["tilt_max"] > 0.6
    assert trace.tracking_error()[1] < 1e-5
    assert trace.orientation_error()[1] < 5e-5


async def test_every_time_step_takes_its_own_number_of_samples_along_the_same_path(pool):
    arm = await pool.get()
    samples = {}
    for step in (0.001, 0.008, 0.02):
        plan = short(MotionOrder(time_step=step, duration=3.0))
        trace = await arm.run(plan, lambda _: None)
        samples[step] = len(trace.times)
        assert samples[step] == plan.samples
        assert trace.tracking_error()[0] < 1e-4
        assert plan.path_error[1] <= 5.2e-5
    assert samples[0.001] > 7.5 * samples[0.008] > 17 * samples[0.02]


@pytest.mark.slow
async def test_two_runs_of_a_plan_leave_bitwise_equal_traces_also_in_another_process(pool):
    plan, other = short(STEADY), line_plan(robots.load(), 0.03)
    arm = await pool.get()
    traces = [await arm.run(plan, lambda _: None)]
    await arm.run(other, lambda _: None)
    traces.append(await arm.run(plan, lambda _: None))
    fresh = PyBulletArm(robots.load(), realtime=False)
    await fresh.open()
    traces.append(await fresh.run(plan, lambda _: None))
    await fresh.close()
    for again in traces[1:]:
        assert np.array_equal(traces[0].joints_measured, again.joints_measured)
        assert np.array_equal(traces[0].tool_measured, again.tool_measured)
        assert np.array_equal(traces[0].orientation_measured, again.orientation_measured)


async def test_pause_and_resume_leave_the_path_by_less_than_ten_micrometres(pool):
    arm = await pool.get()
    plan = short(MotionOrder(time_step=0.001, timing="constant_speed", speed=0.02))
    run = asyncio.create_task(arm.run(plan, lambda _: None))
    for _ in range(2):
        before = arm.state().joints
        await until(lambda before=before: arm.state().joints != before or run.done())
        if not run.done():
            await arm.pause("a look")
        if arm.state().mode is ArmMode.PAUSED:
            await arm.resume()
    trace = await run
    assert (trace.override == 0.0).any()
    assert (np.diff(trace.path_times) >= 0.0).all()
    assert trace.tracking_error()[1] < 1e-5
    assert left_path(trace, plan, arm.model) < 1e-5


async def test_a_run_paced_like_a_real_arm_takes_its_time_and_leaves_the_event_loop_free(pool):
    arm = await pool.get(realtime=True)
    plan = line_plan(arm.model, 0.04)
    loop = asyncio.get_running_loop()
    longest, last = 0.0, loop.time()
    began = last
    run = asyncio.create_task(arm.run(plan, lambda _: None))
    while not run.done():
        await asyncio.sleep(0.001)
        longest, last = max(longest, loop.time() - last), loop.time()
    assert plan.duration - 0.2 < last - began < plan.duration + 3.0
    assert longest < 0.5 * plan.duration  # held up by the run, it would be all of it


async def test_a_stop_from_75_millimetres_a_second_takes_at_most_five(pool):
    line = DrawnMotion(((0.0, 0.0), (0.0, 0.08)))
    arm = await pool.get(realtime=True)
    plan = plan_motion(line, MotionOrder(time_step=0.001, timing="constant_speed", speed=0.075), arm.model)
    first, last = plan.path_rows
    seen = []
    run = asyncio.create_task(arm.run(plan, lambda progress: seen.append(progress.time)))
    await until(lambda: seen and seen[-1] > plan.times[first] + 0.1)
    await arm.stop("enough")
    ended = await outcome(run)
    assert isinstance(ended, Stopped)
    slowing = ended.trace.override < 1.0 - 1e-9
    assert slowing.any()
    assert ended.trace.path_times[slowing][0] < plan.times[last]
    way = np.diff(ended.trace.tool_measured[slowing], axis=0)
    assert np.sqrt((way**2).sum(axis=1)).sum() < 5e-3
    assert left_path(ended.trace, plan, arm.model) < 1e-6
    assert ended.trace.tracking_error()[1] < 1e-5


async def test_an_override_set_while_closed_is_obeyed_by_the_first_run_and_a_pause_is_in_the_trace():
    arm = PyBulletArm(robots.load(), realtime=False)
    await arm.set_override(0.25)
    await arm.open()
    try:
        assert arm.state().override == 0.25
        plan = line_plan(arm.model, 0.03)
        run = asyncio.create_task(arm.run(plan, lambda _: None))
        await until(lambda: arm.state().mode is ArmMode.RUNNING)
        await arm.pause("a look")
        paused = asyncio.get_running_loop().time()
        await until(lambda: asyncio.get_running_loop().time() > paused + 1.0)
        await arm.resume()
        trace = await run
    finally:
        await arm.close()
    assert trace.override.max() == 0.25
    assert trace.times[-1] >= 4.0 * plan.duration + 1.0
    resting = np.flatnonzero(trace.override == 0.0)
    assert trace.times[resting[-1]] - trace.times[resting[0]] >= 1.0
    assert np.ptp(trace.path_times[resting]) == 0.0
    assert not trace.dispense[resting].any()


@pytest.mark.slow
async def test_an_imperfect_arm_is_labelled_watched_and_stopped_as_the_order_says(pool):
    """The same tolerances as any simulated arm watches; here against Bullet's motors, in their own process."""
    arm = await pool.get(imperfection=Imperfection(lag=0.03))
    flagged = replace(STEADY, tube_sigmas=3.0)
    plan = short(flagged, spread=1e-4)
    trace = await arm.run(plan, lambda _: None)
    assert len(trace.times) == plan.samples
    assert any("tube" in text for _, text in trace.events)
    assert "imperfect on purpose" in trace.source
    for order, words in (
        (replace(flagged, tube_policy="stop"), "left the skill's tube"),
        (replace(STEADY, max_deviation=5e-4), "0.500 mm are allowed"),
    ):
        arm = await pool.get(imperfection=Imperfection(lag=0.03))
        ended = await outcome(asyncio.create_task(arm.run(short(order, spread=1e-4), lambda _: None)))
        assert isinstance(ended, ArmFault)
        assert ended.failure == "ToleranceExceeded"
        assert words in ended.text
        assert (arm.state().at_rest, arm.state().mode) == (True, ArmMode.IDLE)


async def test_a_good_arm_stays_in_the_tube(pool):
    arm = await pool.get()
    order = replace(STEADY, max_deviation=1e-4, tube_sigmas=2.0, tube_policy="stop")
    trace = await arm.run(short(order, spread=1e-4), lambda _: None)
    assert trace.events == ()
