"""What is missing or odd in an arm's files: one typed row a thing, with a sentence that says the way out."""

from dataclasses import dataclass
from typing import Literal

from models.errors import SkillError

Weight = Literal["error", "warning", "note"]
Code = Literal[
    "FilesMissing",
    "SeveralArms",
    "Unreadable",
    "Encoding",
    "ByteOrderMark",
    "Xacro",
    "PackagePath",
    "NotUrdf",
    "DuplicateName",
    "UnknownLink",
    "SeveralRoots",
    "SeveralParents",
    "Loop",
    "JointType",
    "Mimic",
    "NoAxis",
    "AxisNotUnit",
    "NumberUnreadable",
    "AxisCount",
    "SeveralChains",
    "NoLimits",
    "ZeroLimits",
    "LimitsSwapped",
    "LimitsWider",
    "InDegrees",
    "InMillimetres",
    "NoSource",
    "NoHull",
    "HullIncomplete",
    "HullSticksOut",
    "NeedleThick",
    "HomeOutside",
    "HomeOutsideWorkspace",
    "HomeInCollision",
    "WorkspaceUnreachable",
    "WorkspacePartly",
    "PartUnreachable",
    "NozzleUp",
    "FewAxes",
    "MeshMissing",
    "MeshUnreadable",
    "MeshHuge",
    "NoInertia",
    "Unconfirmed",
    "NotLoadable",
]


@dataclass(frozen=True, slots=True)
class ArmFinding:
    """One thing about an arm's files. ``where`` is the file, link, joint or field it is about.

    ``error``: the arm is refused or would be wrong; ``warning``: it works, somebody should look; ``note``: to know.
    """

    code: Code
    weight: Weight
    where: str
    text: str


def error(code: Code, where: str, text: str) -> ArmFinding:
    """Return a finding for which the arm cannot be used."""
    return ArmFinding(code, "error", where, text)


def warning(code: Code, where: str, text: str) -> ArmFinding:
    """Return a finding with which the arm can be used, if somebody has looked."""
    return ArmFinding(code, "warning", where, text)


def note(code: Code, where: str, text: str) -> ArmFinding:
    """Return a finding that is only to be known."""
    return ArmFinding(code, "note", where, text)


class DescriptionError(SkillError, ValueError):
    """Files of a robot that cannot be read, proposed from or measured with: one sentence with the way out."""
