"""Atomic skills: what equipment can do, in the field's words, and which of them a learned skill needs."""

from collections.abc import Sequence
from dataclasses import dataclass

from models.demonstration import Demonstration
from sim.arm_model import ArmModel
from sim.planning.checks import LONGEST_STEP, SHORTEST_STEP


@dataclass(frozen=True, slots=True)
class SkillParameter:
    """A typed parameter of an atomic skill, with unit (UNECE code and symbol) and range."""

    name: str
    unit: str
    unit_code: str
    low: float
    high: float
    default: float
    description: str


@dataclass(frozen=True, slots=True)
class AtomicSkill:
    """Something a piece of equipment can do by itself."""

    name: str
    description: str
    parameters: tuple[SkillParameter, ...]


MOVE_TO = AtomicSkill(
    "MoveTo",
    "move the tool to a pose, joints in step, at rest at both ends",
    (SkillParameter("SpeedOverride", "", "C62", 0.0, 1.0, 1.0, "fraction of the planned speed"),),
)
FOLLOW_PATH = AtomicSkill(
    "FollowPath",
    "move the tool tip along a path at given time steps",
    (
        SkillParameter("TimeStep", "s", "SEC", SHORTEST_STEP, LONGEST_STEP, 0.008, "time between commanded samples"),
        SkillParameter("Speed", "m/s", "MTS", 0.0, 1.0, 0.05, "speed of the tool tip, for constant speed"),
        SkillParameter("MaxDeviation", "m", "MTR", 0.0, 1.0, 0.001, "largest distance from the path that is tolerated"),
    ),
)
DISPENSE = AtomicSkill(
    "Dispense",
    "open and close the dispensing valve",
    (
        SkillParameter("Standoff", "m", "MTR", 0.0, 0.5, 0.005, "distance of the nozzle tip from the part"),
        SkillParameter("DispenseLead", "s", "SEC", -1.0, 1.0, 0.0, "how much earlier the valve switches"),
    ),
)
MOTIONS = (MOVE_TO.name, FOLLOW_PATH.name)
KNOWN = {skill.name: skill for skill in (MOVE_TO, FOLLOW_PATH, DISPENSE)}
DISPENSING_WORDS = ("glu", "dispens", "seal", "adhesive", "solder", "paint", "grease")


def described(name: str) -> AtomicSkill:
    """Return what is known of an atomic skill; one of the plant's own has a name and no parameters yet."""
    return KNOWN.get(name, AtomicSkill(name, "process skill of the equipment", ()))


def motions_of(model: ArmModel) -> tuple[str, ...]:
    """Return what an arm can do without process equipment: what its nozzle dispenses comes from a dispenser."""
    return tuple(name for name in model.atomic_skills if name in MOTIONS)


def required_atomic_skills(semantic_type: str, demonstrations: Sequence[Demonstration]) -> tuple[str, ...]:
    """Return what a workstation needs to run a skill of this type that was shown like this.

    Every skill moves; one whose type is a dispensing word, or whose demonstrators used the push button, dispenses too.
    """
    pressed = any(not one.triggers.all() for one in demonstrations)
    named = any(word in semantic_type.lower() for word in DISPENSING_WORDS)
    process = ("Dispense",) if pressed or named else ()
    return ("MoveTo", "FollowPath", *process)
