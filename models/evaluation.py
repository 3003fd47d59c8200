"""How good a path is: distances to a known path, smoothness."""

import numpy as np
from scipy.spatial import KDTree

from models.demonstration import Floats
from models.geometry import norms
from models.phase import arc_lengths, at


def resampled(path: Floats, count: int) -> Floats:
    """Return ``count`` points of a polyline (n, d), evenly spaced along it: shape (count, d)."""
    lengths = arc_lengths(path)
    return at(np.linspace(0.0, lengths[-1], count), lengths, path)


def path_rms(path: Floats, truth: Floats, count: int = 2000) -> float:
    """Return the root mean square closest-point distance in m between two polylines, both ways together."""
    one, other = resampled(path, count), resampled(truth, count)
    there, back = KDTree(other).query(one)[0], KDTree(one).query(other)[0]
    return float(np.sqrt(0.5 * ((there**2).mean() + (back**2).mean())))


def frechet(path: Floats, truth: Floats, count: int = 500) -> float:
    """Return the discrete Fréchet distance in m between two polylines, ``count`` points on each."""
    one, other = resampled(path, count), resampled(truth, count)
    distances = norms(one[:, None] - other[None])
    before = np.full(count + 1, np.inf)
    latest = np.full(count + 1, np.inf)
    for diagonal in range(2 * count - 1):
        rows = np.arange(max(0, diagonal - count + 1), min(count, diagonal + 1))
        reach = np.minimum(np.minimum(before[rows], latest[rows]), latest[rows + 1])
        if diagonal == 0:
            reach = np.zeros(1)
        now = np.full(count + 1, np.inf)
        now[rows + 1] = np.maximum(reach, distances[rows, diagonal - rows])
        before, latest = latest, now
    return float(latest[count])


def corner_error(path: Floats, corners: Floats) -> float:
    """Return the mean distance in m of corner points (c, d) to a path (n, d)."""
    return float(KDTree(resampled(path, 5000)).query(corners)[0].mean())


def end_error(path: Floats, truth: Floats) -> float:
    """Return the mean distance in m of the path's two ends from the true ones."""
    return float(norms(path[[0, -1]] - truth[[0, -1]]).mean())


def smoothness(path: Floats) -> float:
    """Return the log dimensionless jerk of a path (n, d) at even steps: nearer to zero is smoother.

    -ln(T³ / v_peak² · mean square jerk · T²) with T = 1 for the whole path (Hogan and Sternad; Balasubramanian et al.).
    """
    step = 1.0 / (len(path) - 1)
    speed = norms(np.diff(path, axis=0)) / step
    jerk = np.diff(path, n=3, axis=0) / step**3
    return -float(np.log((jerk * jerk).sum() * step / speed.max() ** 2))
