"""What is wrong with a motion or worth telling of it: a code, a place, a size; and the refusal made of such."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from models.errors import SkillError

Code = Literal[
    "WorkspaceLimit", "JointLimit", "SpeedLimit", "NoIkSolution", "Singularity", "Collision", "ParameterInvalid"
]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong or worth telling: ``time`` in s since the path's start, ``phase`` 0..1 along it.

    ``size`` says by how much, in ``unit``. Both places are NaN where the finding is not about a place. A fatal
    finding refuses the plan, any other goes with it in its report. ``place`` is the arc length in m along the path,
    ``asked`` what was wanted and ``limit`` what is possible, both in ``unit``; NaN where there is no such figure.
    ``joint`` counts from 1; 0: it is about no joint.
    """

    code: Code
    time: float
    phase: float
    size: float
    unit: str
    text: str
    fatal: bool = True
    place: float = math.nan
    asked: float = math.nan
    limit: float = math.nan
    joint: int = 0


class MotionRefused(SkillError):
    """A motion that will not be planned: nothing has moved. ``failure`` is the word for the job report."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        super().__init__(tuple(findings))
        self.findings = tuple(findings)

    @property
    def failure(self) -> Code:
        """Return the code of the first finding."""
        return self.findings[0].code

    def __str__(self) -> str:
        """Return what is wrong in one sentence."""
        more = len(self.findings) - 1
        return self.findings[0].text + (f" (and {more} more)" if more else "")
