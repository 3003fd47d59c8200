"""Lost markers: how much of a recording was not seen, and the recording without it."""

from dataclasses import dataclass, replace

import numpy as np

from models.demonstration import Bools, Demonstration


@dataclass(frozen=True, slots=True)
class Gaps:
    """Of ``samples`` samples ``lost`` have no position; ``longest`` is the longest time in s between two that have."""

    samples: int
    lost: int
    longest: float

    def words(self) -> str:
        """Return what was not seen as a sentence without its end."""
        return f"{self.lost} of {self.samples} samples were not seen, the longest gap is {self.longest:.2f} s"


def gaps(demonstration: Demonstration) -> Gaps:
    """Return how much of a recording was not seen."""
    seen: Bools = np.asarray(np.isfinite(demonstration.points).all(axis=1))
    places = np.flatnonzero(seen)
    steps = np.diff(demonstration.times[places])[np.diff(places) > 1]
    return Gaps(len(seen), int(len(seen) - seen.sum()), float(steps.max(initial=0.0)))


def without_gaps(demonstration: Demonstration) -> Demonstration:
    """Return a recording without the samples that were not seen; in time the gap stays, and nothing is filled in.

    A server takes no NaN; learning bridges short gaps and reports long ones by their length in time.
    """
    seen = np.isfinite(demonstration.points).all(axis=1)
    if seen.all() or not seen.any():
        return demonstration
    times = demonstration.times[seen]
    turned = demonstration.orientations
    return replace(
        demonstration,
        times=times - times[0],
        points=demonstration.points[seen],
        triggers=demonstration.triggers[seen],
        orientations=None if turned is None else turned[seen],
    )
