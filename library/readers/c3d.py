"""C3D (Intel), by the format's user guide (Motion Lab Systems): markers with their unit and rate; a lost one is NaN.

Counts stand in 16 bits and are written in up to three places: the size of the file decides which of them is true.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from library.errors import ReaderError
from library.readers.import_options import Choices
from library.readers.text_table import METRES, read_bytes
from library.readers.tracks import Track, follow, pick
from models.demonstration import Demonstration, Floats

AGAIN = "export it again as C3D"
CUT_OFF = "it may be cut off: " + AGAIN
BLOCK = 512
INTEL = 84
FULL = 65_535
TEXT, BYTE, INTEGER, REAL = -1, 1, 2, 4
Values = list[str] | list[float]


def read(path: Path, choices: Choices) -> list[Demonstration]:
    """Return the way of the chosen marker. Z is up unless another axis is chosen, as Vicon and most others write it."""
    content = read_bytes(path)
    head = _head(path, content)
    told = _parameters(content, head)
    if head.points == 0 or _number(told, "POINT:USED") == 0:
        raise ReaderError(path, "it holds forces or other signals and no markers", "export it with trajectories")
    unit_name, rate = _text(told, "POINT:UNITS").lower(), _number(told, "POINT:RATE")
    frames = _frames(path, content, head, told)
    for what, here, there in (
        ("frame rates", head.rate, rate),
        ("scales", head.scale, _number(told, "POINT:SCALE")),
        ("numbers of markers", float(head.points), _number(told, "POINT:USED")),
    ):
        if here and there and abs(abs(here) - abs(there)) > 1e-3 * abs(there):
            raise ReaderError(path, f"its head and its parameters name different {what}, {here:g} and {there:g}", AGAIN)
    unit = METRES.get(unit_name)
    if unit is None or not np.isfinite(rate) or rate <= 0:
        raise ReaderError(path, f"its unit and rate are {unit_name[:40]!r} and {rate:g}", AGAIN)
    names = _labels(told)[: head.points]
    if len(names) != head.points:
        raise ReaderError(path, f"it names {len(names)} markers and holds {head.points}", AGAIN)
    place = pick(path, names, choices.marker)
    way = _way(content, head, frames, place) * unit
    return follow(path, [Track(names[place], np.arange(len(way)) / rate, way)], Choices(up_axis=choices.up_axis))


@dataclass(frozen=True, slots=True)
class _Head:
    """The first block: at which byte parameters and samples begin, how many numbers a frame has, and of what."""

    parameters: int
    data: int
    points: int
    analogs: int
    first: int
    last: int
    rate: float
    scale: float

    @property
    def size(self) -> int:
        """Bytes a number: a negative scale stands for 32-bit floats, a positive one for 16-bit integers."""
        return 4 if self.scale < 0 else 2

    @property
    def frame(self) -> int:
        """Bytes a frame."""
        return (4 * self.points + self.analogs) * self.size


def _head(path: Path, content: bytes) -> _Head:
    if len(content) < 2 * BLOCK or content[1] != 0x50 or not content[0]:
        raise ReaderError(path, "it does not begin as a C3D file", AGAIN)
    parameters = (content[0] - 1) * BLOCK
    if len(content) <= parameters + 4 or content[parameters + 3] != INTEL:
        raise ReaderError(path, "it is not in Intel format", "save it in Intel format")
    points, analogs, first, last = struct.unpack_from("<4H", content, 2)
    scale, data_start, _, rate = struct.unpack_from("<fHHf", content, 12)
    if data_start < 2 or not np.isfinite(scale) or scale == 0:
        raise ReaderError(path, f"its head says that samples begin at block {data_start}, in steps of {scale:g}", AGAIN)
    return _Head(parameters, (data_start - 1) * BLOCK, points, analogs, first, last, float(rate), float(scale))


def _parameters(content: bytes, head: _Head) -> dict[str, Values]:
    """Return what the parameters say, by ``GROUP:NAME``; entries that do not fit into the file are left out."""
    groups: dict[int, str] = {}
    entries: list[tuple[int, str, int, int]] = []
    at = head.parameters + 4
    while at + 4 <= len(content):
        length, group = struct.unpack_from("<bb", content, at)
        name = content[at + 2 : at + 2 + abs(length)].decode("latin-1").upper()
        behind = at + 2 + abs(length)
        if length == 0 or behind + 2 > len(content):
            break
        (step,) = struct.unpack_from("<H", content, behind)
        if group < 0:
            groups[-group] = name
        else:
            entries.append((group, name, behind + 2, behind + step if step else len(content)))
        if step == 0:
            break
        at = behind + step
    found: dict[str, Values] = {}
    for group, name, start, end in entries:
        found.setdefault(f"{groups.get(group, '')}:{name}", _values(content, start, end))
    return found


def _values(content: bytes, at: int, end: int) -> Values:
    """Return the values of one parameter, nothing where it is damaged."""
    if at + 2 > len(content):
        return []
    kind, depth = struct.unpack_from("<bB", content, at)
    sizes = list(content[at + 2 : at + 2 + depth])
    count, start = int(np.prod(sizes, dtype=np.int64)), at + 2 + depth
    if kind not in {TEXT, BYTE, INTEGER, REAL} or start + count * abs(kind) > min(end, len(content)):
        return []
    if kind != TEXT:
        form = {BYTE: "u1", INTEGER: "<i2", REAL: "<f4"}[kind]
        return np.frombuffer(content, form, count, start).astype(np.float64).tolist()
    width = sizes[0] if sizes else 1
    texts = (content[place : place + width] for place in range(start, start + count, max(width, 1)))
    return [text.decode("utf-8", errors="replace").strip(" \0") for text in texts]


def _number(told: dict[str, Values], name: str) -> float:
    """Return a number, 0 where there is none."""
    value = (told.get(name) or [0.0])[0]
    return value if isinstance(value, float) else 0.0


def _text(told: dict[str, Values], name: str) -> str:
    return str((told.get(name) or [""])[0])


def _labels(told: dict[str, Values]) -> list[str]:
    """Return the names of the markers: more than 255 go on in LABELS2, LABELS3 …"""
    keys = [key for key in told if key.startswith("POINT:LABELS")]
    return [str(label) for key in sorted(keys, key=lambda key: (len(key), key)) for label in told[key]]


def _frames(path: Path, content: bytes, head: _Head, told: dict[str, Values]) -> int:
    """Return how many frames there are: the count that fills the file up to its last block.

    A count of 65,535 stands for that many or more, and counts wrap: where none of them fills the file its size alone
    counts, and frames of nothing but zero bytes in its last block are what fills that block.
    """
    ends = head.parameters if head.parameters > head.data else len(content)
    room, rest = divmod(max(0, ends - head.data), head.frame)
    actual = told.get("TRIAL:ACTUAL_START_FIELD", []), told.get("TRIAL:ACTUAL_END_FIELD", [])
    first, last = (_long(field) for field in actual)
    counts = [last - first + 1] if first and last else []
    named = int(_number(told, "POINT:FRAMES"))
    counts += [named % (FULL + 1)] if named % (FULL + 1) not in {0, FULL} else []
    counts += [head.last - head.first + 1] if head.last != FULL else []
    filling = {
        count
        for least in counts
        for count in range(least, room + 1, FULL + 1)
        if count > 1 and (room - count) * head.frame + rest < BLOCK
    }
    if len(filling) == 1:
        return filling.pop()
    short = [count for count in counts or [FULL - head.first + 1] if count > room]
    if short or room < 2:
        least = max([*short, 2])
        needed = head.data + least * head.frame
        problem = (
            f"its head promises {head.points} markers in {least} frames, {needed} bytes, the file has {len(content)}"
        )
        raise ReaderError(path, problem, CUT_OFF)
    if not counts:
        return room - _empty(content[head.data : head.data + room * head.frame], head.frame, BLOCK - 1 - rest)
    if len(set(counts)) > 1 or any(content[head.data + counts[0] * head.frame : ends]):
        said = " or ".join(str(count) for count in sorted(set(counts)))
        raise ReaderError(path, f"it says that it holds {said} frames, and has room for {room}", AGAIN)
    return counts[0]


def _empty(data: bytes, frame: int, most: int) -> int:
    """Return how many frames at the end are nothing but zero bytes, in the last ``most`` bytes."""
    empty = 0
    while (empty + 1) * frame <= most and not any(data[len(data) - (empty + 1) * frame : len(data) - empty * frame]):
        empty += 1
    return empty


def _long(field: Values) -> int:
    """Return a frame number that stands in two words, the lower one first; 0 where there is none."""
    words = [int(word) % (FULL + 1) for word in field if isinstance(word, float)]
    return words[0] + (FULL + 1) * words[1] if len(words) == 2 else 0


def _way(content: bytes, head: _Head, frames: int, place: int) -> Floats:
    """Return the positions (frames, 3) of one marker in the file's unit: lost where the fourth number is negative."""
    form = "<f4" if head.size == 4 else "<i2"
    values = np.frombuffer(content, form, frames * head.frame // head.size, head.data).reshape(frames, -1)
    four = values[:, 4 * place : 4 * place + 4].astype(np.float64)
    way = four[:, :3] * (1.0 if head.size == 4 else head.scale)
    way[(four[:, 3] < 0) | ~np.isfinite(way).all(axis=1)] = np.nan
    return way
