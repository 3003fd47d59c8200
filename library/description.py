"""The semantic description of one skill version: what it is, what it needs, where it comes from, and its model."""

import hashlib
import json
import math
import struct
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from pydantic import Field, JsonValue, model_validator

from library.errors import InvalidValue
from library.lifecycle import JobState, VersionState
from library.recipe import Recipe
from library.records import AuditEntry, Cause, Failure, JobKind, JobMode, JobReport, StationRecord
from library.values import Moment, Name, Text, Value
from models.demonstration import Floats
from models.errors import LearningError
from models.motion import Clock, CovarianceRule, Motion

__all__ = [
    "AuditEntry",
    "Cause",
    "Decision",
    "DescribedVerdict",
    "Failure",
    "JobKind",
    "JobMode",
    "JobReport",
    "JobState",
    "Parameter",
    "Provenance",
    "Recipe",
    "RecordingReference",
    "SkillDescription",
    "SkillSummary",
    "StationRecord",
    "VersionState",
    "description_schema",
    "model_digest",
]

SCHEMA_VERSION: Literal[1] = 1
Rows = tuple[tuple[float, ...], ...]
Interval = tuple[float, float]


class Parameter(Value):
    """A process parameter that a recipe may set: with its unit and, for a number, its range."""

    name: Name
    description: Text = ""
    unit: Text = ""
    default: float | Text
    minimum: float | None = None
    maximum: float | None = None

    @model_validator(mode="after")
    def _default_in_range(self) -> "Parameter":
        self.check(self.default)
        return self

    def check(self, value: float | str) -> None:
        """Raise InvalidValue unless ``value`` has the default's kind and lies in the range."""
        if isinstance(self.default, str) != isinstance(value, str):
            raise InvalidValue(self.name, value, f"it is a {'text' if isinstance(self.default, str) else 'number'}")
        if isinstance(value, str):
            return
        low = -math.inf if self.minimum is None else self.minimum
        high = math.inf if self.maximum is None else self.maximum
        if not low <= value <= high:
            raise InvalidValue(self.name, value, f"it lies in {low:g} to {high:g} {self.unit}".rstrip())


class RecordingReference(Value):
    """A recording the version was learned from; ``digest`` is the SHA-256 of the stored recording, in hex."""

    demonstration_id: Text
    operator: Text = ""
    source: Text = ""
    recorded_at: Moment | None = None
    digest: str = Field(pattern="^[0-9a-f]{64}$")


class Provenance(Value):
    """Who taught the version, when, from which recordings, with which edits and options.

    ``excluded`` are recordings left out by hand, ``struck`` maps a recording to the samples of it that were removed.
    ``based_on`` is the version whose recordings and edits this one started from. ``imported_by`` brought the version in
    from another library, where all the rest happened.
    """

    taught_by: Text
    taught_at: Moment
    recordings: tuple[RecordingReference, ...] = ()
    excluded: tuple[Text, ...] = ()
    struck: dict[Text, tuple[int, ...]] = Field(default_factory=dict)
    options: dict[str, JsonValue] = Field(default_factory=dict)
    based_on: int | None = Field(default=None, ge=1)
    imported_by: Text = ""
    imported_at: Moment | None = None


class DescribedVerdict(Value):
    """What learning made of one recording; ``place`` is where along the path (0 to 1), ``size`` how much in m.

    ``code`` says what ``reason`` says, for programs; versions of before have none.
    """

    demonstration_id: Text
    kind: Text
    reason: Text = ""
    place: float | None = None
    size: float | None = None
    fault: Text = ""
    code: Text = ""


class Decision(Value):
    """Somebody moved the version to ``state``."""

    state: VersionState
    actor: Text
    at: Moment
    comment: Text = ""


class SkillSummary(Value):
    """One line of a list of skills."""

    name: Name
    version: int = Field(ge=1)
    semantic_type: Text
    state: VersionState
    model_digest: str
    created_at: Moment
    created_by: Text
    workstations: tuple[Text, ...] = ()


