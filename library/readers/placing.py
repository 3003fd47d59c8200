"""Demonstrations moved as one: scaled onto a plate, or laid into the plane they were drawn in."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from library.errors import InvalidValue
from models.demonstration import Demonstration, Floats


def fit_to_plate(
    demonstrations: Sequence[Demonstration], width: float = 0.065, height: float = 0.090, margin: float = 0.010
) -> list[Demonstration]:
    """Return 2-D demonstrations moved and scaled, all alike, into a plate from (0, 0) to (width, height), in m.

    The drawing keeps its proportions, fills the plate up to ``margin`` in one direction and is centred in the other.
    """
    if any(one.dimension != 2 for one in demonstrations) or not demonstrations:
        raise InvalidValue("demonstrations", len(demonstrations), "one or more are needed, all in two dimensions")
    if not 0 <= 2 * margin < min(width, height):
        raise InvalidValue("margin", margin, "twice the margin is less than width and height")
    points = np.concatenate([one.points for one in demonstrations])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    room = np.array([width, height]) - 2 * margin
    extent = high - low
    if not (extent > 0).any():
        raise InvalidValue("demonstrations", 0.0, "they have an extent: these stand still")
    scale = float(np.min(room[extent > 0] / extent[extent > 0]))
    centre, plate = (low + high) / 2, np.array([width, height]) / 2
    return [replace(one, points=(one.points - centre) * scale + plate) for one in demonstrations]


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane: ``origin`` (3,) in m, ``axes`` (2, 3) of unit length.

    ``deviation`` is the RMS and ``farthest`` the greatest distance from it, m, of the samples it was laid through.
    """

    origin: Floats
    axes: Floats
    deviation: float
    farthest: float

    def words(self) -> str:
        """Return how flat the samples lie as a sentence without its end."""
        off, most = 1000 * self.deviation, 1000 * self.farthest
        return f"the samples lie {off:.2f} mm from one plane (RMS), {most:.2f} mm at most"


def common_plane(demonstrations: Sequence[Demonstration]) -> Plane:
    """Return the plane nearest to all samples of 3-D demonstrations, by least squares.

    Its first axis points as near along x as the plane allows (y, if the plane stands across x), its normal up.
    """
    if any(one.dimension != 3 for one in demonstrations) or not demonstrations:
        raise InvalidValue("demonstrations", len(demonstrations), "one or more are needed, all in three dimensions")
    points = np.concatenate([one.points for one in demonstrations])
    points = points[np.isfinite(points).all(axis=1)]
    origin = points.mean(axis=0)
    _, sizes, directions = np.linalg.svd(points - origin, full_matrices=False)
    if len(points) < 3 or sizes[1] <= 1e-9 * max(float(sizes[0]), 1e-300):
        raise InvalidValue("demonstrations", float(sizes[0]), "they span a plane: these lie on one line")
    normal = directions[2] * (-1.0 if _points_down(directions[2]) else 1.0)
    towards = np.eye(3)[1 if abs(normal[0]) > 0.9 else 0]
    first = towards - normal * (towards @ normal)
    first = first / np.linalg.norm(first)
    second = np.cross(normal, first)
    away = np.abs((points - origin) @ normal)
    return Plane(origin, np.array([first, second]), float(sizes[2] / np.sqrt(len(points))), float(away.max()))


def onto_plane(demonstrations: Sequence[Demonstration], plane: Plane) -> list[Demonstration]:
    """Return 3-D demonstrations as 2-D ones: coordinates along the plane's axes from its origin, in m."""
    return [
        replace(one, points=(one.points - plane.origin) @ plane.axes.T, orientations=None) for one in demonstrations
    ]


def _points_down(normal: Floats) -> bool:
    """Return whether the last component that matters is negative: up is z, then y, then x."""
    decisive = next(float(value) for value in normal[::-1] if abs(value) > 1e-6)
    return decisive < 0
