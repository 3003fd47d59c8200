"""The conformance suite passes for an arm that is not shipped."""

from random_orders import own_arm

from sim.arm import Arm
from sim.conformance import ArmConformance
from sim.kinematic_arm import KinematicArm


class TestKinematicUR5e(ArmConformance):
    tracking = 0.0
    turning = 0.0

    def make_arm(self) -> Arm:
        return KinematicArm(own_arm("ur5e"), realtime=False)
