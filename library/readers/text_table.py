"""A text table whose every complaint names file, line and remedy. All readers of text files stand on it."""

import csv
import math
import re
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Self, overload

import numpy as np

from library.errors import ChoiceNeeded, ReaderError
from library.readers.lost import without_placeholders
from models.demonstration import Bools, Demonstration, Floats

METRES = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), 0.01),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), 0.001),
}
SECONDS = {
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nanosecond", "nanoseconds"), 1e-9),
}
MAX_MEGABYTES = 256
MAX_MEGABYTES_OF_TEXT = 64
MAX_EXTENT = 20.0
MOST_COLUMNS = 10_000
GAPS = {"nan", "-nan", "null", "none", "na", "n/a", "-nan(ind)", "-", "--", "---"}
WITHOUT_GROUPS = "export it without separators between thousands"
_SEPARATED = re.compile(r"sep=(.)", re.IGNORECASE)

_NUMBER = re.compile(r"[+-]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_GROUPED = re.compile(r"[+-]?[0-9]{1,3}(?:([.,'’ \u00a0\u202f])[0-9]{3})+(?:[.,][0-9]*)?")
_WITH_UNIT = re.compile(r"[+-]?[0-9.,]+ ?(?:[a-zµμ]{1,3}|\")")
_CLOCK = re.compile(r"(?:.*[ T])?[0-9]{1,2}:[0-9]{2}(?::[0-9.,]+)?(?:Z|[+-][0-9:]+)?")
_LINES = re.compile(r"\r\n|\r|\n")


class Rows(Sequence[list[str]]):
    """The cells of lines, split when they are asked for: a large file is held once, as its text."""

    def __init__(self, lines: list[str], delimiter: str) -> None:
        self._lines = lines
        self._delimiter = delimiter
        self._last: int | None = None
        self._cells: list[str] = []

    def __len__(self) -> int:
        return len(self._lines)

    @overload
    def __getitem__(self, place: int) -> list[str]: ...
    @overload
    def __getitem__(self, place: slice) -> list[list[str]]: ...
    def __getitem__(self, place: int | slice) -> list[str] | list[list[str]]:
        # Most often the same line again: that has to cost nothing.
        if place == self._last:
            return self._cells
        if isinstance(place, slice):
            return [self[one] for one in range(*place.indices(len(self)))]
        self._cells = [cell.strip() for cell in _cells(self._lines[place], self._delimiter)]
        self._last = place
        return self._cells


class Sheet:
    """The cells of a text file. Lines are counted from 1, as editors do; ``skipped`` of them come before the first."""

    def __init__(self, path: Path, rows: Rows, *, decimal_comma: bool, skipped: int = 0) -> None:
        self.path = path
        self.rows = rows
        self._decimal_comma = decimal_comma
        self._skipped = skipped
        self._marks: dict[str, tuple[int, int, str]] = {}

    @classmethod
    def read(cls, path: Path) -> Self:
        """Return the cells of a file, separated by what its first such line holds: tabs, semicolons or commas.

        A first line ``sep=;``, as spreadsheets write and take it, says so itself; empty lines may come before the rest.
        """
        lines = _LINES.split(read_text(path))
        told = _SEPARATED.fullmatch(lines[0].strip(' "'))
        skipped = 1 if told else 0
        while skipped < len(lines) - 1 and not lines[skipped].strip():
            skipped += 1
        lines = lines[skipped : None if lines[-1] else -1]
        head = next((line for line in lines if any(mark in line for mark in "\t;,")), "")
        delimiter = told.group(1) if told else next((mark for mark in "\t;," if mark in head), ",")
        if delimiter not in "\t;,":
            remedy = "separate them by commas, semicolons or tabs"
            raise ReaderError(path, f"its cells are separated by {delimiter!r}", remedy, 1)
        if head.count(delimiter) > MOST_COLUMNS:
            columns = head.count(delimiter) + 1
            raise ReaderError(path, f"it has {columns} columns", f"cut out what is needed: {MOST_COLUMNS} at most")
        _check_quotes(path, lines, skipped)
        return cls(path, Rows(lines, delimiter), decimal_comma=delimiter != ",", skipped=skipped)

    def error(self, problem: str, remedy: str, line: int | None = None) -> ReaderError:
        """Return the complaint, for the caller to raise."""
        return ReaderError(self.path, problem, remedy, None if line is None else line + self._skipped)

    def cells(self, line: int) -> list[str]:
        """Return the cells of a line."""
        if line > len(self.rows):
            raise self.error("the file ends before its table begins", "export it again, it may have been cut off", line)
        return self.rows[line - 1]

    def number(self, line: int, column: int, *, gap: bool = False) -> float:
        """Return the finite number in a cell; with ``gap`` an empty cell is NaN: nothing was seen there."""
        text = self.rows[line - 1][column]
        if gap and (not text or (text[0] in "nN-" and text.lower() in GAPS)):
            return math.nan
        plain = text.replace(",", ".") if self._decimal_comma and "." not in text else text
        value = float(plain) if _NUMBER.fullmatch(plain) else math.nan
        if not math.isfinite(value):
            where = f"column {column + 1} holds {text[:40]!r}, which is not a number"
            raise self.error(where, _remedy_for(text), line)
        if self._decimal_comma and not text.isdigit():
            self._check_mark(line, column, text)
        return value

    def _check_mark(self, line: int, column: int, text: str) -> None:
        """Complain of a file whose numbers hold a comma here and a point there: one of them marks thousands."""
        mark = "," if "," in text else "." if "." in text else ""
        if not mark or (mark in self._marks and len(self._marks) == 1):
            return
        self._marks.setdefault(mark, (line, column, text))
        if len(self._marks) > 1:
            other_line, other_column, other = self._marks["." if mark == "," else ","]
            problem = (
                f"column {column + 1} holds {text[:40]!r} and column {other_column + 1} of line "
                f"{other_line + self._skipped} {other[:40]!r}: a comma and a point cannot both be decimal"
            )
            raise self.error(problem, WITHOUT_GROUPS, line)


def _remedy_for(text: str) -> str:
    """Return what to do about a cell that is no number."""
    if _GROUPED.fullmatch(text):
        return WITHOUT_GROUPS
    if _CLOCK.fullmatch(text):
        return "write times as seconds from the start, as in t_s"
    if _WITH_UNIT.fullmatch(text):
        return "write the unit into the name of the column, as in x_mm"
    return "mend the cell or delete the line"


def _check_quotes(path: Path, lines: list[str], skipped: int) -> None:
    """Complain of a quote that is opened and not closed on its line: what it was meant to hold cannot be known."""
    for number, line in enumerate(lines, skipped + 1):
        if line.count('"') % 2:
            raise ReaderError(path, "a quote is opened and not closed", "close it, or take the quotes out", number)
        if len(line) > csv.field_size_limit() and '"' in line:
            raise ReaderError(path, f"a line with quotes has {len(line)} characters", "take the quotes out", number)


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of one line, whose quotes are closed."""
    if '"' not in line:
        return line.split(delimiter) if line else []
    return [cell for cells in csv.reader([line], delimiter=delimiter) for cell in cells]


def is_number(text: str) -> bool:
    """Return whether a cell reads as a number."""
    return _NUMBER.fullmatch(text.replace(",", ".")) is not None


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8 or, by its byte order mark, UTF-16."""
    content = read_bytes(path, MAX_MEGABYTES_OF_TEXT)
    if content[:4] == b"PK\x03\x04":
        raise ReaderError(path, "it is a spreadsheet or another packed file", "save it as CSV")
    encoding = "utf-16" if content[:2] in {b"\xff\xfe", b"\xfe\xff"} else "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        if b"\0" in content[:1000]:
            raise ReaderError(path, "it is no text file", "export it again as CSV") from error
        line = content[: error.start].count(b"\n") + 1
        raise ReaderError(path, "it holds bytes that are no text in UTF-8", "save it as UTF-8", line) from error


def read_bytes(path: Path, most: int = MAX_MEGABYTES) -> bytes:
    """Return the content of a file of at most ``most`` MB."""
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise ReaderError(path, "it is no file but a folder, a pipe or a device", "name a file")
        if about.st_size > most * 1_000_000:
            raise ReaderError(
                path, f"it has {about.st_size / 1e6:.0f} MB", f"cut out what is needed: {most} MB at most"
            )
        content = path.read_bytes()
    except OSError as error:
        raise ReaderError(path, error.strerror or str(error), "check the name and the right to read it") from error
    if not content:
        raise ReaderError(path, "it is empty", "export it again")
    return content


def demonstration(
    path: Path,
    name: str,
    times: Floats,
    points: Floats,
    *,
    triggers: Bools | None = None,
    orientations: Floats | None = None,
    farthest: float = MAX_EXTENT,
) -> Demonstration:
    """Return what was read as a demonstration from time 0 on, or complain that it cannot be one.

    ``times`` (n,) in s, ``points`` (n, d) in m with NaN or a placeholder for gaps, ``triggers`` (n,), else on.
    Beyond ``farthest`` m from the origin the unit has to be said: nobody works there.
    """
    if len(times) < 2:
        raise ReaderError(path, f"{name!r} has {len(times)} samples", "at least 2 are needed: record it again")
    if (np.diff(times) > 0).all():
        points = without_placeholders(times, points)
    if np.isnan(points).any(axis=1).all():
        raise ReaderError(path, f"{name!r} has no position at all", "choose a marker that was seen")
    extent = float(np.nanmax(np.abs(points)))
    if extent > farthest:
        raise ChoiceNeeded(
            path,
            f"{name!r} reaches {extent:.1f} m from the origin",
            "name the unit of its positions, as in x_mm, or choose it when reading",
            "unit",
            ("m", "cm", "mm"),
        )
    steps = np.diff(times)
    if not (steps > 0).all():
        raise ReaderError(path, f"the times of {name!r} do not rise", "export it again with its times")
    return Demonstration(
        demonstration_id=name,
        times=times - times[0],
        points=points,
        triggers=np.ones(len(times), dtype=np.bool_) if triggers is None else triggers,
        source=path.name,
        orientations=orientations,
    )


def turned_up(points: Floats, up_axis: str) -> Floats:
    """Return points (n, 3) turned so that ``up_axis`` becomes z, right-handed as before."""
    if up_axis == "y":
        return points[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0])
    if up_axis == "x":
        return points[:, [1, 2, 0]]
    return points


def orientations_turned_up(orientations: Floats, up_axis: str) -> Floats:
    """Return unit quaternions (n, 4), x y z w, turned with their positions: `turned_up` of every axis of the tool."""
    # Slow to import, and only these files need it.
    from scipy.spatial.transform import Rotation  # pyright: ignore[reportMissingTypeStubs]

    columns = turned_up(np.eye(3), up_axis)
    turn = Rotation.from_matrix(columns.T)
    return np.asarray((turn * Rotation.from_quat(orientations)).as_quat(), dtype=np.float64)
