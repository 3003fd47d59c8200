"""What a program commands, whichever language it is in, and why one is not handed out."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from models.errors import SkillError
from sim.arm_model import Floats

Reason = Literal[
    "AxesNotSpoken", "OrientationTurns", "ToleranceInvalid", "ToleranceLost", "TimingLost", "ValveLost",
    "LineTooLong", "ProgramTooLong", "NotApproved", "NotReadBack", "NameInvalid",
]  # fmt: skip


class ProgramRefused(SkillError):
    """No program: ``reason`` in one word, the message in one sentence with the way out."""

    def __init__(self, reason: Reason, text: str) -> None:
        super().__init__(text)
        self.reason: Reason = reason


@dataclass(frozen=True, slots=True)
class Switch:
    """The valve opens or closes at ``time`` in s since the program's first motion."""

    time: float
    opens: bool


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Straight lines of the tip, each in its time: ``times`` (k,) s, ``points`` (k, 3) m and ``turns`` (k, 4) x y z w.

    All in the arm's base frame; between two rows place and orientation change evenly.
    """

    times: Floats
    points: Floats
    turns: Floats
    switches: tuple[Switch, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Splines:
    """Cubics of the joints, each in its time: ``times`` (k,) s, ``joints`` and ``velocities`` (k, dof)."""

    times: Floats
    joints: Floats
    velocities: Floats
    switches: tuple[Switch, ...]


def switching_at(commanded: Lines | Splines) -> dict[int, list[bool]]:
    """Return for the rows at whose time the valve switches whether it opens, in order."""
    found: dict[int, list[bool]] = {}
    for one in commanded.switches:
        found.setdefault(int(np.abs(commanded.times - one.time).argmin()), []).append(one.opens)
    return found


def ascii_of(text: str) -> str:
    """Return a text that a controller's comment may hold: printable ASCII without parentheses."""
    return "".join(one if 32 <= ord(one) < 127 and one not in "()" else "_" for one in text)


@dataclass(frozen=True, slots=True)
class Header:
    """What every program begins with: where it is from, and who stands for it."""

    skill: str
    skill_version: int
    skill_digest: str
    recipe: str
    recipe_digest: str
    plan_digest: str
    arm: str
    approved_by: str

    def rows(self) -> tuple[tuple[str, str], ...]:
        """Return names and values, in the order in which they are written."""
        return (
            ("skill", f"{self.skill} version {self.skill_version}"),
            ("skill digest", self.skill_digest),
            ("recipe", self.recipe),
            ("recipe digest", self.recipe_digest),
            ("plan digest", self.plan_digest),
            ("arm", self.arm),
            ("approved by", self.approved_by),
        )


@dataclass(frozen=True, slots=True)
class Options:
    """How a program is written: the most by which its path may be off (m and rad), its name, output and tool.

    ``output`` is the valve's; ``tool`` the number under which the controller knows the tool by its measured tip.
    """

    tolerance: float = 5e-5
    turn_tolerance: float = 2e-3
    name: str = "skill"
    output: int = 1
    tool: int = 1


@dataclass(frozen=True, slots=True)
class Language:
    """One controller's language. ``most_lines`` and ``longest_line`` are what it takes at most, ``limits`` says whence.

    ``quantum`` in s: what times are whole numbers of (0: any), ``longest_row`` in s: the longest one line may take.
    ``rounding``: the share of the tolerance that is left to the controller for rounding the corners between lines.
    ``write`` makes the text, ``read`` finds in it what it commands.
    """

    name: str
    ending: str
    form: Literal["lines", "splines"]
    most_lines: int
    longest_line: int
    limits: str
    quantum: float
    rounding: float
    axes: tuple[int, ...]
    turns: Literal["any", "about z"]
    write: Callable[..., str]
    read: Callable[[str], Lines | Splines]
    longest_row: float = math.inf


@dataclass(frozen=True, slots=True)
class Comparison:
    """A program read back beside its plan: what it is off by at most.

    ``path`` m and ``turn`` rad at the same time, so a delay counts as well; ``duration`` and ``switching`` s.
    """

    path: float
    turn: float
    duration: float
    switching: float
    lines: int
    longest_line: int
    rows: int
