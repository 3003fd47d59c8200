"""A stroke that is learned in a moment and run in four seconds: 30 mm along, 20 mm up, shown by a few hands."""

import numpy as np

from models.demonstration import Demonstration

CORNERS = np.array([[0.0, 0.0], [0.03, 0.0], [0.03, 0.02]])


def small_corner(people: int = 3, samples: int = 70, seed: int = 0) -> list[Demonstration]:
    """Return what ``people`` hands drew, each a little beside the other and a little slower than the one before."""
    hands = np.random.default_rng(seed)
    along = np.linspace(0.0, 1.0, samples)
    shape = np.column_stack([np.interp(along, [0.0, 0.6, 1.0], CORNERS[:, axis]) for axis in range(2)])
    return [
        Demonstration(
            demonstration_id=f"hand-{number}",
            times=along * 1.4 * (1.0 + 0.05 * number),
            points=shape + hands.normal(0.0, 1e-4, shape.shape) + hands.normal(0.0, 3e-4, 2),
            triggers=np.ones(samples, dtype=bool),
            operator=f"hand-{number}",
            source="drawn",
        )
        for number in range(people)
    ]
