"""Which sample of one motion belongs to which of another: dynamic time warping (dtw) in any number of dimensions.

``warp`` is exact, on evenly resampled motions, all of them in one sweep along the anti-diagonals of the cost table;
it may leave
start and end of the reference open, for people who started late or let go early. ``warp_fast`` is the published
FastDTW, from the package of that name.
"""

# numpy and scipy leave many results untyped: what leaves a function here is typed by its signature.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false

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
    """Return the exact warps of motions (b, m, d) to a reference (n, d) under Euclidean distance.

    ``open_start`` and ``open_end`` (b,) tell which motions may begin after the reference does or stop before it.
    """
    count = len(others)
    starts = np.zeros(count, dtype=bool) if open_start is None else open_start
    ends = np.zeros(count, dtype=bool) if open_end is None else open_end
    found: list[Warps] = []
    for low in range(0, count, BATCH):
        part = slice(low, low + BATCH)
        references = np.broadcast_to(reference, (len(others[part]), *reference.shape))
        steps, totals = _sweep(references, others[part], starts[part])
        last = np.where(ends[part], totals.argmin(axis=1), len(reference) - 1)
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
    either end of this one, where nobody comes from.
    """
    batch, m = others.shape[:2]
    n = references.shape[1]
    steps = np.zeros((n + m - 1 if tell_steps else 0, n, batch), dtype=np.int8)
    totals = np.empty((n, batch), dtype=np.float32)
    before, latest, now = (np.full((n + 1, batch), np.inf, dtype=np.float32) for _ in range(3))
    free = np.where(open_start, 0.0, np.inf)
    beside = np.empty((n, batch), dtype=bool)
    for diagonal, low, away in _distances(references, others):
        high = low + len(away)
        straight, up, along = before[low:high], latest[low:high], latest[low + 1 : high + 1]
        if diagonal < n:
            straight[-1] = 0.0 if diagonal == 0 else free
        reached = now[low + 1 : high + 1]
        np.minimum(up, along, out=reached)
        if tell_steps:
            step = steps[diagonal, low:high]
            np.greater(up, along, out=beside[low:high])
            np.add(beside[low:high].view(np.int8), ALONG_REFERENCE, out=step, casting="unsafe")
            np.greater(straight, reached, out=beside[low:high])
            np.multiply(step, beside[low:high].view(np.int8), out=step)
        np.minimum(straight, reached, out=reached)
        reached += away
        now[low] = np.inf
        now[high + 1 :][:1] = np.inf
        if diagonal >= m - 1:
            totals[diagonal - m + 1] = now[diagonal - m + 2]
        before, latest, now = latest, now, before
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
    for start in range(0, n + m - 1, BLOCK):
        end = min(start + BLOCK, n + m - 1)
        low, high = max(0, start - m + 1), min(n, end)
        shape = (end - start, high - low, batch)
        away = np.zeros(shape, dtype=np.float32)
        difference = np.empty(shape, dtype=np.float32)
        for axis in range(width):
            begin = axis * whole + (BLOCK - 1 + m - 1 - start + low) * sample
            shifted = np.ndarray(shape, np.float32, turned.data, begin, (-sample, sample, one))
            np.subtract(rows[axis, low:high], shifted, out=difference)
            np.multiply(difference, difference, out=difference)
            away += difference
        np.sqrt(away, out=away)
        for diagonal in range(start, end):
            first_row = max(0, diagonal - m + 1)
            yield diagonal, first_row, away[diagonal - start, first_row - low : min(n, diagonal + 1) - low]


def _backtrack(steps: Steps, totals: Floats, last: Indices, m: int) -> Warps:
    """Return the warps that end at rows ``last`` (b,), followed backwards cell by cell: plain counting is quicker here
    than arrays of b.
    """
    n, batch = steps.shape[1:]
    everywhere = np.arange(n)
    first_column = steps[everywhere, everywhere]
    steps[everywhere, everywhere] = np.where(first_column == DIAGONAL, BEGINNING, first_column)
    cells = steps.tobytes()
    back = {DIAGONAL: (2 * n + 1) * batch, ALONG_REFERENCE: (n + 1) * batch, ALONG_OTHER: n * batch}
    sums, hits = np.empty((batch, n)), np.empty((batch, n))
    first, lengths = np.empty(batch, dtype=np.int64), np.empty(batch)
    for motion in range(batch):
        cell = ((int(last[motion]) + m - 1) * n + int(last[motion])) * batch + motion
        passed = [cell]
        while (step := cells[cell]) != BEGINNING:
            cell -= back[step]
            passed.append(cell)
        diagonals, rows = np.divmod(np.array(passed) // batch, n)
        sums[motion] = np.bincount(rows, diagonals - rows, minlength=n)
        hits[motion] = np.bincount(rows, minlength=n)
        first[motion], lengths[motion] = rows[-1], len(passed)
    positions = np.where(hits > 0, sums / np.maximum(hits, 1), np.nan)
    return Warps(positions, first, last, totals / lengths)


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
