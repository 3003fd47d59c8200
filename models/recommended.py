"""The recommended alignment: every motion by its way, laid upon the others as ``models.group`` does."""

import numpy as np

from models.cleaning import CleanMotion
from models.correspondence import Correspondence, taken_at
from models.demonstration import Floats
from models.group import POINTS, Group, lay_upon_each_other
from models.phase import at, travelled


def to_common_shape(motions: list[CleanMotion], method: str, radius: int) -> tuple[Correspondence, Group]:
    """Return the motions at the instants of their common shape, and how they lie upon each other."""
    places, curves = [], []
    for motion in motions:
        index = np.arange(len(motion.times), dtype=np.float64)
        places.append(np.interp(np.linspace(0.0, 1.0, POINTS), travelled(motion), index))
        curves.append(at(places[-1], index, motion.points))
    group = lay_upon_each_other(np.stack(curves), method, radius)
    samples: Floats = np.stack(
        [
            np.interp(where, np.arange(POINTS), own) + 0.0 * where
            for where, own in zip(group.positions, places, strict=True)
        ]
    )
    return taken_at(motions, samples), group
