"""Plain CSV: one line a sample, its first line names the columns and their units (``t_s,x_mm,y_mm``).

Columns: ``t`` or ``time`` (s, ms, us, ns), ``x``, ``y`` and perhaps ``z`` (m, cm, mm), ``trigger`` (0 or 1),
``qx qy qz qw``, and ``demonstration`` where a file holds several. A unit is written ``x_mm``, ``x [mm]`` or ``x (mm)``;
without one: s and m. Where there are several markers (``pen_x``, ``pen_y``, ``cap_x`` …) one has to be chosen.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from library.readers.import_options import Choices
from library.readers.lost import without_placeholders
from library.readers.text_table import (
    MAX_EXTENT,
    METRES,
    SECONDS,
    Sheet,
    demonstration,
    is_number,
    orientations_turned_up,
    turned_up,
)
from library.readers.tracks import pick
from models.demonstration import Bools, Demonstration, Floats

ROLES = {
    **dict.fromkeys(("t", "time", "times", "timestamp"), "t"),
    **{name: name for name in ("x", "y", "z", "qx", "qy", "qz", "qw")},
    **{f"{word}_{axis}": axis for word in ("pos", "position") for axis in ("x", "y", "z")},
    **dict.fromkeys(("trigger", "triggers", "button", "dispense"), "trigger"),
    **dict.fromkeys(("demonstration", "demonstration_id", "demo", "trial"), "demonstration"),
}
HEADER = "name the columns on the first line, for example t_s,x_mm,y_mm,z_mm,trigger"
USE_S = "use one of s, ms, us, ns"
CONVERT = "use one of m, cm, mm: an inch has 25.4 mm, a foot 304.8"
KNOWN = ("t", "x", "y", "z", "qx", "qy", "qz", "qw", "trigger", "demonstration")
AXES = ("x", "y", "z")
UNUSED = {"frame", "frame#", "sample", "index"}
NO_PLACES = {
    "q",
    "quat",
    "rot",
    "rotation",
    "orientation",
    "angle",
    "euler",
    "v",
    "vel",
    "velocity",
    "acc",
    "force",
    "f",
}
QUATERNION = ("qx", "qy", "qz", "qw")
MAX_EXTENT_WITHOUT_UNIT = 3.0
SLOWEST = 2.0
ON_OFF = {"0": False, "1": True, "false": False, "true": True, "off": False, "on": True}
_UNITS = "|".join(sorted((*SECONDS, *METRES), key=len, reverse=True))
_COLUMN = re.compile(rf"([a-z_]+?)(?:_({_UNITS})| ?[\[(]([^\])]+)[\])])?")
_MARKER = re.compile(rf"(.*[^_. :])[_. :]([xyz])((?:_(?:{_UNITS})| ?[\[(][^\])]+[\])])?)", re.IGNORECASE)
_OTHER_UNIT = re.compile(r"([xyz])[_ ](?:in|inch|inches|ft|foot|feet|um|µm|μm|micron|microns|nm|dm|km|yd)")


def read(sheet: Sheet, choices: Choices) -> list[Demonstration]:
    """Return the demonstrations of a plain CSV file, in the order in which they begin."""
    header = _header(sheet, choices)
    columns = header.columns
    lines = [line for line, cells in enumerate(sheet.rows, 1) if line > 1 and any(cells)]
    groups: dict[str, list[int]] = {}
    width = len(sheet.rows[0])
    for line in lines:
        cells = sheet.rows[line - 1]
        if len(cells) != width:
            remedy = "mend the line, or delete it if it was cut off"
            raise sheet.error(f"the line has {len(cells)} cells, the header {width}", remedy, line)
        label = cells[columns["demonstration"]] if "demonstration" in columns else ""
        groups.setdefault(label, []).append(line)
    if not groups:
        raise sheet.error("there are no samples below the header", "export it again")
    stem = sheet.path.stem
    return [
        _one(sheet, f"{stem}-{label}" if label else stem, group, header, choices) for label, group in groups.items()
    ]


@dataclass(frozen=True, slots=True)
class _Header:
    """Which column holds what, the factor to m or s, and which roles have a unit, in the file or chosen."""

    columns: dict[str, int]
    factors: dict[str, float]
    with_unit: frozenset[str]


def _header(sheet: Sheet, choices: Choices) -> _Header:
    first = sheet.cells(1)
    if first and is_number(first[0]):
        raise sheet.error("the first line holds numbers and no names", HEADER, 1)
    words = first[0].lower().split() if len(first) == 1 else []
    if len(words) > 1 and all(_COLUMN.fullmatch(word) for word in words):
        raise sheet.error("its columns are not separated", "separate them by commas, semicolons or tabs", 1)
    columns: dict[str, int] = {}
    factors: dict[str, float] = {}
    with_unit: set[str] = set()
    for index, cell in enumerate(_of_one_marker(sheet, choices)):
        if cell is None:
            continue
        match = _COLUMN.fullmatch(cell.lower())
        role = ROLES.get(match.group(1), "") if match else ""
        if match is None or not role:
            known = ", ".join(KNOWN)
            remedy = CONVERT if _OTHER_UNIT.fullmatch(cell.lower()) else f"{HEADER}; known names: {known}"
            raise sheet.error(f"column {index + 1} is called {cell[:40]!r}", remedy, 1)
        if role in columns:
            raise sheet.error(f"column {index + 1} is a second {role}", "leave one of them", 1)
        unit = match.group(2) or match.group(3) or (choices.unit if role in AXES else "")
        columns[role] = index
        factors[role] = _factor(sheet, role, unit)
        if unit:
            with_unit.add(role)
    missing = [role for role in ("t", "x", "y") if role not in columns]
    if missing:
        raise sheet.error(f"there is no column {' or '.join(missing)}", HEADER, 1)
    if len({factors[axis] for axis in AXES if axis in factors}) > 1:
        raise sheet.error("x, y and z have different units", "give them one unit", 1)
    turned = [role for role in QUATERNION if role in columns]
    if turned and len(turned) != len(QUATERNION):
        raise sheet.error(f"of the quaternion there is only {', '.join(turned)}", "give qx, qy, qz and qw, or none", 1)
    return _Header(columns, factors, frozenset(with_unit))


def _of_one_marker(sheet: Sheet, choices: Choices) -> list[str | None]:
    """Return the names of the columns; where there are markers, ``pen_x`` of the chosen one as ``x``, others None."""
    cells = sheet.cells(1)
    names: list[str | None] = [None if cell.lower() in UNUSED else cell for cell in cells]
    known = [_COLUMN.fullmatch(cell.lower()) for cell in cells]
    if any(match and ROLES.get(match.group(1)) in AXES for match in known):
        return names
    found: dict[str, dict[int, str]] = {}
    for index, cell in enumerate(cells):
        match = _MARKER.fullmatch(cell)
        if match and re.split(r"[_. :]", match.group(1).lower())[-1] not in NO_PLACES:
            found.setdefault(match.group(1), {})[index] = match.group(2) + match.group(3)
    if not found:
        return names
    markers = list(found)
    chosen = markers[pick(sheet.path, markers, choices.marker)]
    for marker, columns in found.items():
        for index, name in columns.items():
            names[index] = name if marker == chosen else None
    return names


def _factor(sheet: Sheet, role: str, unit: str) -> float:
    known = SECONDS if role == "t" else METRES if role in AXES else {}
    if not unit:
        return 1.0
    if unit not in known:
        allowed = USE_S if role == "t" else CONVERT if known else "leave the unit out"
        raise sheet.error(f"the unit of {role} is {unit!r}", allowed, 1)
    return known[unit]


def _one(
    sheet: Sheet,
    name: str,
    lines: list[int],
    header: _Header,
    choices: Choices,
) -> Demonstration:
    columns, factors = header.columns, header.factors
    axes = [axis for axis in AXES if axis in columns]
    times = np.array([sheet.number(line, columns["t"]) for line in lines])
    points = np.array([[sheet.number(line, columns[axis], gap=True) for axis in axes] for line in lines])
    half = np.flatnonzero(np.isnan(points).any(axis=1) & ~np.asarray(np.isnan(points).all(axis=1)))
    if len(half):
        raise sheet.error("only a part of the position is there", "give all of it or none", lines[int(half[0])])
    for before, after, line in zip(times[:-1], times[1:], lines[1:], strict=True):
        if not after > before:
            raise sheet.error(f"time {after:g} does not come after {before:g}", "delete or mend the line", line)
    points = without_placeholders(times, points)
    triggers = None
    if "trigger" in columns:
        triggers = np.array([_on(sheet, line, columns["trigger"]) for line in lines])
    orientations = None
    if "qw" in columns:
        orientations = _unit_quaternions(sheet, lines, columns, np.asarray(np.isnan(points).all(axis=1)))
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if "t" not in header.with_unit and step > SLOWEST:
        raise sheet.error(f"its samples are {step:g} s apart", "name the unit of its times, as in t_ms", 1)
    times, points = times * factors["t"], points * factors["x"]
    if len(axes) == 3 and choices.up_axis:
        points = turned_up(points, choices.up_axis)
        orientations = None if orientations is None else orientations_turned_up(orientations, choices.up_axis)
    farthest = MAX_EXTENT if "x" in header.with_unit else MAX_EXTENT_WITHOUT_UNIT
    return demonstration(
        sheet.path, name, times, points, triggers=triggers, orientations=orientations, farthest=farthest
    )


def _unit_quaternions(sheet: Sheet, lines: list[int], columns: dict[str, int], lost: Bools) -> Floats:
    """Return the turns (n, 4) of the tool as unit quaternions; where the tool was not seen they may be missing too."""
    found = np.array([[sheet.number(line, columns[part], gap=True) for part in QUATERNION] for line in lines])
    found[lost & (np.isnan(found).any(axis=1) | (found == 0).all(axis=1))] = (0.0, 0.0, 0.0, 1.0)
    missing = np.flatnonzero(np.isnan(found).any(axis=1))
    if len(missing):
        raise sheet.error("of the quaternion a part is missing", "mend or delete the line", lines[int(missing[0])])
    lengths = np.linalg.norm(found, axis=1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > 0.01)
    if len(wrong):
        four = ", ".join(f"{value:g}" for value in found[wrong[0]])
        problem = f"the quaternion {four} has length {lengths[wrong[0]]:.3g}, not length 1"
        raise sheet.error(problem, "mend or delete the line; the order is qx, qy, qz, qw", lines[int(wrong[0])])
    return found / lengths[:, None]


def _on(sheet: Sheet, line: int, column: int) -> bool:
    text = sheet.rows[line - 1][column].lower()
    if text not in ON_OFF:
        raise sheet.error(f"the trigger is {text[:40]!r}", f"write one of {', '.join(ON_OFF)}", line)
    return ON_OFF[text]


def write(path: Path, demonstration: Demonstration) -> None:
    """Write a demonstration as plain CSV in s and m: read again, it is the same bit for bit."""
    axes = _axes(demonstration)
    lines = [",".join(("t_s", *axes, "trigger")), *_lines(demonstration)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_all(path: Path, demonstrations: Sequence[Demonstration]) -> None:
    """Write several demonstrations of one kind into one file, told apart by a column ``demonstration``."""
    head = ",".join(("demonstration", "t_s", *_axes(demonstrations[0]), "trigger"))
    lines = [f"{one.demonstration_id},{line}" for one in demonstrations for line in _lines(one)]
    path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")


def _axes(demonstration: Demonstration) -> tuple[str, ...]:
    axes = ("x_m", "y_m", "z_m")[: demonstration.dimension]
    return axes if demonstration.orientations is None else (*axes, *QUATERNION)


def _lines(one: Demonstration) -> list[str]:
    turned = np.zeros((len(one.times), 0)) if one.orientations is None else one.orientations
    lines: list[str] = []
    for time, point, turn, trigger in zip(one.times, one.points, turned, one.triggers, strict=True):
        values = ("" if np.isnan(value) else repr(float(value)) for value in (*point, *turn))
        lines.append(",".join((repr(float(time)), *values, str(int(trigger)))))
    return lines
