"""The typed client of a skill server: command line, panel, demo and tests use it, and so may anybody else."""

from opcua_skill.client.certificates import APPLICATION_URI, client_folder
from opcua_skill.client.errors import ClientError, NotSignedIn, Refused, ServerChanged, TookTooLong, Unreachable
from opcua_skill.client.recorder import Presses, Recorded, Recorder, RecorderState, RecordingView
from opcua_skill.client.session import Event, Session
from opcua_skill.client.skills import SkillClient
from opcua_skill.client.values import (
    ENDED,
    ArmLinks,
    AuditEntry,
    JobReport,
    JobTrace,
    JointTrace,
    Learned,
    LearningOptions,
    Limits,
    Mode,
    OpenSession,
    Path,
    QueueStatus,
    Recipe,
    Recordings,
    Skill,
    SkillSummary,
    Started,
)
from opcua_skill.client.workstation import ArmReading, DeployedModel, LockReading, Workstation

__all__ = [
    "APPLICATION_URI",
    "ENDED",
    "ArmLinks",
    "ArmReading",
    "AuditEntry",
    "ClientError",
    "DeployedModel",
    "Event",
    "JobReport",
    "JobTrace",
    "JointTrace",
    "Learned",
    "LearningOptions",
    "Limits",
    "LockReading",
    "Mode",
    "NotSignedIn",
    "OpenSession",
    "Path",
    "Presses",
    "QueueStatus",
    "Recipe",
    "Recorded",
    "Recorder",
    "RecorderState",
    "RecordingView",
    "Recordings",
    "Refused",
    "ServerChanged",
    "Session",
    "Skill",
    "SkillClient",
    "SkillSummary",
    "Started",
    "TookTooLong",
    "Unreachable",
    "Workstation",
    "client_folder",
]
