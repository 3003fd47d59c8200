"""What may be written: existing, writable variables, with values of the type and the rank they declare."""

import dataclasses
from typing import Any

from asyncua import ua
from asyncua.server.address_space import AddressSpace
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.services.arguments import builtin_types
from opcua_skill.stack.services.index_ranges import index_range, with_part

READABLE = 1 << ua.AccessLevel.CurrentRead
WRITABLE = 1 << ua.AccessLevel.CurrentWrite
_NULLABLE = frozenset({12, 15, 16, 22})  # String, ByteString, XmlElement, ExtensionObject


def value_to_write(aspace: AddressSpace, item: ua.WriteValue) -> ua.DataValue | int:
    """Return the whole value that a write leads to, or the code to refuse it with (OPC 10000-4, 5.11.4)."""
    node = aspace.get(item.NodeId)
    if node is None:
        return Codes.BadNodeIdUnknown
    if item.AttributeId not in node.attributes:
        return Codes.BadAttributeIdInvalid
    level = _declared(node, AttributeIds.AccessLevel)
    if item.AttributeId != AttributeIds.Value or level is None or not level & WRITABLE:
        return Codes.BadNotWritable
    ranges = index_range(item.IndexRange) if item.IndexRange else ()
    if ranges is None:
        return Codes.BadIndexRangeInvalid
    if item.Value.StatusCode is not None and item.Value.StatusCode.value:
        return Codes.BadWriteNotSupported
    if not ranges:
        return item.Value if fits_variable(aspace, node, item.Value.Value) else Codes.BadTypeMismatch
    if item.Value.Value is None:
        return Codes.BadTypeMismatch
    now = aspace.read_attribute_value(item.NodeId, AttributeIds.Value)
    if now.Value is None:
        return Codes.BadIndexRangeNoData
    whole = with_part(now.Value, ranges, item.Value.Value)
    return whole if isinstance(whole, int) else dataclasses.replace(item.Value, Value=whole)


def fits_variable(aspace: AddressSpace, node: Any, value: ua.Variant | None) -> bool:
    """Return whether a value has the data type and the rank that a variable declares."""
    if value is None:
        return False
    data_type, rank = (_declared(node, one) for one in (AttributeIds.DataType, AttributeIds.ValueRank))
    if not isinstance(data_type, ua.NodeId):
        return False
    rank = -1 if rank is None else int(rank)
    if value.VariantType.value not in builtin_types(aspace, data_type):
        return False
    if rank == -1 or (not value.is_array and rank in {-2, -3}):
        return not value.is_array and (value.Value is not None or value.VariantType.value in _NULLABLE)
    if rank == -2:
        return True
    dimensions = len(value.Dimensions) if value.Dimensions else 1
    return bool(value.is_array) and (dimensions == rank or rank == 0 or (rank == -3 and dimensions == 1))


def _declared(node: Any, attribute: AttributeIds) -> Any:
    found = node.attributes.get(attribute)
    return found.value.Value.Value if found is not None and found.value is not None and found.value.Value else None
