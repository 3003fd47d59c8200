"""Parts of arrays by index range, and how large an answer would be, before it is encoded."""

from typing import Any

from asyncua import ua
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.values import status

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
    first, _, last = wanted.IndexRange.partition(":")
    if not (first.isascii() and first.isdigit()) or (last and not (last.isascii() and last.isdigit())):
        return _bad(Codes.BadIndexRangeInvalid)
    start, stop = int(first), int(last or first) + 1
    if (last and stop <= start + 1) or wanted.IndexRange.endswith(":"):
        return _bad(Codes.BadIndexRangeInvalid)
    value = told.Value.Value
    if not isinstance(value, list | tuple | str | bytes) or start >= len(value):
        return _bad(Codes.BadIndexRangeNoData)
    part = value[start:stop]
    answer = ua.DataValue(ua.Variant(part, told.Value.VariantType, is_array=told.Value.is_array))
    answer.SourceTimestamp, answer.ServerTimestamp = told.SourceTimestamp, told.ServerTimestamp
    return answer


def _bad(code: int) -> ua.DataValue:
    return ua.DataValue(StatusCode=status(code))
