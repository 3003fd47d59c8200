"""What motion-capture files have in common: many markers, of which one is followed."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from library.errors import ChoiceNeeded, ReaderError
from library.readers.import_options import Choices
from library.readers.text_table import Sheet, demonstration, turned_up
from models.demonstration import Demonstration, Floats

LISTED = 12


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The way of one marker or body: ``times`` (n,) in s, ``points`` (n, 3) in m, NaN where it was not seen."""

    name: str
    times: Floats
    points: Floats


def follow(path: Path, tracks: Sequence[Track], choices: Choices, up_axis: str = "z") -> list[Demonstration]:
    """Return the way of the chosen marker, with z up; ``up_axis`` is what the format says where nothing is chosen."""
    track = _chosen(path, tracks, choices.marker)
    points = turned_up(track.points, choices.up_axis or up_axis)
    return [demonstration(path, path.stem, track.times, points)]


def frame_times(
    sheet: Sheet, lines: Sequence[int], rate: float, *, told: Sequence[float] | None = None, told_step: float = 0.001
) -> Floats:
    """Return times (n,) in s by the frame numbers in the first column, which are exact where written times are rounded.

    ``told`` are the written times, rounded to ``told_step``: where they and the rate disagree the file is damaged.
    """
    frames = np.array([sheet.number(line, 0) for line in lines])
    for before, after, line in zip(frames[:-1], frames[1:], lines[1:], strict=True):
        if after <= before or after != round(after):
            raise sheet.error(f"frame {after:g} does not come after {before:g}", "delete or mend the line", line)
    times = (frames - frames[0]) / rate
    if told is not None:
        away = np.abs((np.asarray(told) - told[0]) - times)
        if away.max() > 0.5 / rate + told_step:
            line = lines[int(np.argmax(away))]
            problem = f"its time does not fit its frame number at {rate:g} frames a second"
            raise sheet.error(problem, "export the file again", line)
    return times


def table(sheet: Sheet, lines: Sequence[int], columns: Sequence[int], width: int) -> Floats:
    """Return the numbers (n, c) of some columns; empty cells are NaN, but a position is whole or missing."""
    for line in lines:
        if len(sheet.rows[line - 1]) < width:
            found = len(sheet.rows[line - 1])
            raise sheet.error(f"the line has {found} cells of {width}", "it may be cut off: export it again", line)
    values = np.array([[sheet.number(line, column, gap=True) for column in columns] for line in lines])
    missing = np.isnan(values)
    half = np.flatnonzero(missing.any(axis=1) & ~missing.all(axis=1))
    if len(half):
        raise sheet.error("only a part of a position is there", "mend or empty it", lines[int(half[0])])
    return values


def pick(path: Path, names: Sequence[str], wanted: str, choice: str = "marker") -> int:
    """Return the place of the wanted name; a single one need not be named. ``choice`` says marker or topic."""
    if not wanted and len(names) == 1:
        return 0
    shown = ", ".join(names[:LISTED]) + (f" and {len(names) - LISTED} more" if len(names) > LISTED else "")
    if not names:
        raise ReaderError(path, f"it holds no {choice}s to follow", "export or record it with positions")
    if not wanted:
        raise ChoiceNeeded(path, f"it holds {len(names)} {choice}s", f"choose one of {shown}", choice, tuple(names))
    for same in (str, str.casefold, _without_subject):
        found = [place for place, name in enumerate(names) if same(name) == same(wanted)]
        if len(found) == 1:
            return found[0]
        if found:
            raise ReaderError(path, f"{len(found)} {choice}s are called {wanted!r}", "name them apart and export again")
    raise ChoiceNeeded(path, f"it holds no {choice} {wanted!r}", f"choose one of {shown}", choice, tuple(names))


def up_axis_needed(sheet: Sheet, remedy: str) -> ChoiceNeeded:
    """Return the complaint that the up axis has to be chosen, for the caller to raise."""
    problem = "the format does not say which axis points up"
    return ChoiceNeeded(sheet.path, problem, remedy, "up_axis", ("x", "y", "z"))


def _without_subject(name: str) -> str:
    """Return ``marker`` of Vicon's ``Subject:Marker``."""
    return name.rpartition(":")[2].casefold()


def _chosen(path: Path, tracks: Sequence[Track], wanted: str) -> Track:
    return tracks[pick(path, [track.name for track in tracks], wanted)]
