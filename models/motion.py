"""A learned motion: two arrays and what their columns mean. Every path, at any time step, comes from here by regression."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from models.demonstration import Bools, Floats

Clock = Literal["path", "time"]
CovarianceRule = Literal["paper", "within", "full"]


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A path in time.

    ``times`` (n,) in s from 0; ``phases`` (n,) in 0..1 along the path; ``points`` (n, d) in m;
    ``covariances`` (n, d, d) in m²; ``dispense`` (n,), True where the process is on.
    """

    times: Floats
    phases: Floats
    points: Floats
    covariances: Floats
    dispense: Bools


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Means and covariances of a Gaussian mixture, and how to read them.

    With the ``path`` clock the columns are: phase s in 0..1 along the path, time t in s, then the position in m.
    With the ``time`` clock: time t in s, then the position in m. ``means`` has shape (K, D), ``covariances`` (K, D, D).
    The priors are a function of the covariances (``models.mixture.priors``), so the two arrays are the whole model.

    ``duration`` is the time in s that the demonstrations took, ``dispense`` the intervals of phase where the process is on,
    ``time_step`` the step in s of the path as reported at learning.
    """

    means: Floats
    covariances: Floats
    clock: Clock
    dimension: int
    duration: float
    dispense: tuple[tuple[float, float], ...]
    time_step: float
    covariance_rule: CovarianceRule

    def at_phases(self, phases: Floats) -> tuple[Floats, Floats]:
        """Return points (n, d) in m and covariances (n, d, d) in m² at phases (n,) in 0..1."""
        raise NotImplementedError

    def times_at(self, phases: Floats) -> Floats:
        """Return the time (n,) in s at which the people were at each phase; strictly rising in phase, 0 at 0."""
        raise NotImplementedError

    def phases_at(self, times: Floats) -> Floats:
        """Return the phase (n,) in 0..1 reached at each time in s: the inverse of ``times_at``."""
        raise NotImplementedError

    def dispense_at(self, phases: Floats) -> Bools:
        """Return whether the process is on at each phase."""
        inside = np.zeros(len(phases), dtype=bool)
        for start, end in self.dispense:
            inside |= (phases >= start) & (phases <= end)
        return inside

    def as_learned(self) -> Trajectory:
        """Return the path with the people's own timing at the learned time step; the last sample is the path's end."""
        raise NotImplementedError
