"""The polygons with the least squares of all, for each number of edges: where components of a path begin.

They are found by dynamic programming (Perez and Vidal, "Optimum polygonal approximation of digitized curves", 1994).
"""

from collections.abc import Iterator

import numpy as np

from models.demonstration import Floats

Corners = tuple[int, ...]


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
