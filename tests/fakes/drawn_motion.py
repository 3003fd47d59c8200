"""A motion with a shape known exactly: straight edges with corners of a given radius, shown at an even pace."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
ZIGZAG = (
    (0.0, 0.0),
    (0.0, 0.08),
    (0.008, 0.08),
    (0.008, 0.0),
    (0.016, 0.0),
    (0.016, 0.08),
    (0.024, 0.08),
    (0.024, 0.0),
)


@dataclass(frozen=True)
class DrawnMotion:
    """Fits where a learned ``Motion`` is asked for its path. ``radius`` 0 leaves the corners sharp."""

    corners: Sequence[Sequence[float]] = ZIGZAG
    radius: float = 0.003
    duration: float = 8.0
    dispense: tuple[tuple[float, float], ...] = ((0.0, 1.0),)
    spread: float = 1e-3
    has_orientation = False

    @property
    def dimension(self) -> int:
        return len(self.corners[0])

    def points_at(self, phases: Floats) -> Floats:
        pieces = self._pieces()
        ends = np.cumsum([piece[0] for piece in pieces])
        lengths = np.clip(phases, 0.0, 1.0) * ends[-1]
        index = np.clip(np.searchsorted(ends, lengths), 0, len(pieces) - 1)
        points = np.empty((len(lengths), self.dimension))
        for k, (size, start, *shape) in enumerate(pieces):
            here = index == k
            along = (lengths[here] - (ends[k] - size))[:, None]
            if len(shape) == 1:
                points[here] = start + along * shape[0]
            else:
                centre, out, ahead = shape
                angle = along / self.radius
                points[here] = centre + self.radius * (np.cos(angle) * out + np.sin(angle) * ahead)
        return points

    def at_phases(self, phases: Floats) -> tuple[Floats, Floats]:
        return self.points_at(phases), np.tile(np.eye(self.dimension) * self.spread**2, (len(phases), 1, 1))

    def times_at(self, phases: Floats) -> Floats:
        return np.asarray(phases) * self.duration

    def phases_at(self, times: Floats) -> Floats:
        return np.asarray(times) / self.duration

    @property
    def length(self) -> float:
        return float(sum(piece[0] for piece in self._pieces()))

    def _pieces(self) -> list[tuple]:
        """Return lines (length, start, direction) and arcs (length, start, centre, outwards, ahead)."""
        points = [np.asarray(corner, dtype=float) for corner in self.corners]
        pieces: list[tuple] = []
        start = points[0]
        for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
            back, ahead = _unit(before - corner), _unit(after - corner)
            half = 0.5 * np.arccos(np.clip(back @ ahead, -1.0, 1.0))
            cut = self.radius / np.tan(half) if self.radius else 0.0
            end = corner + back * cut
            pieces.append((float(np.linalg.norm(end - start)), start, _unit(end - start)))
            start = end
            if self.radius:
                centre = corner + _unit(back + ahead) * self.radius / np.sin(half)
                out = _unit(end - centre)
                pieces.append(((np.pi - 2.0 * half) * self.radius, end, centre, out, -back))
                start = corner + ahead * cut
        pieces.append((float(np.linalg.norm(points[-1] - start)), start, _unit(points[-1] - start)))
        return pieces


def _unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector)
