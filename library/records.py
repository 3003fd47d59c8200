"""What is written down while the library is used: job reports, traces, the audit trail, users."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import Field

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


class Cause(StrEnum):
    """Why a job did not go as asked, or why a workstation's queue is held: what happened, not who is at fault."""

    NONE = ""
    ABORTED = "Aborted"
    STOPPED = "Stopped"
    PROTECTIVE_STOP = "ProtectiveStop"
    FAILED = "Failed"
    ARM_LOST = "ArmLost"
    UNASKED_STOP = "UnaskedStop"
    UNASKED_PAUSE = "UnaskedPause"
    UNFINISHED_AT_START = "UnfinishedAtStart"
    REQUESTED = "Requested"


JobKind = Literal["Learning", "Execution"]
JobMode = Literal["", "simulation", "test", "production"]
RmsAndMaximum = Annotated[tuple[float, float], Field(min_length=2, max_length=2)]


class JobReport(Value):
    """A job and how far it has come. ``path_error`` and ``tracking_error`` are RMS and maximum in m.

    ``samples`` is the number of time steps commanded, ``start_time`` when it began to run, ``end_time`` when it ended.
    ``plan_digest`` is the SHA-256 in hex of the motion plan that was checked and is what runs; empty: there is none.

    ``cause`` says what ended or paused it when nobody asked for that, or who asked did. ``path_phase`` (0..1) and
    ``place`` (m along the path) say where on the path that was, None off it; ``slowed_to`` is the least speed in m/s
    the path was slowed to, 0 if it was not. ``held_queue``: its end held the queue. The run stood still from each of
    ``paused_from`` until the one of ``paused_until`` in the same place; the last may still be open.
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
    plan_digest: str = Field(default="", pattern="^([0-9a-f]{64})?$")
    cause: Cause = Cause.NONE
    path_phase: float | None = None
    place: float | None = None
    slowed_to: float = Field(default=0.0, ge=0.0)
    held_queue: bool = False
    paused_from: tuple[Moment, ...] = ()
    paused_until: tuple[Moment, ...] = ()


class JobOrder(Value):
    """What a manufacturing system ordered of a workstation: ``content`` byte for byte as its interface encodes it.

    ``job_id`` is the job the order became, written before that job is; empty: none yet. ``ended`` says how a client
    ended the order itself.
    """

    workstation: Name
    order_id: Annotated[Text, Field(min_length=1, max_length=128)]
    content: bytes = Field(max_length=1_000_000)
    job_id: Text = ""
    ended: Literal["", "Stopped", "Aborted"] = ""
    actor: Text = ""
    received_at: Moment = Field(default_factory=now)


class StationRecord(Value):
    """What is remembered of a workstation over a restart: whether its queue is held and why, and its speed override.

    ``held_because`` is empty while the queue is released; then ``held_by`` is who released it, ``held_since`` when.
    """

    workstation: Name
    held_because: Cause = Cause.NONE
    held_by: Text = ""
    held_since: Moment = Field(default_factory=now)
    speed_override: float = Field(default=1.0, gt=0.0, le=1.0)


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


@dataclass(frozen=True, slots=True)
class AuditEntry:
    """Who asked for what, and what came of it. ``entry_id`` is given by the library and rises with every entry.

    Not checked: a refused call is recorded with whatever was sent. ``arguments`` are kept as JSON, long ones shortened.
    """

    actor: str = ""
    role: str = ""
    action: str = ""
    target: str = ""
    arguments: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    status: str = ""
    reason: str = ""
    at: datetime = field(default_factory=now)
    entry_id: int = 0


@dataclass(frozen=True, slots=True)
class User:
    """Somebody who may sign in: with a password (its argon2 hash) or a certificate (DER), whichever is not empty."""

    name: str
    role: str
    password_hash: str = ""
    certificate: bytes = b""
    created_at: datetime | None = None
    created_by: str = ""
