"""C3D, through ezc3d (extra ``formats``): markers with their unit and rate; a lost marker is NaN."""

import io
import json
import struct
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from library.errors import ReaderError
from library.readers.choices import Choices
from library.readers.sheet import METRES, read_bytes
from library.readers.tracks import Track, follow, pick
from models.demonstration import Demonstration, Floats

AGAIN = "export it again as C3D"
BLOCK = 512
SECONDS = 120


def read(path: Path, choices: Choices) -> list[Demonstration]:
    """Return the way of the chosen marker. Z is up unless another axis is chosen, as Vicon and most others write it."""
    if find_spec("ezc3d") is None:
        raise ReaderError(path, "C3D needs the package ezc3d", "install opcua-skill[formats]")
    told = _check_head(path)
    names, unit_name, rate, scale, points = _parsed_apart(path)
    unit = METRES.get(unit_name)
    for what, here, there in (("frame rates", told.rate, rate), ("scales", told.scale, scale)):
        if here and there and abs(abs(here) - abs(there)) > 1e-3 * abs(there):
            raise ReaderError(path, f"its head and its parameters name different {what}, {here:g} and {there:g}", AGAIN)
    if unit is None or not np.isfinite(rate) or rate <= 0:
        raise ReaderError(path, f"its unit and rate are {unit_name!r} and {rate:g}", AGAIN)
    names = names[: points.shape[1]]
    if points.ndim != 3 or len(names) != points.shape[1]:
        raise ReaderError(path, f"it names {len(names)} markers and holds {points.shape[1]}", AGAIN)
    place = pick(path, names, choices.marker)
    way = np.ascontiguousarray(points[:, place, :].T) * unit
    way[~np.isfinite(way).all(axis=1)] = np.nan
    times = np.arange(len(way)) / rate
    return follow(path, [Track(names[place], times, way)], Choices(up_axis=choices.up_axis))


def _parsed_apart(path: Path) -> tuple[list[str], str, float, float, Floats]:
    """Return names, unit, rate in Hz, scale and points (3, markers, frames), parsed in a process of its own.

    The parser is C++ that trusts the file: a damaged one may take its process down, and that must not be ours.
    """
    command = [sys.executable, "-m", __name__, str(path.absolute())]
    try:
        done = subprocess.run(command, capture_output=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired as error:
        raise ReaderError(path, f"it cannot be read within {SECONDS} s", AGAIN) from error
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["the parser crashed"]
        raise ReaderError(path, f"it cannot be read ({last[0][:200]})", AGAIN)
    head, _, blob = done.stdout.partition(b"\n")
    names, unit_name, rate, scale = json.loads(head)
    return names, unit_name, rate, scale, np.load(io.BytesIO(blob), allow_pickle=False)


def _parse(path: str) -> None:
    """Write what ezc3d finds to standard output: names, unit and rate as a line of JSON, then the points as npy."""
    import ezc3d  # pyright: ignore[reportMissingImports, reportMissingTypeStubs]

    content: Any = ezc3d.c3d(path)
    point: Any = content["parameters"]["POINT"]
    labels = sorted((key for key in point if key.startswith("LABELS")), key=lambda key: (len(key), key))
    names = [str(name) for key in labels for name in point[key]["value"]]
    rate, scale = (float(point[key]["value"][0]) for key in ("RATE", "SCALE"))
    head = json.dumps([names, str(point["UNITS"]["value"][0]).lower(), rate, scale])
    sys.stdout.buffer.write(head.encode() + b"\n")
    np.save(sys.stdout.buffer, np.asarray(content["data"]["points"], dtype=np.float64)[:3], allow_pickle=False)


@dataclass(frozen=True, slots=True)
class _Head:
    """What the head of a file says a second time: frames a second, and the scale of positions (0: nothing)."""

    rate: float
    scale: float


def _check_head(path: Path) -> _Head:
    """Complain of a head that promises more than the file holds, before anything in C++ trusts it."""
    content = read_bytes(path)
    if len(content) < 2 * BLOCK or content[1] != 0x50 or not content[0]:
        raise ReaderError(path, "it does not begin as a C3D file", AGAIN)
    processor = content[(content[0] - 1) * BLOCK + 3] if len(content) > (content[0] - 1) * BLOCK + 3 else 0
    if processor != 84:
        raise ReaderError(path, "it is not in Intel format", "save it in Intel format")
    points, analogs, first, last = struct.unpack_from("<4H", content, 2)
    (data_start,) = struct.unpack_from("<H", content, 16)
    (scale,) = struct.unpack_from("<f", content, 12)
    (rate,) = struct.unpack_from("<f", content, 20)
    frames = last - first + 1
    size = 4 if scale < 0 else 2
    needed = (data_start - 1) * BLOCK + frames * (points * 4 + analogs) * size
    if points == 0 or frames < 2 or data_start < 2 or (last != 65535 and needed > len(content)):
        problem = f"its head promises {points} markers in {frames} frames, {needed} bytes, the file has {len(content)}"
        raise ReaderError(path, problem, "it may be cut off: " + AGAIN)
    return _Head(rate, scale)


if __name__ == "__main__":
    _parse(sys.argv[1])
