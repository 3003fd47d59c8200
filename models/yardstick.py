"""The one yardstick of learning: how sure the people's mean path is, along the path, across it.

Twenty people who each miss a place by 1 mm have a mean that is sure to 0.22 mm there. A path that keeps within the
standard error of the mean says all that these people agreed on; what is closer follows their chance waves.
"""

from dataclasses import dataclass

import numpy as np

from models.alignment.registration import mean_of
from models.demonstration import Floats
from models.geometry import norms

WHOLE_PATH = 4.0  # people that what all differ by on the whole path counts as, where those of one place are few
FINEST = 1e-4  # of the path's length: a tenth of the 1000 points that a path is shown by; for people without any spread
SHARE = 0.95  # of the way that a path has to keep within one standard error
WORST = 2.0  # standard errors that it may be off anywhere
STAYING = 0.05  # of the way between two points counts as distance: a stroke gone over twice lies upon itself
WINDOW = 0.04  # of the path: how far from its own place on the clock a point of it is sought


@dataclass(frozen=True, slots=True, eq=False)
class MeanPath:
    """The mean of people at n even steps of the clock, and how sure it is.

    ``points`` (n, d) in m; ``ahead`` (n, d): the unit direction it moves in; ``errors`` (n,): its standard error in m
    across that, of one direction. ``turned`` (n, 4) and ``turned_error``: the mean orientation, if any, and the
    standard error of one of its numbers.
    """

    points: Floats
    ahead: Floats
    errors: Floats
    turned: Floats | None = None
    turned_error: float = 1.0


def mean_path(points: Floats, weights: Floats, orientations: Floats | None) -> MeanPath:
    """Return the mean of motions (u, n, d), counted by their weights (u, n), and its standard error.

    The variance of few people at one place is itself unsure, so that of the whole path counts as four people more.
    """
    mean = mean_of(points, weights)
    ahead = heading(mean)
    apart = points - mean
    apart = apart - (apart * ahead).sum(axis=2, keepdims=True) * ahead
    square = mean_of((apart * apart).sum(axis=2, keepdims=True), weights)[:, 0] / (mean.shape[1] - 1)
    known = np.where(np.isfinite(points[:, :, 0]), weights, 0.0)
    people = known.sum(axis=0) ** 2 / np.maximum((known * known).sum(axis=0), 1e-12)
    free = np.maximum(people - 1.0, 0.0)
    own = square * people
    variance = (own + WHOLE_PATH * float(own.sum() / max(float(free.sum()), 1.0))) / (free + WHOLE_PATH)
    least = FINEST * float(norms(np.diff(mean, axis=0)).sum())
    errors = np.sqrt(variance / np.maximum(people, 1e-12) + least * least)
    if orientations is None:
        return MeanPath(mean, ahead, errors)
    turned = mean_of(orientations, weights)
    square = float(np.nanmean((orientations - turned) ** 2))
    return MeanPath(mean, ahead, errors, turned, float(np.sqrt(square / max(float(free.mean()), 1.0) + FINEST**2)))


def heading(path: Floats) -> Floats:
    """Return the unit directions (n, d) in which a path (n, d) moves; zero where it stands."""
    moves = np.gradient(path, axis=0)
    lengths = norms(moves)
    still = 1e-9 * float(lengths.max()) + 1e-300
    return moves / np.maximum(lengths, still)[:, None]


@dataclass(frozen=True, slots=True)
class Misfit:
    """How far a path lies from the people's mean, in standard errors: over which ``share`` of the way it keeps within
    one, the ``worst`` and at which ``place`` 0..1, and the mean ``square``. ``beyond``: the share further than two.
    """

    share: float
    worst: float
    square: float
    place: float
    beyond: float

    @property
    def says_all(self) -> bool:
        """Whether the path says all that these people agreed on."""
        return self.share >= SHARE and self.worst <= WORST

    @property
    def agrees(self) -> bool:
        """Whether it is nowhere surely another path than theirs."""
        return self.beyond <= 1.0 - SHARE


def misfit(people: MeanPath, path: Floats, turned: Floats | None) -> Misfit:
    """Return how far a path (n, d) at the people's clock values lies from their mean, seen from either; so does how
    the tool is held there, ``turned`` (n, 4), where they recorded it.
    """
    mean, index = people.points, np.arange(len(people.points), dtype=np.float64)
    there, where = _away(path, mean)
    back, _ = _away(mean, path)
    ratios = [there / np.interp(where, index, people.errors), back / people.errors]
    if people.turned is not None and turned is not None:
        meant = np.column_stack([np.interp(where, index, column) for column in people.turned.T])
        ratios.append(np.abs(turned - meant).max(axis=1) / people.turned_error)
    return Misfit(
        share=min(float((ratio <= 1.0).mean()) for ratio in ratios),
        worst=max(float(ratio.max()) for ratio in ratios),
        square=float(np.mean([(ratio * ratio).mean() for ratio in ratios])),
        place=float(max(ratios, key=lambda ratio: float(ratio.max())).argmax() / (len(mean) - 1)),
        beyond=max(float((ratio > WORST).mean()) for ratio in ratios),
    )


def _away(path: Floats, other: Floats) -> tuple[Floats, Floats]:
    """Return how far (n,) in m each point of a path (n, d) is from another (n, d), and at which index of that (n,)."""
    where = retimed(path, other)
    index = np.arange(len(other), dtype=np.float64)
    return norms(path - np.column_stack([np.interp(where, index, column) for column in other.T])), where


def retimed(path: Floats, mean: Floats, window: float = WINDOW) -> Floats:
    """Return the fractional index (n,) of the mean path (n, d) that is nearest to each point of the path (n, d).

    It is sought within ``window`` (a part of the path) before and after, and rises. A point further off counts as
    further by a twentieth of the way between, so that a stroke gone over twice is not taken for its way back.
    """
    count = len(path)
    reach = max(2, round(window * count))
    index = np.arange(count)
    segments = np.clip(index + np.arange(-reach, reach + 1)[:, None], 0, count - 2)
    walked = np.diff(mean, axis=0)
    gaps = [own - other[segments] for own, other in zip(path.T, mean.T, strict=True)]
    steps = [other[segments] for other in walked.T]
    squares = np.maximum(sum(step * step for step in walked.T), 1e-300)[segments]
    along = sum(gap * step for gap, step in zip(gaps, steps, strict=True)) / squares
    along = np.minimum(np.maximum(along, 0.0), 1.0)
    reached = segments + along
    away = sum((gap - along * step) ** 2 for gap, step in zip(gaps, steps, strict=True))
    moved = STAYING * float(norms(walked).mean()) * (reached - index)
    nearest = np.argmin(away + moved * moved, axis=0)
    where = reached[nearest, index]
    where[0], where[-1] = 0.0, count - 1.0
    return np.minimum(np.maximum.accumulate(where), count - 1.0)
