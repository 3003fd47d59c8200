"""Demonstrations laid upon each other: what both pipelines hand to the clock and the mixture, and what comes of it."""

# numpy and scipy leave many results untyped: what leaves a function here is typed by its signature.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from models.cleaning import CleanMotion
from models.demonstration import Floats
from models.findings import Code, Finding
from models.mixture import Mixture
from models.motion import Clock
from models.phase import at
from models.regression import CovarianceRule
from models.stretches import Extra, Pause

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Correspondence:
    """u motions at the same n instants of the task; NaN where a motion has nothing to say.

    ``points`` (u, n, d) in m; ``times`` (u, n): each motion's own time in s; ``triggers`` (u, n), 0..1;
    ``orientations`` (u, n, 4) or None; ``weights`` (u, n), 0..1.
    """

    points: Floats
    times: Floats
    triggers: Floats
    orientations: Floats | None
    weights: Floats

    def at_instants(self, where: Floats) -> "Correspondence":
        """Return the same motions at fractional instants (k,) of these n."""
        turned = None if self.orientations is None else between(self.orientations, where)
        return Correspondence(
            between(self.points, where),
            between(self.times, where),
            between(self.triggers, where),
            turned,
            between(self.weights, where),
        )


def between(values: Floats, where: Floats) -> Floats:
    """Return values (u, n, ...) at fractional instants (k,) of these n; a NaN reaches only to its neighbours."""
    low = np.clip(where.astype(np.int64), 0, values.shape[1] - 2)
    share = (where - low).reshape((1, -1) + (1,) * (values.ndim - 2))
    mixed = (1.0 - share) * values[:, low] + share * values[:, low + 1]
    return np.where(share == 0, values[:, low], np.where(share == 1, values[:, low + 1], mixed))


@dataclass(frozen=True, slots=True)
class Remark:
    """What is to be said of one motion: ``place`` 0..1 on the path, ``size`` in m, ``code`` for programs."""

    reason: str
    place: float | None = None
    size: float | None = None
    code: Code = ""


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A mixture and the demonstrations behind it.

    ``rows`` (u,): which of the motions given are in ``aligned``; ``phases`` (n,): 0..1, of its instants.
    ``left_out``, ``in_part`` and ``remarks``: what is to be said of motions, by their index; ``findings``: of them all;
    ``pauses`` and ``extras``: where they stood still, and what they drew that the others did not, place 0..1 on the
    path.
    """

    mixture: Mixture
    clock: Clock
    duration: float
    phases: Floats
    aligned: Correspondence
    rows: tuple[int, ...]
    covariance_rule: CovarianceRule
    left_out: dict[int, Remark]
    in_part: dict[int, Remark]
    remarks: dict[int, Remark]
    findings: tuple[Finding, ...]
    pauses: Mapping[int, tuple[Pause, ...]] = field(default_factory=dict[int, tuple[Pause, ...]])
    extras: Mapping[int, tuple[Extra, ...]] = field(default_factory=dict[int, tuple[Extra, ...]])


def taken_at(motions: list[CleanMotion], positions: Floats, weights: Floats) -> Correspondence:
    """Return the motions at fractional sample positions (u, n); NaN positions give NaN."""
    points: list[Floats] = []
    times: list[Floats] = []
    triggers: list[Floats] = []
    orientations: list[Floats] = []
    for motion, where in zip(motions, positions, strict=True):
        index = np.arange(len(motion.times), dtype=np.float64)
        known = np.interp(where, index, motion.known.astype(np.float64)) > 0.5
        blank = np.where(known & np.isfinite(where), 0.0, np.nan)
        points.append(at(where, index, motion.points) + blank[:, None])
        times.append(np.interp(where, index, motion.times) + blank)
        triggers.append(np.interp(where, index, motion.triggers.astype(np.float64)) + blank)
        if motion.orientations is not None:
            orientations.append(at(where, index, motion.orientations) + blank[:, None])
    carried = same_side(np.stack(orientations)) if len(orientations) == len(motions) else None
    stacked = np.stack(points)
    return Correspondence(
        stacked, np.stack(times), np.stack(triggers), carried, np.where(np.isfinite(stacked[:, :, 0]), weights, 0.0)
    )


def same_side(orientations: Floats) -> Floats:
    """Return quaternions (u, n, 4), each motion's sign such that it is on the first motion's side: q and -q are one
    turn.
    """
    agreement = np.nansum(orientations * orientations[:1], axis=(1, 2))
    return orientations * np.where(agreement < 0, -1.0, 1.0)[:, None, None]
