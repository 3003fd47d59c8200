"""The simulated arm: exact, repeatable, stoppable, and gone when it has to be."""

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from drawn_motion import DrawnMotion

from sim import arms
from sim.arm import Arm, ArmFault, ArmMode, StartRefused, Stopped
from sim.conformance import ArmConformance, left_path, line_plan, outcome, refusal
from sim.imperfection import Imperfection
from sim.plan import MotionOrder, plan_motion
from sim.pybullet_arm import PyBulletArm

ROOT = Path(__file__).parents[2]


class TestPyBulletPanda(ArmConformance):
    tracking = 5e-6

    def make_arm(self) -> Arm:
        return PyBulletArm(arms.load("panda"), realtime=False)


@contextlib.asynccontextmanager
async def opened(name="panda", *, realtime=False, imperfection=None):
    arm = PyBulletArm(arms.load(name), realtime=realtime, imperfection=imperfection)
    await arm.open()
    try:
        yield arm
    finally:
        await arm.close()


async def until(condition, limit=30.0):
    end = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        await asyncio.sleep(0.005)


@pytest.mark.parametrize("name", arms.names())
async def test_the_nozzle_follows_within_five_micrometres_at_one_kilohertz(name, planned):
    async with opened(name) as arm:
        for speed in (0.01, 0.03) if name == "xarm6" else (0.03, 0.07):
            plan = planned(MotionOrder(time_step=0.001, timing="constant_speed", speed=speed), name, 0.0035)
            trace = await arm.run(plan, lambda _: None)
            assert trace.tracking_error()[1] < 5e-6, speed


async def test_every_time_step_takes_its_own_number_of_samples_along_the_same_path(planned):
    async with opened() as arm:
        samples = {}
        for step in (0.001, 0.004, 0.008, 0.02):
            plan = planned(MotionOrder(time_step=step, duration=10.0))
            trace = await arm.run(plan, lambda _: None)
            samples[step] = len(trace.times)
            assert samples[step] == plan.samples
            assert trace.tracking_error()[0] < 1e-4
            assert plan.path_error[1] <= 5.2e-5
        assert samples[0.001] > 3.9 * samples[0.004] > 7.5 * samples[0.008] > 18 * samples[0.02]


async def test_two_runs_of_a_plan_leave_bitwise_equal_traces_also_in_another_process(planned):
    plan = planned(MotionOrder(time_step=0.002, timing="constant_speed", speed=0.05))
    traces = []
    for _ in range(2):
        async with opened() as arm:
            traces.append(await arm.run(plan, lambda _: None))
            await arm.run(planned(), lambda _: None)
            traces.append(await arm.run(plan, lambda _: None))
    for other in traces[1:]:
        assert np.array_equal(traces[0].joints_measured, other.joints_measured)
        assert np.array_equal(traces[0].tool_measured, other.tool_measured)


async def test_killing_the_simulation_fails_the_run_by_name_within_a_second(panda):
    async with opened(realtime=True) as arm:
        plan = line_plan(panda)
        run = asyncio.create_task(arm.run(plan, lambda _: None))
        await until(lambda: np.abs(np.array(arm.state().joints) - plan.joints[0]).max() > 1e-3)
        os.kill(arm.process_id, signal.SIGKILL)
        killed = time.monotonic()
        ended = await outcome(run)
        assert time.monotonic() - killed < 1.0
        assert isinstance(ended, ArmFault)
        assert ended.failure == "Interrupted"
        assert "SIGKILL" in ended.text
        assert (arm.state().known, arm.state().mode) == (False, ArmMode.FAULT)
        assert isinstance(await refusal(arm.run(plan, lambda _: None)), StartRefused)
        await arm.stop("already dead")
        await arm.reset()
        assert (arm.state().known, arm.state().mode) == (True, ArmMode.IDLE)


async def test_killing_the_simulation_in_a_pause_wakes_whoever_waits(panda):
    async with opened(realtime=True) as arm:
        run = asyncio.create_task(arm.run(line_plan(panda), lambda _: None))
        await until(lambda: arm.state().mode is ArmMode.RUNNING)
        pause = asyncio.create_task(arm.pause("a look"))
        os.kill(arm.process_id, signal.SIGKILL)
        assert isinstance(await outcome(run), ArmFault)
        await asyncio.wait_for(pause, 2.0)


PARENT = """
import asyncio
from sim import arms
from sim.conformance import line_plan
from sim.pybullet_arm import PyBulletArm

async def main():
    arm = PyBulletArm(arms.load(), realtime=True)
    await arm.open()
    told = lambda progress: print("moving", arm.process_id, flush=True)
    run = asyncio.create_task(arm.run(line_plan(arm.model), told))
    await run

asyncio.run(main())
"""


