"""From a recording to a clean motion: gaps, reflections, tremble. All windows are in seconds and millimetres, never in samples."""

# numpy and scipy leave many results untyped: what leaves a function here is typed by its signature.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from models.demonstration import Bools, Demonstration, Floats
from models.errors import UnusableDemonstration

DESPIKE_WINDOW = 0.15
BRISK = 0.9
JUMP = 8.0
JUMP_REACH = 0.015
LOOK_BACK = 50
FILTER_REACH = 0.02
DESPIKE_PASSES = 4
DESPIKE_FLOOR = 0.5e-3
DEVIATION_FROM_MAD = 1.4826
LONGEST_BRIDGE = 0.3
WIDEST_BRIDGE = 0.05
SHORTEST_MOTION = 1e-3
FINEST_STEP = 5e-3


@dataclass(frozen=True, slots=True, eq=False)
class CleanMotion:
    """A recording without its faults, on an even grid of time.

    ``times`` (n,) in s; ``points`` (n, d) in m; ``triggers`` (n,); ``known`` (n,): False inside gaps too long to bridge;
    ``orientations`` (n, 4) or None; ``spikes``: raw samples taken for reflections; ``rate`` in samples a second.
    """

    demonstration_id: str
    times: Floats
    points: Floats
    triggers: Bools
    known: Bools
    orientations: Floats | None
    used: Bools
    spikes: int
    gap: float


def check(demonstration: Demonstration) -> None:
    """Raise UnusableDemonstration, with what to do, if this recording is not one of a motion at all."""
    times, points = demonstration.times, demonstration.points
    if points.ndim != 2 or points.shape[1] not in {2, 3}:
        raise UnusableDemonstration(f"positions have shape {points.shape}: two or three columns are needed")
    count = len(points)
    if times.shape != (count,) or demonstration.triggers.shape != (count,):
        raise UnusableDemonstration("times, positions and triggers differ in length: export the recording again")
    if demonstration.orientations is not None and demonstration.orientations.shape != (count, 4):
        raise UnusableDemonstration("orientations need four values (x y z w) a sample: export the recording again")
    if count < 4:
        raise UnusableDemonstration(f"{count} samples are no motion: record it again")
    if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        raise UnusableDemonstration(
            "times have to be finite and to rise from sample to sample: export the recording again"
        )
    seen = np.isfinite(points).all(axis=1)
    if int(seen.sum()) < 4:
        raise UnusableDemonstration("the marker was lost nearly throughout: check the cameras and record it again")
    if np.abs(points[seen]).max() > 1e6:
        raise UnusableDemonstration("positions beyond a thousand kilometres: check the export's units")
    reach = np.ptp(points[seen], axis=0)
    if float(np.sqrt((reach * reach).sum())) < SHORTEST_MOTION:
        raise UnusableDemonstration("nothing moves further than 1 mm: record it again")


def clean(demonstration: Demonstration, struck: frozenset[int], filter_window: float, despiking: bool) -> CleanMotion:
    """Return the recording despiked (if asked), bridged and smoothed by a moving average of ``filter_window`` s."""
    check(demonstration)
    times = demonstration.times - demonstration.times[0]
    points = np.array(demonstration.points, dtype=np.float64)
    usable: Bools = np.asarray(np.isfinite(points).all(axis=1))
    usable[np.fromiter((index for index in struck if index < len(usable)), dtype=np.int64)] = False
    if int(usable.sum()) < 4:
        raise UnusableDemonstration("fewer than four samples are left after striking: include some again")
    spikes = np.zeros(len(points), dtype=bool)
    if despiking:
        spikes[usable] = reflections(times[usable], points[usable])
        usable &= ~spikes
    first, last = np.flatnonzero(usable)[[0, -1]]
    kept = np.flatnonzero(usable)
    step = max(float(np.median(np.diff(times[kept]))), FINEST_STEP if despiking else 0.0)
    count = max(4, round((times[last] - times[first]) / step) + 1)
    grid = np.linspace(times[first], times[last], count)
    even = _resampled(times[kept], points[kept], grid)
    if despiking:
        filter_window = min(filter_window, _crossing_time(grid, even))
    smooth = moving_average(even, round(filter_window * (count - 1) / (grid[-1] - grid[0])))
    nearest = np.clip(np.searchsorted(times, grid), 1, len(times) - 1)
    nearest -= (grid - times[nearest - 1]) < (times[nearest] - grid)
    orientations = None
    if demonstration.orientations is not None:
        orientations = _resampled(times[kept], continuous(demonstration.orientations[kept]), grid)
        orientations /= np.sqrt((orientations * orientations).sum(axis=1, keepdims=True))
    known, gap = _without_gaps(times[kept], points[kept], grid)
    return CleanMotion(
        demonstration.demonstration_id,
        grid,
        smooth,
        demonstration.triggers[nearest],
        known,
        orientations,
        usable,
        int(spikes.sum()),
        gap,
    )


