"""Events that reach everybody who listens above their source, and the audit event of a method call."""

import copy
import logging
import secrets
from array import array
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.common import event_objects
from asyncua.common.events import Event
from asyncua.common.node import Node
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds as Ids

from opcua_skill.stack.address_space.standard_nodes import time_zone
from opcua_skill.stack.address_space.types import is_subtype, notifiers
from opcua_skill.stack.address_space.values import SERVER, node_id, status
from opcua_skill.stack.services.arguments import builtin_types
from opcua_skill.stack.services.calls import CallRecord

log = logging.getLogger(__name__)
LONGEST_AUDITED_VALUE = 200
_AUDIT = node_id(Ids.AuditEventType)


async def make_notifier(node: Node, parent: Node | None = None) -> None:
    """Let clients subscribe to events at a node, and let its events rise to ``parent`` (the Server if None)."""
    await node.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
    above = parent or Node(node.session, SERVER)
    await above.add_reference(node, Ids.HasNotifier, forward=True, bidirectional=True)


def completed(aspace: Any, source: ua.NodeId, event: Event) -> Event:
    """Return an event with EventId, Time, ReceiveTime, LocalTime, SourceNode and SourceName."""
    now = datetime.now(UTC)
    _set(event, "EventId", secrets.token_bytes(16), ua.VariantType.ByteString)
    if getattr(event, "Time", None) is None:
        _set(event, "Time", now, ua.VariantType.DateTime)
    _set(event, "ReceiveTime", now, ua.VariantType.DateTime)
    _set(event, "LocalTime", time_zone(now), ua.VariantType.ExtensionObject)
    if getattr(event, "SourceNode", None) is None:
        _set(event, "SourceNode", source, ua.VariantType.NodeId)
    if not getattr(event, "SourceName", None):
        name = aspace.read_attribute_value(source, AttributeIds.BrowseName).Value
        _set(event, "SourceName", name.Value.Name if name is not None else "", ua.VariantType.String)
    message = getattr(event, "Message", None)
    if isinstance(message, str):
        _set(event, "Message", ua.LocalizedText(message), ua.VariantType.LocalizedText)
    for field, kind in event.data_types.items():
        if isinstance(kind, ua.NodeId):  # asyncua's generated classes name some types by their DataType node
            event.data_types[field] = ua.VariantType(next(iter(builtin_types(aspace, kind))))
    return event


async def deliver(iserver: Any, source: ua.NodeId, event: Event) -> None:
    """Complete an event and give it to all subscribers of the source, of its notifiers upwards, and of the Server
    object; an audit event only to those whom it is for."""
    aspace = iserver.aspace
    event = completed(aspace, source, event)
    about = (
        str(getattr(event, "ClientUserId", "") or "") if is_subtype(aspace, vars(event)["EventType"], _AUDIT) else None
    )
    for notifier in notifiers(aspace, source):
        heard: Any = copy.copy(event)
        heard.emitting_node, heard.audited_user = notifier, about
        await iserver.subscription_service.trigger_event(heard)


def call_event(record: CallRecord, server_uri: str) -> Event:
    """Return the AuditUpdateMethodEvent of a call (OPC 10000-5, 6.4.29). Long arguments are described, not repeated."""
    event = event_objects.AuditUpdateMethodEvent()
    ended = "done" if not record.reason else f"{record.status_name}: {record.reason}"
    message = f"{record.method_name} by {record.caller.name or 'anonymous'}: {ended}"
    arguments = [ua.Variant(f"{name}={brief(value)}") for name, value in record.arguments]
    _set(event, "Message", ua.LocalizedText(message), ua.VariantType.LocalizedText)
    _set(event, "Severity", 500 if record.reason else 200, ua.VariantType.UInt16)
    _set(event, "SourceNode", record.object_id, ua.VariantType.NodeId)
    _set(event, "SourceName", "Attribute/Call", ua.VariantType.String)
    _set(event, "ActionTimeStamp", datetime.now(UTC), ua.VariantType.DateTime)
    _set(event, "Status", not record.reason, ua.VariantType.Boolean)
    _set(event, "ServerId", server_uri, ua.VariantType.String)
    _set(event, "ClientUserId", record.caller.name, ua.VariantType.String)
    _set(event, "ClientAuditEntryId", record.client_audit_entry_id, ua.VariantType.String)
    _set(event, "MethodId", record.method_id, ua.VariantType.NodeId)
    _set(event, "StatusCodeId", status(record.status), ua.VariantType.StatusCode)
    _set(event, "InputArguments", arguments, ua.VariantType.Variant)
    return event


def brief(value: Any) -> str:
    """Return a value in words for an audit line: short ones whole, long ones by their size."""
    if isinstance(value, list | tuple | array) and len(value) > 8:
        return f"{type(value[0]).__name__}[{len(value)}]"
    if isinstance(value, bytes):
        return value.hex() if len(value) <= 32 else f"{len(value)} bytes"
    text = str(value)
    return text if len(text) <= LONGEST_AUDITED_VALUE else f"{text[:LONGEST_AUDITED_VALUE]}… ({len(text)} characters)"


def _set(event: Event, name: str, value: Any, kind: ua.VariantType) -> None:
    event.add_property(name, value, kind)
