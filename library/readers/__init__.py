"""Motion-capture and other files as demonstrations, in metres and seconds; gaps stay gaps (NaN).

Every file is a clear error, which names file, line and remedy, or the trajectory that stands in it.
"""

import re
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath, PureWindowsPath

from library.errors import ReaderError
from library.readers import c3d, motive_csv, plain_csv, ros_bag, trc, vicon_csv
from library.readers import lasa as lasa_files
from library.readers.choices import Choices
from library.readers.flat import Plane, common_plane
from library.readers.gaps import Gaps, gaps, without_gaps
from library.readers.lasa import lasa
from library.readers.placing import fit_to_plate, onto_plane
from library.readers.sheet import Sheet
from models.demonstration import Demonstration

__all__ = [
    "Choices",
    "Gaps",
    "Plane",
    "common_plane",
    "fit_to_plate",
    "gaps",
    "lasa",
    "named_apart",
    "onto_plane",
    "read",
    "read_all",
    "read_upload",
    "without_gaps",
]

SPREADSHEETS = {".xlsx", ".xls", ".xlsm", ".ods", ".numbers"}
FORMATS = "CSV (plain, Vicon Nexus, OptiTrack Motive), .trc, .c3d, .bag, .db3, .mcap, LASA .mat"


def read(path: str | Path, choices: Choices | None = None) -> list[Demonstration]:
    """Return the demonstrations in a file; its format is known by its name and its first lines."""
    path = Path(path)
    choices = choices or Choices()
    if path.is_dir() and not (path / "metadata.yaml").exists():
        raise ReaderError(path, "it is a folder", "name the files in it")
    suffix = path.suffix.lower()
    if path.is_dir() or suffix in {".bag", ".db3", ".mcap"}:
        return ros_bag.read(path, choices)
    if suffix == ".c3d":
        return c3d.read(path, choices)
    if suffix == ".mat":
        return lasa_files.read(path)
    if suffix in {".csv", ".txt", ".tsv", ".trc"}:
        return _read_text(Sheet.read(path), choices)
    what = f"files that end in {suffix} are not known" if suffix else "its name does not end in a format"
    sheet = "save it as CSV; " if suffix in SPREADSHEETS else ""
    raise ReaderError(path, what, f"{sheet}these can be read: {FORMATS}")


def read_upload(name: str, content: bytes, choices: Choices | None = None) -> list[Demonstration]:
    """Return the demonstrations in a file that came as its name and its bytes; complaints name it by that name.

    The name is never used as a path: only its last part, and of that only harmless characters.
    """
    last = PureWindowsPath(PurePosixPath(name).name).name
    harmless = re.sub(r"[^\w.-]", "_", last, flags=re.ASCII).lstrip(".")[-80:] or "upload"
    with tempfile.TemporaryDirectory(prefix="opcua-skill-upload-") as folder:
        path = Path(folder) / harmless
        path.write_bytes(content)
        try:
            return read(path, choices)
        except ReaderError as error:
            raise error.named(Path(last or "upload"), path) from None


def _read_text(sheet: Sheet, choices: Choices) -> list[Demonstration]:
    if motive_csv.is_motive(sheet):
        return motive_csv.read(sheet, choices)
    if trc.is_trc(sheet) or sheet.path.suffix.lower() == ".trc":
        return trc.read(sheet, choices)
    if vicon_csv.is_vicon(sheet) or vicon_csv.is_without_trajectories(sheet):
        return vicon_csv.read(sheet, choices)
    return plain_csv.read(sheet, choices)


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
