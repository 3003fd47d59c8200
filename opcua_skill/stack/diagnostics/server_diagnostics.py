"""ServerDiagnostics: worked out when they are read, told to those whom they concern (OPC 10000-5, 6.3.3 to 6.3.5)."""

import asyncio
import logging
from collections.abc import Callable
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.security.access import Caller, Role, caller, calling_as
from opcua_skill.stack.address_space.values import node_id, status
from opcua_skill.stack.diagnostics.counters import SubscriptionCounts, Totals
from opcua_skill.stack.diagnostics.records import security_record, session_records, subscription_record, summary
from opcua_skill.stack.subscriptions.monitored_items import Items

if TYPE_CHECKING:
    from opcua_skill.stack.internal_server import SkillInternalServer
    from opcua_skill.stack.sessions.sessions import Session

log = logging.getLogger(__name__)
TOLD_EVERY_SECONDS = 1.0
_SUMMARY = "Server_ServerDiagnostics_ServerDiagnosticsSummary"
_SESSIONS = "Server_ServerDiagnostics_SessionsDiagnosticsSummary_"
FLAG = node_id(Ids.Server_ServerDiagnostics_EnabledFlag)
SUMMARY = node_id(getattr(Ids, _SUMMARY))
SUBSCRIPTIONS = node_id(Ids.Server_ServerDiagnostics_SubscriptionDiagnosticsArray)
SESSIONS = node_id(getattr(Ids, _SESSIONS + "SessionDiagnosticsArray"))
SECURITY = node_id(getattr(Ids, _SESSIONS + "SessionSecurityDiagnosticsArray"))
SAMPLING = node_id(Ids.Server_ServerDiagnostics_SamplingIntervalDiagnosticsArray)
SECURITY_READERS = Role.ENGINEER.and_above
SWITCHERS = Role.ADMIN.and_above


class Diagnostics:
    """What the server has counted, as nodes. Nothing is worked out before somebody reads it."""

    def __init__(self, iserver: "SkillInternalServer") -> None:
        self.enabled = True
        self.totals = Totals()
        self._iserver = iserver
        self._nodes: dict[ua.NodeId, Callable[[], ua.Variant]] = {
            SUMMARY: lambda: _structure(self.summary()),
            SUBSCRIPTIONS: lambda: _structures(self._subscriptions()),
            SESSIONS: lambda: _structures(session_records(iserver, self._sessions())),
            SECURITY: lambda: _structures([security_record(one) for one in iserver.client_sessions()]),
        }
        for name in ua.ServerDiagnosticsSummaryDataType.__dataclass_fields__:
            self._nodes[node_id(getattr(Ids, f"{_SUMMARY}_{name}"))] = lambda name=name: ua.Variant(
                getattr(self.summary(), name), ua.VariantType.UInt32
            )
        self._telling: asyncio.Task[None] | None = None

    async def offer(self) -> None:
        """Put the diagnostics into the standard nodes. There are no fixed sampling intervals, so none are told of."""
        for node in self._nodes:
            self._iserver.set_attribute_value_callback(node, self._value)
        await self._iserver.isession.delete_nodes(
            ua.DeleteNodesParameters(NodesToDelete=[ua.DeleteNodesItem(NodeId=SAMPLING, DeleteTargetReferences=True)])
        )
        readable = ua.Variant(1 << ua.AccessLevel.CurrentRead, ua.VariantType.Byte)
        writable = ua.Variant(readable.Value | 1 << ua.AccessLevel.CurrentWrite, ua.VariantType.Byte)
        for node in (*self._nodes, FLAG):
            for attribute in (AttributeIds.AccessLevel, AttributeIds.UserAccessLevel):
                level = ua.DataValue(writable if node == FLAG else readable)
                await self._iserver.write_attribute_value(node, level, attribute)
        self._iserver.readers[SECURITY] = SECURITY_READERS
        self._iserver.restrict_writes(FLAG, SWITCHERS)
        self._iserver.on_write[FLAG] = self.switch
        await self._iserver.write_attribute_value(FLAG, ua.DataValue(ua.Variant(True)))

    async def switch(self, on: bool) -> None:
        """Count from zero again, or count no more and tell nothing."""
        log.warning("diagnostics are switched %s by %s", "on" if on else "off", caller().name)
        if on:
            self.totals = Totals()
            for session in self._iserver.client_sessions():
                session.counts.restart()
            for subscription in self._iserver.client_subscriptions():
                subscription.counts = SubscriptionCounts()
        self.enabled = bool(on)

    def start(self) -> None:
        """Go on telling those who monitor."""
        self._telling = asyncio.create_task(self._tell(), name="diagnostics")

    async def stop(self) -> None:
        """Stop telling."""
        if self._telling is not None:
            self._telling.cancel()
            await asyncio.gather(self._telling, return_exceptions=True)

    def summary(self) -> ua.ServerDiagnosticsSummaryDataType:
        """Return the figures of the whole server as they are now."""
        return summary(self._iserver, self.totals)

    def _value(self, node: ua.NodeId, attribute: AttributeIds) -> ua.DataValue:
        if not self.enabled:
            return ua.DataValue(StatusCode=status(Codes.BadNotReadable))
        who = _asking()
        if node == SECURITY and (who is None or who.role not in SECURITY_READERS):
            return ua.DataValue(StatusCode=status(Codes.BadUserAccessDenied))
        now: Any = datetime.now(UTC)
        return ua.DataValue(self._nodes[node](), SourceTimestamp=now, ServerTimestamp=now)

    def _sessions(self) -> "list[Session]":
        """Return the sessions that who is asking may know of: all for an engineer, one's own for others."""
        who = _asking()
        if who is None:
            return []
        everybody = who.role in SECURITY_READERS
        return [one for one in self._iserver.client_sessions() if everybody or _is_of(one, who)]

    def _subscriptions(self) -> list[ua.SubscriptionDiagnosticsDataType]:
        known = {one.session_id for one in self._sessions()}
        return [subscription_record(one) for one in self._iserver.client_subscriptions() if one.session_id in known]

    async def _tell(self) -> None:
        """Once a second, tell those who monitor a figure what it is now: each what its own session may see."""
        aspace = self._iserver.aspace
        while True:
            await asyncio.sleep(TOLD_EVERY_SECONDS)
            for node in self._nodes:
                callbacks = aspace[node].attributes[AttributeIds.Value].datachange_callbacks
                for handle, told in list(callbacks.items()):
                    items = getattr(told, "__self__", None)
                    session = self._iserver.session_of(items.isub.session_id) if isinstance(items, Items) else None
                    if session is not None:
                        with calling_as(session.caller):
                            await told(handle, aspace.read_attribute_value(node, AttributeIds.Value))


def _asking() -> Caller | None:
    """Return for whom a value is worked out; None, who may see nothing of others, when nobody has said."""
    try:
        return caller()
    except LookupError:
        return None


def _is_of(session: "Session", who: Caller) -> bool:
    return session.is_activated() and bool(who.name) and session.identity.name == who.name


def _structure(value: Any) -> ua.Variant:
    return ua.Variant(value, ua.VariantType.ExtensionObject)


def _structures(values: list[Any]) -> ua.Variant:
    return ua.Variant(values, ua.VariantType.ExtensionObject, is_array=True)
