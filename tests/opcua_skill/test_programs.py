"""Programs for closed controllers: what is read back out of one is its plan, or there is no program."""

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from drawn_motion import DrawnMotion
from random_orders import own_arm
from scipy.spatial.transform import Rotation

from opcua_skill.programs.following import Followed
from opcua_skill.programs.making import compared, program_of
from opcua_skill.programs.registry import LANGUAGES
from opcua_skill.programs.values import Header, Options, ProgramRefused
from sim.arm_model import ArmModel
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.planner import plan_motion

HEADER = Header("Zick(zack) – ü", 3, "a" * 64, "r1", "b" * 64, "c" * 64, "arm " + "d" * 16, "Erna, Jürgen")
ORDER = MotionOrder(time_step=0.008, timing="constant_speed", speed=0.05, dispense_lead=0.03)
SPOKEN = [
    ("urscript", "ur5e"),
    ("krl", "ur5e"),
    ("rapid", "ur5e"),
    ("ls", "ur5e"),
    ("gcode", "gantry"),
    ("gcode", "scara"),
]
TWICE = DrawnMotion(corners=((0.0, 0.0), (0.05, 0.0), (0.05, 0.03)), dispense=((0.1, 0.4), (0.5, 0.9)))


@lru_cache(maxsize=4)
def planned(name: str) -> tuple[MotionPlan, ArmModel]:
    arm = own_arm(name)
    return plan_motion(TWICE, replace(ORDER, frame=arm.part_frame), arm), arm


def made(language: str, arm_name: str, **options: object):
    plan, arm = planned(arm_name)
    return program_of(plan, arm, HEADER, LANGUAGES[language], Options(**options))  # type: ignore[arg-type]


@pytest.mark.parametrize(("language", "name"), SPOKEN)
def test_a_program_read_back_is_its_plan_with_valve_and_header(language, name):
    text, found = made(language, name)
    plan, _ = planned(name)
    spoken = LANGUAGES[language]
    assert found.path <= (1.0 - spoken.rounding) * 5e-5
    assert found.turn <= 2e-3
    assert found.duration <= 0.01 * plan.duration
    assert found.switching <= max(spoken.quantum, 1e-4)
    assert len(spoken.read(text).switches) == 4
    assert found.lines <= spoken.most_lines
    assert max(map(len, text.splitlines())) == found.longest_line <= spoken.longest_line
    text.encode("ascii")
    joined = re.sub(r"\n *[0-9]+:|[^0-9a-z]", "", text)
    for digest in (HEADER.skill_digest, HEADER.recipe_digest, HEADER.plan_digest):
        assert digest in joined
    assert "Erna" in text
    assert found.rows < plan.samples / 2, "it is compressed"


@pytest.mark.parametrize(
    ("language", "chosen"),
    [
        ("krl", ("BAS(#TOOL,3)", "BAS(#BASE,0)", "BAS(#VEL_PTP,5)", "BAS(#ACC_PTP,5)")),
        ("ls", ("UFRAME_NUM=0 ;", "UTOOL_NUM=3 ;", "UF : 0, UT : 3,")),
        ("rapid", ("v10,fine,tool3;",)),
    ],
)
def test_a_program_chooses_the_tool_by_its_number_and_begins_slowly(language, chosen):
    text, _ = made(language, "ur5e", tool=3)
    begins = text.index({"krl": "PTP {A1", "ls": "J P[1] 5%", "rapid": "MoveAbsJ"}[language])
    for words in chosen:
        assert words in text
    if language == "krl":  # INITMOV makes everything as fast as it can be, and takes the tool away
        assert text.index("BAS(#INITMOV,0)") < min(map(text.index, chosen)) < max(map(text.index, chosen)) < begins
    if language == "ls":
        assert text.index("UTOOL_NUM") < begins
    if language == "rapid":
        moves = [line for line in text.splitlines() if "Move" in line]
        assert all(re.search(r",tool3(?:,doValve1,[01])?;\Z", line) for line in moves), "never the flange"


