"""Samples that are no positions of the hand: a reflection taken for the marker, a marker swapped for another."""

# numpy and scipy leave many results untyped: what leaves a function here is typed by its signature.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false

import numpy as np
from scipy.ndimage import median_filter

from models.demonstration import Bools, Floats
from models.geometry import norms, ranked

WINDOW = 0.15
PASSES = 4
FLOOR = 0.5e-3
DEVIATION_FROM_MAD = 1.4826
BRISK = 0.9
JUMP = 8.0
JUMP_REACH = 0.015
LOOK_BACK = 50


def reflections(times: Floats, points: Floats) -> Bools:
    """Return which samples (n,) are no positions of the hand: off its track, or off the median of their neighbours.

    Hampel's test, over all axes together: a sample is a reflection if it is further from the running median (0.15 s)
    than
    three deviations (from the running median of those distances), than 0.5 mm and than a brisk hand comes in that time.
    """
    found = _off_the_track(times, points)
    for _ in range(PASSES):
        kept = np.flatnonzero(~found)
        if len(kept) < 8:
            break
        off = _off_the_median(times[kept], points[kept])
        if not off.any():
            break
        found[kept[off]] = True
    return found


def _off_the_track(times: Floats, points: Floats) -> Bools:
    """Return which samples (n,) no hand could have reached: all but the longest chain of stretches without a jump.

    A jump is a step eight times faster than a brisk one of this recording, and 1.5 % of the drawing more.
    """
    spans = np.diff(times)
    speeds = norms(np.diff(points, axis=0)) / spans
    fastest = JUMP * float(ranked(speeds, BRISK))
    low, high = ranked(points, 0.05), ranked(points, 0.95)
    slack = JUMP_REACH * float(norms(high - low))
    starts = np.concatenate([[0], np.flatnonzero(speeds * spans > fastest * spans + slack) + 1])
    ends = np.append(starts[1:], len(points)) - 1
    if len(starts) == 1:
        return np.zeros(len(points), dtype=bool)
    earlier = np.arange(len(starts))[:, None] + np.arange(-min(LOOK_BACK, len(starts) - 1), 0)
    away = norms(points[ends[earlier]] - points[starts, None])
    near = (earlier >= 0) & (away <= fastest * (times[starts, None] - times[ends[earlier]]) + slack)
    sizes: list[int] = (ends - starts + 1).tolist()
    chains, before = sizes.copy(), [-1] * len(sizes)
    for segment, best in zip(np.nonzero(near)[0].tolist(), earlier[near].tolist(), strict=True):
        if chains[best] + sizes[segment] > chains[segment]:
            chains[segment] = chains[best] + sizes[segment]
            before[segment] = best
    found = np.ones(len(points), dtype=bool)
    segment = chains.index(max(chains))
    while segment >= 0:
        found[starts[segment] : ends[segment] + 1] = False
        segment = before[segment]
    return found


def _off_the_median(times: Floats, points: Floats) -> Bools:
    half = max(2, round(0.5 * WINDOW / float(ranked(np.diff(times), 0.5))))
    window = 2 * min(half, (len(points) - 1) // 2) + 1
    middle = np.stack([median_filter(axis, size=window, mode="nearest") for axis in points.T]).T
    away = norms(points - middle)
    speeds = norms(np.diff(points, axis=0)) / np.diff(times)
    reach = 0.5 * WINDOW * float(ranked(speeds, BRISK))
    off: Bools = np.asarray(away > max(FLOOR, reach))
    if not off.any():
        return off
    usual = DEVIATION_FROM_MAD * median_filter(away, size=window, mode="nearest")
    return np.asarray(off & (away > 3.0 * usual))
