"""How to learn: presets and what may be changed of them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from typing import Literal

from models.errors import OptionOutOfRange

OWN_PRESETS = ("recommended", "free", "paper")
DOOR = "opcua_skill.presets"
"""The group of entry points under which others bring presets of their own (``models.presets.Preset``)."""
Progress = Callable[[float, str], None]
"""How learning tells how far it is: the share done, 0..1, and at what."""


@cache
def preset_names() -> tuple[str, ...]:
    """Return the names of all presets: ours, then those that installed distributions bring."""
    return (*OWN_PRESETS, *sorted({entry.name for entry in entry_points(group=DOOR)} - set(OWN_PRESETS)))


@dataclass(frozen=True, slots=True)
class LearningOptions:
    """How to learn. A zero or an empty text stands for what the preset says.

    ``components`` is the number of Gaussians (0: the preset's, where ``recommended`` finds it from the path);
    ``filter_window`` of the moving average in s; ``alignment`` the exact ``dtw`` or the ``fastdtw`` package,
    ``radius`` the latter's; ``clock``: components over the ``path`` or over ``time``; ``reject_outliers``: leave out
    demonstrations that do not fit the others; ``time_step`` in s of the reported path; ``seed`` of whatever is drawn
    at random; ``place``: ``plate`` keeps each demonstration where it was drawn, ``free`` moves, turns and scales them
    onto each other. The preset ``free`` is ``recommended`` with ``place`` free.
    """

    preset: str = "recommended"
    components: int = 0
    filter_window: float = 0.0
    alignment: Literal["", "dtw", "fastdtw"] = ""
    radius: int = 0
    clock: Literal["", "path", "time"] = ""
    reject_outliers: bool = True
    time_step: float = 0.0
    seed: int = 0
    place: Literal["plate", "free"] = "plate"

    def __post_init__(self) -> None:
        for name, allowed in (
            ("preset", preset_names()),
            ("alignment", ("", "dtw", "fastdtw")),
            ("clock", ("", "path", "time")),
            ("place", ("plate", "free")),
        ):
            value = getattr(self, name)
            if value not in allowed:
                words = " or ".join(repr(word) for word in allowed if word)
                raise OptionOutOfRange(f"{name} is {value!r}: it has to be {words}")
        for name, most, unit in (
            ("components", 64, ""),
            ("filter_window", 5.0, " s"),
            ("radius", 1000, ""),
            ("time_step", 10.0, " s"),
        ):
            value = getattr(self, name)
            if not 0 <= value <= most:
                raise OptionOutOfRange(f"{name} is {value:g}{unit}: it has to be between 0 and {most:g}{unit}")
        if self.preset == "free":
            object.__setattr__(self, "place", "free")
        if self.preset == "paper" and self.place == "free":
            raise OptionOutOfRange("place is 'free': the paper's preset keeps demonstrations where they were drawn")
