"""What learning finds worth telling, as values: a code that programs decide on beside the sentence for people."""

from dataclasses import dataclass
from typing import Literal

Code = Literal[
    "",
    # what one demonstration did: verdicts
    "excluded",
    "invalid",
    "off",
    "elsewhere",
    "another-shape",
    "opposite-direction",
    "drawn-twice",
    "started-late",
    "let-go-early",
    "began-before",
    "went-on",
    "marker-lost",
    "other-beads",
    "paused",
    "waited",
    "went-over-again",
    "way-around",
    # what is to be known of them all: findings
    "two-shapes",
    "two-directions",
    "two-places",
    "two-disagree",
    "two-ways",
    "begun-elsewhere",
    "common-gap",
    "start-guessed",
    "end-guessed",
    "path-simplified",
    "without-orientation",
    "tool-held-otherwise",
    "dots-not-laid",
]


@dataclass(frozen=True, slots=True)
class Finding:
    """Something of all demonstrations that an engineer wants to know before signing.

    ``place``: phase 0..1 of it, ``size`` in m; ``people``: ids of the demonstrations it is said of; ``others``: those
    that they differ from, where two groups are told apart.
    """

    code: Code
    sentence: str
    place: float | None = None
    size: float | None = None
    people: tuple[str, ...] = ()
    others: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Remark:
    """What is to be said of one motion: ``place`` 0..1 on the path, ``size`` in m, ``code`` for programs."""

    reason: str
    place: float | None = None
    size: float | None = None
    code: Code = ""
