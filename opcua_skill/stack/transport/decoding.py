"""Decoding that a peer cannot use against the server: lengths are checked before anything is read or allocated.

asyncua keeps its decoders in module-level functions with caches, so they are replaced there, once per process, and the
caches are cleared. What replaces them decodes the same messages to the same values, as its tests show, and refuses
what no honest client sends: negative lengths, arrays longer than their bytes or than the limits, text that is not
UTF-8 or holds NUL, dimensions that do not fit their array, and nesting without end.
"""

import functools
import math
import struct
import threading
from array import array
from collections.abc import Callable
from enum import Enum, IntFlag
from typing import Any

import numpy as np
from asyncua import ua
from asyncua.common.utils import Buffer, NotEnoughData
from asyncua.ua import ua_binary, uaerrors

from opcua_skill.stack.limits import Limits

_limits = Limits()
_UNCOUNTED = 2**62
MANY = 4096
NUMBERS = frozenset("hHiIqQdf")
_NUMPY = {
    "b": "i1",
    "B": "u1",
    "h": "i2",
    "H": "u2",
    "i": "i4",
    "I": "u4",
    "q": "i8",
    "Q": "u8",
    "?": "?",
    "d": "f8",
    "f": "f4",
}


class _Going(threading.local):
    """How far one thread's decoding has come: elements it may still decode, structures it is inside of."""

    elements_left = _UNCOUNTED
    depth = 0


_going = _Going()
_INT32 = struct.Struct("<i")
_NESTING = frozenset({ua.VariantType.Variant, ua.VariantType.ExtensionObject, ua.VariantType.DiagnosticInfo})
MALFORMED = (
    ValueError,
    TypeError,
    LookupError,
    OverflowError,
    AttributeError,
    AssertionError,
    struct.error,
    ua.UaError,
)
"""What decoding may raise for bytes that are not what they claim to be."""


def decode(kind: Any, body: Buffer) -> Any:
    """Return a structure read from a message body; BadDecodingError or BadEncodingLimitsExceeded if it is not one."""
    _going.elements_left = _limits.elements_per_message
    try:
        return ua_binary.struct_from_binary(kind, body)
    except uaerrors.BadEncodingLimitsExceeded:
        raise
    except RecursionError:
        raise uaerrors.BadEncodingLimitsExceeded() from None
    except MALFORMED:
        raise uaerrors.BadDecodingError() from None
    finally:
        _going.elements_left = _UNCOUNTED


def _pack_array(self: Any, data: Any) -> bytes:
    """Return numbers as they go over the wire; those in arrays are copied, not gone through one by one."""
    if data is None:
        return _INT32.pack(-1)
    if isinstance(data, np.ndarray):
        return _INT32.pack(len(data)) + np.ascontiguousarray(data, dtype=f"<{_NUMPY[self.format[-1]]}").tobytes()
    return _INT32.pack(len(data)) + struct.pack(self._fmt.format(len(data)), *data)


def install(limits: Limits) -> None:
    """Put the guarded decoders in place of asyncua's. Called by every server; the last one's limits hold."""
    global _limits
    _limits = limits
    Buffer.read = _read
    Buffer.skip = _skip
    ua_binary._Bytes.unpack = staticmethod(_unpack_bytes)
    ua_binary._String.unpack = staticmethod(_unpack_string)
    ua_binary._create_uatype_array_deserializer = _array_decoder
    ua_binary._create_list_deserializer = _list_decoder
    ua_binary.variant_from_binary = _variant
    ua_binary.extensionobject_from_binary = _extension_object
    ua_binary._reshape = reshape
    ua_binary.create_enum_deserializer = _enumeration
    ua_binary._Primitive1.pack_array = _pack_array
    for cached in ("create_uatype_array_serializer", "create_list_serializer", "create_type_serializer"):
        getattr(ua_binary, cached).cache_clear()
    ua_binary.create_dataclass_serializer.cache_clear()
    for cached in ("_create_uatype_deserializer", "_create_type_deserializer", "_create_dataclass_deserializer"):
        getattr(ua_binary, cached).cache_clear()
    _array_decoder.cache_clear()
    _list_decoder.cache_clear()


def _read(self: Buffer, size: int) -> bytes:
    if size > self._size:
        raise NotEnoughData(f"need {size} bytes, have {self._size}")
    if size < 0:
        raise uaerrors.BadDecodingError()
    start = self._cur_pos
    self._size -= size
    self._cur_pos = start + size
    return self._data[start : start + size]


def _skip(self: Buffer, size: int) -> None:
    if size < 0 or size > self._size:
        raise NotEnoughData(f"need {size} bytes, have {self._size}")
    self._size -= size
    self._cur_pos += size


def _length(data: Any, largest: int) -> int:
    """Return a length from the stream, -1 for null; refuse one that cannot be true or is larger than the limit."""
    (length,) = _INT32.unpack(data.read(4))
    if length < -1:
        raise uaerrors.BadDecodingError()
    if length > largest:
        raise uaerrors.BadEncodingLimitsExceeded()
    if isinstance(data, Buffer) and length > data._size:
        raise NotEnoughData(f"{length} elements announced, {data._size} bytes left")
    return length


