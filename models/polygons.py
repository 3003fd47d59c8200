"""Whether a path is a polygon, and where its corners are: one component of the model is one straight edge.

Douglas and Peucker find the corners of most drawings at once. Where edges are short beside the whole, as in a raster
or a comb, they miss some and invent others; there the polygons with the least squares of all, for each number of edges,
are found by dynamic programming (Perez and Vidal, "Optimum polygonal approximation of digitized curves", 1994).
"""

# numpy and scipy leave many results untyped: what leaves a function here is typed by its signature.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from models.demonstration import Floats
from models.geometry import diagonal, norms
from models.phase import corners, from_chord

Corners = tuple[int, ...]
CORNERS = (0.1, 0.08, 0.065, 0.05)
STRAIGHT = 0.02
BOWED = 0.05
SURE = 5.0
WAVED = 0.13
MOST_EDGES = 40
DISTINCT = 1.25
SLIGHT = 0.2
LEAST_STEPS = 3
ENOUGH = 4


def edges_of(mean: Floats, wavering: float = 0.0) -> tuple[Corners, bool]:
    """Return the indices of the corners of a mean path (n, d), ends included, and whether it is a polygon.

    It is one if its every corner turns more than the edges beside it do along their way, which neither a curve's
    corners nor chance waves' do, and no edge strays from its chord by more than 2 % of the diagonal and 5 % of its own
    length. Of the corners that Douglas and Peucker find the fewest that are enough count. Where hands are less steady
    an edge may stray by five standard errors (``wavering``, in m), up to 13 % of its length; but then, and where that
    is not enough either, the best polygons are asked: the one with the most edges counts that stray by no more than
    five standard errors and are longer than that.
    """
    size = diagonal(mean)
    candidates = [corners(mean, tolerance * size) for tolerance in CORNERS]
    for found in candidates:
        if _straight(mean, found) and _distinct(mean, found):
            return found, True
    steady = (found for found in candidates if _straight(mean, found, wavering, WAVED) and _distinct(mean, found))
    loosely = next(steady, None)
    best, blunt = loosely, 0
    for found in best_polygons(mean, MOST_EDGES):
        if not _straight(mean, found, wavering) or (loosely is not None and len(found) <= len(loosely)):
            continue
        if _long_enough(mean, found, wavering) and _distinct(mean, found):
            best, blunt = found, 0
        else:
            blunt += 1
        if blunt == ENOUGH:
            break
    return (candidates[-1], False) if best is None else (best, True)


def best_polygons(path: Floats, most: int) -> Iterator[Corners]:
    """Give, for 1, 2, .. ``most`` edges, the corners of the polygon on points of the path (n, d) that it strays from
    least: the sum of squares over its edges of how far each point is from the chord.
    """
    count = len(path)
    cost = _chord_costs(path)
    least = cost[0]
    before = [np.zeros(count, dtype=np.int64)]
    for _ in range(most):
        found = [count - 1]
        for step in reversed(before):
            found.append(int(step[found[-1]]))
        yield tuple(reversed(found))
        together = least[:, None] + cost
        before.append(together.argmin(axis=0))
        least = together[before[-1], np.arange(count)]


def _chord_costs(path: Floats) -> Floats:
    """Return the sum of squares (n, n) in m² of how far the points from i to j are from the line through both; infinite
    where j is not after i.

    With the sums of points and of their products up to each point, no pair costs more than another.
    """
    count, dimension = path.shape
    path = path - path.mean(axis=0)
    number = np.subtract.outer(np.arange(count), np.arange(count)).T + 1.0
    start = [axis[:, None] for axis in path.T]
    ahead = [axis[None, :] - axis[:, None] for axis in path.T]
    length = np.sqrt(np.sum([axis * axis for axis in ahead], axis=0))
    ahead = [axis / np.maximum(length, 1e-300) for axis in ahead]
    total, along = np.zeros((count, count)), np.zeros((count, count))
    sums = [_sums(axis) for axis in path.T]
    for i in range(dimension):
        for j in range(i, dimension):
            # the sum of (p - p_start)_i (p - p_start)_j
            product = _sums(path[:, i] * path[:, j]) - start[i] * sums[j] - start[j] * sums[i]
            product += number * start[i] * start[j]
            if i == j:
                total += product
            along += (1.0 + (i != j)) * ahead[i] * ahead[j] * product
    cost = np.maximum(total - along, 0.0)
    cost[np.tril_indices(count)] = np.inf
    return cost


def _sums(values: Floats) -> Floats:
    """Return the sums (n, n) of values (n,) from i to j."""
    summed = np.concatenate([[0.0], np.cumsum(values)])
    return summed[None, 1:] - summed[:-1, None]


def _straight(path: Floats, found: Corners, wavering: float = 0.0, waved: float = 1.0) -> bool:
    size = diagonal(path)
    for first, last in pairwise(found):
        edge = path[first : last + 1]
        length = float(norms(edge[-1] - edge[0]))
        limit = max(min(STRAIGHT * size, BOWED * length), min(SURE * wavering, waved * length))
        if from_chord(edge).max() > limit:
            return False
    return True


def _long_enough(path: Floats, found: Corners, wavering: float) -> bool:
    """Return whether every edge is longer than hands may waver by, and has points enough to tell whether it bends."""
    lengths = norms(np.diff(path[list(found)], axis=0))
    return bool(np.diff(found).min() >= LEAST_STEPS and lengths.min() >= SURE * wavering)


def _distinct(path: Floats, found: Corners) -> bool:
    """Return whether each corner turns by a quarter more than either edge beside it does along its way, and by 11
    degrees at least.

    An edge that strays from its chord by a part b of it turns as an arc does: by 8 b.
    """
    chords = np.diff(path[list(found)], axis=0)
    lengths = np.maximum(norms(chords), 1e-300)
    cosines = (chords[1:] * chords[:-1]).sum(axis=1) / (lengths[1:] * lengths[:-1])
    turns = np.arccos(np.clip(cosines, -1.0, 1.0))
    strayed = np.array([from_chord(path[first : last + 1]).max() for first, last in pairwise(found)])
    bent = 8.0 * strayed / lengths
    return bool((turns >= np.maximum(SLIGHT, DISTINCT * np.maximum(bent[1:], bent[:-1]))).all())
