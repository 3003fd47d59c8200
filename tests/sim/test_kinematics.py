"""The joints are a function of the pose: exact, the same in any batch, and found or refused."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim import robots
from sim.drivers.pybullet.world import BulletWorld
from sim.planning.kinematics import Kinematics, kinematics


def reachable(model, count, seed=0):
    """Return positions in the demonstration cell."""
    random = np.random.default_rng(seed)
    return random.uniform((0.36, -0.12, 0.08), (0.52, 0.16, 0.28), (count, 3))


def test_inverse_of_a_pose_leads_back_to_it_within_a_picometre_scale(model):
    arm = kinematics(model)
    goal = reachable(model, 500)
    solved = arm.inverse(goal, arm.seed_rotation)
    position, rotation = arm.forward(solved.joints)
    assert solved.reached.all()
    assert np.abs(position - goal).max() < 1e-11
    assert np.abs(rotation - arm.seed_rotation).max() < 1e-11


def test_bullet_agrees_on_where_the_nozzle_is(model):
    world = BulletWorld(model)
    random = np.random.default_rng(3)
    low, high = np.array(model.limits.lower), np.array(model.limits.upper)
    try:
        for joints in random.uniform(np.maximum(low, -2.5), np.minimum(high, 2.5), (20, model.dof)):
            world.place(joints)
            assert np.abs(world.tip() - kinematics(model).forward(joints[None])[0][0]).max() < 1e-6
    finally:
        world.close()


def test_a_pose_has_the_same_joints_bit_for_bit_whatever_stands_beside_it(model):
    arm = kinematics(model)
    goal = reachable(model, 300)
    together = arm.inverse(goal, arm.seed_rotation).joints
    backwards = arm.inverse(goal[::-1].copy(), arm.seed_rotation).joints[::-1]
    alone = np.concatenate([arm.inverse(goal[i : i + 1], arm.seed_rotation).joints for i in range(0, 300, 37)])
    assert np.array_equal(together, backwards)
    assert np.array_equal(together[::37], alone)


def test_neighbouring_poses_have_neighbouring_joints(model):
    arm = kinematics(model)
    line = np.linspace((0.38, -0.1, 0.1), (0.5, 0.1, 0.12), 4001)
    bend = np.abs(np.diff(arm.inverse(line, arm.seed_rotation).joints, 3, axis=0))
    assert bend.max() < 1e-8


@settings(deadline=None, max_examples=25)
@given(turn=st.floats(-0.6, 0.6), tilt=st.floats(-0.3, 0.3), name=st.sampled_from(robots.names()))
def test_a_tilted_nozzle_is_reached_too(turn, tilt, name):
    arm = kinematics(robots.load(name))
    wanted = Rotation.from_euler("zy", [turn, tilt]).as_matrix() @ arm.seed_rotation
    solved = arm.inverse(np.array([[0.44, 0.02, 0.2]]), wanted)
    assert np.abs(arm.forward(solved.joints)[1][0] - wanted).max() < 1e-10


def test_jacobian_is_the_derivative_of_the_position(model):
    arm = kinematics(model)
    joints = np.array(model.home) + 0.1
    step = 1e-6
    slopes = [
        (arm.forward((joints + step * axis)[None])[0][0] - arm.forward((joints - step * axis)[None])[0][0]) / (2 * step)
        for axis in np.eye(model.dof)
    ]
    assert np.allclose(arm.jacobian(joints[None])[0, :3], np.array(slopes).T, atol=1e-8)


def test_a_pose_out_of_reach_gets_the_nearest_joints_inside_the_limits(model):
    arm = kinematics(model)
    solved = arm.inverse(np.array([[1.5, 0.0, 0.2], [0.45, 0.0, 0.2]]), arm.seed_rotation)
    low, high = np.array(model.limits.lower), np.array(model.limits.upper)
    assert solved.reached.tolist() == [False, True]
    assert np.isfinite(solved.joints).all()
    assert (solved.joints[0] >= low).all()
    assert (solved.joints[0] <= high).all()
    # Nearer than 0.9 m no arm here gets; farther than 1.2 m off would not be the nearest.
    assert 0.2 < solved.position_error[0] < 1.2


def test_no_points_have_no_joints(panda):
    assert kinematics(panda).inverse(np.empty((0, 3)), np.eye(3)).joints.shape == (0, 7)


def test_joint_axes_other_than_z_turn_as_bullet_turns_them(panda):
    """The general axis: joint 2 of the Panda written once about z, once about y of a frame turned back."""
    text = panda.urdf.replace(
        '<origin xyz="0 0 0" rpy="-1.5707963267948966 0 0"/><axis xyz="0 0 1"/>',
        '<origin xyz="0 0 0" rpy="0 0 0"/><axis xyz="0 1 0"/>',
    )
    # The child frame is turned by hand: the joint after it takes over the quarter turn.
    text = text.replace(
        '<origin xyz="0 -0.316 0" rpy="1.5707963267948966 0 0"/>', '<origin xyz="0 0 0.316" rpy="0 0 0"/>'
    )
    assert text != panda.urdf
    limits = panda.limits
    other = Kinematics(text, panda.tool.tip, panda.home, limits.lower, limits.upper)
    joints = np.array(panda.home) + np.linspace(-0.3, 0.3, 7)
    assert np.allclose(other.forward(joints[None])[0], kinematics(panda).forward(joints[None])[0], atol=1e-12)


def test_a_home_of_the_wrong_length_is_named(panda):
    with pytest.raises(ValueError, match="7 moving joints and the home position 6 values"):
        Kinematics(panda.urdf, panda.tool.tip, panda.home[:6], panda.limits.lower, panda.limits.upper)


def test_a_tip_that_does_not_exist_is_named(panda):
    with pytest.raises(ValueError, match="gripper"):
        Kinematics(panda.urdf, "gripper", panda.home, panda.limits.lower, panda.limits.upper)


def test_every_number_of_the_limits_names_its_source(model):
    assert [row for row, _ in model.limits.sources] == ["position", "velocity", "acceleration", "jerk"]
    assert all(len(source) > 20 for _, source in model.limits.sources)
    rows = (model.limits.lower, model.limits.upper, model.limits.velocity, model.limits.acceleration, model.limits.jerk)
    assert {len(row) for row in rows} == {model.dof}


def test_limits_in_description_and_limits_file_agree(model):
    pairs = re.findall(r'<limit lower="([^"]+)" upper="([^"]+)" velocity="([^"]+)"', model.urdf)
    assert [float(pair[0]) for pair in pairs] == list(model.limits.lower)
    assert [float(pair[1]) for pair in pairs] == list(model.limits.upper)
    assert [float(pair[2]) for pair in pairs] == list(model.limits.velocity)


def test_an_unknown_arm_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="panda, xarm6, iiwa14"):
        robots.load("scara")
