"""A learned motion: two arrays and what their columns mean. Every path, at any time step, comes from here by
regression.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from models.demonstration import Bools, Floats
from models.errors import InvalidModel
from models.geometry import norms
from models.mixture.gmr import CovarianceRule, regress, regress_mean

Clock = Literal["path", "time"]
QUATERNION = 4
CLOCK_GRID = 2049
SLOWEST = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A path in time.

    ``times`` (n,) in s from 0; ``phases`` (n,) in 0..1 along the path; ``points`` (n, d) in m;
    ``covariances`` (n, d, d) in m²; ``dispense`` (n,), True where the process is on;
    ``orientations`` (n, 4), unit quaternions x y z w, where the demonstrations carried them.
    """

    times: Floats
    phases: Floats
    points: Floats
    covariances: Floats
    dispense: Bools
    orientations: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Means and covariances of a Gaussian mixture, and how to read them.

    With the ``path`` clock the columns are: phase s in 0..1 along the path, time t in s, then the position in m.
    With the ``time`` clock: time t in s, then the position in m. Where the demonstrations carried tool orientations,
    four more columns follow: a quaternion x y z w, to be normalised after the regression. ``means`` has shape (K, D),
    ``covariances`` (K, D, D). The priors are a function of the covariances (``models.mixture.priors``), so the two
    arrays are the whole model.

    ``duration`` is the time in s that the demonstrations took, ``dispense`` the intervals of phase where the process
    is on, ``time_step`` the step in s of the path as reported at learning.
    """

    means: Floats
    covariances: Floats
    clock: Clock
    dimension: int
    duration: float
    dispense: tuple[tuple[float, float], ...]
    time_step: float
    covariance_rule: CovarianceRule

    def __post_init__(self) -> None:
        components, width = self.means.shape if self.means.ndim == 2 else (0, 0)
        if self.clock not in {"path", "time"}:
            raise InvalidModel(f"the clock is {self.clock!r}: it has to be 'path' or 'time'")
        if self.dimension not in {2, 3}:
            raise InvalidModel(f"the dimension is {self.dimension}: it has to be 2 or 3")
        plain = self._positions.stop
        if components < 1 or width not in {plain, plain + QUATERNION}:
            raise InvalidModel(
                f"means have shape {self.means.shape}: with the {self.clock} clock in {self.dimension} dimensions "
                f"they need {plain} columns, or {plain + QUATERNION} with orientation"
            )
        if self.covariances.shape != (components, width, width):
            raise InvalidModel(
                f"covariances have shape {self.covariances.shape}: to the means belongs {(components, width, width)}"
            )
        if not (np.isfinite(self.means).all() and np.isfinite(self.covariances).all()):
            raise InvalidModel("means or covariances hold NaN or infinity: export the skill again")
        if not (self.covariances[:, 0, 0] > 0).all():
            raise InvalidModel("a component has no extent on the clock: its covariance [0, 0] has to be positive")
        if not (math.isfinite(self.duration) and self.duration > 0 and self.time_step > 0):
            raise InvalidModel("duration and time step have to be positive")

    @property
    def _positions(self) -> slice:
        first = 2 if self.clock == "path" else 1
        return slice(first, first + self.dimension)

    @property
    def has_orientation(self) -> bool:
        """Whether the model also gives the tool's orientation."""
        return self.means.shape[1] > self._positions.stop

    def at_phases(self, phases: Floats) -> tuple[Floats, Floats]:
        """Return points (n, d) in m and covariances (n, d, d) in m² at phases (n,) in 0..1."""
        return regress(self.means, self.covariances, self._clock(phases), self._positions, self.covariance_rule)

    def points_at(self, phases: Floats) -> Floats:
        """Return the points (n, d) in m at phases (n,) alone: the same values as ``at_phases``, for less work."""
        return regress_mean(self.means, self.covariances, self._clock(phases), self._positions)

    def orientations_at(self, phases: Floats) -> Floats:
        """Return unit quaternions (n, 4), x y z w, of the tool in the part's frame; none recorded is the identity."""
        if not self.has_orientation:
            return np.tile([0.0, 0.0, 0.0, 1.0], (len(phases), 1))
        columns = slice(self._positions.stop, self._positions.stop + QUATERNION)
        mixed = regress_mean(self.means, self.covariances, self._clock(phases), columns)
        return mixed / norms(mixed)[:, None]

    def times_at(self, phases: Floats) -> Floats:
        """Return the time (n,) in s at which the people were at each phase; strictly rising in phase, 0 at 0."""
        phases = np.asarray(phases, dtype=np.float64)
        if self.clock == "time":
            return phases * self.duration
        grid, times = self._timetable()
        return np.asarray(_monotone(grid, times)(phases))

    def phases_at(self, times: Floats) -> Floats:
        """Return the phase (n,) in 0..1 reached at each time in s: the inverse of ``times_at``."""
        times = np.clip(np.asarray(times, dtype=np.float64), 0.0, self.duration)
        if self.clock == "time":
            return times / self.duration
        grid, table = self._timetable()
        forward = _monotone(grid, table)
        pace = forward.derivative()
        phases = np.interp(times, table, grid)
        cell = np.clip(np.searchsorted(table, times, side="right") - 1, 0, len(grid) - 2)
        low, high = grid[cell], grid[cell + 1]
        for _ in range(8):
            rate = np.maximum(pace(phases), SLOWEST * self.duration)
            phases = np.clip(phases - (forward(phases) - times) / rate, low, high)
        return np.asarray(phases)

    def dispense_at(self, phases: Floats) -> Bools:
        """Return whether the process is on at each phase."""
        inside = np.zeros(len(phases), dtype=bool)
        for start, end in self.dispense:
            inside |= (phases >= start) & (phases <= end)
        return inside

    def as_learned(self) -> Trajectory:
        """Return the path with the people's own timing at the learned time step; the last sample is the path's end."""
        steps = max(1, math.ceil(self.duration / self.time_step - 1e-9))
        times = np.append(np.arange(steps) * self.time_step, self.duration)
        phases = self.phases_at(times)
        phases[0], phases[-1] = 0.0, 1.0
        points, covariances = self.at_phases(phases)
        orientations = self.orientations_at(phases) if self.has_orientation else None
        return Trajectory(times, phases, points, covariances, self.dispense_at(phases), orientations)

    def _clock(self, phases: Floats) -> Floats:
        phases = np.asarray(phases, dtype=np.float64)
        return phases if self.clock == "path" else phases * self.duration

    def _timetable(self) -> tuple[Floats, Floats]:
        """Return phases (g,) and the strictly rising time in s at each, from 0 to the duration.

        Time is one more output of the mixture. A hand-over between components may make it stand still or run back by
        a little: there it is held to a thousandth of the mean pace.
        """
        grid = np.linspace(0.0, 1.0, CLOCK_GRID)
        raw = regress_mean(self.means, self.covariances, grid, slice(1, 2))[:, 0]
        pace = SLOWEST * self.duration
        times = np.maximum.accumulate(raw - pace * grid) + pace * grid
        times -= times[0]
        return grid, times * (self.duration / times[-1])


def _monotone(grid: Floats, values: Floats) -> Any:
    """Return the monotone cubic (Fritsch and Carlson 1980) through ``values`` (n,) at ``grid`` (n,).

    scipy's interpolation is imported when a clock is first read: it takes longer than all else that a client imports.
    """
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(grid, values)
