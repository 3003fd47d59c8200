"""How components hand over to each other: narrow at corners, wide on curves, and lines that fit the path given the
hand-over.

The tied mixture says where on the clock each component lives. Its regression is a chain of straight pieces with
hand-overs
as narrow as the bins are; on a curve that is a chain of kinks. So the extent Sigma_11 of every component is divided
by a
``sharpness`` chosen by the data (below one: wide), and the line of each component is fitted anew by least squares to
the mean path under these hand-overs. Both are stored in the same two arrays and read by the same equations 4 to 6.

Only the distance across the path counts in that fit: a point may slide along the path, which changes when, not where.
"""

# numpy and scipy leave many results untyped: what leaves a function here is typed by its signature.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from models.demonstration import Floats
from models.evaluation import smoothness
from models.geometry import diagonal, norms
from models.group import directions
from models.mixture import Mixture, fit_tied, in_bins
from models.phase import at
from models.polygons import edges_of
from models.regression import activations

CURVE_COMPONENTS = (6, 8, 10, 12, 16, 20, 24, 32)
LONG_CURVE_COMPONENTS = (48, 64)
LONG_CURVE_TOLERANCE = 0.006
CURVE_SHARPNESS = (0.25, 0.4)
POLYGON_SHARPNESS = (4.0, 3.0, 2.5, 2.0, 1.7, 1.4)
CORNER_MISS = 0.001
ASTRAY = 0.006
CORNER_REACH = 0.02
CORNER_WEIGHT = 3.0
BENDING = (0.0, 0.65)
BENDING_WIDTH = 0.01
BENT_RMS = 0.0016
BENT_MAX = 0.006
TOLERANCES = (0.0012, 0.0015, 0.0018, 0.0022, 0.003, 0.004)
UNCERTAINTY = 0.05
NEAR = 0.003
ROUGH = -13.0
TURN_MISS = 0.01
MOST_PARTS = 4
ALONG = 0.003
RIDGE = 1e-4
WINDOW = 0.08
NARROW_WINDOW = 0.04
STAYING = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Handover:
    """Where on the clock (0..1) each of K components lives: ``centres`` (K,) and ``extents`` (K,), standard
    deviations.
    """

    centres: Floats
    extents: Floats

    def basis(self, clock: Floats) -> Floats:
        """Return the 2 K functions (n, 2 K) that the path is a sum of: h_k(s), and h_k(s) (s - centre_k) / extent_k."""
        covariances = (self.extents**2)[:, None, None]
        weights = activations(self.centres[:, None], covariances, clock)
        return np.concatenate([weights, weights * (clock[:, None] - self.centres) / self.extents], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A hand-over and the lines ``coefficients`` (2 K, d) under it."""

    handover: Handover
    coefficients: Floats


@dataclass(frozen=True, slots=True, eq=False)
class JudgedFit(Fit):
    """A fit, how far its path is from the mean (rms and largest, m), its smoothness (log dimensionless jerk)."""

    rms: float
    furthest: float
    smoothness: float


@dataclass(frozen=True, slots=True, eq=False)
class MeanPath:
    """The mean path of people, ``points`` (n, d) in m at even clock steps 0..1, and how sure it is.

    ``uncertainty``: its standard error in m as they drew; ``wavering``: that across the path once each one's place,
    turn and size are taken out. ``turned`` (n, 4): the mean orientation, if any.
    """

    points: Floats
    uncertainty: float
    wavering: float
    turned: Floats | None = None


def fit_handover(people: MeanPath, samples: Floats, components: int) -> Fit:
    """Return the hand-over and lines for the people's mean path.

    ``samples`` (r, 1 + d): clock and position of all demonstrations, for the mixture; ``components``: how many, 0 to
    choose. A polygon gets one for each edge (more if the tool turns too much along an edge) and the widest hand-over
    that does not cut its corners by 0.1 % of the diagonal more than the sharpest does. A curve gets the fewest
    components that follow the mean closely and smoothly (``_smooth_curve``).
    """
    mean, turned, uncertainty = people.points, people.turned, people.uncertainty
    size = diagonal(mean)
    found, polygon = edges_of(mean, people.wavering)
    if polygon and components in {0, len(found) - 1}:
        fewer = [count for count in CURVE_COMPONENTS if count < len(found) and not components]
        if not any(
            fit.rms <= BENT_RMS * size and fit.furthest <= BENT_MAX * size
            for fit in _curves(mean, fewer, CURVE_SHARPNESS)
        ):
            return _polygon(mean, samples, _divided(mean, samples, found, turned if not components else None))
    if not components:
        return _smooth_curve(mean, uncertainty)
    tied = _clocks(fit_tied(samples, in_bins(samples, np.linspace(0.0, 1.0, components + 1))))
    widths = (*CURVE_SHARPNESS, 0.7, 1.0, *reversed(POLYGON_SHARPNESS))
    tried = [_judged(mean, _fit(mean, _sharpened(tied, sharpness))) for sharpness in widths]
    near = max(NEAR * size, UNCERTAINTY * uncertainty)
    return next((fit for fit in tried if fit.furthest <= near), min(tried, key=lambda fit: fit.furthest))


def _smooth_curve(mean: Floats, uncertainty: float) -> Fit:
    """Return the hand-over and lines that follow a curve's mean path (n, d) smoothly.

    Of the tolerances 0.12 % to 0.4 % of the diagonal (or a twentieth of the mean's standard error) the first counts
    that some fit keeps everywhere without being rougher than a hand; of those fits the smoothest with the fewest
    components. A path of many turns is rough by itself: there the smoothest of those that keep 0.6 % counts, with up to
    64 components; where none does, the nearest one.
    """
    limits = [max(tolerance * diagonal(mean), UNCERTAINTY * uncertainty) for tolerance in TOLERANCES]
    fits: list[JudgedFit] = []
    for count in CURVE_COMPONENTS:
        fits += _curves(mean, (count,), CURVE_SHARPNESS)
        if any(fit.smoothness >= ROUGH and fit.furthest <= limits[0] for fit in fits):
            break
    smooth = [fit for fit in fits if fit.smoothness >= ROUGH]
    for limit in limits:
        near = [fit for fit in smooth if fit.furthest <= limit]
        if near:
            return min(near, key=lambda fit: (len(fit.handover.centres), -fit.smoothness))
    for count in (0, *LONG_CURVE_COMPONENTS):
        fits += _curves(mean, (count,) if count else (), CURVE_SHARPNESS)
        near = [fit for fit in fits if fit.furthest <= LONG_CURVE_TOLERANCE * diagonal(mean)]
        if near:
            return max(near, key=lambda fit: fit.smoothness)
    return min(fits, key=lambda fit: fit.furthest)


def _divided(mean: Floats, samples: Floats, found: tuple[int, ...], turned: Floats | None) -> tuple[int, ...]:
    """Return the corners, with every edge divided evenly until straight pieces follow the tool's turning to a
    degree.
    """
    if turned is None:
        return found
    knots = np.array(found, dtype=np.float64)
    for parts in range(1, MOST_PARTS + 1):
        divided = np.interp(np.arange(parts * (len(found) - 1) + 1) / parts, np.arange(len(found)), knots)
        edges = tuple(round(float(place)) for place in divided)
        fit = _polygon(mean, samples, edges)
        basis = fit.handover.basis(np.linspace(0.0, 1.0, len(mean)))
        if np.abs(basis @ lines(fit.handover, turned) - turned).max() <= TURN_MISS:
            return edges
    return found


def _polygon(mean: Floats, samples: Floats, found: tuple[int, ...]) -> Fit:
    """Return one component for each edge, with the widest hand-over that hardly cuts a corner or bulges beside one.

    The components are those of the tied mixture. Where an edge is short beside what the people differ by, its component
    spreads over its neighbours; if that costs more than 0.6 % of the diagonal, the edges' own stretches of the clock
    count.
    """
    clock = np.linspace(0.0, 1.0, len(mean))
    knots = clock[list(found)]
    away = np.abs(np.subtract.outer(np.arange(len(mean)), found[1:-1])).min(axis=1, initial=len(mean))
    weights = np.where(away < CORNER_REACH * len(mean), CORNER_WEIGHT, 1.0)
    closely = np.linspace(0.0, 1.0, 4 * len(mean))
    tree = cKDTree(at(closely, clock, mean))

    def path_of(fit: Fit) -> Floats:
        return fit.handover.basis(closely) @ fit.coefficients

    def cut(path: Floats) -> float:
        return max(float(norms(path - mean[corner]).min()) for corner in found)

    def bulge(path: Floats) -> float:
        return float(tree.query(path[::2])[0].max())

    def sharpened(start: Handover, sharpness: float) -> tuple[Fit, float, float]:
        fit = _fit(mean, _sharpened(start, sharpness), weights)
        path = path_of(fit)
        return fit, cut(path), bulge(path)

    sharpest, *wider = POLYGON_SHARPNESS
    start, size = _clocks(fit_tied(samples, in_bins(samples, knots))), diagonal(mean)
    best, deepest, widest = sharpened(start, sharpest)
    if widest > ASTRAY * size:
        even = sharpened(_stretches(knots), sharpest)
        if widest > even[2] + ASTRAY * size:
            start, (best, deepest, widest) = _stretches(knots), even
    for sharpness in wider:
        fit, deep, wide = sharpened(start, sharpness)
        if deep > deepest + CORNER_MISS * size or wide > widest + ASTRAY * size:
            break
        best = fit
    return best


def _curves(mean: Floats, counts: Sequence[int], sharpnesses: Sequence[float]) -> Iterator[JudgedFit]:
    """Give the fits with each of ``counts`` components in even bins of the clock, and in bins narrow where it bends.

    The lines are fitted to the mean anyway, so bins need no expectation maximisation: it neither brings them nearer
    nor makes them smoother. A bin's extent is the standard deviation of its clock, the bin's width by sqrt(12).
    """
    for count in counts:
        for share in BENDING:
            bins = _stretches(_bins(mean, count, share))
            for sharpness in sharpnesses:
                yield _judged(mean, _fit(mean, _sharpened(bins, sharpness)))


def _bins(mean: Floats, count: int, share: float) -> Floats:
    """Return the edges (count + 1,) of bins of a path (n, d): ``share`` of them spread by the root of its bending."""
    clock = np.linspace(0.0, 1.0, len(mean))
    turning = norms(np.gradient(directions(mean), axis=0))
    bending = np.sqrt(gaussian_filter1d(turning, BENDING_WIDTH * len(mean), mode="nearest"))
    density = 1.0 - share + share * bending / max(float(bending.mean()), 1e-12)
    filled = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    return np.interp(np.linspace(0.0, 1.0, count + 1), filled / filled[-1], clock)


def lines(handover: Handover, values: Floats) -> Floats:
    """Return coefficients (2 K, m) so that the outputs are nearest to values (n, m) at even clock steps, and equal
    at both ends.
    """
    basis = handover.basis(np.linspace(0.0, 1.0, len(values)))
    usual = _local_lines(handover, values)
    matrix = basis.T @ basis / len(basis)
    matrix[np.diag_indices(len(matrix))] += RIDGE
    right = basis.T @ (values - basis @ usual) / len(basis)
    ends = basis[[0, -1]]
    return usual + _constrained(matrix, right, ends, values[[0, -1]] - ends @ usual)


def retimed(path: Floats, mean: Floats, window: float = WINDOW) -> Floats:
    """Return the fractional index (n,) of the mean path (n, d) that is nearest to each point of the path (n, d).

    It is sought within ``window`` (a part of the path) before and after, and rises. A point further off counts as
    further by a twentieth of the way between, so that a stroke gone over twice is not taken for its way back.
    """
    count = len(path)
    reach = max(2, round(window * count))
    offsets = np.arange(-reach, reach + 1)
    segments = np.clip(np.arange(count)[:, None] + offsets, 0, count - 2)
    gaps = [own[:, None] - other[segments] for own, other in zip(path.T, mean.T, strict=True)]
    steps = [np.diff(other)[segments] for other in mean.T]
    squares = np.maximum(sum(step * step for step in steps), 1e-300)
    along = np.clip(sum(gap * step for gap, step in zip(gaps, steps, strict=True)) / squares, 0.0, 1.0)
    away = sum((gap - along * step) ** 2 for gap, step in zip(gaps, steps, strict=True))
    moved = STAYING * float(norms(np.diff(mean, axis=0)).mean()) * (segments + along - np.arange(count)[:, None])
    nearest = np.argmin(away + moved * moved, axis=1)
    everyone = np.arange(count)
    where = segments[everyone, nearest] + along[everyone, nearest]
    where[0], where[-1] = 0.0, count - 1.0
    return np.minimum(np.maximum.accumulate(where), count - 1.0)


def _clocks(mixture: Mixture) -> Handover:
    """Return where on the clock the components of a mixture live."""
    order = np.argsort(mixture.means[:, 0], kind="stable")
    return Handover(mixture.means[order, 0], np.sqrt(mixture.covariances[order, 0, 0]))


def _stretches(knots: Floats) -> Handover:
    """Return the components that live on the stretches between rising clock values (K + 1,), evenly filled."""
    return Handover(0.5 * (knots[1:] + knots[:-1]), np.diff(knots) / np.sqrt(12.0))


def _sharpened(handover: Handover, sharpness: float) -> Handover:
    return replace(handover, extents=handover.extents / np.sqrt(sharpness))


def _fit(mean: Floats, handover: Handover, weights: Floats | None = None) -> Fit:
    return Fit(handover, _lines_across(handover, mean, np.ones(len(mean)) if weights is None else weights))


def _judged(mean: Floats, fit: Fit) -> JudgedFit:
    path = fit.handover.basis(np.linspace(0.0, 1.0, len(mean))) @ fit.coefficients
    there = _distances(path, mean)
    back = _distances(mean, path)
    rms = float(np.sqrt(0.5 * ((there**2).mean() + (back**2).mean())))
    furthest = float(max(there.max(), back.max()))
    return JudgedFit(fit.handover, fit.coefficients, rms, furthest, smoothness(path))


def _distances(path: Floats, other: Floats) -> Floats:
    where = retimed(path, other, NARROW_WINDOW)
    index = np.arange(len(other), dtype=np.float64)
    nearest = np.column_stack([np.interp(where, index, column) for column in other.T])
    return norms(path - nearest)


def _local_lines(handover: Handover, values: Floats) -> Floats:
    """Return the coefficients (2 K, m) of each component on its own: the value at its centre, the slope over its
    extent.
    """
    clock = np.linspace(0.0, 1.0, len(values))
    low, high = np.clip(handover.centres - handover.extents, 0, 1), np.clip(handover.centres + handover.extents, 0, 1)
    share = handover.extents / (high - low)
    rows = [
        np.column_stack([np.interp(handover.centres, clock, column) for column in values.T]),
        np.column_stack(
            [share * (np.interp(high, clock, column) - np.interp(low, clock, column)) for column in values.T]
        ),
    ]
    return np.concatenate(rows)


def _lines_across(handover: Handover, mean: Floats, weights: Floats) -> Floats:
    """Return coefficients (2 K, d) of the path nearest to the mean (n, d), where only distance across the mean counts,
    by the weights (n,) of its points.

    A little weight keeps every component near the stretch it stands for: a component's mean is a place on the path.
    """
    count, dimension = mean.shape
    basis = handover.basis(np.linspace(0.0, 1.0, count))
    width = basis.shape[1]
    usual = _local_lines(handover, mean)
    moves = np.gradient(mean, axis=0)
    ahead = moves / np.maximum(norms(moves)[:, None], 1e-300)
    across = np.eye(dimension)[None] - (1.0 - ALONG) * ahead[:, :, None] * ahead[:, None, :]
    across *= weights[:, None, None]
    matrix = np.empty((width, dimension, width, dimension))
    for i in range(dimension):
        for j in range(i + 1):
            matrix[:, i, :, j] = matrix[:, j, :, i] = (basis * across[:, i, j, None]).T @ basis / count
    square = matrix.reshape(width * dimension, width * dimension)
    square[np.diag_indices(len(square))] += RIDGE
    missing = (across * (mean - basis @ usual)[:, None, :]).sum(axis=2)
    right = (basis.T @ missing / count).reshape(-1, 1)
    ends = basis[[0, -1]]
    blocks = np.asarray(np.kron(ends, np.eye(dimension)), dtype=np.float64)
    solved = _constrained(square, right, blocks, (mean[[0, -1]] - ends @ usual).reshape(-1, 1))
    return usual + solved.reshape(width, dimension)


def _constrained(matrix: Floats, right: Floats, ends: Floats, values: Floats) -> Floats:
    """Return x with least x' matrix x / 2 - right' x that keeps ends @ x = values."""
    size, extra = len(matrix), len(ends)
    whole = np.zeros((size + extra, size + extra))
    whole[:size, :size], whole[:size, size:], whole[size:, :size] = matrix, ends.T, ends
    whole[np.arange(size, size + extra), np.arange(size, size + extra)] = -1e-12
    return np.asarray(np.linalg.solve(whole, np.concatenate([right, values]))[:size], dtype=np.float64)
