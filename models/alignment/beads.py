"""Beads and travel: the push button cuts a demonstration into stretches that are the shape, and ways between them.

Only beads are laid upon each other and judged. How somebody approaches the first bead, goes from one to the next and
leaves the last is their own affair.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from models.findings import Remark
from models.geometry import diagonal
from models.phase import arc_lengths
from models.preprocessing.filtering import LEAST_SAMPLES, SHORTEST_MOTION, CleanMotion, travelled

MAJORITY = 0.6
CHATTER = 0.02

Bead = tuple[int, int]
Beads = tuple[Bead, ...]


def beads_of(motion: CleanMotion) -> Beads:
    """Return the first and the last sample of each press of the button.

    Presses with hardly a way between them, less than 2 % of the drawing, are one: a button chatters.
    """
    turns = np.flatnonzero(np.diff(np.concatenate([[False], motion.triggers, [False]]).astype(np.int64)))
    presses = [(int(first), int(after) - 1) for first, after in zip(turns[::2], turns[1::2], strict=True)]
    if len(presses) < 2:
        return tuple(presses)
    way = arc_lengths(motion.points)
    least = CHATTER * diagonal(motion.points)
    while len(presses) > 1:
        gaps = [float(way[after[0]] - way[before[1]]) for before, after in pairwise(presses)]
        nearest = int(np.argmin(gaps))
        if gaps[nearest] >= least:
            break
        presses = _joined(presses, nearest)
    return tuple(presses)


def cut(
    motions: Sequence[CleanMotion], may_leave_out: bool
) -> tuple[list[CleanMotion], list[Beads], dict[int, Remark]]:
    """Return the motions from their first press of the button to their last, the beads of each, and who has too few.

    There are as many beads as six in ten have at least (as all have, if nobody may be left out). Who has more pressed
    again within one: the presses nearest to each other count as one. Who never pressed drew one bead from beginning to
    end.
    """
    pressed = [beads_of(motion) for motion in motions]
    counts = sorted((max(1, len(one)) for one in pressed), reverse=True)
    common = counts[int(np.ceil(MAJORITY * len(counts))) - 1] if may_leave_out else counts[-1]
    cut_motions: list[CleanMotion] = []
    found: list[Beads] = []
    lacking: dict[int, Remark] = {}
    for index, (motion, presses) in enumerate(zip(motions, pressed, strict=True)):
        beads = presses or ((0, len(motion.times) - 1),)
        if len(beads) < common:
            words = (
                f"the button was pressed {len(presses)} times where the others pressed it {common} times: draw it again"
            )
            lacking[index] = Remark(words, code="other-beads")
        way = arc_lengths(motion.points) if len(beads) > common else np.zeros(0)
        while len(beads) > common:
            gaps = [float(way[after[0]] - way[before[1]]) for before, after in pairwise(beads)]
            beads = tuple(_joined(beads, int(np.argmin(gaps))))
        first, last = beads[0][0], beads[-1][1]
        points = motion.points[first : last + 1]
        if last - first + 1 >= LEAST_SAMPLES and diagonal(points) >= SHORTEST_MOTION:
            motion = between_samples(motion, first, last)
            beads = tuple((start - first, end - first) for start, end in beads)
        cut_motions.append(motion)
        found.append(beads)
    return cut_motions, found, lacking


def between_samples(motion: CleanMotion, first: int, last: int) -> CleanMotion:
    """Return a motion from its first to its last of these samples."""
    kept = slice(first, last + 1)
    turned = None if motion.orientations is None else motion.orientations[kept]
    return replace(
        motion,
        times=motion.times[kept],
        points=motion.points[kept],
        triggers=motion.triggers[kept],
        known=motion.known[kept],
        orientations=turned,
    )


def shares(motions: Sequence[CleanMotion], beads: Sequence[Beads]) -> list[float]:
    """Return the median way in m of each bead and of each way between two: bead, way, bead ..."""
    ways: list[list[float]] = []
    for motion, own in zip(motions, beads, strict=True):
        lengths = arc_lengths(motion.points)
        knots = [index for bead in own for index in bead]
        ways.append([float(lengths[b] - lengths[a]) for a, b in pairwise(knots)])
    return [float(np.median(column)) for column in zip(*ways, strict=True)]


def places_of(motion: CleanMotion, beads: Beads, sizes: Sequence[int]) -> np.ndarray:
    """Return the fractional samples (n,) of a motion at even steps of its way along each bead and each way between:
    as many as ``sizes`` says of each.
    """
    index = np.arange(len(motion.times), dtype=np.float64)
    gone = travelled(motion)
    knots = [end for bead in beads for end in bead]
    if len(sizes) == 1:
        knots = [0, len(index) - 1]
    parts = [
        np.interp(np.linspace(gone[first], gone[last], size), gone, index)
        for first, last, size in zip(knots, knots[1:], sizes, strict=False)
    ]
    return np.concatenate(parts)


def _joined(presses: Sequence[Bead], which: int) -> list[Bead]:
    return [*presses[:which], (presses[which][0], presses[which + 1][1]), *presses[which + 2 :]]
