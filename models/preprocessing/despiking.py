"""Samples that are no positions of the hand: a reflection taken for the marker, a marker swapped for another."""

import numpy as np
from numpy.typing import NDArray

from models.demonstration import Bools, Floats
from models.geometry import diagonal, norms, ranked

LEAST_REACH = 7  # samples to either side: bursts of reflections last up to six
PASSES = 4
DEVIATION_FROM_MAD = 1.4826  # of a normal distribution
BRISK = 0.9
JUMP = 8.0
JUMP_REACH = 0.015
LOOK_BACK = 50

Indices = NDArray[np.int64]


def reflections(times: Floats, points: Floats, crossing: float, size: float) -> Bools:
    """Return which samples (n,) are no positions of the hand: off its track, or off its neighbours.

    Hampel's test, on distances, so that it sees no axes: a sample is a reflection if half of its neighbours (within
    ``crossing`` s, seven samples at least, to either side) are further away than a brisk hand comes in that time, and
    than three deviations by what is usual among them. ``size`` in m of the drawing.
    """
    found = _off_the_track(times, points, size)
    for _ in range(PASSES):
        kept = np.flatnonzero(~found)
        if len(kept) < 8:
            break
        off = _off_the_neighbours(times[kept], points[kept], crossing)
        if not len(off):
            break
        found[kept[off]] = True
    return found


def _off_the_track(times: Floats, points: Floats, size: float) -> Bools:
    """Return which samples (n,) no hand could have reached, or was not at when they say so.

    A jump is a step eight times faster than a brisk one of this recording, and 1.5 % of the drawing more. A place told
    again and again until the hand is seen elsewhere was the tracker's last, not the hand's.
    """
    spans, steps = np.diff(times), norms(np.diff(points, axis=0))
    fastest, slack = JUMP * float(ranked(steps / spans, BRISK)), JUMP_REACH * size
    index = np.arange(len(points))
    first_there = np.maximum.accumulate(np.where(np.concatenate([[True], steps > 0.0]), index, 0))
    found = np.zeros(len(points), dtype=bool)
    for last in np.flatnonzero(steps > fastest * spans + slack):
        first = first_there[last]
        if first < last and steps[last] <= fastest * (times[last + 1] - times[first]) + slack:
            found[first + 1 : last + 1] = True
    kept = np.flatnonzero(~found)
    found[kept] = _off_the_chain(times[kept], points[kept], fastest, slack)
    return found


def _off_the_chain(times: Floats, points: Floats, fastest: float, slack: float) -> Bools:
    """Return which samples (n,) are not of the longest chain of stretches without a jump.

    A reflection comes back to the track. What lies before or after the chain, and goes a way of its own, is the task
    too: frames were lost in between.
    """
    spans, steps = np.diff(times), norms(np.diff(points, axis=0))
    starts = np.concatenate([[0], np.flatnonzero(steps > fastest * spans + slack) + 1])
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
    kept = np.flatnonzero(~found)
    for part in (slice(0, kept[0]), slice(kept[-1] + 1, len(points))):
        if len(times[part]) > 1:
            off = _off_the_chain(times[part], points[part], fastest, slack)
            found[part] = off if diagonal(points[part][~off]) > slack else True
    return found


def _off_the_neighbours(times: Floats, points: Floats, crossing: float) -> Indices:
    """Return the indices of the samples that are off their neighbours.

    Who is off has gone a longer way than a brisk hand's within the window: only those are looked at closely.
    """
    step = float(ranked(np.diff(times), 0.5))
    half = min(max(LEAST_REACH, round(crossing / step)), (len(points) - 1) // 2)
    lengths = norms(np.diff(points, axis=0))
    # Of positions told in whole millimetres most steps are none: the hand is as fast as over a window.
    strides = norms(points[half:] - points[:-half]) / (times[half:] - times[:-half])
    reach = half * step * max(float(ranked(lengths / np.diff(times), BRISK)), float(ranked(strides, 0.5)))
    way = np.concatenate([[0.0], np.cumsum(lengths)])
    index = np.arange(len(points))
    low, high = np.maximum(index - half, 0), np.minimum(index + half, len(points) - 1)
    suspects = np.flatnonzero(np.maximum(way - way[low], way[high] - way) > reach)
    away = _usual_distance(points, suspects, half)
    suspects = suspects[away > reach]
    if not len(suspects):
        return suspects
    among = np.unique(np.clip(suspects[:, None] + np.arange(-half, half + 1), 0, len(points) - 1))
    every = np.empty(len(points))
    every[among] = _usual_distance(points, among, half)
    usual = ranked(every[_window(suspects, half, len(points))].T, 0.5)
    return suspects[every[suspects] > 3.0 * DEVIATION_FROM_MAD * usual]


def _window(centres: Indices, half: int, count: int) -> Indices:
    """Return the samples (k, 2 half + 1) about each centre (k,); at the ends the window stays inside."""
    first = np.clip(centres - half, 0, count - 2 * half - 1)
    return first[:, None] + np.arange(2 * half + 1)


def _usual_distance(points: Floats, centres: Indices, half: int) -> Floats:
    """Return the median distance (k,) in m of the samples about each centre from it."""
    columns = [axis[_window(centres, half, len(points))] - axis[centres, None] for axis in points.T]
    squares = np.sum([column * column for column in columns], axis=0)
    return np.sqrt(ranked(squares.T, 0.5))
