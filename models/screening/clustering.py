"""Whether people drew one thing or several: groups of shapes, so that two of them are never averaged into a third."""

from collections.abc import Sequence

import numpy as np
from scipy.cluster.hierarchy import average, fcluster
from scipy.spatial.distance import squareform

from models.alignment.dtw import costs, warp
from models.alignment.registration import some_of
from models.demonstration import Floats
from models.errors import MixedDemonstrations
from models.findings import Finding, Remark
from models.geometry import diagonal, norms
from models.phase import arc_lengths, at
from models.screening.messages import another_shape

POINTS = 64
MOST = 24
LEAST_APART = 0.25
LEAST_APART_OF_FEW = 0.35
FEW = 4
SPREADS = 3.0
MAJORITY = 0.6
MINORITY = 0.25
TURNED = 0.5
WINDOW = 0.05
SHOWN = 5
PART_DISTANCE = 0.1
PART_COVER = 0.3
PART_LENGTH = 1.4
LEAST_OFF = 0.08

Groups = tuple[tuple[int, ...], ...]


def other_shapes(names: Sequence[str], curves: Floats) -> dict[int, Remark]:
    """Return which of the curves (u, n, d) show another shape than most do, with where and how much.

    Raises MixedDemonstrations, naming the groups, if no shape has a clear majority: six in ten. A part of the shape,
    the shape drawn from the other end, or with a stretch drawn again, is not another one.
    """
    chosen = some_of(curves, MOST)
    groups, limit = shape_groups(curves[chosen])
    members = [[int(chosen[index]) for index in group] for group in groups]
    if len(groups) > 1 and len(groups[0]) < MAJORITY * len(chosen) and len(groups[1]) >= MINORITY * len(chosen):
        _refuse(names, curves, members[0], members[1])
    typical = curves[members[0][0]]
    if len(groups) == 1 and len(chosen) == len(curves):
        return {}
    distances = _apart_from(typical, curves)
    suspects = [index for index in range(len(curves)) if distances[index] > limit and index not in members[0]]
    if not suspects:
        return {}
    turned = _apart_from(typical, curves[suspects][:, ::-1])
    found: dict[int, Remark] = {}
    for index, backwards in zip(suspects, turned, strict=True):
        if backwards > TURNED * distances[index] and not _is_part(typical, curves[index]):
            place, size = _worst(typical, curves[index])
            if size > LEAST_OFF * diagonal(typical):
                found[index] = another_shape(place, size)
    return found


def _refuse(names: Sequence[str], curves: Floats, one: list[int], other: list[int]) -> None:
    """Raise MixedDemonstrations with what the two groups are, unless one only draws a part of the other's shape."""
    if _is_part(curves[one[0]], curves[other[0]]) or _is_part(curves[other[0]], curves[one[0]]):
        return
    here, there = (tuple(sorted(names[index] for index in group)) for group in (one, other))
    first, second = named(here), named(there)
    straight, turned = _apart_from(curves[one[0]], np.stack([curves[other[0]], curves[other[0], ::-1]]))
    if turned < TURNED * straight:
        words = (
            f"some are drawn from one end ({first}) and some from the other ({second}): "
            "draw one group again in the other direction, or exclude it"
        )
        raise MixedDemonstrations(words, Finding("two-directions", words, people=there, others=here))
    words = (
        f"different shapes are mixed, and none has a clear majority: {first}, and {second}: "
        "learn each as a skill of its own, or exclude those that do not belong"
    )
    raise MixedDemonstrations(words, Finding("two-shapes", words, people=there, others=here))


def shape_groups(curves: Floats) -> tuple[Groups, float]:
    """Return which of the curves (u, n, d) show one shape, the largest group first, in each the most typical first.

    And the distance from which on shapes are taken to differ.

    Place and size are taken out. Groups are further apart (average linkage of warped distances, in parts of the
    drawing's radius) than a quarter, or three times the distance to the nearest quarter of the others.
    """
    count = len(curves)
    if count < 2:
        return (tuple(range(count)),), LEAST_APART_OF_FEW
    table = _apart(curves)
    spread = float(np.median(np.sort(table, axis=1)[:, count // 4]))
    limit = max(LEAST_APART if count >= FEW else LEAST_APART_OF_FEW, SPREADS * spread)
    labels = fcluster(average(squareform(table, checks=False)), limit, criterion="distance")
    groups = [np.flatnonzero(labels == label) for label in np.unique(labels)]
    ordered = sorted(groups, key=lambda group: (-len(group), float(table[np.ix_(group, group)].sum())))
    typical_first = tuple(
        tuple(int(index) for index in group[np.argsort(table[np.ix_(group, group)].sum(axis=1), kind="stable")])
        for group in ordered
    )
    return typical_first, limit


def _shapes(curves: Floats) -> Floats:
    """Return curves (u, n, d) at 64 points (u, 64, d), their middle at 0 and their mean radius 1."""
    coarse = curves[:, np.linspace(0, curves.shape[1] - 1, POINTS).round().astype(np.int64)]
    centred = coarse - coarse.mean(axis=1, keepdims=True)
    radius = np.sqrt((centred * centred).sum(axis=2).mean(axis=1))
    return centred / np.maximum(radius, 1e-12)[:, None, None]


def _apart_from(typical: Floats, curves: Floats) -> Floats:
    """Return the distance (u,) of each curve's shape from one curve's."""
    shapes, reference = _shapes(curves), _shapes(typical[None])
    return costs(np.broadcast_to(reference, shapes.shape), shapes) / POINTS


def _apart(curves: Floats) -> Floats:
    """Return the distance (u, u) of each two curves' shapes: mean of the warp, in parts of their radius."""
    shapes = _shapes(curves)
    one, other = np.triu_indices(len(shapes), 1)
    table = np.zeros((len(shapes), len(shapes)))
    table[one, other] = costs(shapes[one], shapes[other]) / POINTS
    return table + table.T


def _is_part(whole: Floats, part: Floats) -> bool:
    """Return whether one drawing (n, d) is a stretch of another: let go early or started late, no other shape."""
    everything = np.ones(1, dtype=bool)
    coarse = np.linspace(0, len(whole) - 1, POINTS).round().astype(np.int64)
    whole, part = whole[coarse], part[coarse]
    found = warp(whole, part[None], everything, everything)
    first, last = int(found.first[0]), int(found.last[0])
    if last - first < PART_COVER * len(whole):
        return False
    lengths = arc_lengths(whole)
    share = float(arc_lengths(part)[-1]) / max(float(lengths[last] - lengths[first]), 1e-12)
    return bool(found.costs[0] < PART_DISTANCE * diagonal(whole) and 1.0 / PART_LENGTH < share < PART_LENGTH)


def _worst(typical: Floats, curve: Floats) -> tuple[float, float]:
    """Return where on the typical drawing (n, d), 0 to 1, and by how much in m another curve is off it the most."""
    where = warp(typical, curve[None]).positions[0]
    index = np.arange(len(curve), dtype=np.float64)
    away = norms(at(where, index, curve) - typical)
    width = max(1, round(WINDOW * len(away)))
    windows = np.convolve(away, np.full(width, 1.0 / width), mode="valid")
    worst = int(windows.argmax())
    return (worst + 0.5 * (width - 1)) / (len(away) - 1), float(windows[worst])


def named(names: Sequence[str]) -> str:
    """Return the first five of these names in words, and how many more there are."""
    told = ", ".join(names[:SHOWN])
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"{told}{more}"
