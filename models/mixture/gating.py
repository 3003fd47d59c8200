"""How many components, and where each lives on the clock: the fewest that say all that the people agreed on.

One question is put to one yardstick (``models.yardstick``): does the path keep within one standard error of the
people's mean over 95 % of the way, and nowhere beyond two? A zigzag of twenty people needs four components that hand
over sharply, a G three that hand over widely, a straight seam one: corners, bows and curves are of one family, and
nothing has to be told apart first.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from models.demonstration import Floats
from models.mixture.handover import Fit, Handover, held, lines
from models.mixture.refinement import refined, target_of
from models.mixture.segmentation import best_polygons
from models.yardstick import MeanPath, Misfit, misfit

MOST = 64  # components: a raster of thirty lines has 59 edges
HOPELESS = 10.0  # squared standard errors: who says all has 1.15 at most, the exact ends not yet held
EDGE, CURVE = 0.5, 1.7  # times the extent of an evenly filled stretch: starts that hand over sharply, or widely


@dataclass(frozen=True, slots=True, eq=False)
class JudgedFit:
    """A fit and how far its path lies from the people's mean."""

    fit: Fit
    misfit: Misfit


class Search:
    """The fits of one mean path, each made once."""

    def __init__(self, people: MeanPath, patient: bool) -> None:
        self.people = people
        self._target = target_of(people)
        self._patient = patient
        shape = people.points / float(np.median(people.errors))
        if people.turned is not None:
            shape = np.concatenate([shape, people.turned / people.turned_error], axis=1)
        self._clock = np.linspace(0.0, 1.0, len(shape))
        self._polygons = best_polygons(shape[::2], MOST)
        self._corners: list[tuple[int, ...]] = []
        self._tried: dict[int, list[tuple[Fit, float]]] = {}
        self._fits: dict[int, JudgedFit] = {}

    def with_components(self, count: int) -> JudgedFit:
        """Return the nearest fit with so many components."""
        if count not in self._fits:
            tried = self._refined(count)
            nearest = min(cost for _, cost in tried)
            near = [fit for fit, cost in tried if cost <= max(nearest, HOPELESS)]
            judged = [self._judged(held(self.people, fit)) for fit in near]
            self._fits[count] = min(judged, key=lambda one: (not one.misfit.says_all, one.misfit.square))
        return self._fits[count]

    def fewest(self) -> JudgedFit:
        """Return the fit with the fewest components that says all, or the nearest one where none does.

        Above eight components more are added by a quarter at a time, and then halved back.
        """
        short, count = 0, 1
        while not self._says_all(count):
            if count == MOST:
                return self._nearest()
            short, count = count, min(MOST, count + max(1, count // 4))
        while count - short > 1:
            middle = (count + short) // 2
            if self._says_all(middle):
                count = middle
            else:
                short = middle
        return self.with_components(count)

    def _nearest(self) -> JudgedFit:
        """Return the nearest fit where none says all: with as many components as there may be, unless given up."""
        found = min(map(self.with_components, self._tried), key=lambda one: one.misfit.square)
        if self._patient or found.misfit.agrees:
            return found
        patient = Search(self.people, True).with_components(MOST)
        return min(found, patient, key=lambda one: one.misfit.square)

    def _says_all(self, count: int) -> bool:
        """Return whether so many components say all: what is hopeless needs no closer look."""
        nearest = min(cost for _, cost in self._refined(count))
        return nearest <= HOPELESS and self.with_components(count).misfit.says_all

    def _refined(self, count: int) -> list[tuple[Fit, float]]:
        """Return the fits with so many components that are reached from its starts, and their mean squared distance."""
        if count not in self._tried:
            tried = self._tried[count] = []
            for start in self._starts(count):
                if len(tried) > 1 and not self._patient and min(cost for _, cost in tried) > HOPELESS:
                    break
                tried.append(refined(self._target, start, self._patient))
        return self._tried[count]

    def _starts(self, count: int) -> Iterator[Handover]:
        """Give starts on the edges of the best polygon, sharp and wide, and one on even stretches of the clock."""
        while len(self._corners) < count:
            self._corners.append(next(self._polygons))
        knots = self._clock[::2][list(self._corners[count - 1])]
        knots[-1] = 1.0
        yield _stretches(knots, EDGE)
        if count > 1:
            yield _stretches(np.linspace(0.0, 1.0, count + 1), CURVE)
            yield _stretches(knots, CURVE)

    def _judged(self, fit: Fit) -> JudgedFit:
        basis = fit.handover.basis(self._clock)
        turned = self.people.turned
        held_so = None if turned is None else basis @ lines(fit.handover, turned)
        return JudgedFit(fit, misfit(self.people, basis @ fit.coefficients, held_so))


def fit_handover(people: MeanPath, components: int) -> JudgedFit:
    """Return the hand-over and lines for the people's mean path; ``components``: how many, 0 to choose."""
    search = Search(people, components > 0)
    return search.with_components(components) if components else search.fewest()


def _stretches(knots: Floats, width: float) -> Handover:
    """Return the components that live on the stretches between rising clock values (K + 1,), so many times as wide
    as if evenly filled.
    """
    return Handover(0.5 * (knots[1:] + knots[:-1]), width * np.diff(knots) / np.sqrt(12.0))
