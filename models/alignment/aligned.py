"""Demonstrations laid upon each other: what both pipelines hand to the clock and the mixture, and what comes of it."""

from dataclasses import dataclass

import numpy as np

from models.demonstration import Floats
from models.phase import at
from models.preprocessing.filtering import CleanMotion


@dataclass(frozen=True, slots=True, eq=False)
class AlignedDemonstrations:
    """u motions at the same n instants of the task; NaN where a motion has nothing to say.

    ``points`` (u, n, d) in m; ``times`` (u, n): each motion's own time in s; ``triggers`` (u, n), 0..1;
    ``orientations`` (u, n, 4) or None; ``weights`` (u, n), 0..1.
    """

    points: Floats
    times: Floats
    triggers: Floats
    orientations: Floats | None
    weights: Floats

    def at_instants(self, where: Floats) -> "AlignedDemonstrations":
        """Return the same motions at fractional instants (k,) of these n."""
        turned = None if self.orientations is None else between(self.orientations, where)
        return AlignedDemonstrations(
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


def taken_at(motions: list[CleanMotion], positions: Floats, weights: Floats) -> AlignedDemonstrations:
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
    return AlignedDemonstrations(
        stacked, np.stack(times), np.stack(triggers), carried, np.where(np.isfinite(stacked[:, :, 0]), weights, 0.0)
    )


def same_side(orientations: Floats) -> Floats:
    """Return quaternions (u, n, 4), each motion's sign such that it is on the first motion's side: q and -q are one
    turn.
    """
    agreement = np.nansum(orientations * orientations[:1], axis=(1, 2))
    return orientations * np.where(agreement < 0, -1.0, 1.0)[:, None, None]
