"""Samples that are no positions of the hand: a reflection taken for the marker, a marker swapped for another."""

# numpy and scipy leave many results untyped: what leaves a function here is typed by its signature.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false

import numpy as np
from scipy.ndimage import median_filter

from models.demonstration import Bools, Floats
from models.geometry import norms

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
    fastest = JUMP * float(_ranked(speeds, BRISK))
    low, high = _ranked(points, 0.05), _ranked(points, 0.95)
    slack = JUMP_REACH * float(norms(high - low))
    starts = np.concatenate([[0], np.flatnonzero(speeds * spans > fastest * spans + slack) + 1])
    ends = np.append(starts[1:], len(points)) - 1
    if len(starts) == 1:
        return np.zeros(len(points), dtype=bool)
    chain = (ends - starts + 1).astype(np.float64)
    before = np.full(len(starts), -1)
    for segment in range(1, len(starts)):
        earlier = np.arange(max(0, segment - LOOK_BACK), segment)
        away = norms(points[ends[earlier]] - points[starts[segment]])
        near = earlier[away <= fastest * (times[starts[segment]] - times[ends[earlier]]) + slack]
        if len(near):
            best = near[chain[near].argmax()]
            chain[segment] += chain[best]
            before[segment] = best
    found = np.ones(len(points), dtype=bool)
    segment = int(chain.argmax())
    while segment >= 0:
        found[starts[segment] : ends[segment] + 1] = False
        segment = int(before[segment])
    return found


def _off_the_median(times: Floats, points: Floats) -> Bools:
    half = max(2, round(0.5 * WINDOW / float(np.median(np.diff(times)))))
    window = 2 * min(half, (len(points) - 1) // 2) + 1
    middle = np.stack([median_filter(axis, size=window, mode="nearest") for axis in points.T]).T
    away = norms(points - middle)
    speeds = norms(np.diff(points, axis=0)) / np.diff(times)
    reach = 0.5 * WINDOW * float(_ranked(speeds, BRISK))
    off: Bools = np.asarray(away > max(FLOOR, reach))
    if not off.any():
        return off
    usual = DEVIATION_FROM_MAD * median_filter(away, size=window, mode="nearest")
    return np.asarray(off & (away > 3.0 * usual))


def _ranked(values: Floats, share: float) -> Floats:
    """Return the value that this share of values (n, ...) does not exceed: numpy's quantile without its cost."""
    place = int(share * (len(values) - 1))
    return np.asarray(np.partition(values, place, axis=0)[place])
