"""The arm without a simulator does what every arm must."""

from sim import arms
from sim.arm import Arm
from sim.conformance import ArmConformance
from sim.kinematic_arm import KinematicArm


class TestKinematicPanda(ArmConformance):
    tracking = 0.0

    def make_arm(self) -> Arm:
        return KinematicArm(arms.load("panda"), realtime=False)


class TestKinematicXArm6(ArmConformance):
    tracking = 0.0

    def make_arm(self) -> Arm:
        return KinematicArm(arms.load("xarm6"), realtime=False)