def alive(process_id):
    try:
        return Path(f"/proc/{process_id}/stat").read_text().split(")")[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_nothing_is_left_behind_when_the_parent_is_killed():
    with subprocess.Popen([sys.executable, "-c", PARENT], cwd=ROOT, stdout=subprocess.PIPE, text=True) as parent:
        word, process_id = parent.stdout.readline().split()
        assert word == "moving"
        assert alive(process_id)
        parent.kill()
        parent.wait()
        limit = time.monotonic() + 5.0
        while alive(process_id):
            assert time.monotonic() < limit, "the simulation outlived its parent"
            time.sleep(0.02)


QUIET = """
import asyncio
from sim import arms
from sim.pybullet_arm import PyBulletArm

async def main():
    for name in arms.names():
        arm = PyBulletArm(arms.load(name), realtime=False)
        await arm.open()
        await arm.close()

asyncio.run(main())
"""


def test_pybullet_says_nothing_on_stdout_or_stderr():
    done = subprocess.run([sys.executable, "-c", QUIET], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


async def test_a_run_paced_like_a_real_arm_takes_its_time_and_leaves_the_event_loop_free(panda):
    async with opened(realtime=True) as arm:
        plan = line_plan(panda, 0.02)
        longest, last = 0.0, time.monotonic()
        began = last
        run = asyncio.create_task(arm.run(plan, lambda _: None))
        while not run.done():
            await asyncio.sleep(0.001)
            longest, last = max(longest, time.monotonic() - last), time.monotonic()
        assert plan.duration - 0.2 < last - began < plan.duration + 3.0
        assert longest < 0.5 * plan.duration  # held up by the run, it would be all of it


async def test_a_stop_from_75_millimetres_a_second_takes_at_most_five(planned):
    plan = planned(MotionOrder(time_step=0.001, timing="constant_speed", speed=0.075), radius=0.0035)
    first, last = plan.path_rows
    async with opened(realtime=True) as arm:
        seen = []
        run = asyncio.create_task(arm.run(plan, lambda progress: seen.append(progress.time)))
        await until(lambda: seen and seen[-1] > plan.times[first] + 0.4)
        await arm.stop("enough")
        ended = await outcome(run)
    assert isinstance(ended, Stopped)
    slowing = ended.trace.override < 1.0 - 1e-9
    assert slowing.any()
    assert ended.trace.path_times[slowing][0] < plan.times[last]
    way = np.diff(ended.trace.tool_measured[slowing], axis=0)
    assert np.sqrt((way**2).sum(axis=1)).sum() < 5e-3
    assert left_path(ended.trace, plan) < 1e-6
    assert ended.trace.tracking_error()[1] < 1e-5


async def test_pause_and_resume_leave_the_path_by_less_than_ten_micrometres(planned):
    plan = planned(MotionOrder(time_step=0.001, timing="constant_speed", speed=0.05))
    async with opened() as arm:
        run = asyncio.create_task(arm.run(plan, lambda _: None))
        for _ in range(3):
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
    assert left_path(trace, plan) < 1e-5


async def test_an_imperfect_arm_is_labelled_and_stopped_when_it_strays_too_far(planned):
    worse = Imperfection(lag=0.02, backlash=2e-4, noise=1e-5)
    async with opened(imperfection=worse) as arm:
        plan = planned(MotionOrder(time_step=0.004, timing="constant_speed", speed=0.03, max_deviation=5e-4))
        ended = await outcome(asyncio.create_task(arm.run(plan, lambda _: None)))
    assert isinstance(ended, ArmFault)
    assert ended.failure == "ToleranceExceeded"
    assert "0.500 mm are allowed" in ended.text
    assert "imperfect on purpose" in ended.trace.source
    assert arm.state().at_rest


@pytest.mark.parametrize(("policy", "stops"), [("flag", False), ("stop", True)])
async def test_leaving_the_skills_tube_is_told_or_stops_the_run(policy, stops, panda):
    order = MotionOrder(time_step=0.004, timing="constant_speed", speed=0.03, tube_sigmas=3.0, tube_policy=policy)
    plan = plan_motion(DrawnMotion(spread=1e-4), order, panda)
    async with opened(imperfection=Imperfection(lag=0.03)) as arm:
        run = asyncio.create_task(arm.run(plan, lambda _: None))
        if stops:
            ended = await outcome(run)
            assert isinstance(ended, ArmFault)
            assert ended.failure == "ToleranceExceeded"
            assert "tube" in ended.text
        else:
            trace = await run
            assert len(trace.times) == plan.samples
            assert any("tube" in text for _, text in trace.events)


async def test_a_good_arm_stays_in_the_tube(panda):
    order = MotionOrder(
        time_step=0.004, timing="constant_speed", speed=0.03, max_deviation=1e-4, tube_sigmas=2.0, tube_policy="stop"
    )
    plan = plan_motion(DrawnMotion(spread=1e-4), order, panda)
    async with opened() as arm:
        assert (await arm.run(plan, lambda _: None)).events == ()
