"""Recordings and what an operator struck from them: values, never changed once made."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Demonstration:
    """One recorded human motion.

    ``times`` has shape (n,), in seconds from the first sample, strictly rising.
    ``points`` has shape (n, d), d = 2 or 3, in metres in the part's frame; a lost marker is NaN.
    ``triggers`` has shape (n,): the push button, True while the process (glue) is to be on.
    ``orientations``, if recorded, has shape (n, 4): unit quaternions x y z w of the tool in the part's frame.
    """

    demonstration_id: str
    times: Floats
    points: Floats
    triggers: Bools
    operator: str = ""
    source: str = ""
    recorded_at: datetime | None = None
    orientations: Floats | None = None

    @property
    def dimension(self) -> int:
        """Number of position values a sample has: 2 or 3."""
        return int(self.points.shape[1])


@dataclass(frozen=True, slots=True)
class Edits:
    """What an operator took out of recordings: kept beside them and replayed at each learning.

    ``excluded`` holds ids of whole demonstrations; ``struck`` maps an id to the indices of samples of the recording.
    """

    excluded: frozenset[str] = frozenset()
    struck: Mapping[str, frozenset[int]] = field(default_factory=dict[str, frozenset[int]])

    def __post_init__(self) -> None:
        object.__setattr__(self, "struck", MappingProxyType(dict(self.struck)))

    def __reduce__(self) -> tuple[type["Edits"], tuple[frozenset[str], dict[str, frozenset[int]]]]:
        """Cross to a worker process: a read-only view of a mapping cannot be pickled as it is."""
        return Edits, (self.excluded, dict(self.struck))

    def with_struck(self, demonstration_id: str, indices: frozenset[int]) -> "Edits":
        """Return these edits and the samples at ``indices`` of one recording struck as well."""
        merged = dict(self.struck)
        merged[demonstration_id] = merged.get(demonstration_id, frozenset()) | indices
        return Edits(self.excluded, merged)
