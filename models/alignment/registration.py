"""The shape that a group of people drew: each laid upon the others, whoever started late, let go early or does not
fit found.

What belongs together is found on where the pen is, once place and size of each person's drawing are taken out, and
on which way
it moves: so a corner meets a corner although people put it at different places. The mean is taken of the drawings as
they lie.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from models.alignment.dtw import Indices, medoid, warp, warp_fast
from models.demonstration import Bools, Floats
from models.geometry import diagonal, middle, norms, parted
from models.phase import arc_lengths, at, corners, edges
from models.preprocessing.filtering import moving_average

MEDOID_POINTS = 64
MEDOID_CANDIDATES = 24
ROUNDS = 2
COARSE = 2
COARSEST = 4
SMOOTH = 5
DIRECTION_WEIGHT = 0.3
DIRECTION_WIDTH = 5.0
CORNER = 0.05
LEAST_CORNER = 0.01
STRAIGHT = 5.0
BESIDE_CORNER = 13
OF_EDGE = 4
LEAST_EDGE = 4
SKIPPED_IN = 0.02
LEAST_EXTRA = 0.08
OPEN_DISTANCE = 0.05
OPEN_PHASE = 0.02
OPEN_SPREAD = 3.0
FADING = 0.05
LEAST_COVER = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """u drawings laid upon each other at n instants of the common shape.

    ``positions`` (u, n): fractional sample of each drawing's n, NaN where it has nothing to say;
    ``first`` and ``last`` (u,): between which instants it was there; ``late`` and ``early`` (u,): whether that is a
    fault.
    ``weights`` (u, n): 0..1, fading where a drawing begins late or ends early, so that the mean does not jump there.
    """

    positions: Floats
    first: Floats
    last: Floats
    late: Bools
    early: Bools
    weights: Floats


def directions(curves: Floats) -> Floats:
    """Return the unit directions (..., n, d) in which curves (..., n, d) move, over five of their points."""
    smooth = gaussian_filter1d(curves, DIRECTION_WIDTH, axis=-2, mode="nearest")
    moves = np.gradient(smooth, axis=-2)
    away = norms(curves - curves.mean(axis=-2, keepdims=True))
    still = 1e-9 * away.max(axis=-1)[..., None] + 1e-300
    return moves / np.maximum(norms(moves), still)[..., None]


def reference_of(curves: Floats) -> int:
    """Return which of the curves (u, n, d) is nearest to the others: the medoid, of 24 if there are more."""
    chosen = some_of(curves, MEDOID_CANDIDATES)
    coarse = np.linspace(0, curves.shape[1] - 1, MEDOID_POINTS).round().astype(np.int64)
    return int(chosen[medoid(curves[chosen][:, coarse])])


def some_of(curves: Floats, most: int) -> Indices:
    """Return at most so many of the curves (u, n, d), evenly chosen from short to long: the same in whatever order
    they come.
    """
    if len(curves) <= most:
        return np.arange(len(curves))
    by_length = np.argsort(norms(np.diff(curves, axis=1)).sum(axis=1), kind="stable")
    return by_length[np.linspace(0, len(curves) - 1, most).round().astype(np.int64)]


def fitted_to(curves: Floats, positions: Floats, shape: Floats, weights: Floats) -> Floats:
    """Return the curves (u, n, d) moved and scaled so that what ``positions`` matches lies nearest to ``shape`` (n,
    d).
    """
    known = np.isfinite(positions)
    share = np.where(known, weights + 1e-9, 0.0)[:, :, None]
    share /= share.sum(axis=1, keepdims=True)
    own = np.where(known[:, :, None], taken(curves, positions), 0.0)
    middle = (share * own).sum(axis=1, keepdims=True)
    target = (share * shape).sum(axis=1, keepdims=True)
    size = (share * (own - middle) ** 2).sum(axis=(1, 2), keepdims=True)
    wanted = (share * (shape - target) ** 2).sum(axis=(1, 2), keepdims=True)
    scale = np.where(size > 0, np.sqrt(wanted / np.where(size > 0, size, 1.0)), 1.0)
    return (curves - middle) * scale + target


def register(
    curves: Floats, reference: int, method: str, radius: int, open_ends: tuple[bool, bool] = (True, True)
) -> Group:
    """Return how the curves (u, n, d), evenly sampled along their way, belong together, seen from one of them.

    ``open_ends``: whether somebody may have begun late, and let go early.
    """
    count, points = curves.shape[:2]
    shape = curves[reference]
    everyone = np.ones(count, dtype=bool)
    placed = fitted_to(curves, in_place(curves, shape)[1], shape, np.ones((count, points)))
    loose = warp(shape[::COARSE], placed[:, ::COARSE], everyone, everyone)
    first, last = loose.first * COARSE, loose.last * COARSE
    late, early = _open_sides(curves, placed, shape, loose.costs, first, last)
    late, early = late & open_ends[0], early & open_ends[1]
    positions = _finer(loose.positions, points)
    positions[last - first < LEAST_COVER * points] = np.arange(points, dtype=np.float64)
    weights = _fading(first, last, late, early, points)
    told = _direction_weight(shape)
    for turn in range(ROUNDS):
        size = diagonal(shape)
        fitted = fitted_to(curves, positions, shape, weights)
        features = np.concatenate([fitted / size, told * directions(fitted)], axis=2)
        target = np.concatenate([shape / size, told * directions(shape)], axis=1)
        last_turn = turn == ROUNDS - 1
        if method == "fastdtw" and last_turn:
            positions = np.stack([warp_fast(target, feature, radius) for feature in features])
            weights = np.ones_like(positions)
            first, last = np.zeros_like(first), np.full_like(last, points - 1)
            break
        step = 1 if last_turn else COARSE
        found = warp(target[::step], features[:, ::step], late, early)
        first, last = found.first * step, found.last * step
        positions = _whole(_finer(found.positions, points), late, early)
        weights = _fading(first, last, late, early, points)
        if not last_turn:
            shape, positions, weights = _evened(mean_of(taken(curves, positions), weights), positions, weights)
    if method != "fastdtw":
        points_there = taken(curves, positions)
        shape = mean_of(points_there, weights)
        positions = _by_length(positions, shape, _straightness(points_there, shape))
    return Group(positions, first / (points - 1.0), last / (points - 1.0), late, early, weights)


def _direction_weight(shape: Floats) -> float:
    """Return how much a unit of direction counts against one of place, in parts of the shape's (n, d) diagonal: 0.3,
    but no more than a place two edges away. In a weave of many small turns it would lay one turn upon the next.
    """
    return min(DIRECTION_WEIGHT, 2.0 * float(arc_lengths(shape)[-1]) / (edges(shape) * diagonal(shape)))


def in_place(curves: Floats, shape: Floats) -> tuple[Floats, Floats]:
    """Return the curves (u, n, d), and their positions (u, n) along the shape (n, d), either where they lie or moved
    to the shape's middle, as they lie nearest to it along what they drew of it.

    Who drew a part is where the shape is, who drew elsewhere is not. Along a straight edge both lie as near: who is
    shorter or longer than the shape by as much as it would have to be moved stays, but where half of that were gained.
    """
    count, points = curves.shape[:2]
    moves = shape.mean(axis=0) - curves.mean(axis=1, keepdims=True)
    moved = curves + moves
    everyone = np.ones(2 * count, dtype=bool)
    found = warp(shape[::COARSEST], np.concatenate([curves, moved])[:, ::COARSEST], everyone, everyone)
    positions = _finer(found.positions, points)
    gained = found.costs[:count] - found.costs[count:]
    far = norms(moves[:, 0])
    differ = np.abs(norms(np.diff(curves, axis=1)).sum(axis=1) - norms(np.diff(shape, axis=0)).sum())
    stays = (gained <= 0.0) | ((differ > far) & (gained < 0.5 * far))
    return (
        np.where(stays[:, None, None], curves, moved),
        np.where(stays[:, None], positions[:count], positions[count:]),
    )


def skips(positions: Floats, points: int) -> Bools:
    """Return from which of rising positions (..., m) on, in a drawing of ``points`` points, 8 % more of its way than
    usual are passed within 2 % of the shape: (..., m - reach).
    """
    reach = max(1, round(SKIPPED_IN * points))
    return (positions[..., reach:] - positions[..., :-reach]) / (points - 1.0) > LEAST_EXTRA + SKIPPED_IN


def touched(skipped: Bools, points: int, low: int, high: int) -> Bools:
    """Return who (u,) skips (u, points - reach), as ``skips`` says, somewhere between two instants of the shape."""
    reach = points - skipped.shape[1]
    return np.asarray(skipped[:, max(0, low - reach + 1) : high].any(axis=1))


def _straightness(points: Floats, shape: Floats) -> float:
    """Return how far in m the mean shape (n, d) of aligned drawings (u, n, d) may stray from a straight edge by chance:
    five of its standard errors, each one's place taken out; between 1 and 5 % of the drawing.
    """
    rests = points - shape
    rests = rests - np.nanmean(rests, axis=1, keepdims=True)
    error = float(np.sqrt(np.nanmean((rests * rests).sum(axis=2)) / max(1, len(points) - 1)))
    size = diagonal(shape)
    return float(np.clip(STRAIGHT * error, LEAST_CORNER * size, CORNER * size))


def _by_length(positions: Floats, shape: Floats, tolerance: float) -> Floats:
    """Return positions (u, n) that pass each edge of the shape (n, d) evenly, by the drawing's own length. An edge is
    straight to within ``tolerance`` m.

    Where nothing tells one place of an edge from another, a warp lays chance wave upon chance wave, and the mean waves
    as if all had meant it. So a warp counts within 13 points of a corner, or a quarter of an edge that is short;
    between them, length does, but where a drawing has a stretch that the others do not have.
    """
    positions, count = positions.copy(), len(shape)
    skipped = skips(positions, count)
    found = corners(moving_average(shape, SMOOTH), tolerance)
    for first, last in pairwise(found):
        beside = min(BESIDE_CORNER, (last - first) // OF_EDGE)
        low, high = first + beside * (first > 0), last - beside * (last < count - 1)
        if high - low < LEAST_EDGE:
            continue
        stretch = positions[:, low : high + 1]
        whole = np.isfinite(stretch).all(axis=1) & ~touched(skipped, count, low, high)
        stretch[whole] = np.linspace(stretch[whole, 0], stretch[whole, -1], high - low + 1, axis=1)
    return positions


def _whole(positions: Floats, late: Bools, early: Bools) -> Floats:
    """Return positions (u, n) that begin with the first and end with the last sample of all who drew that end.

    Many samples may match one instant, and their mean is inside the drawing: the ends would be drawn in. What is
    missing at an end is caught up over 5 % of the shape.
    """
    positions = positions.copy()
    count = positions.shape[1]
    rising = np.clip(1.0 - np.arange(count) / (FADING * count), 0.0, 1.0)
    positions[~late] -= positions[~late, :1] * rising
    positions[~early] += (count - 1.0 - positions[~early, -1:]) * rising[::-1]
    return positions


def _finer(positions: Floats, points: int) -> Floats:
    """Return positions (u, n) found on every other sample for all of them (u, points); NaN beyond what was found."""
    step = points // positions.shape[1]
    if step == 1:
        return positions
    index = np.arange(points, dtype=np.float64)
    finer = np.full((len(positions), points), np.nan)
    for u, own in enumerate(positions):
        known = np.flatnonzero(np.isfinite(own))
        inside = (index >= step * known[0]) & (index <= step * known[-1] + (step - 1) * (known[-1] == len(own) - 1))
        finer[u, inside] = np.interp(index[inside], step * known, step * own[known])
    return finer


def taken(curves: Floats, positions: Floats) -> Floats:
    """Return the points (u, n, d) of curves at fractional positions (u, n); NaN stays NaN."""
    everyone = np.arange(len(curves))[:, None]
    before = np.clip(np.nan_to_num(positions).astype(np.int64), 0, curves.shape[1] - 2)
    share = (positions - before)[:, :, None]
    return (1.0 - share) * curves[everyone, before] + share * curves[everyone, before + 1]


def mean_of(points: Floats, weights: Floats) -> Floats:
    """Return the weighted mean (n, m) of values (u, n, m), NaN left out."""
    known = np.isfinite(points)
    share = np.where(known, weights[:, :, None], 0.0)
    return (share * np.where(known, points, 0.0)).sum(axis=0) / np.maximum(share.sum(axis=0), 1e-12)


def _open_sides(
    curves: Floats, placed: Floats, shape: Floats, apart: Floats, first: Indices, last: Indices
) -> tuple[Bools, Bools]:
    """Return who (u,) started late and who let go early.

    Someone did if the drawing's end is far from the median end, as drawn and as ``placed`` onto the shape: than 5 % of
    the diagonal and than three times the others' usual distance; or, as many may stop early as not, if the drawing is
    of a group that stops where nobody else does, against how far they all are from the shape, ``apart`` (u,) in m. And
    if the open warp leaves at least 2 % of the shape unmatched there, and matches 30 % of it at all; and if the drawing
    is shorter than the whole ones, nearer to what is matched than to all of it.
    """
    size, most = diagonal(shape), len(shape) - 1
    missing = (first + most - last) / most
    lengths = norms(np.diff(placed, axis=1)).sum(axis=1)
    whole = missing <= OPEN_PHASE
    usual = float(np.median(lengths[whole] if whole.any() else lengths))
    partial = (last - first >= LEAST_COVER * len(shape)) & (lengths < (1.0 - 0.5 * missing) * usual)
    sides: list[Bools] = []
    for side, unmatched in ((0, first), (-1, most - last)):
        far = np.ones(len(curves), dtype=bool)
        for values in (curves, placed):
            away = norms(values[:, side] - middle(values[:, side]))
            far &= away > max(OPEN_DISTANCE * size, OPEN_SPREAD * float(np.median(away)))
        whole_ones = parted(-unmatched / most * usual, float(np.median(apart)))
        far |= ~whole_ones & bool(whole_ones.any())
        far &= partial & (unmatched > OPEN_PHASE * most)
        sides.append(far)
    return sides[0], sides[1]


def _fading(first: Indices, last: Indices, late: Bools, early: Bools, points: int) -> Floats:
    """Return weights (u, n): one, but rising over 5 % of the shape after a late start and falling before an early
    end.
    """
    instants = np.arange(points)[None, :]
    width = FADING * points
    rising = np.where(late[:, None], np.clip((instants - first[:, None] + 1) / width, 0.0, 1.0), 1.0)
    falling = np.where(early[:, None], np.clip((last[:, None] - instants + 1) / width, 0.0, 1.0), 1.0)
    return rising * falling


def _evened(shape: Floats, positions: Floats, weights: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the shape at even steps of its length, and positions and weights at the same instants."""
    lengths = arc_lengths(shape)
    index = np.arange(len(shape), dtype=np.float64)
    where = np.interp(np.linspace(0.0, lengths[-1], len(shape)), lengths, index)
    moved = np.full_like(positions, np.nan)
    for u, own in enumerate(positions):
        known = np.flatnonzero(np.isfinite(own))
        inside = (where >= known[0]) & (where <= known[-1])
        moved[u, inside] = np.interp(where[inside], index[known], own[known])
    return at(where, index, shape), moved, np.stack([np.interp(where, index, row) for row in weights])
