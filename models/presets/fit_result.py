"""What a preset makes of demonstrations: a mixture, and what has to be said of everybody behind it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from models.alignment.aligned import AlignedDemonstrations
from models.demonstration import Floats
from models.findings import Finding, Remark
from models.mixture.gmm import Mixture
from models.mixture.gmr import CovarianceRule
from models.motion import Clock
from models.screening.pauses import Detour, Pause


@dataclass(frozen=True, slots=True, eq=False)
class FitResult:
    """A mixture and the demonstrations behind it.

    ``rows`` (u,): which of the motions given are in ``aligned``; ``phases`` (n,): 0..1, of its instants.
    ``left_out``, ``in_part`` and ``remarks``: what is to be said of motions, by their index; ``findings``: of them all;
    ``pauses`` and ``extras``: where they stood still, and what they drew that the others did not, place 0..1 on the
    path.
    """

    mixture: Mixture
    clock: Clock
    duration: float
    phases: Floats
    aligned: AlignedDemonstrations
    rows: tuple[int, ...]
    covariance_rule: CovarianceRule
    left_out: dict[int, Remark]
    in_part: dict[int, Remark]
    remarks: dict[int, Remark]
    findings: tuple[Finding, ...]
    pauses: Mapping[int, tuple[Pause, ...]] = field(default_factory=dict[int, tuple[Pause, ...]])
    extras: Mapping[int, tuple[Detour, ...]] = field(default_factory=dict[int, tuple[Detour, ...]])
