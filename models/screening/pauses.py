"""What one hand did that the others did not: stood still on the way, went over a stretch again, took a way around.

None of it changes the path that is learned (a pause changes the timing); an operator may want to know of it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from models.alignment.registration import skips
from models.demonstration import Bools, Floats
from models.geometry import diagonal, norms
from models.phase import arc_lengths
from models.preprocessing.filtering import LENGTH_WINDOW, CleanMotion, moving_average

LEAST_PAUSE = 0.05
WINDOW = 3.5
LOOKED_AT = 4
STILL = 0.2
STILL_SIZE = 0.005
NEAR = 0.06


@dataclass(frozen=True, slots=True)
class Pause:
    """A stretch in which the hand stood still.

    ``start`` and ``duration`` in s of the recording; ``place`` 0..1 on the path. A wait before the first move has
    place 0, one after the last has place 1. ``share``: the duration in parts of the whole recording's.
    """

    start: float
    duration: float
    place: float
    share: float


@dataclass(frozen=True, slots=True)
class Detour:
    """A stretch of one drawing that the others do not have: drawn there and back again, or a way around.

    ``place`` 0..1 on the common path; ``start`` and ``duration`` in s of the recording; ``length`` of it and how far
    ``away`` from the common path it went, in m. ``repeated``: it stays on the path, so it went over it again.
    """

    place: float
    start: float
    duration: float
    length: float
    away: float
    repeated: bool


def pauses(motion: CleanMotion, least: float = LEAST_PAUSE) -> tuple[Pause, ...]:
    """Return where the hand stood still for longer than a twentieth of the recording (``least`` of it), in order of
    time; places are shares of its way.

    It stands still while, within the time in which it crosses 7 % of the drawing, it goes no further than 20 % of the
    way it usually goes in that time, or than 0.5 % of the drawing: slow hands and trembling ones are not pausing ones.
    """
    still = _still(motion)
    step = float(motion.times[1] - motion.times[0])
    turns = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int64)))
    way = np.concatenate([[0.0], np.cumsum(norms(np.diff(motion.points, axis=0)) * ~(still[1:] & still[:-1]))])
    found: list[Pause] = []
    for first, after in zip(turns[::2], turns[1::2], strict=True):
        duration = (after - 1 - first) * step
        share = float(duration / (motion.times[-1] - motion.times[0]))
        if share > least:
            place = float(way[first] / way[-1]) if way[-1] > 0 else 0.0
            found.append(Pause(float(motion.times[first]), float(duration), place, share))
    return tuple(found)


def extras(curve: Floats, positions: Floats, path: Floats, times: Floats) -> tuple[Detour, ...]:
    """Return which stretches of one drawing have no counterpart in the others'.

    ``curve`` (n, d) is the drawing at even steps of its way, ``times`` (n,) in s when it was there, ``positions``
    (m,) its sample at each even instant of the common ``path`` (m, d), NaN where it was not there. A stretch has no
    counterpart if 8 % of the way or more, beyond what is usual, is passed within 2 % of the path.
    """
    count = len(positions)
    known = np.flatnonzero(np.isfinite(positions))
    where = positions[known]
    skipped = skips(where, count)
    if not len(skipped):
        return ()
    over = np.convolve(skipped, np.ones(len(where) - len(skipped))) > 0
    turns = np.flatnonzero(np.diff(np.concatenate([[False], over, [False]]).astype(np.int64)))
    if not len(turns):
        return ()
    lengths, size, tree = arc_lengths(curve), diagonal(path), KDTree(path)
    index = np.arange(len(curve), dtype=np.float64)
    found: list[Detour] = []
    for first, after in zip(turns[::2], turns[1::2], strict=True):
        low, high = float(where[first]), float(where[after])
        inside = curve[int(np.ceil(low)) : int(high) + 1]
        away = float(tree.query(inside)[0].max())
        begun, ended = np.interp([low, high], index, times)
        place = float(known[first] + known[after]) / (2.0 * (count - 1))
        length = float(np.interp(high, index, lengths) - np.interp(low, index, lengths))
        found.append(Detour(place, float(begun), float(ended - begun), length, away, away < NEAR * size))
    return tuple(found)


def _still(motion: CleanMotion) -> Bools:
    """Return at which samples (n,) the hand stands still: all of a window about or beside each."""
    step = float(motion.times[1] - motion.times[0])
    half = max(1, round(0.5 * WINDOW * motion.crossing / step))
    if 2 * half + 1 > len(motion.points):
        return np.zeros(len(motion.points), dtype=bool)
    smooth = moving_average(motion.points, round(LENGTH_WINDOW * motion.crossing / step))
    count = len(smooth)
    within = [np.concatenate([np.full(half, axis[0]), axis, np.full(half, axis[-1])]) for axis in smooth.T]
    reach = np.zeros(count)
    for offset in sorted({round(half * look / LOOKED_AT) for look in range(1, LOOKED_AT + 1)} - {0}):
        gaps = [axis[offset:] - axis[:-offset] for axis in within]
        squares = np.sum([gap * gap for gap in gaps], axis=0)
        for begin in (half, half - offset):
            np.maximum(reach, squares[begin : begin + count], out=reach)
    limit = max(STILL * _usual_way(smooth, 2 * half + 1), STILL_SIZE * diagonal(motion.points))
    centres = (2.0 * np.sqrt(reach) < limit) & motion.known
    before = np.concatenate([np.zeros(half + 1, dtype=np.int64), np.cumsum(centres)])
    before = np.concatenate([before, np.full(half, before[-1])])
    return before[2 * half + 1 :] > before[:count]


def _usual_way(points: Floats, window: int) -> float:
    """Return the median way in m gone within ``window`` samples, by length gone: rests do not lower it."""
    lengths = arc_lengths(points)
    ways = np.sort(lengths[window:] - lengths[:-window])
    gone = np.cumsum(ways)
    return float(ways[int(np.searchsorted(gone, 0.5 * gone[-1]))]) if len(ways) and gone[-1] > 0 else 0.0
