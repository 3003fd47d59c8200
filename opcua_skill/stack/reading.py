"""What a client asks of a value: a part by index range, which timestamps; and how large an answer would be."""

import dataclasses
import re
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.values import status

_RANGE = re.compile(r"(\d{1,10})(?::(\d{1,10}))?", re.ASCII)
_BOTH = ua.TimestampsToReturn.Both
_WANT_SOURCE = frozenset({ua.TimestampsToReturn.Source, _BOTH})
_WANT_SERVER = frozenset({ua.TimestampsToReturn.Server, _BOTH})
_DEFAULT_ENCODINGS = {None, "", "Default Binary"}


def size_of(value: Any) -> int:
    """Return roughly how many bytes a value takes when encoded."""
    if isinstance(value, str | bytes):
        return len(value)
    if isinstance(value, list | tuple):
        if value and not isinstance(value[0], int | float):
            return sum(size_of(element) for element in value) + 4 * len(value)
        return 8 * len(value)
    return 64 if isinstance(value, ua.ExtensionObject) or hasattr(value, "__dataclass_fields__") else 8


def narrowed(told: ua.DataValue, wanted: ua.ReadValueId) -> ua.DataValue:
    """Return the part of a value that an index range asks for, or the code that says why there is none."""
    if wanted.DataEncoding is not None and wanted.DataEncoding.Name not in _DEFAULT_ENCODINGS:
        return _bad(Codes.BadDataEncodingInvalid)
    if not wanted.IndexRange or told.Value is None:
        return told
    if wanted.AttributeId != AttributeIds.Value:
        return _bad(Codes.BadIndexRangeNoData)
    places = index_range(wanted.IndexRange)
    if places is None:
        return _bad(Codes.BadIndexRangeInvalid)
    start, stop = places.start, places.stop
    value = told.Value.Value
    if not isinstance(value, list | tuple | str | bytes) or start >= len(value):
        return _bad(Codes.BadIndexRangeNoData)
    part = value[start:stop]
    answer = ua.DataValue(ua.Variant(part, told.Value.VariantType, is_array=told.Value.is_array))
    answer.SourceTimestamp, answer.ServerTimestamp = told.SourceTimestamp, told.ServerTimestamp
    return answer


def index_range(text: str) -> range | None:
    """Return the places that an index range such as "3" or "2:5" names, None if it is not one (of one dimension)."""
    found = _RANGE.fullmatch(text)
    if found is None:
        return None
    first, last = int(found[1]), int(found[2] or found[1])
    return range(first, last + 1) if found[2] is None or last > first else None


def stamped(told: ua.DataValue, which: ua.TimestampsToReturn) -> ua.DataValue:
    """Return a value with the timestamps that were asked for, and no others."""
    source = told.SourceTimestamp if which in _WANT_SOURCE else None
    server = (told.ServerTimestamp or datetime.now(UTC)) if which in _WANT_SERVER else None
    if source is told.SourceTimestamp and server is told.ServerTimestamp:
        return told
    return dataclasses.replace(
        told,
        SourceTimestamp=source,
        ServerTimestamp=server,
        SourcePicoseconds=told.SourcePicoseconds if source is not None else None,
        ServerPicoseconds=None,
    )


def _bad(code: int) -> ua.DataValue:
    return ua.DataValue(StatusCode=status(code))
