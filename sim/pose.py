"""Poses as seven numbers: x y z in m, then a unit quaternion x y z w."""

from scipy.spatial.transform import Rotation

from sim.arm_model import Floats, Pose
from sim.planning.kinematics import Kinematics


def pose_of(arm: Kinematics, joints: Floats) -> Pose:
    """Return the nozzle's pose in the base frame for joints (dof,)."""
    position, rotation = arm.forward(joints[None])
    x, y, z = (float(value) for value in position[0])
    qx, qy, qz, qw = (float(value) for value in Rotation.from_matrix(rotation[0]).as_quat())
    return x, y, z, qx, qy, qz, qw
