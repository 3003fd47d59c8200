"""What goes over the wire, as frozen values. Metres, seconds, radians; arrays are row-major numpy arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from models.demonstration import Bools, Demonstration, Floats
from models.motion import Motion

Mode = Literal["simulation", "test", "production"]
MODES: tuple[Mode, ...] = ("simulation", "test", "production")
ENDED = frozenset({"Completed", "Failed", "Aborted"})


class Failure(StrEnum):
    """Why a job did not do what was asked; ``NONE`` is false, so that ``if report.failure`` reads as it should."""

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

    def __bool__(self) -> bool:
        return self is not Failure.NONE


@dataclass(frozen=True, slots=True)
class LearningOptions:
    """How to learn. Empty or 0 means the preset's own value; ``filter_window`` and ``time_step`` in s.

    ``preset`` is one that the server has (`SkillClient.presets`); ``free`` is ``recommended`` for a task that may be
    shown anywhere, at any size and turn.
    """

    preset: str = "recommended"
    components: int = 0
    filter_window: float = 0.0
    alignment: Literal["", "dtw", "fastdtw"] = ""
    radius: int = 0
    clock: Literal["", "path", "time"] = ""
    reject_outliers: bool = True
    time_step: float = 0.0
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Learned:
    """What `LearnFromDemonstration` answered: ``results`` holds one status name a demonstration, in the order sent.

    While ``state`` is ``Running``, ``version`` is 0 and ``report`` is empty: follow the job.
    """

    job_id: str
    state: str
    version: int
    results: tuple[str, ...]
    report: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class SkillSummary:
    """One line of the library: the newest version of a skill that matches."""

    name: str
    version: int
    semantic_type: str
    state: str
    model_digest: bytes
    created_at: datetime | None
    created_by: str
    workstations: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Skill:
    """A version's semantic description. ``means`` (K, D), ``covariances`` (K, D, D); ``document`` is all of it."""

    name: str
    version: int
    semantic_type: str
    state: str
    model_digest: bytes
    required_atomic_skills: tuple[str, ...]
    means: Floats
    covariances: Floats
    document: Mapping[str, Any]

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> "Skill":
        """Read the keys INTERFACE promises; everything else stays in ``document``."""
        return cls(
            name=document["name"],
            version=int(document["version"]),
            semantic_type=document["semanticType"],
            state=document["state"],
            model_digest=bytes.fromhex(document["modelDigest"]),
            required_atomic_skills=tuple(document["requiredAtomicSkills"]),
            means=np.asarray(document["means"], dtype=np.float64),
            covariances=np.asarray(document["covariances"], dtype=np.float64),
            document=MappingProxyType(dict(document)),
        )

    def motion(self) -> Motion:
        """Return the learned motion, equal bit for bit to the server's: path, timing and orientation at any phase."""
        keys = self.document
        return Motion(
            means=self.means,
            covariances=self.covariances,
            clock=keys["clock"],
            dimension=int(keys["dimension"]),
            duration=float(keys["duration"]),
            dispense=tuple((float(start), float(end)) for start, end in keys.get("dispense") or ()),
            time_step=float(keys["timeStep"]),
            covariance_rule=keys["covarianceRule"],
        )

    @property
    def report(self) -> Mapping[str, Any]:
        """The quality report of the learning."""
        return self.document.get("report") or {}


