"""Places that are none: what recorders write where a marker was lost, 0,0,0 or 9999,9999,9999 among them."""

import numpy as np

from models.demonstration import Bools, Floats
from models.geometry import norms, ranked

BRISK = 0.9
QUICKER = 2.0
LEAST = 4


def without_placeholders(times: Floats, points: Floats) -> Floats:
    """Return points (n, d) with NaN for samples that say by one number in every axis that nothing was seen.

    No list of such numbers is kept: samples count as that if their axes hold the same number, sign apart, and if the
    hand, at twice its brisk speed, came to them neither from the sample before nor to the one after.
    """
    seen: Bools = np.asarray(np.isfinite(points).all(axis=1))
    same: Bools = np.asarray(seen & (np.abs(points) == np.abs(points[:, :1])).all(axis=1))
    if 2 * int(same.sum()) > int(seen.sum()):
        # A drawing along the diagonal, or a marker that was hardly seen: then nothing but zeros says so.
        same &= (points == 0).all(axis=1)
    real, doubtful = np.flatnonzero(seen & ~same), np.flatnonzero(same)
    if not len(doubtful) or len(real) < LEAST:
        return points
    speeds = norms(np.diff(points[real], axis=0)) / np.diff(times[real])
    fastest = QUICKER * float(ranked(speeds, BRISK))
    another = (np.diff(doubtful) > 1) | (np.abs(np.diff(points[doubtful], axis=0)) > 0).any(axis=1)
    starts = np.concatenate([[0], np.flatnonzero(another) + 1])
    firsts, lasts = doubtful[starts], doubtful[np.append(starts[1:], len(doubtful)) - 1]
    place = np.searchsorted(real, firsts)
    reached = np.zeros(len(firsts), dtype=np.bool_)
    for ends, others, there in (
        (firsts, real[np.maximum(place - 1, 0)], place > 0),
        (lasts, real[np.minimum(place, len(real) - 1)], place < len(real)),
    ):
        away = norms(points[ends] - points[others])
        reached |= there & (away <= fastest * np.abs(times[ends] - times[others]))
    found = points.copy()
    for first, last in zip(firsts[~reached].tolist(), lasts[~reached].tolist(), strict=True):
        found[first : last + 1] = np.nan
    return found
