"""Which sample of one motion belongs to which of another: dynamic time warping (dtw) in any number of dimensions.

``warp`` is exact, on evenly resampled motions, all of them in one sweep along the anti-diagonals of the cost table;
it may leave
start and end of the reference open, for people who started late or let go early. ``warp_fast`` is the published
FastDTW, from the package of that name.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import fastdtw
import numpy as np
from numpy.typing import NDArray

from models.demonstration import Bools, Floats

Steps = NDArray[np.int8]
Indices = NDArray[np.int64]
BATCH = 64
PAIRS = 512
BLOCK = 16
DIAGONAL, ALONG_REFERENCE, ALONG_OTHER, BEGINNING = 0, 1, 2, 3


@dataclass(frozen=True, slots=True, eq=False)
class Warps:
    """Where each of b motions is while the reference is at sample i.

    ``positions`` (b, n): mean index of the samples matched to i; NaN where the motion has not begun or has ended.
    ``first`` and ``last`` (b,): the samples of the reference between which it was there. ``costs`` (b,): mean
    distance along the warping path.
    """

    positions: Floats
    first: Indices
    last: Indices
    costs: Floats


def warp(reference: Floats, others: Floats, open_start: Bools | None = None, open_end: Bools | None = None) -> Warps:
    """Return the exact warps of motions (b, m, d) to a reference (n, d), or each to its own (b, n, d), under Euclidean
    distance.

    ``open_start`` and ``open_end`` (b,) tell which motions may begin after the reference does or stop before it.
    """
    count = len(others)
    starts = np.zeros(count, dtype=bool) if open_start is None else open_start
    ends = np.zeros(count, dtype=bool) if open_end is None else open_end
    found: list[Warps] = []
    for low in range(0, count, BATCH):
        part = slice(low, low + BATCH)
        references = np.broadcast_to(reference, (count, *reference.shape[-2:]))[part]
        steps, totals = _sweep(references, others[part], starts[part])
        last = np.where(ends[part], totals.argmin(axis=1), reference.shape[-2] - 1)
        found.append(_backtrack(steps, totals[np.arange(len(last)), last], last, others.shape[1]))
    return Warps(
        np.concatenate([part.positions for part in found]),
        np.concatenate([part.first for part in found]),
        np.concatenate([part.last for part in found]),
        np.concatenate([part.costs for part in found]),
    )


def costs(references: Floats, others: Floats) -> Floats:
    """Return the whole cost (p,) of warping each of p motions (p, m, d) to its own reference (p, n, d)."""
    nobody = np.zeros(len(others), dtype=bool)
    parts = [
        _sweep(references[low : low + PAIRS], others[low : low + PAIRS], nobody[low : low + PAIRS], False)[1][:, -1]
        for low in range(0, len(others), PAIRS)
    ]
    return np.concatenate(parts)


def medoid(motions: Floats) -> int:
    """Return which of the motions (b, n, d) is nearest to all others by dtw: the reference. Ties go to the first."""
    one, other = np.triu_indices(len(motions), 1)
    table = np.zeros((len(motions), len(motions)))
    table[one, other] = costs(motions[one], motions[other])
    table += table.T
    return int(np.sqrt(table).sum(axis=1).argmin())


def warp_fast(reference: Floats, other: Floats, radius: int) -> Floats:
    """Return the positions (n,) in another motion (m, d) while the reference (n, d) is at sample i, by FastDTW."""
    _warn_once_if_slow()
    _, path = fastdtw.fastdtw(reference, other, radius=radius, dist=2)
    pairs = np.array(path, dtype=np.int64)
    hits = np.bincount(pairs[:, 0], minlength=len(reference))
    return np.bincount(pairs[:, 0], weights=pairs[:, 1], minlength=len(reference)) / hits


def fastdtw_is_compiled() -> bool:
    """Return whether the fastdtw package runs its compiled form here."""
    return str(fastdtw.fastdtw.__module__) != "fastdtw.fastdtw"


def _sweep(references: Floats, others: Floats, open_start: Bools, tell_steps: bool = True) -> tuple[Steps, Floats]:
    """Return the step into each cell, by anti-diagonal and row (n + m - 1, n, b), and the cost (b, n) of ending at
    each row. Who asks for costs alone gets no steps (0, n, b).

    The motions are the last axis, so that a stretch of a diagonal is one piece of memory. Buffers of a diagonal are
    shifted by one: place i + 1 holds row i, place 0 is outside the table. The next two diagonals look one row beyond
    either end of this one, where nobody comes from: rows beyond the last were never reached, the one before the first
    is closed.
    """
    batch, m = others.shape[:2]
    n = references.shape[1]
    beside, turned = np.empty((2, n + m - 1 if tell_steps else 0, n, batch), dtype=bool)
    totals = np.empty((n, batch), dtype=np.float32)
    before, latest, now = (np.full((n + 1, batch), np.inf, dtype=np.float32) for _ in range(3))
    free = np.where(open_start, 0.0, np.inf)
    for diagonal, low, away in _distances(references, others):
        high = low + len(away)
        straight, up, along = before[low:high], latest[low:high], latest[low + 1 : high + 1]
        if diagonal < n:
            straight[-1] = 0.0 if diagonal == 0 else free
        reached = now[low + 1 : high + 1]
        np.minimum(up, along, out=reached)
        if tell_steps:
            np.greater(up, along, out=beside[diagonal, low:high])
            np.greater(straight, reached, out=turned[diagonal, low:high])
        np.minimum(straight, reached, out=reached)
        np.add(reached, away, out=reached)
        now[low] = np.inf
        if diagonal >= m - 1:
            totals[diagonal - m + 1] = now[diagonal - m + 2]
        before, latest, now = latest, now, before
    steps = beside.view(np.int8)
    steps += ALONG_REFERENCE
    steps *= turned
    return steps, totals.T.astype(np.float64)


def _distances(references: Floats, others: Floats) -> Iterator[tuple[int, int, NDArray[np.float32]]]:
    """Give each anti-diagonal of the distance tables of b pairs: its number, its first row, its cells (r, b).

    A block of diagonals is computed at once, on a view in which moving on to the next diagonal is a step backwards
    through the turned motion. Single precision about the common middle is a millionth of the drawing, in half the time.
    """
    batch, m, width = others.shape
    n = references.shape[1]
    middle = references.mean(axis=(0, 1))
    rows = np.ascontiguousarray((references - middle).transpose(2, 1, 0), dtype=np.float32)
    turned = np.zeros((width, m + 2 * (BLOCK - 1), batch), dtype=np.float32)
    turned[:, BLOCK - 1 : BLOCK - 1 + m] = (others[:, ::-1] - middle).transpose(2, 1, 0)
    whole, sample, one = turned.strides
    room = np.empty((2, BLOCK * n * batch), dtype=np.float32)
    for start in range(0, n + m - 1, BLOCK):
        end = min(start + BLOCK, n + m - 1)
        low, high = max(0, start - m + 1), min(n, end)
        shape = (end - start, high - low, batch)
        away, square = (part[: shape[0] * shape[1] * batch].reshape(shape) for part in room)
        for axis in range(width):
            begin = axis * whole + (BLOCK - 1 + m - 1 - start + low) * sample
            shifted = np.ndarray(shape, np.float32, turned.data, begin, (-sample, sample, one))
            difference = square if axis else away
            np.subtract(rows[axis, low:high], shifted, out=difference)
            np.multiply(difference, difference, out=difference)
            if axis:
                np.add(away, square, out=away)
        np.sqrt(away, out=away)
        for diagonal in range(start, end):
            first_row = max(0, diagonal - m + 1)
            yield diagonal, first_row, away[diagonal - start, first_row - low : min(n, diagonal + 1) - low]


def _backtrack(steps: Steps, totals: Floats, last: Indices, m: int) -> Warps:
    """Return the warps that end at rows ``last`` (b,), followed backwards cell by cell, all motions at once."""
    n, batch = steps.shape[1:]
    everywhere = np.arange(n)
    first_column = steps[everywhere, everywhere]
    steps[everywhere, everywhere] = np.where(first_column == DIAGONAL, BEGINNING, first_column)
    flat = steps.reshape(-1)
    back = np.array([2 * n + 1, n + 1, n, 0])[[DIAGONAL, ALONG_REFERENCE, ALONG_OTHER, BEGINNING]] * batch
    cell = ((last + m - 1) * n + last) * batch + np.arange(batch)
    passed = [cell]
    while len(passed) % 16 or flat[cell].min() != BEGINNING:
        cell = cell - back[flat[cell]]
        passed.append(cell)
    trace = np.stack(passed)
    path = trace[np.concatenate([np.ones((1, batch), dtype=bool), trace[1:] != trace[:-1]])]
    place, motion = np.divmod(path, batch)
    diagonals, rows = np.divmod(place, n)
    where = motion * n + rows
    sums = np.bincount(where, diagonals - rows, minlength=batch * n).reshape(batch, n)
    hits = np.bincount(where, minlength=batch * n).reshape(batch, n)
    positions = np.where(hits > 0, sums / np.maximum(hits, 1), np.nan)
    return Warps(positions, (hits > 0).argmax(axis=1), last, totals / hits.sum(axis=1))


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
