"""Filters of values: what a deadband may stand on, what it comes to, and whether a value has moved far enough."""

import dataclasses
import math
from typing import Any

import numpy as np
from asyncua import ua
from asyncua.server.address_space import AddressSpace
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes
from asyncua.ua.uaprotocol_auto import DataChangeFilter  # what is decoded: ua.DataChangeFilter is a child of it

from opcua_skill.stack.address_space.types import is_subtype
from opcua_skill.stack.address_space.values import node_id

_NUMBER, _HAS_PROPERTY = node_id(Ids.Number), node_id(Ids.HasProperty)


def data_filter(wanted: Any, aspace: AddressSpace, item: ua.ReadValueId) -> DataChangeFilter | int | None:
    """Return the filter of an item for values, None for none, or the code to refuse it with (OPC 10000-4, 7.22.2).

    A deadband in percent becomes an absolute one by the range of the value.
    """
    if wanted is None or (isinstance(wanted, ua.ExtensionObject) and not wanted.TypeId.Identifier):
        return None
    if not isinstance(wanted, DataChangeFilter):
        return _not_for_values(wanted)
    if not isinstance(wanted.Trigger, ua.DataChangeTrigger):
        return Codes.BadMonitoredItemFilterInvalid
    if wanted.DeadbandType == ua.DeadbandType.None_:
        return wanted
    if wanted.DeadbandType not in {ua.DeadbandType.Absolute, ua.DeadbandType.Percent}:
        return Codes.BadMonitoredItemFilterUnsupported
    if item.AttributeId != AttributeIds.Value or not _is_number(aspace, item.NodeId):
        return Codes.BadFilterNotAllowed
    if not math.isfinite(wanted.DeadbandValue) or wanted.DeadbandValue < 0:
        return Codes.BadDeadbandFilterInvalid
    if wanted.DeadbandType == ua.DeadbandType.Absolute:
        return wanted
    span = _span(aspace, item.NodeId)
    if span is None:
        return Codes.BadFilterNotAllowed
    if wanted.DeadbandValue > 100:
        return Codes.BadDeadbandFilterInvalid
    absolute: Any = ua.DeadbandType.Absolute
    return dataclasses.replace(wanted, DeadbandType=absolute, DeadbandValue=wanted.DeadbandValue / 100 * span)


def _not_for_values(wanted: Any) -> int:
    if isinstance(wanted, ua.EventFilter):
        return Codes.BadFilterNotAllowed
    return (
        Codes.BadMonitoredItemFilterUnsupported
        if isinstance(wanted, ua.AggregateFilter)
        else Codes.BadMonitoredItemFilterInvalid
    )


def _is_number(aspace: AddressSpace, variable: ua.NodeId) -> bool:
    told = aspace.read_attribute_value(variable, AttributeIds.DataType).Value
    return told is not None and is_subtype(aspace, told.Value, _NUMBER)


def _span(aspace: AddressSpace, variable: ua.NodeId) -> float | None:
    """Return how far a value's range reaches, None if it has none that says so."""
    node = aspace.get(variable)
    for reference in node.references if node is not None else ():
        if (
            reference.IsForward
            and reference.ReferenceTypeId == _HAS_PROPERTY
            and reference.BrowseName.Name == "EURange"
        ):
            told = aspace.read_attribute_value(reference.NodeId, AttributeIds.Value).Value
            if told is not None and isinstance(told.Value, ua.Range) and told.Value.High > told.Value.Low:
                return told.Value.High - told.Value.Low
    return None


def moved(old: ua.Variant | None, new: ua.Variant | None, deadband: float) -> bool:
    """Return whether a number, or any one of an array, is farther than a deadband from what was told last."""
    if old is None or new is None or old.Value is None or new.Value is None:
        return True
    if isinstance(old.Value, int | float) and isinstance(new.Value, int | float):
        return not abs(new.Value - old.Value) <= deadband
    before, after = np.asarray(old.Value, dtype=float), np.asarray(new.Value, dtype=float)
    if before.shape != after.shape:
        return True
    with np.errstate(invalid="ignore"):
        return not bool(np.all(np.abs(after - before) <= deadband))
