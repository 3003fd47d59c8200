"""The modes of a run in the words of robot people, each with a colour that is never alone, and what they need."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape

from opcua_skill.client import JobReport, Mode
from opcua_skill.panel.words import Words


@dataclass(frozen=True, slots=True)
class ModeLook:
    """How a mode is said: button, name, what moves; ``right`` is what the person has to have, ``role`` who has it."""

    button: str
    icon: str
    name: str
    moves: str
    right: str
    role: str


LOOKS: Mapping[Mode, ModeLook] = {
    "simulation": ModeLook("Simulate", "visibility", "SIMULATION", "nothing moves", "run", "operator"),
    # Roles go up in steps: who may approve may test (docs/interface.md, 7); the server says no more of a mode's rights.
    "test": ModeLook("Test", "directions_walk", "TEST (T1)", "the arm moves at reduced speed", "approve", "engineer"),
    "production": ModeLook(
        "Run", "play_arrow", "PRODUCTION (AUTO)", "the arm moves at the speed of the recipe", "run", "operator"
    ),
}


def mode_tag(words: Words, mode: str) -> str:
    """Return HTML for a mode: word and colour."""
    look = LOOKS.get(mode)  # type: ignore[call-overload]
    return f'<span class="tag mode-{escape(mode)}">{escape(words(look.name))}</span>' if look else escape(mode)


def moves(job: JobReport) -> bool:
    """Whether a job is one that moves the arm itself."""
    return job.mode != "simulation"
