"""The process of the simulated arm: its death has a name, and nothing of it is left behind."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from sim import robots
from sim.arm import ArmFault, ArmMode, StartRefused
from sim.drivers.pybullet.arm import PyBulletArm
from sim.planning.planner import plan_home
from sim.testing.conformance import away, line_plan, outcome, refusal
from tests.processes import alive

ROOT = Path(__file__).parents[2]


async def until(condition, limit=30.0):
    async with asyncio.timeout(limit):
        while not condition():
            await asyncio.sleep(0.002)


@pytest.mark.parametrize("name", robots.names())
async def test_killing_the_simulation_fails_the_run_by_name_within_a_second(name):
    arm = PyBulletArm(robots.load(name), realtime=True)
    await arm.open()
    try:
        plan = line_plan(arm.model)
        run = asyncio.create_task(arm.run(plan, lambda _: None))
        await until(lambda: away(arm, plan.joints[0]) > 1e-3)
        os.kill(arm.process_id, signal.SIGKILL)
        killed = time.monotonic()
        ended = await outcome(run)
        assert time.monotonic() - killed < 1.0
        assert isinstance(ended, ArmFault)
        assert ended.failure == "Interrupted"
        assert "SIGKILL" in ended.text
        last = arm.state()
        assert (last.known, last.mode) == (False, ArmMode.FAULT)
        assert ended.trace is not None
        assert np.array_equal(ended.trace.joints_measured[-1], last.joints)
        assert 0.0 < ended.trace.path_times[-1] < plan.duration
        assert ended.trace.tracking_error()[1] < 1e-4
        refused = await refusal(arm.run(plan, lambda _: None))
        assert isinstance(refused, StartRefused)
        assert "reset it first" in refused.text
        await arm.stop("already dead")
        await arm.reset()
        assert (arm.state().known, arm.state().mode) == (True, ArmMode.IDLE)
        assert away(arm, np.array(last.joints)) < 1e-9, "a reset moved the arm"
        home = await arm.run(plan_home(arm.model, arm.state().joints, speed_fraction=1.0), lambda _: None)
        assert np.abs(home.joints_measured[0] - last.joints).max() < 1e-9
    finally:
        await arm.close()


async def test_killing_the_simulation_in_a_pause_wakes_whoever_waits(panda):
    arm = PyBulletArm(panda, realtime=True)
    await arm.open()
    try:
        run = asyncio.create_task(arm.run(line_plan(panda), lambda _: None))
        await until(lambda: arm.state().mode is ArmMode.RUNNING)
        pause = asyncio.create_task(arm.pause("a look"))
        os.kill(arm.process_id, signal.SIGKILL)
        assert isinstance(await outcome(run), ArmFault)
        await asyncio.wait_for(pause, 10.0)
    finally:
        await arm.close()


PARENT = """
import asyncio
from sim import robots
from sim.testing.conformance import line_plan
from sim.drivers.pybullet.arm import PyBulletArm

async def main():
    arm = PyBulletArm(robots.load(), realtime=True)
    await arm.open()
    told = lambda progress: print("moving", arm.process_id, flush=True)
    run = asyncio.create_task(arm.run(line_plan(arm.model), told))
    await run

asyncio.run(main())
"""


def test_nothing_is_left_behind_when_the_parent_is_killed():
    with subprocess.Popen([sys.executable, "-c", PARENT], cwd=ROOT, stdout=subprocess.PIPE, text=True) as parent:
        word, process_id = parent.stdout.readline().split()
        assert word == "moving"
        assert alive(process_id)
        parent.kill()
        parent.wait()
        limit = time.monotonic() + 20.0
        while alive(process_id):
            assert time.monotonic() < limit, "the simulation outlived its parent"
            time.sleep(0.02)


QUIET = """
from sim import robots
from sim.drivers.pybullet.world import BulletWorld

for name in robots.names():
    BulletWorld(robots.load(name)).close()
"""


def test_pybullet_says_nothing_on_stdout_or_stderr():
    done = subprocess.run([sys.executable, "-c", QUIET], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