def _count(length: int) -> None:
    """Count elements that are decoded one by one: nested arrays, each within its limit, must not add up either."""
    _going.elements_left -= length
    if _going.elements_left < 0:
        raise uaerrors.BadEncodingLimitsExceeded()


def _unpack_bytes(data: Any) -> bytes | None:
    length = _length(data, _limits.string)
    return None if length == -1 else data.read(length)


def _unpack_string(data: Any) -> str | None:
    content = _unpack_bytes(data)
    if content is None:
        return None
    if b"\0" in content:  # no database stores it and no honest client sends it
        raise uaerrors.BadDecodingError()
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise uaerrors.BadDecodingError() from None


@functools.cache
def _array_decoder(kind: Any) -> Callable[[Any], list[Any] | None]:
    primitive = getattr(ua_binary.Primitives1, kind.name, None)
    if primitive is not None:

        def decode_primitives(data: Any) -> list[Any] | None:
            length = _length(data, _limits.array_of_primitives)
            if length > MANY and primitive.format[-1] in NUMBERS:
                many = array(primitive.format[-1])
                many.frombytes(data.read(length * primitive.size))
                return many  # pyright: ignore[reportReturnType] - a sequence of numbers that costs no object for each
            return None if length == -1 else list(primitive.unpack_array(data, length))

        return decode_primitives
    element = ua_binary._create_uatype_deserializer(kind)

    def decode_others(data: Any) -> list[Any] | None:
        length = _length(data, _limits.array_of_others)
        _count(length)
        return None if length == -1 else [element(data) for _ in range(length)]

    return decode_others


@functools.cache
def _list_decoder(kind: Any) -> Callable[[Any], list[Any]]:
    element: Callable[[Any], Any] | None = None

    def decode_list(data: Any) -> list[Any]:
        nonlocal element
        length = _length(data, _limits.array_of_others)
        _count(length)
        if element is None:  # looked up late: structures may hold lists of themselves
            element = ua_binary._create_type_deserializer(kind, type(None))
        return [element(data) for _ in range(length)]

    return decode_list


def _variant(data: Any) -> ua.Variant:
    encoding = ord(data.read(1))
    kind: Any = ua.uatypes.datatype_to_varianttype(encoding & 0b0011_1111)
    is_array = bool(encoding & 0b1000_0000)
    if kind in _NESTING:
        _going.depth += 1
        try:
            if _going.depth > _limits.nesting:
                raise uaerrors.BadEncodingLimitsExceeded()
            value = _value(kind, is_array, data)
        finally:
            _going.depth -= 1
    else:
        value = _value(kind, is_array, data)
    dimensions = None
    if encoding & 0b0100_0000:
        dimensions = ua_binary.unpack_uatype_array(ua.VariantType.Int32, data)
        if value is not None and is_array and dimensions:
            value = reshape(value, dimensions)
    return ua.Variant(value, kind, dimensions, is_array=is_array)


def _value(kind: Any, is_array: bool, data: Any) -> Any:
    return ua_binary.unpack_uatype_array(kind, data) if is_array else ua_binary.unpack_uatype(kind, data)


def reshape(flat: list[Any], dimensions: list[int]) -> list[Any]:
    """Return a flat array as nested lists; BadDecodingError if the dimensions do not say how many values there are."""
    if any(size < 0 for size in dimensions) or math.prod(dimensions) != len(flat):
        raise uaerrors.BadDecodingError()
    for size in reversed(dimensions[1:]):
        flat = [flat[at : at + size] for at in range(0, len(flat), size or 1)]
    return flat


def _extension_object(data: Any) -> Any:
    """Return the structure, or the raw ExtensionObject when its type is unknown or its body is not of that type.

    Then it is the service or the method check that refuses it, with the argument it stands in.
    """
    type_id = ua_binary.nodeid_from_binary(data)
    encoding = ord(data.read(1))
    if encoding not in {0, 1, 2}:
        raise uaerrors.BadDecodingError()
    body = _unpack_bytes(data) if encoding else None
    if type_id.Identifier == 0:
        return ua.ExtensionObject()
    structure = ua.extension_objects_by_typeid.get(type_id) if encoding == 1 else None
    if structure is None or body is None:
        return _raw(type_id, body)
    content = Buffer(body)
    _going.depth += 1
    try:
        if _going.depth > _limits.nesting:
            raise uaerrors.BadEncodingLimitsExceeded()
        value = ua_binary.from_binary(structure, content)
    except uaerrors.BadEncodingLimitsExceeded:
        raise
    except MALFORMED:
        return _raw(type_id, body)
    finally:
        _going.depth -= 1
    return _raw(type_id, body) if len(content) else value


def _enumeration(kind: type[Enum]) -> Callable[[Any], Any]:
    """Return the decoder of an enumeration. A number without a name stays one, at its operation's cost."""
    named: Any = getattr(kind, "datatype", None) if issubclass(kind, IntFlag) else None
    name = named() if named is not None else "UInt32" if issubclass(kind, IntFlag) else "Int32"
    primitive = getattr(ua_binary.Primitives1, name)

    def decode_member(data: Any) -> Any:
        number = primitive.unpack(data)
        try:
            return kind(number)
        except ValueError:
            return number

    return decode_member


def _raw(type_id: ua.NodeId, body: Any) -> ua.ExtensionObject:
    return ua.ExtensionObject(TypeId=type_id, Body=body)
