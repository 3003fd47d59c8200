"""The simulated arms do what every arm must: each class keeps one process, started once, for all its tests."""

from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from sim import robots
from sim.arm import Arm
from sim.drivers.pybullet.arm import PyBulletArm
from sim.testing.conformance import ArmConformance


@pytest_asyncio.fixture(scope="class", loop_scope="class", autouse=True)
async def let_go_of_the_arm(request: pytest.FixtureRequest) -> AsyncIterator[None]:
    yield
    await request.cls.let_go()
    assert request.cls._kept is None


@pytest.mark.asyncio(loop_scope="class")
class TestPyBulletPanda(ArmConformance):
    tracking = 5e-6
    turning = 1e-5
    speed = 0.006
    keep_open = True
    name = "panda"

    def make_arm(self) -> Arm:
        return PyBulletArm(robots.load(self.name), realtime=False)


@pytest.mark.slow
class TestPyBulletXArm6(TestPyBulletPanda):
    name = "xarm6"


@pytest.mark.slow
class TestPyBulletIiwa14(TestPyBulletPanda):
    name = "iiwa14"
