"""Demonstrations moved as one: scaled onto a plate, or laid into the plane they were drawn in.

What is lost or a reflection says nothing about where a drawing lies: it is left out before anything is measured.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from library.errors import InvalidValue
from library.readers.flat import Plane, believable
from models.demonstration import Demonstration


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
    points = np.concatenate(believable(demonstrations))
    if not len(points):
        raise InvalidValue("demonstrations", 0, "positions are needed: no marker was seen")
    low, high = points.min(axis=0), points.max(axis=0)
    room = np.array([width, height]) - 2 * margin
    extent = high - low
    if not (extent > 0).any():
        raise InvalidValue("demonstrations", 0.0, "they have an extent: these stand still")
    scale = float(np.min(room[extent > 0] / extent[extent > 0]))
    centre, plate = (low + high) / 2, np.array([width, height]) / 2
    return [replace(one, points=(one.points - centre) * scale + plate) for one in demonstrations]


def onto_plane(demonstrations: Sequence[Demonstration], plane: Plane) -> list[Demonstration]:
    """Return 3-D demonstrations as 2-D ones: coordinates along the plane's axes from its origin, in m."""
    return [
        replace(one, points=(one.points - plane.origin) @ plane.axes.T, orientations=None) for one in demonstrations
    ]
