"""From a recording to a clean motion: gaps, reflections, tremble. All windows come from the drawing itself: from how
long its hand needs for 2 % of it. So a slower or larger drawing is cleaned as the same one, only slower or larger.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from models.demonstration import Bools, Demonstration, Floats
from models.errors import UnusableDemonstration
from models.geometry import diagonal, middle, norms, ranked, usual_size
from models.phase import arc_lengths, edges
from models.preprocessing.despiking import reflections
from models.preprocessing.resting import waiting, without

LEAST_SAMPLES = 4
MOST_SAMPLES = 20_000
CROSSED = 0.02
LEAST_GAP = 8
WIDEST_BRIDGE = 0.1
SHORTEST_MOTION = 1e-3
FINEST_STEP = 0.1
STRIDES = 128
QUICKEST = 0.15
THROWN = 3.0
TURNS = 512
OF_EDGE = 0.25
RESTING = 0.1
LENGTH_WINDOW = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class CleanMotion:
    """A recording without its faults, on an even grid of time.

    ``times`` (n,) in s; ``points`` (n, d) in m; ``triggers`` (n,); ``known`` (n,): False inside gaps too long to
    bridge; ``orientations`` (n, 4) or None; ``used`` (r,): which raw samples are neither lost, struck nor reflections;
    ``gap``: the longest stretch in s that is not known; ``crossing``: in how many s this hand crosses 2 % of the
    drawing. A closed drawing may have been turned to another start: then the recording is followed from ``begun`` s on,
    and what came before has times later by ``period`` s.
    """

    demonstration_id: str
    times: Floats
    points: Floats
    triggers: Bools
    known: Bools
    orientations: Floats | None
    used: Bools
    gap: float
    crossing: float
    begun: float = 0.0
    period: float = 0.0


def check(demonstration: Demonstration) -> None:
    """Raise UnusableDemonstration, with what to do, if this recording is not one of a motion at all."""
    times, points = demonstration.times, demonstration.points
    if points.ndim != 2 or points.shape[1] not in {2, 3}:
        raise UnusableDemonstration(f"positions have shape {points.shape}: two or three columns are needed")
    count, columns = len(points), np.asfortranarray(points)
    if times.shape != (count,) or demonstration.triggers.shape != (count,):
        raise UnusableDemonstration("times, positions and triggers differ in length: export the recording again")
    if demonstration.orientations is not None and demonstration.orientations.shape != (count, 4):
        raise UnusableDemonstration("orientations need four values (x y z w) a sample: export the recording again")
    if count < LEAST_SAMPLES:
        raise UnusableDemonstration(f"{count} samples are no motion: record it again")
    if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        raise UnusableDemonstration(
            "times have to be finite and to rise from sample to sample: export the recording again"
        )
    seen: Bools = np.asarray(np.isfinite(columns).all(axis=1))
    if int(seen.sum()) < LEAST_SAMPLES:
        raise UnusableDemonstration("the marker was lost nearly throughout: check the cameras and record it again")
    positions = _rows(columns, seen)
    if np.abs(positions).max() > 1e6:
        raise UnusableDemonstration("positions beyond a thousand kilometres: check the export's units")
    if diagonal(positions) < SHORTEST_MOTION:
        raise UnusableDemonstration("nothing moves further than 1 mm: record it again")


def clean(demonstration: Demonstration, struck: frozenset[int], filter_window: float, despiking: bool) -> CleanMotion:
    """Return the recording bridged and smoothed by a moving average of ``filter_window`` s.

    With ``despiking`` rests longer than the task are taken out of the clock until the end, reflections are taken out,
    recordings of more samples than ten to 2 % of the drawing are thinned by middles, and the filter is never longer
    than the hand needs for 2 % of the drawing (zero: just so long), nor for a quarter of an edge, so that fast people
    keep their corners, and weaves their width.
    """
    check(demonstration)
    times = demonstration.times - demonstration.times[0]
    points = np.asfortranarray(demonstration.points, dtype=np.float64)
    usable: Bools = np.asarray(np.isfinite(points).all(axis=1))
    usable[np.fromiter((index for index in struck if index < len(usable)), dtype=np.int64)] = False
    kept = np.flatnonzero(usable)
    if len(kept) < LEAST_SAMPLES:
        raise UnusableDemonstration("fewer than four samples are left after striking: include some again")
    seen, places = times[kept], _rows(points, usable)
    clock = seen
    if despiking:
        waits = waiting(seen, places)
        if waits.any():
            kept, places = kept[~waits], _rows(places, ~waits)
            clock, seen = seen[~waits], without(seen, waits)
    moving = seen
    if despiking:
        seen, places, wrong = _without_reflections(seen, places)
        usable[kept[wrong]] = False
    step = float(ranked(np.diff(seen), 0.5))
    count = max(LEAST_SAMPLES, round((seen[-1] - seen[0]) / step) + 1)
    grid = np.linspace(seen[0], seen[-1], min(count, MOST_SAMPLES))
    triggers = demonstration.triggers[_nearest(times, np.interp(grid, moving, clock))]
    smooth, crossing = _smoothed(grid, _resampled(seen, places, grid), triggers, filter_window, despiking)
    if clock is not moving:  # the rests are put back: the hand stands still meanwhile
        count = min(max(len(grid), round((clock[-1] - clock[0]) / step) + 1), MOST_SAMPLES)
        whole = np.linspace(clock[0], clock[-1], count)
        smooth = _resampled(grid, smooth, np.interp(whole, clock, moving))
        seen, grid, triggers = np.interp(seen, moving, clock), whole, demonstration.triggers[_nearest(times, whole)]
    known, gap = _without_gaps(seen, places, grid)
    return CleanMotion(
        demonstration.demonstration_id,
        grid,
        smooth,
        triggers,
        known,
        _turned(times[usable], demonstration.orientations, usable, grid),
        usable,
        gap,
        crossing,
    )


def _without_reflections(seen: Floats, places: Floats) -> tuple[Floats, Floats, Bools]:
    """Return times (b,) and places (b, d), thinned, without what is no place of a hand; and which samples that was."""
    size = usual_size(_some(places))
    crossing = _crossing(seen, places, size)
    block = int(FINEST_STEP * crossing / float(ranked(np.diff(seen), 0.5)))
    middles, medians = _thinned(seen, places, block)
    wrong = reflections(middles, medians, crossing, size)
    if block <= 1 and not wrong.any():
        return seen, places, np.zeros(len(seen), dtype=bool)
    if len(middles) - int(wrong.sum()) < LEAST_SAMPLES:
        raise UnusableDemonstration("reflections throughout: check the cameras and record it again")
    return middles[~wrong], _rows(medians, ~wrong), np.repeat(wrong, _block_sizes(len(seen), block))


def _smoothed(
    grid: Floats, even: Floats, triggers: Bools, filter_window: float, despiking: bool
) -> tuple[Floats, float]:
    """Return even samples (n, d) averaged, each press of the button by itself, and s in which 2 % are crossed."""
    size, parts = diagonal(even), [slice(None)]
    if despiking:
        parts = _presses(triggers)
        if len(parts) > 1:
            size = min(size, max((diagonal(even[part]) for part in parts if triggers[part][0]), default=np.inf))
    crossing = _crossing(grid, even, size)
    if despiking:
        filter_window = min(filter_window or crossing, crossing)
    window = round(filter_window * (len(grid) - 1) / (grid[-1] - grid[0]))
    smooth = np.concatenate([moving_average(even[part], window) for part in parts])
    if despiking and (shorter := _of_an_edge(smooth, size)) < 1.0:
        window = round(shorter * window)
        smooth = np.concatenate([moving_average(even[part], window) for part in parts])
    if diagonal(smooth) < SHORTEST_MOTION:
        raise UnusableDemonstration(
            "nothing moves further than 1 mm but for reflections and trembling: record it again"
        )
    return smooth, crossing


def travelled(motion: CleanMotion) -> Floats:
    """Return how much of its way a motion has gone at each of its samples: (n,), from 0 to 1, rising.

    Trembling at rest is no way: speeds under a tenth of the median hardly count.
    """
    step = float(motion.times[1] - motion.times[0])
    smooth = moving_average(motion.points, round(LENGTH_WINDOW * motion.crossing / step))
    lengths = norms(np.diff(smooth, axis=0))
    moving = lengths[lengths > 0]
    if not len(moving):
        return np.linspace(0.0, 1.0, len(motion.times))
    least = RESTING * float(ranked(moving, 0.5))
    counted = np.where(lengths > least, lengths, 1e-3 * lengths) + 1e-9 * float(lengths.sum()) / len(lengths)
    way = np.concatenate([[0.0], np.cumsum(counted)])
    return way / way[-1]


def _presses(triggers: Bools) -> list[slice]:
    """Return the stretches in which the button is held, and not: what comes before a bead is not averaged into it."""
    turns = [0, *(np.flatnonzero(triggers[1:] != triggers[:-1]) + 1).tolist(), len(triggers)]
    return [slice(first, after) for first, after in pairwise(turns)]


def _rows(points: Floats, chosen: Bools) -> Floats:
    """Return the chosen rows of points (n, d), each column in one piece of memory: what follows is much quicker."""
    return points if chosen.all() else points.T[:, chosen].T


def _thinned(times: Floats, points: Floats, block: int) -> tuple[Floats, Floats]:
    """Return mean times (b,) and middle points (b, d) of each ``block`` samples; the ends stay where they are.

    The middle is the mean where the samples keep together, and the geometric median where one is thrown off.
    """
    if block < 2:
        return times, points
    whole = len(times) // block * block
    parts = [points[first:whole:block] for first in range(block)]
    middles = np.sum([times[first:whole:block] for first in range(block)], axis=0) / block
    places = np.add.reduce(parts) / block
    furthest = np.maximum.reduce([norms(part - places) for part in parts])
    thrown = np.flatnonzero(furthest > THROWN * float(ranked(furthest, 0.5)))
    rest = np.full((int(whole < len(times)), block, points.shape[1]), np.nan)
    if len(thrown) or len(rest):
        rest[:, : len(times) - whole] = points[whole:]
        unsure = middle(np.concatenate([np.stack([part[thrown] for part in parts], axis=1), rest]))
        places[thrown] = unsure[: len(thrown)]
        places = np.concatenate([places, unsure[len(thrown) :]])
    if len(rest):
        middles = np.append(middles, times[whole:].mean())
    middles[0], middles[-1] = times[0], times[-1]
    return middles, np.asfortranarray(places)


def _block_sizes(count: int, block: int) -> NDArray[np.int64]:
    if block < 2:
        return np.ones(count, dtype=np.int64)
    sizes = np.full(-(-count // block), block, dtype=np.int64)
    sizes[-1] = count - block * (len(sizes) - 1)
    return sizes


def _nearest(times: Floats, grid: Floats) -> NDArray[np.int64]:
    """Return the index (n,) of the sample that is nearest in time to each instant of the grid."""
    return np.floor(np.interp(grid, times, np.arange(len(times), dtype=np.float64)) + 0.5).astype(np.int64)


def _turned(times: Floats, orientations: Floats | None, usable: Bools, grid: Floats) -> Floats | None:
    """Return the unit quaternions (n, 4) on the grid, or None where none were recorded."""
    if orientations is None:
        return None
    mixed = _resampled(times, continuous(orientations[usable]), grid)
    return mixed / norms(mixed)[:, None]


def moving_average(points: Floats, window: int) -> Floats:
    """Return points (n, d) averaged over ``window`` samples; point symmetry at both ends keeps the ends where they
    are.
    """
    half = min(window // 2, (len(points) - 1) // 2)
    if half < 1:
        return points
    before = 2 * points[0] - points[half:0:-1]
    after = 2 * points[-1] - points[-2 : -half - 2 : -1]
    sums = np.cumsum(np.concatenate([np.zeros((1, points.shape[1])), before, points, after]), axis=0)
    width = 2 * half + 1
    return (sums[width:] - sums[:-width]) / width


def continuous(quaternions: Floats) -> Floats:
    """Return unit quaternions (n, 4) whose sign does not jump from sample to sample."""
    unit = quaternions / norms(quaternions)[:, None]
    turns = (unit[1:] * unit[:-1]).sum(axis=1) < 0
    signs = np.concatenate([[1.0], np.where(np.cumsum(turns) % 2 == 1, -1.0, 1.0)])
    return unit * signs[:, None]


def _without_gaps(times: Floats, points: Floats, grid: Floats) -> tuple[Bools, float]:
    """Return where on the grid (n,) the motion is known, and the longest gap in s that is not bridged.

    A gap is bridged if the hand hardly moved meanwhile: pens send nothing while they rest.
    """
    spans = np.diff(times)
    long = np.flatnonzero(spans > LEAST_GAP * float(ranked(spans, 0.5)))
    wide = long[norms(points[long + 1] - points[long]) > WIDEST_BRIDGE * diagonal(points)] if len(long) else long
    known = np.ones(len(grid), dtype=bool)
    for gap in wide:
        known &= (grid <= times[gap]) | (grid >= times[gap + 1])
    return known, float(spans[wide].max(initial=0.0))


def _some(points: Floats) -> Floats:
    """Return about 128 of values (n, ...), evenly chosen."""
    return points[:: max(1, len(points) // STRIDES)]


def _crossing(times: Floats, points: Floats, size: float) -> float:
    """Return the time in s in which the hand crosses 2 % of a drawing of this size, at the pace at which it goes half
    of its way: rests do not lower it. It is measured over 128 strides, so that trembling is no pace; the quickest
    strides may be reflections. Who goes all of the way needs 2 % of the recording for it at most.
    """
    places, instants = _some(points), _some(times)
    paces = norms(places[1:] - places[:-1]) / (instants[1:] - instants[:-1])
    paces.sort()
    paces = paces[: max(1, round((1.0 - QUICKEST) * len(paces)))]
    gone = np.cumsum(paces)
    usual = float(paces[int(np.searchsorted(gone, 0.5 * gone[-1]))])
    longest = CROSSED * float(times[-1] - times[0])
    return min(CROSSED * size / usual, longest) if usual > 0 else longest


def _of_an_edge(points: Floats, size: float) -> float:
    """Return a quarter of an edge of the drawing (n, d), in parts of what is averaged, 2 % of its size; 1 where it
    turns too little for edges half as short as that.
    """
    moves = np.diff(_some(points), axis=0)
    lengths = norms(moves)
    if not size or not lengths.any():  # one place: reflections took the rest
        return 1.0
    moving = lengths > RESTING * float(lengths.mean())
    ahead = moves[moving] / lengths[moving][:, None]
    most = OF_EDGE * float(lengths.sum()) / (CROSSED * size)
    if float(norms(np.diff(ahead, axis=0)).sum()) < 2.0 * most:
        return 1.0
    some = points[:: max(1, len(points) // TURNS)]
    return min(1.0, OF_EDGE * float(arc_lengths(some)[-1]) / (edges(some) * CROSSED * size))


def _resampled(times: Floats, values: Floats, grid: Floats) -> Floats:
    return np.stack([np.interp(grid, times, column) for column in values.T]).T
