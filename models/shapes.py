"""Whether people drew one thing or several: groups of shapes, so that two of them are never averaged into a third."""

# numpy and scipy leave many results untyped: what leaves a function here is typed by its signature.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false

from collections.abc import Sequence

import numpy as np
from scipy.cluster.hierarchy import average, fcluster
from scipy.spatial.distance import squareform

from models.alignment import costs, warp
from models.cleaning import CleanMotion
from models.demonstration import Floats
from models.errors import MixedDemonstrations
from models.group import diagonal
from models.phase import arc_lengths, at, travelled

POINTS = 64
MOST = 24
LEAST_APART = 0.25
LEAST_APART_OF_FEW = 0.35
FEW = 4
SPREADS = 3.0
MAJORITY = 0.6
MINORITY = 0.25
SHOWN = 5
PART_DISTANCE = 0.1
PART_COVER = 0.3
PART_LENGTH = 1.4

Groups = tuple[tuple[int, ...], ...]


def refuse_mixed(names: Sequence[str], curves: Floats) -> None:
    """Raise MixedDemonstrations, naming the groups, if no shape has a clear majority among curves (u, n, d).

    Six in ten is clear: then the others can be left out one by one.
    """
    chosen = np.unique(np.linspace(0, len(curves) - 1, min(len(curves), MOST)).round().astype(np.int64))
    groups = shape_groups(curves[chosen])
    if len(groups) < 2 or len(groups[0]) >= MAJORITY * len(chosen) or len(groups[1]) < MINORITY * len(chosen):
        return
    one, other = ([int(chosen[index]) for index in group] for group in groups[:2])
    first, second = (_named([names[index] for index in group]) for group in (one, other))
    if _is_part(curves[one[0]], curves[other[0]]) or _is_part(curves[other[0]], curves[one[0]]):
        return
    backwards = np.stack([curves[other[0], ::-1], curves[other[0]]])
    turned, straight = _apart(np.stack([curves[one[0]], *backwards]))[0, 1:]
    if turned < 0.5 * straight:
        raise MixedDemonstrations(
            f"some are drawn from one end ({first}) and some from the other ({second}): "
            "draw one group again in the other direction, or exclude it"
        )
    raise MixedDemonstrations(
        f"different shapes are mixed, and none has a clear majority: {first}, and {second}: "
        "learn each as a skill of its own, or exclude those that do not belong"
    )


def shape_groups(curves: Floats) -> Groups:
    """Return which of the curves (u, n, d) show one shape, the largest group first, in each the most typical first.

    Place and size are taken out. Groups are further apart (average linkage of warped distances, in parts of the
    drawing's radius) than a quarter, or three times the distance to the nearest quarter of the others.
    """
    count = len(curves)
    if count < 2:
        return (tuple(range(count)),)
    table = _apart(curves)
    spread = float(np.median(np.sort(table, axis=1)[:, count // 4]))
    limit = max(LEAST_APART if count >= FEW else LEAST_APART_OF_FEW, SPREADS * spread)
    labels = fcluster(average(squareform(table, checks=False)), limit, criterion="distance")
    groups = [np.flatnonzero(labels == label) for label in np.unique(labels)]
    ordered = sorted(groups, key=lambda group: (-len(group), int(group[0])))
    return tuple(
        tuple(int(index) for index in group[np.argsort(table[np.ix_(group, group)].sum(axis=1), kind="stable")])
        for group in ordered
    )


def is_another(path: Floats, motion: CleanMotion) -> bool:
    """Return whether a motion has another shape than a path (n, d) at even steps of its length."""
    index = np.arange(len(motion.times), dtype=np.float64)
    way = np.interp(np.linspace(0.0, 1.0, len(path)), travelled(motion), index)
    return bool(_apart(np.stack([path, at(way, index, motion.points)]))[0, 1] > LEAST_APART_OF_FEW)


def _apart(curves: Floats) -> Floats:
    """Return the distance (u, u) of each two curves' shapes: mean of the warp, in parts of their radius."""
    coarse = curves[:, np.linspace(0, curves.shape[1] - 1, POINTS).round().astype(np.int64)]
    centred = coarse - coarse.mean(axis=1, keepdims=True)
    radius = np.sqrt((centred * centred).sum(axis=2).mean(axis=1))
    shapes = centred / np.maximum(radius, 1e-12)[:, None, None]
    one, other = np.triu_indices(len(shapes), 1)
    table = np.zeros((len(shapes), len(shapes)))
    table[one, other] = costs(shapes[one], shapes[other]) / POINTS
    return table + table.T


def _is_part(whole: Floats, part: Floats) -> bool:
    """Return whether one drawing (n, d) is a stretch of another: let go early or started late, no other shape."""
    everything = np.ones(1, dtype=bool)
    found = warp(whole, part[None], everything, everything)
    first, last = int(found.first[0]), int(found.last[0])
    if last - first < PART_COVER * len(whole):
        return False
    lengths = arc_lengths(whole)
    share = float(arc_lengths(part)[-1]) / max(float(lengths[last] - lengths[first]), 1e-12)
    return bool(found.costs[0] < PART_DISTANCE * diagonal(whole) and 1.0 / PART_LENGTH < share < PART_LENGTH)


def _named(names: Sequence[str]) -> str:
    told = ", ".join(sorted(names)[:SHOWN])
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"{told}{more}"
