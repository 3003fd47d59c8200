"""Parts of values by index range (OPC 10000-4, 7.27): of arrays and matrices, of text and bytes; read and written."""

import re
from typing import Any

from asyncua import ua
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.transport.decoding import reshape

Ranges = tuple[range, ...]
"""The places that are meant, one range for each dimension; the last may be within the texts of an array."""

MOST_DIMENSIONS = 32
_RANGE = re.compile(r"(\d{1,10})(?::(\d{1,10}))?", re.ASCII)
_TEXTS = frozenset({ua.VariantType.String, ua.VariantType.ByteString})


def index_range(text: str) -> Ranges | None:
    """Return the places that an index range such as "3", "2:5" or "1,0:2" names, None if its syntax is wrong."""
    if text.count(",") >= MOST_DIMENSIONS:
        return None
    ranges = []
    for dimension in text.split(","):
        found = _RANGE.fullmatch(dimension)
        if found is None:
            return None
        first, last = int(found[1]), int(found[2] or found[1])
        if found[2] is not None and last <= first:
            return None
        ranges.append(range(first, last + 1))
    return tuple(ranges)


def part_of(value: ua.Variant, ranges: Ranges) -> ua.Variant | None:
    """Return what lies within the ranges, as an array of as many dimensions (text stays text); None if nothing does.

    A range may end beyond the value, then the part is shorter. Texts of an array that end before the range are null.
    """
    shape = _shape(value)
    if not _fits(value, shape, ranges) or any(r.start >= n for r, n in zip(ranges, shape, strict=False)):
        return None
    part = _cut(_nested(value), ranges[: len(shape)])
    if len(ranges) > len(shape):
        part = _each_text(part, len(shape), ranges[-1])
        if all(text is None for text in _flat(part, len(shape))):
            return None
    return ua.Variant(part, value.VariantType, is_array=bool(shape))


def with_part(value: ua.Variant, ranges: Ranges, part: ua.Variant) -> ua.Variant | int:
    """Return a value with the places within the ranges replaced, or the code that says why they cannot be.

    All places must exist (BadIndexRangeNoData), and the part be of the same type (BadTypeMismatch) and of their number
    in each dimension (BadIndexRangeDataMismatch). The value itself is left as it is.
    """
    shape = _shape(value)
    if not _fits(value, shape, ranges) or any(r.stop > n for r, n in zip(ranges, shape, strict=False)):
        return Codes.BadIndexRangeNoData
    if part.VariantType != value.VariantType or bool(part.is_array) != bool(shape):
        return Codes.BadTypeMismatch
    places = ranges[: len(shape)]
    if _shape(part) != [len(one) for one in places]:
        return Codes.BadIndexRangeDataMismatch
    whole, new = _nested(value), _nested(part)
    if len(ranges) > len(shape):
        within = ranges[-1]
        old = _flat(_cut(whole, places), len(shape))
        texts = _flat(new, len(shape))
        if any(text is None or within.stop > len(text) for text in old):
            return Codes.BadIndexRangeNoData
        if any(text is None or len(text) != len(within) for text in texts):
            return Codes.BadIndexRangeDataMismatch
        flat = [a[: within.start] + b + a[within.stop :] for a, b in zip(old, texts, strict=True)]
        new = reshape(flat, [len(one) for one in places]) if places else flat[0]
    whole = _put(whole, places, new)
    return ua.Variant(whole, value.VariantType, value.Dimensions, is_array=bool(shape))


def _shape(value: ua.Variant) -> list[int]:
    """Return the length of each dimension, none for a scalar."""
    if not value.is_array:
        return []
    return [int(n) for n in value.Dimensions] if value.Dimensions else [len(value.Value or ())]


def _fits(value: ua.Variant, shape: list[int], ranges: Ranges) -> bool:
    """Return whether there is a range for each dimension, and at most one more for what is within a text."""
    if value.Value is None:
        return False
    return len(ranges) == len(shape) or (len(ranges) == len(shape) + 1 and value.VariantType in _TEXTS)


def _nested(value: ua.Variant) -> Any:
    """Return a matrix as nested lists, also where it was given as a flat one with dimensions."""
    content, shape = value.Value, _shape(value)
    flat = len(shape) > 1 and content and not isinstance(content[0], list | tuple)
    return reshape(list(content), shape) if flat else content


def _cut(content: Any, ranges: Ranges) -> Any:
    if not ranges:
        return content
    part = content[ranges[0].start : ranges[0].stop]
    return [_cut(one, ranges[1:]) for one in part] if len(ranges) > 1 else list(part)


def _put(content: Any, ranges: Ranges, new: Any) -> Any:
    if not ranges:
        return new
    first, whole = ranges[0], list(content)
    whole[first.start : first.stop] = [
        _put(old, ranges[1:], one) for old, one in zip(whole[first.start : first.stop], new, strict=True)
    ]
    return whole


def _each_text(content: Any, depth: int, within: range) -> Any:
    if depth:
        return [_each_text(one, depth - 1, within) for one in content]
    return content[within.start : within.stop] if content is not None and within.start < len(content) else None


def _flat(content: Any, depth: int) -> list[Any]:
    if not depth:
        return [content]
    return [text for one in content for text in _flat(one, depth - 1)]
