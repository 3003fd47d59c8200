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
from dataclasses import dataclass

import fastdtw
import numpy as np
from numpy.typing import NDArray

from models.demonstration import Bools, Floats

Steps = NDArray[np.int8]
Indices = NDArray[np.int64]
BATCH = 64
PAIRS = 512
DIAGONAL, ALONG_REFERENCE, ALONG_OTHER = 0, 1, 2


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
    """Return the step into each cell, by anti-diagonal and row (n + m - 1, b, n), and the cost (b, n) of ending at
    each row. Who asks for costs alone gets no steps (0, b, n), in half the time.

    Buffers of a diagonal are shifted by one: place i + 1 holds row i, place 0 is outside the table. The next two
    diagonals look one row beyond either end of this one, where nobody comes from.
    """
    batch, m, width = others.shape
    n = references.shape[1]
    steps = np.zeros((n + m - 1 if tell_steps else 0, batch, n), dtype=np.int8)
    totals = np.empty((batch, n))
    axes = [np.ascontiguousarray(references[:, :, axis]) for axis in range(width)]
    flipped = [np.ascontiguousarray(others[:, ::-1, axis]) for axis in range(width)]
    before, latest, now = (np.full((batch, n + 1), np.inf) for _ in range(3))
    free = np.where(open_start, 0.0, np.inf)
    for diagonal in range(n + m - 1):
        low, high = max(0, diagonal - m + 1), min(n, diagonal + 1)
        start = m - 1 - diagonal + low
        away = np.zeros((batch, high - low))
        for one, other in zip(axes, flipped, strict=True):
            difference = one[:, low:high] - other[:, start : start + high - low]
            away += difference * difference
        np.sqrt(away, out=away)
        straight = before[:, low:high]
        if diagonal < n:
            straight[:, -1] = 0.0 if diagonal == 0 else free
        up, along = latest[:, low:high], latest[:, low + 1 : high + 1]
        nearest = np.minimum(up, along)
        if tell_steps:
            beside = np.greater(up, along).view(np.int8) + np.int8(ALONG_REFERENCE)
            np.multiply(np.greater(straight, nearest).view(np.int8), beside, out=steps[diagonal, :, low:high])
        np.minimum(straight, nearest, out=nearest)
        np.add(away, nearest, out=now[:, low + 1 : high + 1])
        now[:, low] = np.inf
        now[:, high + 1 :][:, :1] = np.inf
        if diagonal >= m - 1:
            totals[:, diagonal - m + 1] = now[:, diagonal - m + 2]
        before, latest, now = latest, now, before
    return steps, totals


def _backtrack(steps: Steps, totals: Floats, last: Indices, m: int) -> Warps:
    batch, n = steps.shape[1:]
    sums, hits = np.zeros((batch, n)), np.zeros((batch, n))
    row, column = last.copy(), np.full(batch, m - 1)
    everyone = np.arange(batch)
    lengths = np.zeros(batch)
    active = np.ones(batch, dtype=bool)
    while active.any():
        there = everyone[active]
        sums[there, row[active]] += column[active]
        hits[there, row[active]] += 1
        lengths += active
        step = steps[row + column, everyone, row]
        active &= ~((column == 0) & (step == DIAGONAL))
        row = row - (active & (step != ALONG_OTHER))
        column = column - (active & (step != ALONG_REFERENCE))
    positions = np.where(hits > 0, sums / np.maximum(hits, 1), np.nan)
    return Warps(positions, row, last, totals / lengths)


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
