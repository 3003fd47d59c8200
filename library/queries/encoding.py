"""Arrays and values as bytes and text, the same in every process: what is stored and what is hashed."""

import hashlib
import io
import json
import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from library.errors import Damaged, InvalidValue
from library.values import as_utc, check_text
from models.demonstration import Demonstration
from models.report import AlignedDemonstration

Scalar = TypeVar("Scalar", bound=np.generic)


@contextmanager
def stored(what: str) -> Generator[None]:
    """Say Damaged, naming what, where a stored row cannot be read back, whatever is wrong with it."""
    try:
        yield
    except (InvalidValue, ValueError, TypeError, KeyError) as error:
        raise Damaged(what, f"{error}") from error


def pack(array: NDArray[Any]) -> bytes:
    """Return the array in npy format, version 1.0: C order, little-endian."""
    buffer = io.BytesIO()
    plain = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    np.lib.format.write_array(buffer, plain, version=(1, 0), allow_pickle=False)
    return buffer.getvalue()


def unpack(blob: bytes, kind: type[Scalar]) -> NDArray[Scalar]:
    """Return the array of scalars ``kind`` that was packed; nothing in a blob is ever executed."""
    array = np.lib.format.read_array(io.BytesIO(blob), allow_pickle=False)
    return np.asarray(array, dtype=kind)


def to_text(value: Any) -> str:
    """Return ``value`` as JSON text in ASCII. Floats come back bit for bit; NaN and infinity are refused."""
    return json.dumps(value, allow_nan=False, separators=(",", ":"))


def finite(value: Any) -> Any:
    """Return a JSON value in which NaN and infinity, which JSON cannot say, are null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in cast(Mapping[Any, Any], value).items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in cast(Sequence[Any], value)]
    return value


@dataclass(frozen=True, slots=True)
class PackedRecording:
    """A recording as it is stored: ``digest`` is the SHA-256, in hex, over everything else in ``row``."""

    digest: str
    row: dict[str, Any]


def pack_recording(recording: Demonstration) -> PackedRecording:
    """Return the recording as a row, or raise InvalidValue if its parts do not fit together."""
    check_text(recording.demonstration_id, "demonstration_id")
    check_text(recording.operator, "operator")
    check_text(recording.source, "source")
    _check_shapes(recording)
    recorded_at = None if recording.recorded_at is None else as_utc(recording.recorded_at)
    head = {
        "demonstration_id": recording.demonstration_id,
        "operator": recording.operator,
        "source": recording.source,
        "recorded_at": recorded_at and recorded_at.isoformat(),
    }
    orientations = recording.orientations
    blobs = {
        "times": pack(np.asarray(recording.times, dtype=np.float64)),
        "points": pack(np.asarray(recording.points, dtype=np.float64)),
        "triggers": pack(np.asarray(recording.triggers, dtype=np.bool_)),
        "orientations": None if orientations is None else pack(np.asarray(orientations, dtype=np.float64)),
    }
    sha = hashlib.sha256(json.dumps(head, sort_keys=True, separators=(",", ":")).encode("ascii"))
    for blob in blobs.values():
        sha.update(blob or b"")
    samples, dimension = recording.points.shape
    shape = {"dimension": dimension, "samples": samples}
    digest = sha.hexdigest()
    return PackedRecording(digest, {"digest": digest, **head, "recorded_at": recorded_at, **shape, **blobs})


def unpack_recording(row: Any) -> Demonstration:
    """Return the recording of a row, equal bit for bit to the one that was packed."""
    with stored(f"recording {row.demonstration_id}"):
        return Demonstration(
            demonstration_id=row.demonstration_id,
            times=unpack(row.times, np.float64),
            points=unpack(row.points, np.float64),
            triggers=unpack(row.triggers, np.bool_),
            operator=row.operator,
            source=row.source,
            recorded_at=row.recorded_at,
            orientations=None if row.orientations is None else unpack(row.orientations, np.float64),
        )


def pack_aligned(aligned: AlignedDemonstration) -> dict[str, Any]:
    """Return an aligned demonstration as a row without its keys."""
    return {
        "demonstration_id": aligned.demonstration_id,
        "phases": pack(aligned.phases),
        "times": pack(aligned.times),
        "points": pack(aligned.points),
        "triggers": pack(aligned.triggers),
    }


def unpack_aligned(row: Any) -> AlignedDemonstration:
    """Return the aligned demonstration of a row."""
    with stored(f"aligned demonstration {row.demonstration_id}"):
        return AlignedDemonstration(
            demonstration_id=row.demonstration_id,
            phases=unpack(row.phases, np.float64),
            times=unpack(row.times, np.float64),
            points=unpack(row.points, np.float64),
            triggers=unpack(row.triggers, np.bool_),
        )


def _check_shapes(recording: Demonstration) -> None:
    samples = len(recording.times)
    name = recording.demonstration_id
    if recording.points.ndim != 2 or recording.points.shape[1] not in {2, 3}:
        raise InvalidValue(f"points of {name!r}", recording.points.shape, "they have shape (n, 2) or (n, 3)")
    lengths = {"points": len(recording.points), "triggers": len(recording.triggers)}
    if recording.orientations is not None:
        lengths["orientations"] = len(recording.orientations)
    for part, length in lengths.items():
        if length != samples:
            raise InvalidValue(f"{part} of {name!r}", length, f"there are as many as times, {samples}")
