"""Demonstrations that do not fit the others: drawn twice, drawn backwards, another shape, off in one place."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from models.alignment.dtw import costs, warp
from models.alignment.procrustes import laid_upon
from models.alignment.registration import directions, mean_of
from models.demonstration import Floats
from models.findings import Remark
from models.geometry import diagonal, middle, norms
from models.phase import arc_lengths
from models.screening.messages import off

WINDOW = 0.05
FAR = 3.5
PLACED = 2.0
LEAST_SHARE = 0.7
LEAST_SIZE = 0.03
KEPT = 0.6
TWICE = 1.6
AGAIN = 0.05
COARSE = 4
BACKWARDS = 0.5


def first_pass(curves: Floats) -> dict[int, int]:
    """Return for each curve (of u, n, d) that draws the shape more than once the sample at which the first time ends.

    It is 1.6 times as long as is usual, the usual shape fits upon its beginning alone, and half of the rest is near it
    again, within 5 % of its diagonal.
    """
    count, points = curves.shape[:2]
    lengths = np.array([arc_lengths(curve)[-1] for curve in curves])
    usual = float(np.median(lengths))
    found: dict[int, int] = {}
    if count < 3:
        return found
    typical = curves[int(np.abs(lengths - usual).argmin())]
    for index in np.flatnonzero(lengths > TWICE * usual):
        part = warp(curves[index], typical[None], open_end=np.ones(1, dtype=bool))
        whole = costs(typical[None], curves[index][None])[0] / points
        rest = KDTree(typical).query(curves[index, int(part.last[0]) :])[0]
        again = float(np.median(rest)) < AGAIN * diagonal(typical)
        if part.last[0] < points / TWICE and part.costs[0] < 0.5 * whole and again:
            found[int(index)] = int(part.last[0])
    return found


def against_direction(curves: Floats, typical: int) -> list[int]:
    """Return which curves (u, n, d) fit the typical one far better when they are run from end to start."""
    if len(curves) < 3:
        return []
    curves = curves[:, ::COARSE]
    reference = np.broadcast_to(curves[typical], curves.shape)
    forward = costs(reference, curves)
    suspects = np.flatnonzero(forward > 2 * np.median(forward))
    if not len(suspects):
        return []
    backward = costs(reference[suspects], curves[suspects, ::-1])
    return [int(index) for index in suspects[backward < BACKWARDS * forward[suspects]]]


def mismatch(points: Floats, weights: Floats) -> float:
    """Return how far half of the aligned motions (u, n, d) are from their mean shape, once place and size are taken
    out.

    In parts of the mean's diagonal, root mean square. People who draw one shape stay below 0.06; two shapes mixed
    make 0.17.
    """
    mean = mean_of(points, weights)
    known = np.isfinite(points[:, :, :1])
    count = known.sum(axis=1, keepdims=True)
    here, there = (
        np.where(known, values - np.where(known, values, 0.0).sum(axis=1, keepdims=True) / count, 0.0)
        for values in (points, np.broadcast_to(mean, points.shape))
    )
    sizes = (here * here).sum(axis=(1, 2), keepdims=True)
    scales = np.sqrt((there * there).sum(axis=(1, 2), keepdims=True) / np.maximum(sizes, 1e-300))
    rests = np.sqrt(((scales * here - there) ** 2).sum(axis=(1, 2)) / count[:, 0, 0])
    return float(np.median(rests)) / max(diagonal(mean), 1e-300)


def odd_ones(points: Floats, weights: Floats, phases: Floats) -> dict[int, Remark]:
    """Return which of the aligned motions (u, n, d) are off, where and by how much, by their worst 5 % of the path.

    ``phases`` (n,): 0..1, of the instants. What is told is the largest distance from the mean of the others.

    Off is further across the path from the median motion than 3.5 times the others' usual distance there, also when
    the motion is moved, turned and scaled onto the median. Who only draws the same shape elsewhere or at another size
    may do so twice as far. Never more than 40 % of them, and never so that fewer than two are left.
    """
    count = len(points)
    if count < 3:
        return {}
    usual = _median(points, weights)
    offsets = _across(points, usual)
    ratio = _ratios(offsets, usual)
    placed = _ratios(_across(laid_upon(points, usual), usual), usual).max(axis=1)
    worst = np.minimum(ratio.max(axis=1), np.maximum(placed, ratio.max(axis=1) / PLACED))
    most = min(count - 2, int((1.0 - KEPT) * count))
    suspects = [int(row) for row in np.argsort(-worst, kind="stable")[:most] if worst[row] > FAR]
    found: dict[int, Remark] = {}
    fitting = [row for row in range(count) if row not in suspects]
    offsets = _across(points, mean_of(points[fitting], weights[fitting]))
    for row in suspects:
        away = np.nan_to_num(norms(offsets[row]))
        peak = int(away.argmax())
        found[row] = off(float(phases[peak]), offsets[row, peak])
    return found


@dataclass(frozen=True, slots=True)
class Ways:
    """Two ways past one place, rows of who took which, the fewer last: ``place`` 0..1 of the path, ``size`` m apart."""

    most: tuple[int, ...]
    others: tuple[int, ...]
    place: float
    size: float


def two_ways(points: Floats, weights: Floats, phases: Floats) -> Ways | None:
    """Return where the aligned motions (u, n, d) part in two ways with nobody between, None if they nowhere do.

    Of two groups, a third of them at least each, the means over 5 % of the path are there seven times as far apart,
    across it, as the members of a group are among themselves, and as everybody usually is.
    """
    if len(points) < 3:
        return None
    width = _width(points.shape[1])
    count = points.shape[1] // width
    windows = _across(points, _median(points, weights))[:, : count * width].reshape(len(points), count, width, -1)
    known = np.isfinite(windows[..., 0])
    people = known.sum(axis=2)
    offsets = np.where(known[..., None], windows, 0.0).sum(axis=2) / np.maximum(people, 1)[..., None]
    there = people > 0
    counted = [k for k in range(count) if there[:, k].sum() > 2]
    if not counted:
        return None
    usual = float(np.median([_spread([offsets[there[:, k], k]]) for k in counted]))
    found, furthest = None, 2.0 * FAR
    for k in counted:
        rows = np.flatnonzero(there[:, k])
        here = offsets[rows, k]
        main = np.linalg.svd(here - here.mean(axis=0))[2][0]
        order = np.argsort(here @ main, kind="stable")
        least = -(-len(rows) // 3)
        for cut in range(least, len(rows) - least + 1):
            groups = [here[order[:cut]], here[order[cut:]]]
            size = float(norms(groups[1].mean(axis=0) - groups[0].mean(axis=0)))
            if size > furthest * max(_spread(groups), usual, 1e-12):
                furthest = size / max(_spread(groups), usual, 1e-12)
                ids = [tuple(sorted(rows[part].tolist())) for part in (order[:cut], order[cut:])]
                ids.sort(key=len, reverse=True)
                found = Ways(ids[0], ids[1], float(phases[k * width + width // 2]), size)
    return found


def _spread(groups: list[Floats]) -> float:
    """Return the deviation in m within groups of places (k, d), each from its own mean."""
    square = sum(float(((group - group.mean(axis=0)) ** 2).sum()) for group in groups)
    return float(np.sqrt(square / max(sum(map(len, groups)) - len(groups), 1)))


def _across(points: Floats, usual: Floats) -> Floats:
    """Return the offsets (u, n, d) of motions (u, n, d) from the median motion (n, d), across the path only."""
    ahead = directions(usual)
    offsets = points - usual
    return offsets - (offsets * ahead).sum(axis=2, keepdims=True) * ahead


def _ratios(offsets: Floats, path: Floats) -> Floats:
    """Return, for each motion and each 5 % of the path, its mean distance by the usual one there: shape (u, n - w + 1).

    Usual is the median motion's, but 70 % of the motions' usual worst and 3 % of the diagonal by 3.5 at least.
    """
    away = np.where(np.isfinite(offsets[:, :, 0]), norms(offsets), 0.0)
    width = _width(away.shape[1])
    sums = np.cumsum(np.concatenate([np.zeros((len(away), 1)), away], axis=1), axis=1)
    windows = (sums[:, width:] - sums[:, :-width]) / width
    usual = np.maximum(np.median(windows, axis=0), LEAST_SHARE * float(np.median(windows.max(axis=1))))
    return windows / np.maximum(usual, LEAST_SIZE / FAR * diagonal(path))


def _width(instants: int) -> int:
    return max(1, round(WINDOW * instants))


def _median(points: Floats, weights: Floats) -> Floats:
    """Return the geometric median (n, d) of the motions there are at each instant."""
    nobody = np.asarray(~np.isfinite(points).any(axis=(0, 2)))
    filled = np.where(nobody[None, :, None], mean_of(points, weights), points)
    return middle(filled.transpose(1, 0, 2))
