"""What is written down while the library is used: job reports, traces, the audit trail, users."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field, JsonValue

from library.lifecycle import JobState
from library.values import Moment, Name, Text, Value, now
from models.demonstration import Floats


class Failure(StrEnum):
    """Why a job did not do what it was asked, in one word; the order is the order of the enumeration on the wire."""

    NONE = "None"
    CONTROL_NOT_OWNED = "ControlNotOwned"
    NOT_PERMITTED_IN_MODE = "NotPermittedInMode"
    NOT_APPROVED = "NotApproved"
    NOT_DEPLOYED = "NotDeployed"
    NOT_FOUND = "NotFound"
    PARAMETER_INVALID = "ParameterInvalid"
    WORKSPACE_LIMIT = "WorkspaceLimit"
    JOINT_LIMIT = "JointLimit"
    SPEED_LIMIT = "SpeedLimit"
    NO_IK_SOLUTION = "NoIkSolution"
    SINGULARITY = "Singularity"
    COLLISION = "Collision"
    TOLERANCE_EXCEEDED = "ToleranceExceeded"
    QUEUE_FULL = "QueueFull"
    BUSY = "Busy"
    ABORTED = "Aborted"
    PROTECTIVE_STOP = "ProtectiveStop"
    TIMEOUT = "Timeout"
    INTERRUPTED = "Interrupted"
    INTERNAL = "Internal"


JobKind = Literal["Learning", "Execution"]
JobMode = Literal["", "simulation", "test", "production"]
RmsAndMaximum = Annotated[tuple[float, float], Field(min_length=2, max_length=2)]


class JobReport(Value):
    """A job and how far it has come. ``path_error`` and ``tracking_error`` are RMS and maximum in m.

    ``samples`` is the number of time steps commanded, ``start_time`` when it began to run, ``end_time`` when it ended.
    """

    job_id: Name
    kind: JobKind
    state: JobState = JobState.QUEUED
    progress: float = Field(default=0.0, ge=0.0, le=1.0)
    skill_name: Text = ""
    skill_version: int = Field(default=0, ge=0)
    recipe_id: Text = ""
    mode: JobMode = ""
    workstation: Text = ""
    actor: Text = ""
    created_at: Moment = Field(default_factory=now)
    start_time: Moment | None = None
    end_time: Moment | None = None
    failure: Failure = Failure.NONE
    message: Text = ""
    path_error: RmsAndMaximum = (0.0, 0.0)
    tracking_error: RmsAndMaximum = (0.0, 0.0)
    samples: int = Field(default=0, ge=0)


@dataclass(frozen=True, slots=True, eq=False)
class JobTrace:
    """What was commanded and what was measured in one run.

    ``times`` has shape (n,) in s; ``commanded`` and ``measured`` have shape (n, c); ``columns`` names the c columns
    with their units.
    """

    times: Floats
    commanded: Floats
    measured: Floats
    columns: tuple[str, ...]


class AuditEntry(Value):
    """Who asked for what, and what came of it. ``entry_id`` is given by the library and rises with every entry."""

    entry_id: int = Field(default=0, ge=0)
    at: Moment = Field(default_factory=now)
    actor: str = ""
    role: str = ""
    action: str = ""
    target: str = ""
    arguments: dict[str, JsonValue] = Field(default_factory=dict)
    status: str = ""
    reason: str = ""


class User(Value):
    """Somebody who may sign in: by password (its argon2 hash) or by certificate (its SHA-256 thumbprint in hex)."""

    name: Name
    role: Name
    password_hash: Text = ""
    certificate: Annotated[str, Field(pattern="^([0-9a-f]{64})?$")] = ""
    created_at: Moment = Field(default_factory=now)
    created_by: Text = ""
