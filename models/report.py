"""What learning tells: a verdict for each demonstration, the aligned demonstrations, the report an engineer reads."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from models.demonstration import Bools, Floats
from models.errors import UnknownDemonstration
from models.findings import Code, Finding
from models.motion import Motion

Fault = Literal["", "invalid", "odd", "excluded"]


class VerdictKind(StrEnum):
    """What became of a demonstration."""

    USED = "used"
    USED_IN_PART = "used in part"
    LEFT_OUT = "left out"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of one demonstration and why, in words and as a ``code``.

    ``place``: phase 0..1 of what is wrong; ``size`` of it in m.
    """

    demonstration_id: str
    kind: VerdictKind
    reason: str
    place: float | None
    size: float | None
    fault: Fault
    code: Code = ""


@dataclass(frozen=True, slots=True, eq=False)
class AlignedDemonstration:
    """A demonstration warped onto the common clock.

    ``phases`` (r,): the phase of each raw sample, NaN where it is not used. ``times`` (m,) in s, ``points`` (m, d)
    in m and
    ``triggers`` (m,) of the warped motion; m and the times are common to all aligned demonstrations; points are NaN
    where this demonstration has nothing to say (let go early, a long gap).
    """

    demonstration_id: str
    phases: Floats
    times: Floats
    points: Floats
    triggers: Bools


@dataclass(frozen=True, slots=True)
class DemonstrationError:
    """Distance in m of one demonstration from the learned path at the same phase: root mean square, largest, and at
    which phase.
    """

    demonstration_id: str
    rms: float
    max: float
    place: float


@dataclass(frozen=True, slots=True)
class LearningReport:
    """What an engineer reads before approving. SI units.

    ``path_error`` is the distance between the learned path and the mean of the aligned demonstrations at equal
    phase: root mean square and largest, m; ``end_error`` is that of the path's ``start`` and ``end``.
    ``repeatability`` is the standard deviation of the demonstrations' distance from their mean along the path, at
    ``repeatability_phases``. ``smoothness`` is the log dimensionless jerk of the path at constant speed: nearer to
    zero is smoother. ``paper`` is how the paper's preset does on the same demonstrations (nothing for that preset
    itself), ``previous`` what has changed since the version before, if there was one: see ``models.comparison``.
    ``findings`` are what is to be known of them all, each with a code; ``notes`` are their sentences.
    ``pauses`` and ``extras`` are what single demonstrations did that the others did not: see
    ``models.screening.pauses``.
    """

    preset: str
    components: int
    clock: str
    duration: float
    length: float
    path_error: Mapping[str, float]
    demonstrations: tuple[DemonstrationError, ...]
    repeatability_phases: tuple[float, ...]
    repeatability: tuple[float, ...]
    smoothness: float
    verdicts: tuple[Verdict, ...]
    covariance_rule: str
    notes: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    end_error: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    pauses: tuple[Mapping[str, Any], ...] = ()
    extras: tuple[Mapping[str, Any], ...] = ()
    paper: Mapping[str, Any] | None = None
    previous: Mapping[str, Any] | None = None
    findings: tuple[Finding, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the report as JSON-able values."""
        return {
            "preset": self.preset,
            "components": self.components,
            "clock": self.clock,
            "duration": self.duration,
            "length": self.length,
            "path_error": dict(self.path_error),
            "end_error": dict(self.end_error),
            "demonstrations": [asdict(error) for error in self.demonstrations],
            "repeatability": {"phases": list(self.repeatability_phases), "deviation": list(self.repeatability)},
            "smoothness": self.smoothness,
            "verdicts": [{**asdict(verdict), "kind": verdict.kind.value} for verdict in self.verdicts],
            "covariance_rule": self.covariance_rule,
            "notes": list(self.notes),
            "findings": [asdict(finding) for finding in self.findings],
            "options": dict(self.options),
            "pauses": [dict(pause) for pause in self.pauses],
            "extras": [dict(extra) for extra in self.extras],
            "paper": None if self.paper is None else dict(self.paper),
            "previous": None if self.previous is None else dict(self.previous),
        }

    def __reduce__(self) -> tuple[Any, ...]:
        """Cross process borders: a mapping proxy cannot."""
        values = [getattr(self, name) for name in self.__slots__]
        return _report, (tuple(dict(value) if isinstance(value, Mapping) else value for value in values),)


def _report(values: tuple[Any, ...]) -> LearningReport:
    return LearningReport(*values)


@dataclass(frozen=True, slots=True, eq=False)
class LearnedMotion:
    """A motion and how it came about: one verdict for each demonstration given, in order; the aligned ones of those
    used.
    """

    motion: Motion
    verdicts: tuple[Verdict, ...]
    aligned: tuple[AlignedDemonstration, ...]
    report: LearningReport


@dataclass(frozen=True, slots=True, eq=False)
class Previous:
    """The version that a skill had before: its number and motion, its ``repeatability`` in m where it is known."""

    version: int
    motion: Motion
    repeatability: float | None


def mean_repeatability(report: Mapping[str, Any]) -> float | None:
    """Return the root mean square in m of the deviation along the path that a report tells, None if it tells none."""
    told = report.get("repeatability")
    deviation = told.get("deviation") if isinstance(told, Mapping) else None
    if not deviation:
        return None
    known = np.array([value for value in deviation if value is not None], dtype=np.float64)
    return float(np.sqrt((known * known).mean())) if len(known) else None


def samples_along_path(
    motion: Motion, aligned: Sequence[AlignedDemonstration], indices: Sequence[int]
) -> dict[str, frozenset[int]]:
    """Return the raw samples of all demonstrations that lie where samples ``indices`` of the learned path lie.

    The keys are demonstration ids. Raises UnknownDemonstration if the learned path has no such sample.
    """
    phases = motion.as_learned().phases
    chosen = np.unique(np.asarray(indices, dtype=np.int64))
    if len(chosen) and (chosen[0] < 0 or chosen[-1] >= len(phases)):
        raise UnknownDemonstration(f"the learned path has samples 0 to {len(phases) - 1}: choose among them")
    borders = np.concatenate([[-np.inf], 0.5 * (phases[1:] + phases[:-1]), [np.inf]])
    struck: dict[str, frozenset[int]] = {}
    for demonstration in aligned:
        cell = np.searchsorted(borders, np.nan_to_num(demonstration.phases, nan=-1.0), side="right") - 1
        hit = np.isin(cell, chosen) & np.isfinite(demonstration.phases)
        struck[demonstration.demonstration_id] = frozenset(int(index) for index in np.flatnonzero(hit))
    return struck
