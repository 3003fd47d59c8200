"""Arms that are not shipped do what every arm must, and are simulated like any other."""

from random_orders import own_arm

from sim.arm import Arm
from sim.drivers.kinematic.arm import KinematicArm
from sim.drivers.pybullet.arm import PyBulletArm
from sim.testing.conformance import ArmConformance, line_plan


class TestKinematicUR5e(ArmConformance):
    tracking = 0.0
    turning = 0.0
    name = "ur5e"

    def make_arm(self) -> Arm:
        return KinematicArm(own_arm(self.name), realtime=False)


class TestKinematicGantry(TestKinematicUR5e):
    name = "gantry"


class TestKinematicScara(TestKinematicUR5e):
    name = "scara"


async def test_an_arm_whose_joints_slide_is_simulated_by_pybullet():
    arm = PyBulletArm(own_arm("gantry"), realtime=False)
    await arm.open()
    try:
        plan = line_plan(arm.model, 0.03)
        trace = await arm.run(plan, lambda _: None)
    finally:
        await arm.close()
    assert len(trace.times) == plan.samples
    assert trace.tracking_error()[1] < 5e-6
