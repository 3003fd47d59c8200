"""Motion-capture and other files as demonstrations, in metres and seconds; gaps stay gaps (NaN).

Every file is a clear error, which names file, line and remedy, or the trajectory that stands in it.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from library.readers.flat import Plane, common_plane
from library.readers.formats import read
from library.readers.gaps import Gaps, gaps, without_gaps
from library.readers.import_options import Choices
from library.readers.isolation import Reader, read_apart, read_upload
from library.readers.lasa import lasa
from library.readers.placing import fit_to_plate, onto_plane
from models.demonstration import Demonstration

__all__ = [
    "Choices",
    "Gaps",
    "Plane",
    "Reader",
    "common_plane",
    "fit_to_plate",
    "gaps",
    "lasa",
    "named_apart",
    "onto_plane",
    "read",
    "read_all",
    "read_apart",
    "read_upload",
    "without_gaps",
]


def read_all(paths: Sequence[str | Path], choices: Choices | None = None) -> list[Demonstration]:
    """Return the demonstrations of several files; where names are equal, the later ones get a number."""
    return named_apart([one for path in paths for one in read(path, choices)])


def named_apart(demonstrations: Sequence[Demonstration]) -> list[Demonstration]:
    """Return demonstrations of different names: the second ``stroke`` becomes ``stroke-2``."""
    found: list[Demonstration] = []
    taken: set[str] = set()
    for demonstration in demonstrations:
        name, number = demonstration.demonstration_id, 2
        while name in taken:
            name, number = f"{demonstration.demonstration_id}-{number}", number + 1
        taken.add(name)
        found.append(replace(demonstration, demonstration_id=name))
    return found
