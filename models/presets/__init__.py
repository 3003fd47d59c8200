"""What a preset is, and which there are: ours, and those that installed distributions bring by entry point."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points

from models.options import DOOR, LearningOptions, Progress
from models.preprocessing.filtering import CleanMotion
from models.presets.fit_result import FitResult
from models.presets.paper import fit_as_published
from models.presets.recommended import fit_recommended

FILTER_WINDOW = 0.07
"""The moving average of the paper's preset, in s: seven samples at 100 Hz, with which its figures were measured.

The paper names the filter and not its width.
"""


@dataclass(frozen=True, slots=True)
class Preset:
    """A way to learn.

    ``fit`` returns the mixture of cleaned motions, of which there are at least two of one dimension. Before, each is
    filtered by a moving average of ``filter_window`` s (0: by as much as its own noise asks for), and ``despiked``
    says whether reflections are taken out. ``compared``: the report holds the paper's preset against it.
    """

    fit: Callable[[list[CleanMotion], LearningOptions, Progress], FitResult]
    filter_window: float = 0.0
    despiked: bool = True
    compared: bool = True


OWN = {
    "recommended": Preset(fit_recommended),
    "free": Preset(fit_recommended),
    "paper": Preset(fit_as_published, filter_window=FILTER_WINDOW, despiked=False, compared=False),
}


@cache
def preset_named(name: str) -> Preset:
    """Return a preset of ``models.options.preset_names``. Raises TypeError if an entry point brings something else."""
    if name in OWN:
        return OWN[name]
    (entry,) = entry_points(group=DOOR, name=name)
    found = entry.load()
    if not isinstance(found, Preset):
        raise TypeError(f"{entry.value} is no models.presets.Preset")
    return found
