"""The nozzle's way along a skill, in the arm's base frame and by arc length. Every point on it comes by regression."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from models.motion import Motion
from sim.arm_model import Floats, Pose

FINEST = 1e-4
FEWEST, MOST = 1000, 8000
STILL = 1e-9
# The blending window is a trapezium: two moving averages, this share of the blend radius and the rest of it wide.
WIDE = 0.75


class ToolPath:
    """The learned path placed in the arm's base frame, ``standoff`` above the part, corners blended if asked.

    ``lengths`` (g,) in m is the arc length at ``phases`` (g,), about 0.1 mm apart. Before 0 and beyond the end the
    path goes straight on along its end tangents: there the nozzle gathers and loses speed.

    A blend radius h replaces the path by its mean over the arc from h before to h after each point. Two straight
    edges become edge, parabola, edge, with the parabola starting h before the corner: the zone radius of industrial
    controllers.
    """

    def __init__(self, motion: Motion, frame: Pose, standoff: float, blend_radius: float = 0.0) -> None:
        self.motion = motion
        self.rotation = Rotation.from_quat(frame[3:]).as_matrix()
        self.origin = np.array(frame[:3])
        self.standoff = standoff
        phases, lengths = self._by_length()
        self._plain = _inverse_of(phases, lengths)
        self._blend = min(blend_radius, 0.5 * float(lengths[-1]))
        if self._blend > 0.0:
            self._plain_length = float(lengths[-1])
            self._twice = self._integrated_twice(lengths)
            along, lengths = lengths, _arc_lengths(self._blended(lengths))
            self._along = _inverse_of(along, lengths)
        self.phases, self.lengths = phases, lengths
        self.length = float(lengths[-1])
        ends = self._on_curve(np.array([0.0, min(FINEST, self.length), max(0.0, self.length - FINEST), self.length]))
        self._start, self._end = ends[0], ends[3]
        self._start_tangent = _unit(ends[1] - ends[0])
        self._end_tangent = _unit(ends[3] - ends[2])

    def exact(self, phases: Floats) -> Floats:
        """Return the learned points (n, 3) at phases, unblended, in the base frame."""
        points = self.motion.points_at(phases)
        part = np.zeros((len(points), 3))
        part[:, : points.shape[1]] = points
        part[:, 2] += self.standoff
        return self._to_base(part)

    def phases_at(self, lengths: Floats) -> Floats:
        """Return the phase (n,) in 0..1 at each arc length; clipped to the path's ends."""
        inside = np.clip(lengths, 0.0, self.length)
        phases = np.clip(self._plain(self._along(inside) if self._blend > 0.0 else inside), 0.0, 1.0)
        return np.where(lengths >= self.length, 1.0, np.where(lengths <= 0.0, 0.0, phases))

    def points(self, lengths: Floats) -> Floats:
        """Return the nozzle tip (n, 3) at each arc length; the path's own ends are met exactly."""
        inside = np.clip(lengths, 0.0, self.length)
        before = np.minimum(lengths, 0.0)[:, None] * self._start_tangent
        beyond = np.maximum(lengths - self.length, 0.0)[:, None] * self._end_tangent
        return self._on_curve(inside) + before + beyond

    def covariances(self, phases: Floats) -> Floats:
        """Return the skill's covariance (n, 3, 3) in m² in the base frame; no spread across a flat part's plane."""
        learned = self.motion.at_phases(phases)[1]
        part = np.zeros((len(learned), 3, 3))
        part[:, : learned.shape[1], : learned.shape[2]] = learned
        return np.einsum("ij,njk,lk->nil", self.rotation, part, self.rotation)

    def _to_base(self, part: Floats) -> Floats:
        columns = [sum(self.rotation[row, k] * part[:, k] for k in range(3)) for row in range(3)]
        return np.stack(columns, axis=1) + self.origin

    def _on_curve(self, lengths: Floats) -> Floats:
        return self._blended(self._along(lengths)) if self._blend > 0.0 else self.exact(self.phases_at(lengths))

    def _blended(self, along: Floats) -> Floats:
        """Return the weighted mean of the learned path around each of its own arc lengths (n,)."""
        wide, narrow = WIDE * self._blend, (1.0 - WIDE) * self._blend
        corners = ((1, wide + narrow), (-1, wide - narrow), (-1, narrow - wide), (1, -wide - narrow))
        points = sum((sign * self._twice(along + offset) for sign, offset in corners), np.zeros(3))
        points = points / (4.0 * wide * narrow)
        for end, phase in ((along <= 0.0, 0.0), (along >= self._plain_length, 1.0)):
            points[end] = self.exact(np.array([phase]))
        return points

    def _integrated_twice(self, lengths: Floats) -> Any:
        """Return the second integral of the path over arc length, continued beyond its ends by point reflection."""
        count = math.ceil(self._blend / (lengths[1] - lengths[0])) + 2
        points = self.exact(np.clip(self._plain(lengths), 0.0, 1.0))
        count = min(count, len(points) - 1)
        before = 2.0 * points[0] - points[count:0:-1]
        beyond = 2.0 * points[-1] - points[-2 : -count - 2 : -1]
        along = [-lengths[count:0:-1], lengths, 2.0 * lengths[-1] - lengths[-2 : -count - 2 : -1]]
        return scipy.interpolate.make_interp_spline(
            np.concatenate(along), np.concatenate([before, points, beyond]), k=1
        ).antiderivative(2)

    def _by_length(self) -> tuple[Floats, Floats]:
        """Return phases (g,) evenly spaced along the learned path and the arc length (g,) at each, strictly rising."""
        phases = np.linspace(0.0, 1.0, 4 * FEWEST + 1)
        lengths = _arc_lengths(self.exact(phases))
        count = int(np.clip(lengths[-1] / FINEST, FEWEST, MOST)) + 1
        moving = np.concatenate([[True], np.diff(lengths) > STILL])
        phases = np.interp(np.linspace(0.0, lengths[-1], count), lengths[moving], phases[moving])
        phases[0], phases[-1] = 0.0, 1.0
        lengths = _arc_lengths(self.exact(phases))
        moving = np.concatenate([[True], np.diff(lengths) > STILL])
        phases, lengths = phases[moving], lengths[moving]
        phases[-1] = 1.0
        return phases, lengths


def _arc_lengths(points: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)))])


def _inverse_of(phases: Floats, lengths: Floats) -> Callable[[Floats], Floats]:
    """Return the phase as a function of arc length: smooth, and monotone whatever the pace of the phase."""
    smooth = scipy.interpolate.CubicSpline(lengths, phases)
    middles = 0.5 * (lengths[1:] + lengths[:-1])
    if (smooth(middles, 1) > 0.0).all() and (smooth(lengths, 1) >= 0.0).all():
        return smooth
    return scipy.interpolate.PchipInterpolator(lengths, phases)


def _unit(vector: Floats) -> Floats:
    size = float(np.sqrt((vector**2).sum()))
    return vector / size if size > 0.0 else np.zeros(3)
