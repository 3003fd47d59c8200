"""How far each hand went along the common way: who began after the others or let go before them, and who went on past
where they end.

Where it ends is a question to all of them: the way goes as far as a third of them drew, and two of them at least.
Who stops short of that is used up to there; whoever alone goes past it is used up to where the others end.
"""

from dataclasses import dataclass

import numpy as np

from models.alignment.dtw import warp
from models.alignment.registration import COARSEST, OPEN_PHASE, in_place, reference_of
from models.demonstration import Bools, Floats
from models.geometry import PARTED, norms, parted

SUPPORT = 3


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """How far in m each of u drawings goes, at one end, past where a typical one does, less than nothing if it stops
    short of it: ``past`` (u,). ``further`` (u,): who belongs to a group that goes further than the others.
    """

    past: Floats
    further: Bools

    @property
    def supported(self) -> bool:
        """Whether those who go further are so many that it is the common way: a third, two at least, but one of two."""
        return int(self.further.sum()) >= max(min(2, len(self.past) - 1), -(-len(self.past) // SUPPORT))

    @property
    def too_far(self) -> Floats:
        """How far (u,) in m those go past the end of the others who are too few to be followed."""
        if self.supported or not self.further.any():
            return np.zeros(len(self.past))
        return np.where(self.further, self.past - self.past[~self.further].mean(), 0.0)


def reaches(curves: Floats, typical: int) -> tuple[Reach, Reach]:
    """Return how far the curves (u, n, d), evenly sampled along their way, reach at their beginning and at their end.

    A curve goes past the typical one by what that one, warped onto it with open ends, leaves unmatched of it, if it is
    longer by half of that at least; and stops short by what it leaves unmatched of the typical one, if it is shorter.
    Who ends in the same place does neither. Who goes further, and what is the same place, is asked against how far the
    curves are from each other where they are matched; where the groups are less than 2 % of the way apart nobody does.
    """
    count = len(curves)
    coarse = in_place(curves, curves[typical])[0][:, ::COARSEST]
    everyone = np.ones(count, dtype=bool)
    own = np.broadcast_to(curves[typical, ::COARSEST], coarse.shape)
    long, short = warp(coarse, own, everyone, everyone), warp(own, coarse, everyone, everyone)
    most = coarse.shape[1] - 1
    lengths = norms(np.diff(curves, axis=1)).sum(axis=1)
    way = float(lengths[typical])
    waver = float(np.median(np.delete(np.minimum(long.costs, short.costs), typical)))
    found: list[Reach] = []
    for side, rest, missing in ((0, long.first, short.first), (-1, most - long.last, most - short.last)):
        more, less = rest / most * lengths, missing / most * way
        past = np.where(lengths - 0.5 * more > way, more, np.where(lengths < way - 0.5 * less, -less, 0.0))
        past[norms(coarse[:, side] - own[:, side]) < PARTED * waver] = 0.0
        further = parted(past, waver)
        if further.any() and past[further].mean() - past[~further].mean() < OPEN_PHASE * way:
            further = np.zeros(count, dtype=bool)
        found.append(Reach(past, further))
    return found[0], found[1]


def furthest_of(curves: Floats) -> int:
    """Return which of the curves (u, n, d) is nearest to the others, of those who drew all that enough of them drew."""
    typical = reference_of(curves)
    sides = [reach.further for reach in reaches(curves, typical) if reach.further.any() and reach.supported]
    if not sides:
        return typical
    rows = np.flatnonzero(np.logical_and.reduce(sides))
    if not len(rows):
        rows = np.flatnonzero(max(sides, key=np.count_nonzero))
    return int(rows[reference_of(curves[rows]) if len(rows) > 1 else 0])
