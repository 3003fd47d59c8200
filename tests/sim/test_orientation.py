"""A tool held as it was shown: the nozzle follows the learned orientation, on every arm, or the plan is refused."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest
from drawn_motion import DrawnMotion
from scipy.spatial.transform import Rotation

from models.learning import learn
from models.synthetic import ZIGZAG_IN_SPACE, simulated_people, true_orientations
from sim import robots
from sim.arm import angles_between
from sim.drivers.kinematic.arm import KinematicArm
from sim.findings import MotionRefused
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.clearance import Box, Cell
from sim.planning.kinematics import kinematics
from sim.planning.planner import plan_motion

RISE = ((0.0, 0.0, 0.0), (0.03, 0.02, 0.02), (0.0, 0.05, 0.03))
ORDER = MotionOrder(time_step=0.004, duration=6.0)
# The part turned by 35 degrees and tipped by 5, to tell a product of rotations from its reverse.
TURNED = (0.42, 0.02, 0.12, *Rotation.from_euler("zx", [35, 5], degrees=True).as_quat())


@dataclass(frozen=True)
class TiltedMotion(DrawnMotion):
    """A way in space along which the tool leans by ``lean`` about y and swings by ``swing`` about x: known exactly."""

    corners: tuple = RISE
    lean: float = math.radians(20)
    swing: float = math.radians(15)
    twist: float = math.radians(10)
    has_orientation = True

    def held_at(self, phases):
        angles = np.column_stack(
            [np.full(len(phases), self.lean), self.swing * np.sin(np.pi * phases), self.twist * phases]
        )
        return Rotation.from_euler("yxz", angles)

    def orientations_at(self, phases):
        return self.held_at(phases).as_quat()


def on_path(plan: MotionPlan) -> slice:
    return slice(plan.path_rows[0], plan.path_rows[1] + 1)


@pytest.mark.parametrize("frame", [MotionOrder().frame, TURNED], ids=["straight", "turned"])
def test_the_nozzle_points_where_the_tool_pointed(model, frame):
    motion = TiltedMotion()
    plan = plan_motion(motion, replace(ORDER, frame=frame), model)
    part = Rotation.from_quat(frame[3:])
    phases = plan.phases[on_path(plan)]
    shown = part * motion.held_at(phases)
    _, rotations = kinematics(model).forward(plan.joints[on_path(plan)])
    # The tool's z points up along it, the nozzle's out of its tip.
    assert np.abs(rotations[:, :, 2] + shown.apply([0.0, 0.0, 1.0])).max() < 1e-9
    # About its axis the nozzle turns with the tool: the same turn from the first sample to every other.
    nozzle = Rotation.from_matrix(rotations)
    assert ((nozzle * nozzle[0].inv()) * (shown * shown[0].inv()).inv()).magnitude().max() < 1e-9
    assert angles_between(plan.orientations[on_path(plan)], nozzle.as_quat()).max() < 1e-9
    tip = plan.tool[on_path(plan)] - np.array(frame[:3])
    assert np.abs(part.inv().apply(tip) - motion.points_at(phases) - [0.0, 0.0, ORDER.standoff]).max() < 1e-9
    tilt = np.arccos(motion.held_at(phases).as_matrix()[:, 2, 2]).max()
    assert plan.report["tilt_max"] == pytest.approx(tilt, abs=1e-6)
    assert 0.0 < plan.report["orientation_error_max"] < 1e-4
    assert plan.report["orientation_error_rms"] <= plan.report["orientation_error_max"]
    assert plan.report["turning_max"] < 1.0


def test_a_tool_held_upright_is_the_same_as_none_recorded(panda):
    upright = plan_motion(TiltedMotion(lean=0.0, swing=0.0, twist=0.0), ORDER, panda)
    none = plan_motion(DrawnMotion(corners=RISE), ORDER, panda)
    assert np.abs(upright.joints - none.joints).max() < 1e-9
    assert "tilt_max" not in none.report


def test_a_way_in_space_without_orientation_is_run_straight_down(model):
    plan = plan_motion(DrawnMotion(corners=RISE), ORDER, model)
    _, rotations = kinematics(model).forward(plan.joints[on_path(plan)])
    assert np.abs(rotations[:, 2, 2] + 1.0).max() < 1e-9
    assert np.ptp(plan.tool[on_path(plan), 2]) == pytest.approx(0.03, abs=1e-3)


def test_a_free_nozzle_keeps_the_axis_shown_but_does_not_turn_with_the_hand(panda):
    motion = TiltedMotion(twist=math.radians(110))
    plans = {turn: plan_motion(motion, replace(ORDER, nozzle_turn=turn), panda) for turn in ("shown", "free")}
    turned = {}
    for turn, plan in plans.items():
        rotations = kinematics(panda).forward(plan.joints[on_path(plan)])[1]
        expected = motion.held_at(plan.phases[on_path(plan)]).apply([0.0, 0.0, -1.0])
        assert np.abs(rotations[:, :, 2] - expected).max() < 1e-9
        turned[turn] = math.degrees(np.arccos(np.clip(rotations[:, :, 0] @ rotations[0, :, 0], -1.0, 1.0)).max())
    assert turned["shown"] > 90.0
    assert turned["free"] < 30.0


@pytest.mark.parametrize("name", robots.names())
def test_a_tilt_no_arm_can_hold_is_refused_with_its_place(name):
    with pytest.raises(MotionRefused) as caught:
        plan_motion(TiltedMotion(lean=math.radians(-150), swing=0.0), ORDER, robots.load(name))
    finding = caught.value.findings[0]
    assert finding.code in {"NoIkSolution", "JointLimit", "Singularity", "Collision"}
    assert 0.0 <= finding.phase <= 1.0
    assert "% of the path" in finding.text
    assert finding.size > 0.0


def test_a_tilt_half_way_that_cannot_be_held_says_by_how_many_degrees(panda):
    class Turning(TiltedMotion):
        def held_at(self, phases):
            return Rotation.from_euler("y", math.radians(-160) * np.clip(4.0 * (phases - 0.5), 0.0, 1.0)[:, None])

    with pytest.raises(MotionRefused) as caught:
        plan_motion(Turning(), ORDER, panda)
    finding = caught.value.findings[0]
    assert finding.code == "NoIkSolution"
    assert 0.5 < finding.phase < 0.8
    assert finding.unit == "degrees"
    assert 20.0 < finding.size < 160.0
    assert "with the nozzle upright, but not tilted by" in finding.text


def test_a_tilted_nozzle_is_as_wide_as_it_is_tilted(panda):
    """The same post is free of an upright nozzle and in the way of one that leans over it."""
    line = TiltedMotion(corners=((0.0, 0.0, 0.0), (0.0, 0.05, 0.0)), lean=math.radians(35), swing=0.0, twist=0.0)
    post = Cell((Box("post", (0.475, 0.025, 0.15, 0.0, 0.0, 0.0, 1.0), (0.01, 0.01, 0.10)),))
    upright = replace(line, lean=0.0)
    assert plan_motion(upright, ORDER, panda, cell=post).report["smallest_clearance"] > 0.005
    with pytest.raises(MotionRefused) as caught:
        plan_motion(line, ORDER, panda, cell=post)
    assert caught.value.failure == "Collision"
    assert "the post" in str(caught.value)


def test_an_arm_that_would_have_to_jump_to_another_posture_is_refused_there(panda):
    class Flipping(TiltedMotion):
        def held_at(self, phases):
            return Rotation.from_euler("z", np.where(phases > 0.4, math.radians(90), 0.0)[:, None])

    with pytest.raises(MotionRefused) as caught:
        plan_motion(Flipping(), ORDER, panda)
    finding = caught.value.findings[0]
    assert finding.code == "Singularity"
    assert finding.phase == pytest.approx(0.4, abs=0.01)
    assert "change its posture" in finding.text


def test_a_nozzle_turn_that_does_not_exist_is_refused(panda):
    with pytest.raises(MotionRefused, match="nozzle turn is 'loose'"):
        plan_motion(TiltedMotion(), replace(ORDER, nozzle_turn="loose"), panda)  # pyright: ignore[reportArgumentType]


@lru_cache(maxsize=1)
def learned_in_space():
    return learn(simulated_people(5, 1, corners=ZIGZAG_IN_SPACE, orientation=True)[0]).motion


def test_a_skill_learned_with_orientation_is_followed_as_it_was_meant(model):
    plan = plan_motion(learned_in_space(), ORDER, model)
    _, rotations = kinematics(model).forward(plan.joints[on_path(plan)])
    meant = Rotation.from_quat(true_orientations(plan.phases[on_path(plan)])).as_matrix()[:, :, 2]
    apart = np.arccos(np.clip(-(rotations[:, :, 2] * meant).sum(axis=1), -1.0, 1.0))
    assert np.degrees(apart.max()) < 4.0  # the people's own habit is 2 degrees


async def test_the_trace_tells_how_the_nozzle_was_held(panda):
    plan = plan_motion(TiltedMotion(), ORDER, panda)
    arm = KinematicArm(panda, realtime=False)
    await arm.open()
    try:
        trace = await arm.run(plan, lambda _: None)
    finally:
        await arm.close()
    assert angles_between(trace.orientation_commanded, plan.orientations).max() < 1e-9
    assert trace.orientation_error() == (0.0, 0.0)
    assert (np.abs(np.diff(trace.orientation_commanded, axis=0)) < 0.1).all()  # no change of sign on the way
