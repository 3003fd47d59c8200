"""A text table whose every complaint names file, line and remedy. All readers of text files stand on it."""

import csv
import math
import re
from pathlib import Path
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation  # pyright: ignore[reportMissingTypeStubs]

from library.errors import ChoiceNeeded, ReaderError
from library.readers.lost import without_placeholders
from models.demonstration import Bools, Demonstration, Floats

METRES = {"m": 1.0, "meters": 1.0, "metres": 1.0, "cm": 0.01, "centimeters": 0.01, "mm": 0.001, "millimeters": 0.001}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
MAX_MEGABYTES = 256
MAX_MEGABYTES_OF_TEXT = 64
MAX_EXTENT = 20.0

_NUMBER = re.compile(r"[+-]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


class Sheet:
    """The cells of a text file. Lines are counted from 1, as editors do."""

    def __init__(self, path: Path, rows: list[list[str]], *, decimal_comma: bool) -> None:
        self.path = path
        self.rows = rows
        self._decimal_comma = decimal_comma

    @classmethod
    def read(cls, path: Path) -> Self:
        """Return the cells of a file, separated by what its first such line holds: tabs, semicolons or commas."""
        text = read_text(path)
        lines = text.splitlines()
        head = next((line for line in lines if any(mark in line for mark in "\t;,")), "")
        delimiter = next((mark for mark in "\t;," if mark in head), ",")
        rows = [[cell.strip() for cell in _cells(line, delimiter)] for line in lines]
        return cls(path, rows, decimal_comma=delimiter != ",")

    def error(self, problem: str, remedy: str, line: int | None = None) -> ReaderError:
        """Return the complaint, for the caller to raise."""
        return ReaderError(self.path, problem, remedy, line)

    def cells(self, line: int) -> list[str]:
        """Return the cells of a line."""
        if line > len(self.rows):
            raise self.error("the file ends before its table begins", "export it again, it may have been cut off", line)
        return self.rows[line - 1]

    def number(self, line: int, column: int, *, gap: bool = False) -> float:
        """Return the finite number in a cell; with ``gap`` an empty cell is NaN: nothing was seen there."""
        text = self.rows[line - 1][column]
        if gap and (not text or (text[0] in "nN" and text.lower() == "nan")):
            return math.nan
        plain = text.replace(",", ".") if self._decimal_comma and "." not in text else text
        value = float(plain) if _NUMBER.fullmatch(plain) else math.nan
        if not math.isfinite(value):
            where = f"column {column + 1} holds {text[:40]!r}, which is not a number"
            raise self.error(where, "mend the cell or delete the line", line)
        return value


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of one line; a quote that is never closed ends with its line."""
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
        size = path.stat().st_size
        if size > most * 1_000_000:
            raise ReaderError(path, f"it has {size / 1e6:.0f} MB", f"cut out what is needed: {most} MB at most")
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
    columns = turned_up(np.eye(3), up_axis)
    turn = Rotation.from_matrix(columns.T)
    return np.asarray((turn * Rotation.from_quat(orientations)).as_quat(), dtype=np.float64)