@dataclass(frozen=True, slots=True)
class Recordings:
    """What a version was learned from: recordings as sent, and as aligned (all of one length)."""

    raw: tuple[Demonstration, ...]
    aligned: tuple[Demonstration, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """A path: ``times`` (n,) s, ``points`` (n, d) m, ``covariances`` (n, d, d) m², ``dispense`` (n,)."""

    times: Floats
    points: Floats
    covariances: Floats
    dispense: Bools


@dataclass(frozen=True, slots=True)
class Recipe:
    """How one product wants a skill run. In m and s; ``frame``: the part in the arm's base, x y z qx qy qz qw."""

    recipe_id: str
    skill_name: str
    skill_version: int = 0
    product: str = ""
    time_step: float = 0.008
    timing: Literal["demonstrated", "constant_speed", "time_optimal"] = "demonstrated"
    duration: float = 0.0
    speed: float = 0.0
    speed_override: float = 1.0
    frame: tuple[float, ...] = (0.45, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)
    standoff: float = 0.005
    approach_height: float = 0.05
    retract_height: float = 0.05
    dispense_lead: float = 0.0
    max_deviation: float = 0.001
    parameters: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Started:
    """What `ExecuteSkill` answered."""

    job_id: str
    state: str


@dataclass(frozen=True, slots=True)
class JobReport:
    """A learning or execution job. ``path_error``, ``tracking_error``: RMS and maximum, m; ``samples``: steps.

    ``cause`` says in one word what ended or paused it, empty when all is well. ``path_phase`` (0..1) and ``place`` (m
    along the path) say where on the path it is or ended, NaN off it; ``slowed_to`` is the least speed in m/s the path
    was slowed to, 0 if it was not. ``held_queue``: its end held the queue, or it waits in a held one. The run stood
    still from each of ``paused_from`` until its partner in ``paused_until``.
    """

    job_id: str
    kind: str
    state: str
    progress: float
    skill_name: str
    skill_version: int
    recipe_id: str
    mode: str
    start_time: datetime | None
    end_time: datetime | None
    failure: Failure
    message: str
    path_error: tuple[float, float]
    tracking_error: tuple[float, float]
    samples: int
    cause: str = ""
    path_phase: float = float("nan")
    place: float = float("nan")
    plan_digest: str = ""
    slowed_to: float = 0.0
    held_queue: bool = False
    paused_from: tuple[datetime, ...] = ()
    paused_until: tuple[datetime, ...] = ()

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen to this job."""
        return self.state in ENDED


@dataclass(frozen=True, slots=True)
class QueueStatus:
    """Whether the next job of an arm may begin: ``state`` is Released or Held, ``because`` one word, empty: released.

    ``by`` held or released it last: a user, `arm` or `server`; ``waiting`` jobs wait.
    """

    state: str
    because: str
    by: str
    since: datetime | None
    waiting: int

    @property
    def held(self) -> bool:
        """Whether no further job begins until somebody releases the queue."""
        return self.state == "Held"


@dataclass(frozen=True, slots=True, eq=False)
class JobTrace:
    """What was commanded and measured: ``times`` (n,) s, ``commanded`` and ``measured`` (n, c) m at the nozzle."""

    times: Floats
    commanded: Floats
    measured: Floats


@dataclass(frozen=True, slots=True, eq=False)
class JointTrace:
    """The joints of a run: ``times`` (n,) s, ``commanded`` and ``measured`` (n, dof) rad; dof 0: not kept."""

    times: Floats
    commanded: Floats
    measured: Floats


@dataclass(frozen=True, slots=True, eq=False)
class ArmLinks:
    """The links of an arm from its base to the nozzle's tip.

    ``origins`` (n, 7) x y z qx qy qz qw: each link's frame in the one before while its joint is at 0, m. ``axes``
    (n, 3) the axis it turns about in its own frame, 0 0 0 if fixed: the k-th link that turns has joint k.
    ``capsules`` (m, 8) link, x y z of both ends in the link's frame and radius, m; link -1 is the base.
    """

    names: tuple[str, ...]
    origins: Floats
    axes: Floats
    capsules: Floats


@dataclass(frozen=True, slots=True)
class AuditEntry:
    """One entry of the audit trail: who asked for what, and what came of it; ``reason`` is empty when it was done."""

    entry_id: int
    at: datetime | None
    actor: str
    role: str
    action: str
    target: str
    arguments: Mapping[str, Any]
    status: str
    reason: str


@dataclass(frozen=True, slots=True)
class OpenSession:
    """Somebody who is signed in: ``session_id`` in hex, ``idle`` in s since the last request."""

    session_id: str
    user: str
    role: str
    client: str
    address: str
    since: datetime | None
    idle: float


@dataclass(frozen=True, slots=True)
class Limits:
    """The library's limits, as a client can read them before it sends; ``max_message_size`` is a call's, in bytes."""

    max_demonstrations: int
    max_points_per_demonstration: int
    max_queued_jobs: int
    max_message_size: int