@pytest.mark.parametrize(("language", "name"), SPOKEN[:-1])
def test_what_somebody_changes_in_a_program_is_seen(language, name):
    text, _ = made(language, name)
    plan, arm = planned(name)
    spoken, followed = LANGUAGES[language], Followed.of(plan, arm)
    lines = text.splitlines()
    moves = [k for k, line in enumerate(lines) if re.search(r"piece\(\[|LIN \{|MoveL|msec|^G1", line)]
    outputs = [k for k, line in enumerate(lines) if re.search(r"digital_out|\$OUT|SetDO|MoveLDO|DO\[|^M6", line)]
    middle, output = moves[len(moves) // 2], outputs[len(outputs) // 2]
    without = compared(followed, spoken.read("\n".join(lines[:middle] + lines[middle + 1 :])), text, spoken.quantum)
    assert without.path > 5e-5 or without.duration > 1e-3
    if "MoveLDO" not in lines[output]:
        quiet = compared(followed, spoken.read("\n".join(lines[:output] + lines[output + 1 :])), text, spoken.quantum)
        assert quiet.switching == np.inf


@pytest.mark.parametrize(
    ("language", "name", "options", "reason"),
    [
        ("urscript", "gantry", {}, "AxesNotSpoken"),
        ("gcode", "ur5e", {"turn_tolerance": 1e-4}, "OrientationTurns"),
        ("gcode", "gantry", {"tolerance": 0.0}, "ToleranceInvalid"),
        ("gcode", "gantry", {"tolerance": float("nan")}, "ToleranceInvalid"),
        ("gcode", "gantry", {"turn_tolerance": 1.0}, "ToleranceInvalid"),
        ("gcode", "gantry", {"name": "1st; drop"}, "NameInvalid"),
    ],
)
def test_what_cannot_be_kept_is_refused_by_its_reason(language, name, options, reason):
    with pytest.raises(ProgramRefused) as refused:
        made(language, name, **options)
    assert refused.value.reason == reason
    assert len(str(refused.value)) > 40


def test_a_controllers_limits_are_kept_or_the_program_is_refused():
    plan, arm = planned("gantry")
    for small, reason in (({"most_lines": 60}, "ProgramTooLong"), ({"longest_line": 40}, "LineTooLong")):
        with pytest.raises(ProgramRefused) as refused:
            program_of(plan, arm, HEADER, replace(LANGUAGES["gcode"], **small), Options())
        assert refused.value.reason == reason
    with pytest.raises(ProgramRefused) as refused:
        program_of(replace(plan, joints=plan.joints + 1e-3), arm, HEADER, LANGUAGES["gcode"], Options())
    assert refused.value.reason == "NotReadBack"


def test_a_larger_tolerance_needs_fewer_rows():
    rows = [made("gcode", "gantry", tolerance=tolerance)[1].rows for tolerance in (5e-6, 5e-5, 5e-4)]
    assert rows == sorted(rows, reverse=True)
    assert rows[0] > 2 * rows[2]


@pytest.mark.parametrize("seed", range(3))
def test_a_random_plan_comes_back_or_is_refused_for_what_the_language_cannot_say(seed):
    """Fewer here than were tried by hand; the same seeds give the same plans."""
    random = np.random.default_rng(seed)
    arm = own_arm(("ur5e", "gantry")[seed % 2])
    ways = random.uniform(-1.5, 1.5, 3).cumsum()
    steps = random.uniform(0.01, 0.03, (3, 1)) * np.column_stack([np.cos(ways), np.sin(ways), np.zeros(3)])
    corners = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    motion = DrawnMotion(tuple(map(tuple, corners)), radius=0.001, dispense=((0.0, random.uniform(0.2, 1.0)),))
    order = MotionOrder(
        time_step=round(float(random.uniform(0.002, 0.02)), 4),
        timing=("constant_speed", "time_optimal")[seed // 2],
        speed=float(random.uniform(0.01, 0.1)) if seed < 2 else 0.0,
        frame=arm.part_frame,
        dispense_lead=float(random.uniform(0.0, 0.05)),
        approach_height=0.02,
    )
    plan = plan_motion(motion, order, arm)
    for language in LANGUAGES.values():
        if arm.dof not in language.axes:
            continue
        try:
            text, found = program_of(plan, arm, HEADER, language, Options(tolerance=float(random.uniform(2e-5, 2e-4))))
        except ProgramRefused as refused:
            assert (refused.reason, language.name, arm.name) == ("OrientationTurns", "gcode", "ur5e")
            continue
        assert compared(Followed.of(plan, arm), language.read(text), text, language.quantum) == found


def test_turns_are_written_as_each_controller_counts_them():
    """Rotations of the makers' own definitions, worked out by hand."""
    turn = Rotation.from_euler("z", 30, degrees=True) * Rotation.from_euler("y", 20, degrees=True)
    turn = turn * Rotation.from_euler("x", 10, degrees=True)
    from opcua_skill.programs.krl import _frame

    assert _frame(np.zeros(3), turn.as_quat()).endswith("A 30.000000, B 20.000000, C 10.000000")
    assert np.allclose(turn.as_euler("xyz", degrees=True), [10.0, 20.0, 30.0])
