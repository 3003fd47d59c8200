"""Which reader reads which file. A new format is one more file beside these and its name in one of the tables here.

Installed distributions bring formats of their own by entry point: a ``Format`` under ``opcua_skill.readers``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

from library.errors import ReaderError
from library.readers import c3d, motive_csv, plain_csv, qualisys_tsv, ros_bag, trc, vicon_csv
from library.readers.import_options import Choices
from library.readers.lasa import read as read_lasa
from library.readers.text_table import Sheet
from models.demonstration import Demonstration

DOOR = "opcua_skill.readers"


@dataclass(frozen=True, slots=True)
class Format:
    """A format of files that end in one of the lower-case ``suffixes``, such as ``.pose``.

    ``recognised`` says by a look into a file whether it is one. ``read`` returns the demonstrations in it, in m and s;
    what it raises besides ReaderError is told as a damaged file.
    """

    suffixes: frozenset[str]
    read: Callable[[Path, Choices], list[Demonstration]]
    recognised: Callable[[Path], bool] = lambda path: True


@dataclass(frozen=True, slots=True)
class TextFormat:
    """A format of text files: whether a file is one, by its first lines, and what stands in it."""

    recognised: Callable[[Sheet], bool]
    read: Callable[[Sheet, Choices], list[Demonstration]]


TEXT = (
    TextFormat(motive_csv.is_motive, motive_csv.read),
    TextFormat(trc.is_trc, trc.read),
    TextFormat(qualisys_tsv.is_qualisys, qualisys_tsv.read),
    TextFormat(vicon_csv.is_vicon, vicon_csv.read),
    TextFormat(lambda sheet: True, plain_csv.read),
)
"""Text formats, the first that recognises a file reads it: whatever is no maker's is plain."""

BINARY: dict[str, Callable[[Path, Choices], list[Demonstration]]] = {
    ".bag": ros_bag.read,
    ".db3": ros_bag.read,
    ".mcap": ros_bag.read,
    ".c3d": c3d.read,
    ".mat": read_lasa,
}
TEXT_SUFFIXES = {".csv", ".txt", ".tsv", ".trc"}
KNOWN = (
    "CSV (plain, Vicon Nexus and Tracker, OptiTrack Motive), Qualisys .tsv, .trc, .c3d, .bag, .db3, .mcap, LASA .mat"
)
SPREADSHEETS = {".xlsx", ".xls", ".xlsm", ".ods", ".numbers"}
PACKED = {".zip", ".gz", ".bz2", ".xz", ".zst", ".7z", ".rar", ".tar", ".tgz"}
OTHER_PROGRAMS = {
    ".tak": ("Motive", "CSV"),
    ".x1d": ("Vicon Nexus", "C3D"),
    ".x2d": ("Vicon Nexus", "C3D"),
    ".xcp": ("Vicon Nexus", "C3D"),
    ".trial": ("Vicon Nexus", "C3D"),
    ".qtm": ("Qualisys Track Manager", "TSV or C3D"),
    ".cap": ("Cortex", "TRC or C3D"),
    ".trb": ("Cortex", "TRC or C3D"),
    ".mvn": ("Xsens MVN", "C3D"),
    ".mvnx": ("Xsens MVN", "C3D"),
    ".sto": ("OpenSim", "TRC"),
    ".mot": ("OpenSim", "TRC"),
    ".bvh": ("the program that wrote it", "C3D or CSV"),
    ".fbx": ("the program that wrote it", "C3D or CSV"),
    ".npy": ("Python", "CSV"),
    ".npz": ("Python", "CSV"),
    ".h5": ("the program that wrote it", "CSV"),
    ".json": ("the program that wrote it", "CSV"),
    ".parquet": ("the program that wrote it", "CSV"),
}
"""Files of other programs, which only those can read: the program, and as what to export them."""


@cache
def brought() -> tuple[Format, ...]:
    """Return the formats that installed distributions bring. Raises TypeError if one brings something else."""
    found: list[Format] = []
    for entry in sorted(entry_points(group=DOOR), key=lambda entry: entry.name):
        one = entry.load()
        if not isinstance(one, Format):
            raise TypeError(f"{entry.value} is no library.readers.formats.Format")
        found.append(one)
    return tuple(found)


def suffixes() -> tuple[str, ...]:
    """Return how files end that can be read, in lower case."""
    return tuple(sorted({*BINARY, *TEXT_SUFFIXES}.union(*(one.suffixes for one in brought()))))


def read(path: str | Path, choices: Choices | None = None) -> list[Demonstration]:
    """Return the demonstrations in a file; its format is known by its name and its first lines."""
    path = Path(path)
    choices = choices or Choices()
    suffix = path.suffix.lower()
    if path.is_dir():
        if not (path / "metadata.yaml").exists():
            raise ReaderError(path, "it is a folder", "name the files in it")
        return ros_bag.read(path, choices)
    theirs = next((one for one in brought() if suffix in one.suffixes and one.recognised(path)), None)
    if theirs is not None:
        try:
            return theirs.read(path, choices)
        except (ReaderError, MemoryError):
            raise
        except Exception as error:  # whatever a stranger's reader stumbles over, the file is not read
            raise ReaderError(path, f"its reader failed: {error!r}", "ask whoever wrote that reader") from error
    if suffix in BINARY:
        return BINARY[suffix](path, choices)
    if suffix in TEXT_SUFFIXES:
        sheet = Sheet.read(path)
        if suffix == ".trc":
            return trc.read(sheet, choices)
        return next(one for one in TEXT if one.recognised(sheet)).read(sheet, choices)
    if suffix in OTHER_PROGRAMS:
        program, form = OTHER_PROGRAMS[suffix]
        raise ReaderError(path, f"only {program} reads files that end in {suffix}", f"export it from there as {form}")
    what = f"files that end in {suffix} are not known" if suffix else "its name does not end in a format"
    first = "save it as CSV; " if suffix in SPREADSHEETS else "unpack it; " if suffix in PACKED else ""
    more = sorted(set(suffixes()) - BINARY.keys() - TEXT_SUFFIXES)
    raise ReaderError(path, what, f"{first}these can be read: {', '.join((KNOWN, *more))}")
