"""What a client is told when its queue was too short: the Overflow bit of a value, an event in place of events."""

import dataclasses
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.common.event_objects import EventQueueOverflowEvent
from asyncua.server.monitored_item_service import MonitoredItemData

from opcua_skill.stack.address_space.values import SERVER, status

OVERFLOW = 0x0480
"""InfoType DataValue and InfoBits Overflow of a StatusCode. OPC UA Part 4, 7.39.1 (StatusCode)."""
MESSAGE = "events were lost: more came within a publishing interval than this item's queue holds"


def make_room(queue: list[Any], size: int, discard_oldest: bool) -> bool:
    """Drop the oldest or the newest entry of a full queue, and return whether one was dropped."""
    if not size or len(queue) < size:
        return False
    queue.pop(0 if discard_oldest else -1)
    return True


def marked_overflowed(value: ua.DataValue) -> ua.DataValue:
    """Return a value with the Overflow bit: values beside it were lost."""
    code = value.StatusCode.value if value.StatusCode is not None else 0
    return dataclasses.replace(value, StatusCode=status(code | OVERFLOW))


def event_fields(item: MonitoredItemData, fields: list[ua.Variant]) -> ua.EventFieldList:
    """Return what an item is told of an event."""
    told = ua.EventFieldList()
    told.ClientHandle, told.EventFields = item.client_handle, fields  # pyright: ignore[reportAttributeAccessIssue]
    return told


def overflow(item: MonitoredItemData) -> ua.EventFieldList:
    """Return the event that stands for those an item has lost. OPC UA Part 5, 6.4.34 (EventQueueOverflowEventType)."""
    event: Any = EventQueueOverflowEvent(sourcenode=SERVER, message=MESSAGE, severity=500)
    event.SourceName, event.Time = "Internal/EventQueueOverflow", datetime.now(UTC)
    return event_fields(item, event.to_event_fields(item.filter.SelectClauses))
