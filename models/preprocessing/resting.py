"""Rests longer than the task: what is usual is asked of samples, and most of these would be of a hand that waits.

So the rests are taken out of a recording's clock before anything is asked of it, and put back afterwards.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from models.demonstration import Bools, Floats
from models.geometry import middle, norms, ranked

BLOCKS = 256
OF_BLOCK = 5  # samples, so that two reflections among them do not move its middle
LEAST_REST = 0.05  # of the recording: what is called a pause
STILL_SIZE = 0.02  # of how far the drawing goes from the usual place: hands tremble
THROWN_OFF = 0.2  # of a rest may be reflections
MOST = 0.5  # of a recording: medians bear rests up to there
FEWEST = 0.2  # of all windows end where they began before it is worth looking closer: half would, of such a recording
EDGE = 0.01  # of what is left stays of a rest on either side: the place is part of the drawing
ROUNDS = 4


def waiting(times: Floats, points: Floats) -> Bools:
    """Return which samples (n,) of a recording, ``times`` (n,) in s and ``points`` (n, d) in m, are of rests that take
    more than half of it; none where they take less.

    A rest is a twentieth of the recording within 2 % of how far it goes from its usual place, reflections apart. Long
    rests hide shorter ones: these are looked for again in what is left.
    """
    count = len(points)
    index = np.arange(count)
    for _ in range(ROUNDS):
        found = _rests(points[index])
        if not found.any():
            break
        index = index[~found]
    waits = np.ones(count, dtype=bool)
    waits[index] = False
    spans = np.diff(times, append=times[-1])
    if float(spans[waits].sum()) <= MOST * float(times[-1] - times[0]):
        return np.zeros(count, dtype=bool)
    return waits


def without(times: Floats, waits: Bools) -> Floats:
    """Return the instants (m,) in s of the samples that do not wait, on a clock that stands still while others do."""
    step = float(ranked(np.diff(times), 0.5))
    spans = np.diff(times[~waits])
    across = np.diff(np.flatnonzero(~waits)) > 1
    return np.concatenate([[0.0], np.cumsum(np.where(across, step, spans))])


def _rests(points: Floats) -> Bools:
    """Return which of the points (n, d) are of stays, but for their edges."""
    count = len(points)
    blocks = min(BLOCKS, count // OF_BLOCK)
    window = round(LEAST_REST * blocks)
    found = np.zeros(count, dtype=bool)
    if window < 2:
        return found
    borders = np.linspace(0, count, blocks + 1).astype(np.int64)
    inside = (np.arange(OF_BLOCK) + 0.5) / OF_BLOCK
    sampled = (borders[:-1, None] + np.diff(borders)[:, None] * inside).astype(np.int64)
    places = middle(points[sampled])
    far = norms(places - middle(places))
    still = STILL_SIZE * float(np.minimum(far[1:], far[:-1]).max())
    beside = norms(places[window - 1 :] - places[: 1 - window]) <= 2.0 * still
    if np.count_nonzero(beside) < FEWEST * len(beside):
        return found
    views = sliding_window_view(places, window, axis=0).transpose(0, 2, 1)
    middles = middle(views)
    bearable = round(THROWN_OFF * (window - 1))
    away = np.sort(norms(views - middles[:, None]), axis=1)[:, window - 1 - bearable]
    stays: list[tuple[int, int]] = []
    begin = 0
    while len(rests := begin + np.flatnonzero(away[begin:] <= still)):
        there = rests[0] + np.flatnonzero(norms(places[rests[0] :] - middles[rests[0]]) <= 2.0 * still)
        ends = np.flatnonzero(np.diff(there) > bearable + 1)
        there = there[: ends[0] + 1] if len(ends) else there
        first, after = borders[there[0]], borders[there[-1] + 1]
        near = first + np.flatnonzero(norms(points[first:after] - middle(places[there])) <= still)
        if len(near):
            stays.append((int(near[0]), int(near[-1])))
        begin = int(max(there[-1], rests[0])) + 1
    moving = count - sum(last - first for first, last in stays)
    edge = max(2, round(EDGE * moving))
    for first, last in stays:
        found[first + edge : max(first + edge, last + 1 - edge)] = True
    return found
