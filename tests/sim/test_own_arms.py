"""Somebody else's arm from a folder, and what a workstation has otherwise: planned as it is, or refused aloud."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawn_motion import DrawnMotion
from random_orders import OWN, ROBOTS, ends_pushed, largest_shares, own_arm
from scipy.spatial.transform import Rotation

from sim import robots
from sim.arm_model import ArmModel
from sim.description.reach import reaching, seeds
from sim.findings import MotionRefused
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.clearance import Box, Cell, check_clearance, least_distances
from sim.planning.kinematics import kinematics
from sim.planning.planner import plan_home, plan_motion
from sim.robots import Changes, changed, read_model

ORDER = MotionOrder(time_step=0.004, timing="constant_speed", speed=0.02)


def texts(name: str) -> tuple[str, str]:
    return tuple((ROBOTS / f"{name}.{kind}").read_text("utf-8") for kind in ("urdf", "toml"))  # pyright: ignore


def without_hull(name: str) -> ArmModel:
    urdf, table = texts(name)
    return read_model(name, urdf, table[: table.index("[hull]")])


def refusal(arm: ArmModel, order: MotionOrder = ORDER, **more) -> MotionRefused:
    with pytest.raises(MotionRefused) as caught:
        plan_motion(DrawnMotion(), order, arm, **more)
    return caught.value


@pytest.mark.parametrize("name", OWN)
def test_an_arm_from_a_folder_runs_the_zigzag_and_goes_home(name):
    arm = own_arm(name)
    plan = plan_motion(DrawnMotion(), replace(ORDER, frame=arm.part_frame), arm)
    assert (plan.arm, largest_shares(plan, arm).max() <= 1.0) == (name, True)
    first, last = plan.path_rows
    path = plan.tool[first : last + 1] - arm.part_frame[:3]
    assert np.abs(path[:, :2] - DrawnMotion().points_at(plan.phases[first : last + 1])).max() < 1e-9
    home = plan_home(arm, tuple(plan.joints[(first + last) // 2]))
    assert np.allclose(home.joints[-1], arm.home)
    assert max(ends_pushed(plan, arm), ends_pushed(home, arm)) < 1e-3


def test_a_folder_with_one_arm_names_it_and_one_with_more_asks_which(tmp_path):
    for kind, text in zip(("urdf", "toml"), texts("gantry"), strict=True):
        (tmp_path / f"bench.{kind}").write_text(text, "utf-8")
    assert robots.load(str(tmp_path)).name == "bench"
    with pytest.raises(ValueError, match="more than one arm: name one of"):
        robots.load(str(ROBOTS))


def test_a_slide_moves_along_its_axis_and_its_jacobian_says_so():
    for name in ("gantry", "scara"):
        chain = kinematics(own_arm(name))
        joints = chain.seed + 0.02
        slopes = np.array(
            [
                (chain.forward((joints + 1e-6 * axis)[None])[0][0] - chain.forward((joints - 1e-6 * axis)[None])[0][0])
                for axis in np.eye(chain.dof)
            ]
        )
        assert np.allclose(chain.jacobian(joints[None])[0, :3], slopes.T / 2e-6, atol=1e-8)
    assert np.allclose(kinematics(own_arm("gantry")).seed_position, [0.42, 0.0, 0.33])


@pytest.mark.parametrize("name", OWN)
def test_an_arm_without_hull_is_refused_unless_it_is_said_that_nothing_is_checked(name):
    bare = without_hull(name)
    assert "has no hull" in str(refusal(bare))
    with pytest.raises(MotionRefused, match="has no hull"):
        plan_home(bare, bare.home)
    said = changed(bare, Changes(collisions_checked=False))
    assert isinstance(plan_motion(DrawnMotion(), replace(ORDER, frame=bare.part_frame), said), MotionPlan)
    assert said.digest != bare.digest


def test_an_elbow_below_the_table_is_found_with_the_hull():
    arm = own_arm("ur5e")
    low = np.array([[0.0, 0.35, 0.3, -1.2, -1.5, 0.0]])
    found, _ = check_clearance(arm, low, np.zeros(1), np.array([math.nan]), (Cell().table(),))
    assert any("the table" in one.text for one in found)


WRONG = [
    ("gantry", 'type="prismatic"', 'type="planar"', "is of type 'planar': it has to be one of"),
    ("gantry", 'type="prismatic"', 'type="floating"', "of type 'floating'"),
    ("scara", '<joint name="j2" type="revolute">', '<joint name="j2" type="revolute"><mimic joint="j1"/>', "mimic"),
    ("ur5e", '<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "it has to have a direction"),
    ("ur5e", "UR description joint_limits.yaml", "", "the position limits of ur5e name no source"),
    ("ur5e", 'source = "chosen low: not published"', "", "has no 'source'"),
    ("scara", "values = [20.0,20.0,5.0,50.0]", "values = [20.0,20.0,5.0]", "4 moving joints and 3 accelerations"),
    ("scara", "values = [20.0,20.0,5.0,50.0]", "values = [20.0,20.0,0.0,5.0]", "have to be more than 0"),
    (
        "scara",
        "home = [-0.8, 1.6, -0.05, -0.8]",
        "home = [-0.8, 1.6, 0.05, -0.8]",
        "joint 3 of scara is at 0.05 at home",
    ),
    ("gantry", 'tip = "nozzle_tip"', 'tip = "pen"', "'pen'"),
    ("gantry", 'link = "x"', 'link = "w"', "the hull of gantry names link 'w'"),
    ("gantry", "[path]", "[way]", "has no 'path'"),
    ("gantry", "home =", "home", "cannot be read"),
    ("gantry", "workspace_low = [0.0,", "workspace_low = [0.9,", "every upper number has to be more"),
]


@pytest.mark.parametrize(("name", "before", "after", "words"), WRONG, ids=lambda value: str(value)[:24])
def test_what_is_wrong_with_an_arms_files_is_said_in_one_sentence(name, before, after, words):
    changes = [text.replace(before, after) for text in texts(name)]
    assert tuple(changes) != texts(name)
    with pytest.raises(ValueError) as caught:
        read_model(name, *changes)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_workstations_own_workspace_home_and_tip_are_planned_with(panda):
    beside = replace(ORDER, frame=(0.0, 0.45, 0.1, 0.0, 0.0, 0.0, 1.0))
    assert refusal(panda, beside).failure == "WorkspaceLimit"
    wider = Changes(workspace_low=(-0.6, -0.6, 0.005), workspace_high=(0.75, 0.75, 0.9))
    assert plan_motion(DrawnMotion(), beside, changed(panda, wider)).arm_digest != panda.digest
    high = replace(ORDER, frame=(0.42, 0.0, 0.45, 0.0, 0.0, 0.0, 1.0))
    blocked = refusal(panda, high)
    assert (blocked.failure, "at home" in str(blocked)) == ("Collision", True)
    up = kinematics(panda).inverse(np.array([[0.35, -0.3, 0.6]]), kinematics(panda).seed_rotation).joints[0]
    plan = plan_motion(DrawnMotion(), high, changed(panda, replace(wider, home=tuple(up))))
    assert np.allclose(plan.joints[[0, -1]], up)
    longer = changed(panda, Changes(tip=(0.0, 0.0, 0.03)))
    tool = plan_motion(DrawnMotion(), ORDER, longer)
    wrist = kinematics(panda).forward(tool.joints)[0]
    assert np.allclose(wrist[tool.path_rows[0], 2] - tool.tool[tool.path_rows[0], 2], 0.03, atol=1e-9)
    with pytest.raises(ValueError, match="7 moving joints and 3 at its configured home"):
        changed(panda, Changes(home=(0.0, 0.0, 0.0)))
    with pytest.raises(ValueError, match="joint 2 of panda is at 9 at the configured home"):
        changed(panda, Changes(home=(0.0, 9.0, *panda.home[2:])))


def test_travel_goes_round_a_wall_between_home_and_the_part(model):
    wall = Cell((Box("wall", (0.42, 0.13, 0.17, 0.0, 0.0, 0.0, 1.0), (0.3, 0.01, 0.2)),))
    order = replace(ORDER, frame=(0.42, 0.26, 0.1, 0.0, 0.0, 0.0, 1.0), approach_height=0.02, retract_height=0.02)
    motion = DrawnMotion(corners=((0.0, 0.0), (0.03, 0.0), (0.03, 0.02)))
    narrow = replace(model, workspace_high=(0.8, 0.6, 0.9), workspace_low=(-0.4, -0.6, 0.005))
    plan = plan_motion(motion, order, narrow, cell=wall)
    assert least_distances(narrow, plan.joints[::5], wall.fixtures).min() > 4.5e-3
    assert largest_shares(plan, narrow).max() <= 1.0
    assert plan.segments[0].stage == "travel"
    straight = np.linspace(plan.joints[0], plan.joints[plan.segments[0].last], 200)
    assert least_distances(narrow, straight, wall.fixtures).min() < 0.0, "the straight move would have gone through it"


def five_axes() -> ArmModel:
    """Return a UR5e whose last axis is fixed."""
    urdf, table = texts("ur5e")
    urdf = urdf.replace('name="wrist_3_joint" type="revolute"', 'name="wrist_3_joint" type="fixed"')
    lines = [
        re.sub(r", [^,\]]+\]$", "]", line) if re.match(r"(lower|upper|values|home) = ", line) else line
        for line in table.splitlines()
    ]
    return read_model("five", urdf, "\n".join(lines))


FEW = {"gantry": 3, "gantry_c": 4, "scara": 4, "five": 5}


@pytest.mark.parametrize("name", FEW)
def test_arms_of_few_axes_find_back_to_every_pose_they_can_have(name):
    arm = five_axes() if name == "five" else own_arm(name)
    chain = kinematics(arm)
    assert chain.dof == FEW[name]
    random = np.random.default_rng(4)
    joints = chain.seed + random.uniform(-0.25, 0.25, (40, chain.dof))
    places, turns = chain.forward(joints)
    found = chain.refine(places, turns, joints + random.uniform(-0.02, 0.02, joints.shape))
    assert found.reached.all()
    again, held = chain.forward(found.joints)
    assert np.abs(again - places).max() < 1e-9
    assert np.abs(held - turns).max() < 1e-6
    one_by_one = [chain.refine(places[[k]], turns[[k]], joints[[k]] + 0.01).joints for k in range(3)]
    together = chain.refine(places[:3], turns[:3], joints[:3] + 0.01).joints
    assert np.array_equal(np.concatenate(one_by_one), together)


@pytest.mark.parametrize(("name", "least"), [("scara", 2), ("ur5e", 8), ("gantry", 1)])
def test_every_branch_that_reaches_a_pose_is_found(name, least):
    chain = kinematics(own_arm(name))
    joints, good = reaching(chain, chain.seed_position[None], chain.seed_rotation, seeds(chain, 80))
    turns = np.where(chain.slides, joints[good], np.mod(joints[good] + 1e-6, 2.0 * np.pi))
    assert len({tuple(row) for row in np.round(turns, 3)}) >= least


def test_a_gantry_with_a_turning_axis_holds_the_nozzle_as_the_part_is_turned_and_one_without_cannot_lean():
    arm = own_arm("gantry_c")
    yaw = tuple(Rotation.from_euler("z", 40.0, degrees=True).as_quat())
    plan = plan_motion(DrawnMotion(), replace(ORDER, frame=(0.42, 0.0, 0.1, *yaw)), arm)
    assert not [one for one in plan.findings if one.code == "NoIkSolution"]
    assert largest_shares(plan, arm).max() <= 1.0
    leaning = tuple(Rotation.from_euler("y", 20.0, degrees=True).as_quat())
    motion = DrawnMotion(corners=((0.0, 0.0), (0.03, 0.0), (0.03, 0.02)))
    told = plan_motion(motion, replace(ORDER, frame=(0.42, 0.0, 0.1, *leaning)), own_arm("gantry")).findings
    [lean] = [one for one in told if one.code == "NoIkSolution"]
    assert (lean.unit, lean.fatal) == ("degrees", False)
    assert lean.size == pytest.approx(20.0, abs=1e-6)


BRANCHES = [
    ("panda", (0.42, 0.0, 0.1), ("y", -45)),
    ("panda", (0.6, 0.0, 0.5), ("y", -90)),
    ("xarm6", (0.42, 0.0, 0.1), ("y", -45)),
]


@pytest.mark.parametrize(("name", "place", "turn"), BRANCHES, ids=str)
def test_another_posture_is_tried_before_a_path_is_refused(name, place, turn):
    arm = robots.load(name)
    frame = (*place, *Rotation.from_euler(*turn, degrees=True).as_quat())
    plan = plan_motion(DrawnMotion(), replace(ORDER, frame=frame), arm)
    assert largest_shares(plan, arm).max() <= 1.0
    low, high = np.array(arm.limits.lower), np.array(arm.limits.upper)
    assert ((plan.joints >= low) & (plan.joints <= high)).all()
    assert plan.report["smallest_singular_value"] >= 0.03
    assert plan.report["smallest_clearance"] >= 0.005


def test_no_folder_is_no_arm(tmp_path: Path):
    with pytest.raises(ValueError, match="or a folder with a URDF and a limits file"):
        robots.load(str(tmp_path / "nothing"))