class SkillDescription(Value):
    """One version of a skill: everything a workstation needs to run it, and everything a human needs to judge it.

    ``means`` has shape (K, D), ``covariances`` (K, D, D). Columns with the ``path`` clock: phase 0..1, time in s,
    position in m; with the ``time`` clock: time in s, position in m. Where the tool's orientation was recorded, four
    more hold a quaternion x y z w. All are in the part's frame, ``frame``.
    ``dispense`` holds the intervals of phase in which the process is on; ``duration`` and ``time_step`` are in s.
    ``contributors`` are all who taught, edited or imported this version or anything it comes from; none of them may
    approve it. ``approvals_needed`` is how many others have to.
    """

    schema_version: Literal[1] = SCHEMA_VERSION
    name: Name
    version: int = Field(ge=1)
    semantic_type: Text
    state: VersionState
    model_digest: str = Field(pattern="^[0-9a-f]{64}$")
    required_atomic_skills: tuple[Name, ...]
    dimension: int = Field(ge=2, le=3)
    frame: Text = "part"
    clock: Clock
    duration: float = Field(gt=0)
    time_step: float = Field(gt=0)
    covariance_rule: CovarianceRule
    means: Rows = Field(min_length=1, max_length=1000)
    covariances: tuple[Rows, ...] = Field(min_length=1, max_length=1000)
    dispense: tuple[Interval, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    provenance: Provenance
    contributors: tuple[Text, ...] = ()
    approvals_needed: int = Field(default=1, ge=1)
    decisions: tuple[Decision, ...] = ()
    workstations: tuple[Text, ...] = ()
    report: dict[str, JsonValue] = Field(default_factory=dict)
    verdicts: tuple[DescribedVerdict, ...] = ()

    @model_validator(mode="after")
    def _model_is_one(self) -> "SkillDescription":
        columns, plain = len(self.means[0]), self.dimension + (2 if self.clock == "path" else 1)
        if columns not in {plain, plain + 4} or any(len(row) != columns for row in self.means):
            raise InvalidValue("means", self.means, f"they have {plain} columns, or {plain + 4} with orientation")
        if len(self.covariances) != len(self.means):
            raise InvalidValue("covariances", self.covariances, f"there are {len(self.means)}, as many as means")
        if any(len(rows) != columns or any(len(row) != columns for row in rows) for rows in self.covariances):
            raise InvalidValue("covariances", self.covariances, f"each is {columns} by {columns}")
        try:
            self.motion()
        except LearningError as error:
            raise InvalidValue("means", self.means, str(error)) from error
        covariances = np.array(self.covariances)
        if not np.allclose(covariances, covariances.transpose(0, 2, 1), rtol=1e-9, atol=1e-15):
            raise InvalidValue("covariances", self.covariances, "each is symmetric")
        eigenvalues = np.linalg.eigvalsh(covariances)
        if np.any(eigenvalues[:, 0] < -1e-9 * eigenvalues[:, -1]) or np.any(covariances[:, 0, 0] <= 0):
            raise InvalidValue("covariances", self.covariances, "each is positive, along the clock above 0")
        ends = [edge for interval in self.dispense for edge in interval]
        if ends != sorted(ends) or any(not 0.0 <= edge <= 1.0 for edge in ends):
            raise InvalidValue("dispense", self.dispense, "intervals of phase lie in 0 to 1, in order, apart")
        names = [parameter.name for parameter in self.parameters]
        if len(set(names)) != len(names):
            raise InvalidValue("parameters", names, "each has a name of its own")
        return self

    @property
    def approval(self) -> Decision | None:
        """The decision that approved this version, if one did: the last, where more than one was needed."""
        if self.state not in {VersionState.APPROVED, VersionState.RETIRED}:
            return None
        return next((made for made in reversed(self.decisions) if made.state is VersionState.APPROVED), None)

    @property
    def summary(self) -> SkillSummary:
        """The line that stands for this version in a list."""
        return SkillSummary(
            name=self.name,
            version=self.version,
            semantic_type=self.semantic_type,
            state=self.state,
            model_digest=self.model_digest,
            created_at=self.provenance.imported_at or self.provenance.taught_at,
            created_by=self.provenance.imported_by or self.provenance.taught_by,
            workstations=self.workstations,
        )

    def computed_digest(self) -> str:
        """Return the digest of what stands here; it equals ``model_digest`` unless the content was changed."""
        return model_digest(
            means=np.array(self.means),
            covariances=np.array(self.covariances),
            semantic_type=self.semantic_type,
            required_atomic_skills=self.required_atomic_skills,
            dimension=self.dimension,
            frame=self.frame,
            clock=self.clock,
            duration=self.duration,
            time_step=self.time_step,
            covariance_rule=self.covariance_rule,
            dispense=self.dispense,
            parameters=self.parameters,
        )

    def motion(self) -> Motion:
        """Return the learned motion, equal to the one that was stored bit for bit."""
        return Motion(
            means=np.array(self.means),
            covariances=np.array(self.covariances),
            clock=self.clock,
            dimension=self.dimension,
            duration=self.duration,
            dispense=self.dispense,
            time_step=self.time_step,
            covariance_rule=self.covariance_rule,
        )


def model_digest(
    *,
    means: Floats,
    covariances: Floats,
    semantic_type: str,
    required_atomic_skills: Sequence[str],
    dimension: int,
    frame: str,
    clock: str,
    duration: float,
    time_step: float,
    covariance_rule: str,
    dispense: Sequence[Interval],
    parameters: Sequence[Parameter],
) -> str:
    """Return the SHA-256, in hex, over the model and its semantic part: not over name, version, state, who or when.

    The text hashed is JSON with sorted keys, no spaces and ASCII only, in which every float is the 16 hexadecimal
    digits of its big-endian IEEE 754 bits: any language can compute it, and no rounding can hide in it.
    """
    content: dict[str, Any] = {
        "clock": clock,
        "covarianceRule": covariance_rule,
        "covariances": [[[_bits(x) for x in row] for row in rows] for rows in covariances.tolist()],
        "dimension": dimension,
        "dispense": [[_bits(start), _bits(end)] for start, end in dispense],
        "duration": _bits(duration),
        "frame": frame,
        "means": [[_bits(x) for x in row] for row in means.tolist()],
        "parameters": [
            {key: _bits(x) if isinstance(x, float) else x for key, x in parameter.model_dump(by_alias=True).items()}
            for parameter in parameters
        ],
        "requiredAtomicSkills": list(required_atomic_skills),
        "semanticType": semantic_type,
        "timeStep": _bits(time_step),
    }
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def description_schema() -> dict[str, Any]:
    """Return the JSON schema of a skill description, as published with the product."""
    schema = SkillDescription.model_json_schema(by_alias=True)
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["$id"] = "urn:opcua-skill:schema:skill-description:1"
    return schema


def _bits(number: float) -> str:
    return struct.pack(">d", number).hex()