def reflections(times: Floats, points: Floats) -> Bools:
    """Return which samples (n,) are no positions of the hand: off its track, or off the median of their neighbours.

    Hampel's test, over all axes together: a sample is a reflection if it is further from the running median (0.15 s) than
    three deviations (from the running median of those distances), than 0.5 mm and than a brisk hand comes in that time.
    """
    found = _off_the_track(times, points)
    for _ in range(DESPIKE_PASSES):
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
    speeds = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)) / spans
    fastest = JUMP * float(np.quantile(speeds, BRISK))
    extent = np.quantile(points, 0.95, axis=0) - np.quantile(points, 0.05, axis=0)
    slack = JUMP_REACH * float(np.sqrt((extent * extent).sum()))
    starts = np.concatenate([[0], np.flatnonzero(speeds * spans > fastest * spans + slack) + 1])
    ends = np.append(starts[1:], len(points)) - 1
    if len(starts) == 1:
        return np.zeros(len(points), dtype=bool)
    chain = (ends - starts + 1).astype(np.float64)
    before = np.full(len(starts), -1)
    for segment in range(1, len(starts)):
        earlier = np.arange(max(0, segment - LOOK_BACK), segment)
        away = np.sqrt(((points[ends[earlier]] - points[starts[segment]]) ** 2).sum(axis=1))
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
    half = max(2, round(0.5 * DESPIKE_WINDOW / float(np.median(np.diff(times)))))
    window = 2 * min(half, (len(points) - 1) // 2) + 1
    middle = np.column_stack([median_filter(axis, size=window, mode="nearest") for axis in points.T])
    away = np.sqrt(((points - middle) ** 2).sum(axis=1))
    usual = DEVIATION_FROM_MAD * median_filter(away, size=window, mode="nearest")
    speeds = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)) / np.diff(times)
    reach = 0.5 * DESPIKE_WINDOW * float(np.quantile(speeds, BRISK))
    return away > np.maximum(3.0 * usual, max(DESPIKE_FLOOR, reach))


def moving_average(points: Floats, window: int) -> Floats:
    """Return points (n, d) averaged over ``window`` samples; point symmetry at both ends keeps the ends where they are."""
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
    unit = quaternions / np.sqrt((quaternions * quaternions).sum(axis=1, keepdims=True))
    turns = (unit[1:] * unit[:-1]).sum(axis=1) < 0
    signs = np.concatenate([[1.0], np.where(np.cumsum(turns) % 2 == 1, -1.0, 1.0)])
    return unit * signs[:, None]


def _without_gaps(times: Floats, points: Floats, grid: Floats) -> tuple[Bools, float]:
    """Return where on the grid (n,) the motion is known, and the longest gap in s that is not bridged.

    A gap is bridged if it is short, or if the hand hardly moved meanwhile: pens send nothing while they rest.
    """
    spans = np.diff(times)
    moved = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    reach = np.ptp(points, axis=0)
    size = float(np.sqrt((reach * reach).sum()))
    wide = (spans > max(LONGEST_BRIDGE, 8.0 * float(np.median(spans)))) & (moved > WIDEST_BRIDGE * size)
    known = np.ones(len(grid), dtype=bool)
    for gap in np.flatnonzero(wide):
        known &= (grid <= times[gap]) | (grid >= times[gap + 1])
    return known, float(spans[wide].max()) if wide.any() else 0.0


def _crossing_time(times: Floats, points: Floats) -> float:
    """Return the time in s in which the hand usually crosses 2 % of the drawing: a longer filter would cut its corners."""
    reach = np.ptp(points, axis=0)
    lengths = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    usual = float(np.median(lengths[lengths > 0])) / float(times[1] - times[0])
    return FILTER_REACH * float(np.sqrt((reach * reach).sum())) / usual


def _resampled(times: Floats, values: Floats, grid: Floats) -> Floats:
    return np.column_stack([np.interp(grid, times, column) for column in values.T])
