"""The one job engine under every face: durable jobs, learning in workers, one motion at a time per arm.

Every change of state is written to the library before anybody is told.
"""

from opcua_skill.jobs.engine import JobEngine
from opcua_skill.jobs.errors import (
    ArmNotReady,
    LacksAtomicSkill,
    LearningFailed,
    MotionNotPossible,
    NotExecutable,
    QueueFull,
)
from opcua_skill.jobs.learning import LearningOutcome, LearningRequest
from opcua_skill.jobs.motion_parameters import MOTION_PARAMETER_RANGES, motion_parameters
from opcua_skill.jobs.station import ArmFactory, Station, ready_to_move
from opcua_skill.jobs.worker_tasks import PlanRefused

__all__ = [
    "MOTION_PARAMETER_RANGES",
    "ArmFactory",
    "ArmNotReady",
    "JobEngine",
    "LacksAtomicSkill",
    "LearningFailed",
    "LearningOutcome",
    "LearningRequest",
    "MotionNotPossible",
    "NotExecutable",
    "PlanRefused",
    "QueueFull",
    "Station",
    "motion_parameters",
    "ready_to_move",
]
