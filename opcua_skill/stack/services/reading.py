"""What a client asks of a value: a part by index range, which timestamps; and how large an answer would be."""

import dataclasses
from datetime import UTC, datetime
from typing import Any

import numpy as np
from asyncua import ua
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.address_space.values import status
from opcua_skill.stack.services.index_ranges import index_range, part_of

_BOTH = ua.TimestampsToReturn.Both
_WANT_SOURCE = frozenset({ua.TimestampsToReturn.Source, _BOTH})
_WANT_SERVER = frozenset({ua.TimestampsToReturn.Server, _BOTH})
_OTHER_ENCODINGS = frozenset({"Default XML", "Default JSON"})


def size_of(value: Any) -> int:
    """Return roughly how many bytes a value takes when encoded."""
    if isinstance(value, str | bytes):
        return len(value)
    if isinstance(value, list | tuple):
        if value and not isinstance(value[0], int | float):
            return sum(size_of(element) for element in value) + 4 * len(value)
        return 8 * len(value)
    return 64 if isinstance(value, ua.ExtensionObject) or hasattr(value, "__dataclass_fields__") else 8


def weight_of(value: Any) -> int:
    """Return roughly how many bytes a method's output takes, the fields of its structures counted too."""
    if isinstance(value, np.ndarray):
        return int(value.nbytes)
    if isinstance(value, list | tuple):
        plain = not value or isinstance(value[0], int | float)
        return 8 * len(value) if plain else sum(weight_of(one) for one in value)
    if isinstance(value, str | bytes):
        return len(value)
    fields = getattr(value, "__dataclass_fields__", ())
    return 8 + sum(weight_of(getattr(value, name)) for name in fields)


def narrowed(told: ua.DataValue, wanted: ua.ReadValueId) -> ua.DataValue:
    """Return the part of a value that an index range asks for, or the code that says why there is none."""
    if code := encoding_fault(told, wanted):
        return _bad(code)
    if not wanted.IndexRange:
        return told
    ranges = index_range(wanted.IndexRange)
    if ranges is None:
        return _bad(Codes.BadIndexRangeInvalid)
    if told.Value is None or (told.StatusCode is not None and told.StatusCode.is_bad()):
        return told
    part = part_of(told.Value, ranges)
    return _bad(Codes.BadIndexRangeNoData) if part is None else dataclasses.replace(told, Value=part)


def encoding_fault(told: ua.DataValue, wanted: ua.ReadValueId) -> int:
    """Return the code to refuse an encoding with, 0 for one there is: structures have the binary one, others none."""
    encoding = wanted.DataEncoding
    if encoding is None or not encoding.Name:
        return Codes.Good
    structure = told.Value is not None and told.Value.VariantType == ua.VariantType.ExtensionObject
    if wanted.AttributeId != AttributeIds.Value or not structure or encoding.NamespaceIndex:
        return Codes.BadDataEncodingInvalid
    if encoding.Name in _OTHER_ENCODINGS:
        return Codes.BadDataEncodingUnsupported
    return Codes.Good if encoding.Name == "Default Binary" else Codes.BadDataEncodingInvalid


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
