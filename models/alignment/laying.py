"""Motions laid upon each other, bead upon bead: from what was cleaned to a correspondence at even instants."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.alignment.aligned import AlignedDemonstrations, between, taken_at
from models.alignment.beads import Beads, places_of, shares
from models.alignment.corners import laid_at_tips, sharp_corners
from models.alignment.registration import Group, mean_of, register, some_of, taken
from models.demonstration import Bools, Floats
from models.geometry import diagonal
from models.options import LearningOptions
from models.phase import arc_lengths, at, edges
from models.preprocessing.filtering import CleanMotion

POINTS = 256
PER_EDGE = 20
MOST = 1024
LEAST = 32
COUNTED = 5
DOT = 0.02
CLOCK_POINTS = 300


@dataclass(frozen=True, slots=True, eq=False)
class Drawings:
    """Motions at even steps of their way along each bead and each way between two.

    ``curves`` (u, n, d) in m; ``places`` (u, n): their fractional samples; ``sizes``: how many of the n points are
    bead, way, bead ...
    """

    motions: Sequence[CleanMotion]
    curves: Floats
    places: Floats
    sizes: tuple[int, ...]

    @property
    def judged(self) -> Bools:
        """Which of the n points (n,) lie on beads."""
        return np.concatenate([np.full(size, part % 2 == 0) for part, size in enumerate(self.sizes)])

    @property
    def shapes(self) -> Floats:
        """Return the points on beads (u, m, d)."""
        return self.curves if len(self.sizes) == 1 else self.curves[:, self.judged]

    def of(self, rows: Sequence[int]) -> "Drawings":
        """Return those of these rows."""
        kept = list(rows)
        return Drawings([self.motions[row] for row in kept], self.curves[kept], self.places[kept], self.sizes)


def drawn(motions: Sequence[CleanMotion], beads: Sequence[Beads]) -> Drawings:
    """Return the motions as drawings.

    256 points follow most of them to the millimetre; a raster or a weave gets twenty an edge, 1024 at most.
    """
    ways = shares(motions, beads) if len(beads[0]) > 1 else [1.0]
    total = sum(ways)
    coarse = _sampled(motions, beads, _split(ways, total, POINTS))
    some = coarse.curves[some_of(coarse.curves, COUNTED)]
    most = float(np.median([edges(curve) for curve in some]))
    if most * PER_EDGE <= POINTS:
        return coarse
    return _sampled(motions, beads, _split(ways, total, 4 * round(0.25 * min(MOST, most * PER_EDGE))))


def _split(ways: Sequence[float], total: float, points: int) -> tuple[int, ...]:
    """Return how many of so many points each part of the way gets: a multiple of four, 32 at least."""
    if len(ways) == 1:
        return (points,)
    return tuple(max(LEAST, 4 * round(0.25 * points * way / max(total, 1e-300))) for way in ways)


def _sampled(motions: Sequence[CleanMotion], beads: Sequence[Beads], sizes: tuple[int, ...]) -> Drawings:
    places = [places_of(motion, own, sizes) for motion, own in zip(motions, beads, strict=True)]
    curves = [
        at(where, np.arange(len(motion.times), dtype=np.float64), motion.points)
        for motion, where in zip(motions, places, strict=True)
    ]
    return Drawings(motions, np.stack(curves), np.stack(places), sizes)


def laid(drawings: Drawings, typical: int, options: LearningOptions) -> tuple[Group, AlignedDemonstrations, Bools]:
    """Return how the drawings lie upon each other, seen from the typical one; they themselves at even instants of their
    mean path; and which of those instants (m,) lie on beads.
    """
    method, radius = options.alignment or "dtw", options.radius or 1
    parts: list[Group] = []
    sharp: list[int] = []
    begin = 0
    size = diagonal(drawings.shapes[typical])
    for part, count in enumerate(drawings.sizes):
        curves, places = (values[:, begin : begin + count] for values in (drawings.curves, drawings.places))
        if part % 2 or (len(drawings.sizes) > 1 and diagonal(curves[typical]) < DOT * size):
            parts.append(_evenly(len(curves), count))
        else:
            ends = (part == 0, part == len(drawings.sizes) - 1)
            group = register(curves, typical, method, radius, ends)
            if method == "dtw":
                found = sharp_corners(mean_of(taken(curves, group.positions), group.weights))
                positions = laid_at_tips(drawings.motions, places, group.positions, found)
                group = replace(group, positions=positions)
                sharp += [begin + corner.tip for corner in found]
            parts.append(group)
        begin += count
    group = _joined(parts, drawings.sizes)
    samples = _samples_of(drawings.places, group.positions)
    pairs = zip(samples, drawings.motions, strict=True)
    points = [at(where, np.arange(len(one.points), dtype=np.float64), one.points) for where, one in pairs]
    instants = _even_instants(mean_of(np.stack(points), group.weights), sharp)
    samples = _samples_of(drawings.places, between(group.positions, instants))
    aligned = taken_at(list(drawings.motions), samples, between(group.weights, instants))
    judged = drawings.judged
    judged = judged[np.floor(instants).astype(np.int64)] & judged[np.ceil(instants).astype(np.int64)]
    return group, _on_one_way(aligned, judged), judged


def _evenly(count: int, points: int) -> Group:
    """Return the group of those who go a way between beads, each at its own: an even share of it at any instant."""
    nobody = np.zeros(count, dtype=bool)
    positions = np.broadcast_to(np.arange(points, dtype=np.float64), (count, points)).copy()
    return Group(positions, np.zeros(count), np.ones(count), nobody, nobody, np.ones((count, points)))


def _on_one_way(aligned: AlignedDemonstrations, judged: Bools) -> AlignedDemonstrations:
    """Return the motions, between beads on the mean way from their own bead's end to their own next one's beginning.

    How each of them goes there is no part of what they agree on: nothing is to be surer or less sure for it.
    """
    if judged.all():
        return aligned
    points = aligned.points.copy()
    turns = np.flatnonzero(np.diff(np.concatenate([[True], judged, [True]]).astype(np.int64)))
    for first, after in zip(turns[::2], turns[1::2], strict=True):
        low, high = max(0, int(first) - 1), min(len(judged) - 1, int(after))
        way = mean_of(points[:, low : high + 1], aligned.weights[:, low : high + 1])
        share = np.linspace(0.0, 1.0, high - low + 1)[:, None]
        begun, ended = (np.nan_to_num(points[:, at] - way[end])[:, None] for at, end in ((low, 0), (high, -1)))
        known = np.isfinite(points[:, low : high + 1])
        points[:, low : high + 1] = np.where(known, way + (1.0 - share) * begun + share * ended, np.nan)
    return replace(aligned, points=points)


def _joined(parts: Sequence[Group], sizes: Sequence[int]) -> Group:
    """Return the group of whole drawings from those of their beads and ways: late is who begins the first bead late,
    early who lets go of the last one early.
    """
    if len(parts) == 1:
        return parts[0]
    begins = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    most = float(sum(sizes) - 1)
    first, last = parts[0], parts[-1]
    return Group(
        np.concatenate([part.positions + begin for part, begin in zip(parts, begins, strict=True)], axis=1),
        first.first * (sizes[0] - 1) / most,
        (begins[-1] + last.last * (sizes[-1] - 1)) / most,
        first.late,
        last.early,
        np.concatenate([part.weights for part in parts], axis=1),
    )


def _samples_of(places: Floats, positions: Floats) -> Floats:
    """Return the fractional samples (u, m) of the motions at positions (u, m) on their curves; NaN stays NaN."""
    index = np.arange(places.shape[1], dtype=np.float64)
    return np.stack([np.interp(where, index, own) + 0.0 * where for where, own in zip(positions, places, strict=True)])


def _even_instants(path: Floats, sharp: Sequence[int]) -> Floats:
    """Return 300 fractional instants (or more, where more points are drawn) evenly along a mean path (n, d), and in
    place of the nearest ones the sharp corners themselves: between two instants a tip would be cut off.
    """
    lengths = arc_lengths(path)
    index = np.arange(len(lengths), dtype=np.float64)
    count = round(CLOCK_POINTS * max(1.0, len(lengths) / POINTS))
    instants = np.interp(np.linspace(0.0, lengths[-1], count), lengths, index)
    for corner in sharp:
        instants[1 + int(np.abs(instants[1:-1] - corner).argmin())] = corner
    return instants
