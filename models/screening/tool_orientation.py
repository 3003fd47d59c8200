"""How people held the tool: whether one of them, or a group, held it otherwise than the rest."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from models.demonstration import Bools, Floats
from models.findings import Finding
from models.geometry import norms
from models.screening.agreement import elsewhere, two_places
from models.screening.clustering import named


def held(orientations: Floats) -> tuple[Floats, float]:
    """Return how each of the aligned motions' tool (u, n, 4) was turned on average from that of the one in their midst.

    Rotation vectors (u, 3) in rad, and how far hands waver beside that, root mean square.
    """
    known: Bools = np.asarray(np.isfinite(orientations).all(axis=2))
    apart = [
        sum(_angle(*_both(orientations, known, one, other)) for other in range(len(known))) for one in range(len(known))
    ]
    midst = int(np.argmin(apart))
    where, squares = [], []
    for row in range(len(orientations)):
        reference, own = _both(orientations, known, midst, row)
        turned = Rotation.from_quat(reference).inv() * Rotation.from_quat(own)
        usual = turned.mean()
        where.append(usual.as_rotvec())
        squares.append((usual.inv() * turned).magnitude() ** 2)
    return _same_way(np.array(where)), float(np.sqrt(np.concatenate(squares).mean()))


def _angle(one: Floats, other: Floats) -> float:
    """Return the mean angle in rad, halved, between unit quaternions (k, 4)."""
    return float(np.arccos(np.minimum(np.abs((one * other).sum(axis=1)), 1.0)).mean())


def _same_way(turns: Floats) -> Floats:
    """Return rotation vectors (u, 3) of which those of nearly half a turn go the same way round."""
    angles = norms(turns)
    far = np.flatnonzero(angles > 0.5 * np.pi)
    if len(far):
        back = far[turns[far] @ turns[far[0]] < 0.0]
        turns[back] *= (1.0 - 2.0 * np.pi / angles[back])[:, None]
    return turns


def _both(orientations: Floats, known: Bools, one: int, other: int) -> tuple[Floats, Floats]:
    """Return the unit quaternions (k, 4) of two motions where both are known."""
    there = known[one] & known[other]
    first, second = orientations[one][there], orientations[other][there]
    return first / norms(first)[:, None], second / norms(second)[:, None]


def tool_findings(orientations: Floats | None, names: Sequence[str]) -> tuple[Finding, ...]:
    """Return what is to be said of people who held the tool otherwise, of aligned motions (u, n, 4)."""
    if orientations is None or len(orientations) < 3:
        return ()
    where, waver = held(orientations)
    far = elsewhere(where, waver)
    if far:
        people = tuple(sorted(names[row] for row in far))
        degrees = np.degrees(max(float(norms(offset)) for offset in far.values()))
        words = (
            f"{named(people)} held the tool up to {degrees:.0f} degrees from how the others did: exclude them, or let "
            "them show it again, for the tool is held as all did on average"
        )
        return (Finding("tool-held-otherwise", words, people=people),)
    groups = two_places(where, waver)
    if groups is None or not groups.apart:
        return ()
    most, others = (tuple(sorted(names[row] for row in group)) for group in (groups.most, groups.others))
    words = (
        f"the tool was held in two ways, {np.degrees(groups.size):.0f} degrees apart, by {named(most)} and by "
        f"{named(others)}: exclude one group, or show it again one way, for the tool is held between them"
    )
    return (Finding("tool-held-otherwise", words, people=others, others=most),)
