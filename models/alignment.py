"""Which sample of one demonstration belongs to which of another: dynamic time warping (dtw) in any number of dimensions.

``warp`` is exact, on evenly resampled motions, all demonstrations in one sweep along the anti-diagonals of the cost table; it
may leave the end of the reference open, for people who let go early. ``warp_fast`` is the published FastDTW, from the package
of that name.
"""

import warnings
from dataclasses import dataclass

import fastdtw
import numpy as np

from models.demonstration import Floats

BATCH = 64
DIAGONAL, ALONG_REFERENCE, ALONG_OTHER = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class Warps:
    """Where each of b motions is while the reference is at sample i.

    ``positions`` (b, n): mean index of the samples matched to i; NaN beyond the last sample of the reference reached.
    ``reached`` (b,): that last sample. ``costs`` (b,): mean distance along the warping path.
    """

    positions: Floats
    reached: np.ndarray
    costs: Floats


def warp(reference: Floats, others: Floats, open_end: np.ndarray | None = None) -> Warps:
    """Return the exact warps of motions (b, m, d) to a reference (n, d) under Euclidean distance.

    ``open_end`` (b,) tells which motions may stop before the reference does.
    """
    count = len(others)
    ends = np.zeros(count, dtype=bool) if open_end is None else open_end
    parts = [_warp_batch(reference, others[i : i + BATCH], ends[i : i + BATCH]) for i in range(0, count, BATCH)]
    return Warps(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.reached for part in parts]),
        np.concatenate([part.costs for part in parts]),
    )


def _warp_batch(reference: Floats, others: Floats, open_end: np.ndarray) -> Warps:
    steps, totals = _sweep(reference, others)
    batch, m = others.shape[:2]
    n = len(reference)
    last = np.where(open_end, totals.argmin(axis=1), n - 1)
    return _backtrack(steps, totals[np.arange(batch), last], last, n, m)


def _sweep(reference: Floats, others: Floats) -> tuple[np.ndarray, Floats]:
    """Return the step taken into each cell (b, n, m) and the cost (b, n) of ending the other at each reference sample."""
    batch, m, width = others.shape
    n = len(reference)
    steps = np.empty((n + m - 1, batch, n), dtype=np.int8)
    totals = np.empty((batch, n))
    flipped = others[:, ::-1]
    infinite = np.full((batch, n + 1), np.inf)
    before, latest = infinite.copy(), infinite.copy()
    choices = np.empty((3, batch, n))
    for diagonal in range(n + m - 1):
        low, high = max(0, diagonal - m + 1), min(n, diagonal + 1)
        away = np.zeros((batch, high - low))
        start = m - 1 - diagonal + low
        for axis in range(width):
            difference = reference[low:high, axis] - flipped[:, start : start + high - low, axis]
            away += difference * difference
        away = np.sqrt(away)
        now = infinite.copy()
        cell = choices[:, :, : high - low]
        cell[DIAGONAL] = before[:, low:high]
        cell[ALONG_REFERENCE] = latest[:, low:high]
        cell[ALONG_OTHER] = latest[:, low + 1 : high + 1]
        if diagonal == 0:
            cell[DIAGONAL] = 0.0
        chosen = cell.argmin(axis=0)
        steps[diagonal, :, low:high] = chosen
        now[:, low + 1 : high + 1] = away + cell.min(axis=0)
        if diagonal >= m - 1:
            totals[:, diagonal - m + 1] = now[:, diagonal - m + 2]
        before, latest = latest, now
    return steps, totals


def _backtrack(steps: np.ndarray, totals: Floats, last: np.ndarray, n: int, m: int) -> Warps:
    batch = len(last)
    sums, hits = np.zeros((batch, n)), np.zeros((batch, n))
    row, column = last.copy(), np.full(batch, m - 1)
    everyone = np.arange(batch)
    lengths = np.zeros(batch)
    active = np.ones(batch, dtype=bool)
    while active.any():
        sums[everyone[active], row[active]] += column[active]
        hits[everyone[active], row[active]] += 1
        lengths += active
        done = (row == 0) & (column == 0)
        active &= ~done
        step = steps[row + column, everyone, row]
        row = row - (active & (step != ALONG_OTHER))
        column = column - (active & (step != ALONG_REFERENCE))
    with np.errstate(invalid="ignore"):
        positions = np.where(hits > 0, sums / np.maximum(hits, 1), np.nan)
    return Warps(positions, last, totals / lengths)


def medoid(motions: Floats) -> int:
    """Return which of the motions (b, n, d) is nearest to all others by dtw: the reference. Ties go to the first."""
    costs = np.array([warp(motion, motions).costs for motion in motions])
    return int((costs + costs.T).sum(axis=1).argmin())


def warp_fast(reference: Floats, other: Floats, radius: int) -> np.ndarray:
    """Return FastDTW's warping path (l, 2) of index pairs between a reference (n, d) and another motion (m, d)."""
    _warn_once_if_slow()
    _, path = fastdtw.fastdtw(reference, other, radius=radius, dist=2)
    return np.array(path, dtype=np.int64)


def fastdtw_is_compiled() -> bool:
    """Return whether the fastdtw package runs its compiled form here."""
    return fastdtw.fastdtw.__module__ != "fastdtw.fastdtw"


_warned: set[str] = set()


def _warn_once_if_slow() -> None:
    if not fastdtw_is_compiled() and not _warned:
        _warned.add("fastdtw")
        warnings.warn(
            "the fastdtw package was installed without its compiled form and runs a hundred times slower: "
            "install numpy, Cython and a C compiler, then reinstall fastdtw without build isolation",
            RuntimeWarning,
            stacklevel=3,
        )
