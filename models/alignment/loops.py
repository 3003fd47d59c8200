"""Closed drawings that people begin where they like: turned to one start before anything is laid upon anything."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from models.alignment.registration import some_of
from models.demonstration import Bools, Floats
from models.geometry import norms
from models.preprocessing.filtering import CleanMotion

POINTS = 64
CANDIDATES = 8
WIDEST_GAP = 0.1
BETTER = 2.0
NEAR = 0.04
SEAM = 0.05


class Starts(NamedTuple):
    """Where each of u drawings of one ring begins: ``turned`` (u,), 0..1 of its own way to the common start; zero for
    those that begin there.
    """

    turned: Floats


def starts(curves: Floats) -> Starts | None:
    """Return where drawings (u, n, d) of a closed shape begin, or None if they show no closed shape, or all begin in
    one place.

    Whether a shape is closed is no matter of how near its ends are: turned to another start, a drawing of an open
    shape lies worse upon the others, one of a ring begun elsewhere better. A drawing is begun elsewhere if it is at
    most half as far from the others once it is turned. The common start is where most began.
    """
    ways = norms(np.diff(curves, axis=1)).sum(axis=1)
    gaps = norms(curves[:, -1] - curves[:, 0])
    if float(np.median(gaps / np.maximum(ways, 1e-300))) > WIDEST_GAP:
        return None
    rings = curves[:, np.linspace(0, curves.shape[1] - 1, POINTS + 1).round().astype(np.int64)[:-1]]
    best: tuple[float, Floats, Floats] | None = None
    for candidate in some_of(curves, CANDIDATES):
        forward = _turned_upon(rings, rings[candidate])
        rest = float(np.median(forward.min(axis=1)))
        if best is None or rest < best[0]:
            best = (rest, forward, _turned_upon(rings[:, ::-1], rings[candidate]))
    assert best is not None
    _, forward, backward = best
    reverse = backward.min(axis=1) < forward.min(axis=1) / BETTER
    apart = np.where(reverse[:, None], backward, forward)
    turns = apart.argmin(axis=1)
    begun = np.where(reverse, -1 - turns, -turns) % POINTS
    offsets = np.abs(begun[:, None] - begun)
    offsets = np.minimum(offsets, POINTS - offsets)
    beside = (offsets <= NEAR * POINTS).sum(axis=1)
    common = int(begun[int(np.lexsort((offsets.sum(axis=1), -beside))[0])])
    own = np.where(reverse, begun - common, common - begun) % POINTS
    still: Bools = np.minimum(own, POINTS - own) <= NEAR * POINTS
    unturned = np.where(still, 0.0, own / POINTS)
    rest = apart.min(axis=1)
    first = int(np.flatnonzero(still)[0])
    upon = _turned_upon(np.where(reverse[:, None, None], rings[:, ::-1], rings), rings[first])[:, 0]
    elsewhere = ~still & (upon > BETTER * rest)
    return Starts(np.where(elsewhere, unturned, 0.0)) if elsewhere.any() else None


def _turned_upon(rings: Floats, ring: Floats) -> Floats:
    """Return the distance (u, m) in m, root mean square, of rings (u, m, d) from one, begun at each of their points."""
    index = np.arange(len(ring))
    turned = rings[:, (index[:, None] + index) % len(ring)]
    return np.sqrt(((turned - ring) ** 2).sum(axis=3).mean(axis=2))


def begun_at(motion: CleanMotion, places: Floats, share: float, start: Floats) -> CleanMotion:
    """Return a closed motion begun about ``share`` of its way later, at its sample nearest to the common start (d,).

    ``places`` (n,): its fractional samples at even steps of its way. What its own beginning and end are apart is made
    up for over 5 % of it on either side.
    """
    count = len(motion.times)
    reach = max(1, round(NEAR * len(places)))
    about = round(share * (len(places) - 1))
    low, high = (int(places[min(max(at, 0), len(places) - 1)]) for at in (about - reach, about + reach))
    low, high = min(max(low, 1), count - 2), min(max(high, 2), count - 1)
    first = low + int(norms(motion.points[low : max(high, low + 1)] - start).argmin())
    width = max(2, round(SEAM * count))
    gap = motion.points[0] - motion.points[-1]
    fading = np.clip(1.0 - np.arange(count) / width, 0.0, 1.0)[:, None]
    points = motion.points + 0.5 * gap * (fading[::-1] - fading)
    period = float(motion.times[-1] - motion.times[0] + motion.times[1] - motion.times[0])
    return replace(
        motion,
        times=np.concatenate([motion.times[first:], motion.times[:first] + period]),
        points=np.roll(points, -first, axis=0),
        triggers=np.roll(motion.triggers, -first),
        known=np.roll(motion.known, -first),
        orientations=None if motion.orientations is None else np.roll(motion.orientations, -first, axis=0),
        begun=float(motion.times[first]),
        period=period,
    )
