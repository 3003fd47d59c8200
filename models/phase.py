"""The clock of the model: where on the path, rather than when. Arc length of the people's common path, from 0 to 1."""

import numpy as np

from models.demonstration import Floats
from models.geometry import diagonal, norms

EDGE = 0.02


def arc_lengths(path: Floats) -> Floats:
    """Return the length in m from the start to each point of a path (n, d)."""
    return np.concatenate([[0.0], np.cumsum(norms(np.diff(path, axis=0)))])


def at(positions: Floats, knots: Floats, values: Floats) -> Floats:
    """Return values (n, m), given at rising ``knots`` (n,), at ``positions`` of any shape: shape (*positions, m)."""
    return np.stack([np.interp(positions, knots, column) for column in values.T], axis=-1)


def from_chord(path: Floats) -> Floats:
    """Return how far in m each point of a path (n, d) is from the straight line between its ends: (n,)."""
    chord = path[-1] - path[0]
    square = float(np.add.reduce(chord * chord))
    inner = [column - column[0] for column in path.T]
    if square > 0:
        along = sum(gap * way for gap, way in zip(inner, chord, strict=True)) / square
        along = np.minimum(np.maximum(along, 0.0), 1.0)
        inner = [gap - along * way for gap, way in zip(inner, chord, strict=True)]
    return np.sqrt(sum(gap * gap for gap in inner))


def corners(path: Floats, tolerance: float) -> tuple[int, ...]:
    """Return the indices of the corners of a path (n, d), its ends included, by Douglas and Peucker.

    A point is a corner if it is further than ``tolerance`` from the straight line between the corners around it. What
    an early division of the path left that its neighbours make needless, is no corner.
    """
    found = {0, len(path) - 1}
    stretches = [(0, len(path) - 1)]
    while stretches:
        first, last = stretches.pop()
        if last - first < 2:
            continue
        away = from_chord(path[first : last + 1])[1:-1]
        furthest = int(away.argmax())
        if away[furthest] > tolerance:
            corner = first + 1 + furthest
            found.add(corner)
            stretches += [(first, corner), (corner, last)]
    return _needed(path, sorted(found), tolerance)


def edges(path: Floats) -> int:
    """Return how many edges a path (n, d) has: straight ones to 2 % of its diagonal.

    Of a curve, half of that tolerance finds 1.4 times as many. Where it finds twice as many there are turns as small as
    that, as in a weave, and they count.
    """
    size = diagonal(path)
    found, fine = (len(corners(path, tolerance * size)) - 1 for tolerance in (EDGE, 0.5 * EDGE))
    return fine if fine > 2 * found else found


def _needed(path: Floats, found: list[int], tolerance: float) -> tuple[int, ...]:
    while len(found) > 2:
        without = [
            float(from_chord(path[before : after + 1]).max())
            for before, after in zip(found[:-2], found[2:], strict=True)
        ]
        least = int(np.argmin(without))
        if without[least] > tolerance:
            break
        del found[least + 1]
    return tuple(found)
