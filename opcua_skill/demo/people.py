"""Whose demonstrations the demo learns from: files, the LASA handwriting set, or simulated people."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from library.errors import ReaderError
from library.readers import fit_to_plate, lasa, read_all
from models.demonstration import Demonstration
from models.synthetic import simulated_people

SHAPE = "WShape"
PEOPLE = 20


@dataclass(frozen=True, slots=True)
class Shown:
    """Demonstrations, and in words where they come from."""

    demonstrations: Sequence[Demonstration]
    source: str


def shown_by(people: str, files: Sequence[Path]) -> Shown:
    """Return what the files hold, if any; else real strokes, unless simulated people are asked for or all there is."""
    if files:
        return Shown(read_all(files), f"{len(files)} files")
    if people != "simulated":
        try:
            strokes = fit_to_plate(lasa(SHAPE))
        except ReaderError:
            return simulated(" (the LASA package is not installed)")
        return Shown(strokes, f"{len(strokes)} real demonstrations, LASA {SHAPE}, on a 65 × 90 mm plate")
    return simulated("")


def simulated(why: str) -> Shown:
    """Return simulated people on the paper's plate."""
    demonstrations, _ = simulated_people(PEOPLE)
    return Shown(demonstrations, f"{PEOPLE} simulated people on the paper's plate{why}")
