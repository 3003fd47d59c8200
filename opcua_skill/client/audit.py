"""Why the server said no: the reason stands in the audit event of the call, which only the events can tell."""

import asyncio
import contextlib
from collections import deque
from dataclasses import dataclass
from typing import Any

from asyncua import ua
from asyncua.client.client import Client
from asyncua.common.subscription import OpcEvent
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds

WAIT = 2.0
KEPT = 200
FIELDS = {
    "Message": ObjectIds.BaseEventType,
    "Status": ObjectIds.AuditEventType,
    "ClientAuditEntryId": ObjectIds.AuditEventType,
    "ClientUserId": ObjectIds.AuditEventType,
    "MethodId": ObjectIds.AuditUpdateMethodEventType,
}


@dataclass(frozen=True, slots=True)
class Refusal:
    """One refused call, as the audit event tells it."""

    entry: str
    method: ua.NodeId
    user: str
    reason: str


class AuditReasons:
    """Collects the audit events of refused calls and hands out the sentence of one call.

    A call carries an id of its own (``RequestHeader.AuditEntryId``) that the event repeats (``ClientAuditEntryId``);
    a server that does not repeat it is recognised by method and user.
    """

    def __init__(self) -> None:
        self._heard: deque[Refusal] = deque(maxlen=KEPT)
        self._news = asyncio.Condition()
        self._listener: asyncio.Task[None] | None = None

    @classmethod
    async def subscribe(cls, client: Client) -> "AuditReasons | None":
        """Listen to audit events at the Server object; None where the server does not let this session."""
        reasons = cls()
        with contextlib.suppress(ua.UaStatusCodeError):
            subscription = await client.create_subscription(50, None)
            clauses = [
                ua.SimpleAttributeOperand(ua.NodeId(ua.Int32(kind)), [ua.QualifiedName(name)], AttributeIds.Value)
                for name, kind in FIELDS.items()
            ]
            audit_type = ua.NodeId(ua.Int32(ObjectIds.AuditUpdateMethodEventType))
            only = ua.ContentFilterElement(ua.FilterOperator.OfType, [ua.LiteralOperand(ua.Variant(audit_type))])
            await subscription.subscribe_events(
                client.nodes.server,
                evfilter=ua.EventFilter(SelectClauses=clauses, WhereClause=ua.ContentFilter([only])),
                queuesize=KEPT,
            )
            reasons._listener = asyncio.create_task(reasons._listen(subscription))
            return reasons
        return None

    async def close(self) -> None:
        """Stop listening."""
        if self._listener is not None:
            self._listener.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._listener

    async def _listen(self, subscription: Any) -> None:
        async for told in subscription:
            if not isinstance(told, OpcEvent):
                continue
            fields = told.event.get_event_props_as_fields_dict()
            message = fields["Message"].Value
            if message and fields["Status"].Value is False:
                async with self._news:
                    self._heard.append(
                        Refusal(
                            entry=fields["ClientAuditEntryId"].Value or "",
                            method=fields["MethodId"].Value,
                            user=fields["ClientUserId"].Value or "",
                            reason=message.Text or "",
                        )
                    )
                    self._news.notify_all()

    async def reason(self, entry: str, method: ua.NodeId, user: str) -> str:
        """Return the sentence for the refused call ``entry``; empty if none was told in time."""

        def found() -> Refusal | None:
            return next((one for one in self._heard if one.entry == entry), None) or next(
                (one for one in self._heard if not one.entry and (one.method, one.user) == (method, user)), None
            )

        async with self._news:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(WAIT):
                    await self._news.wait_for(lambda: found() is not None)
            mine = found()
            if mine is None:
                return ""
            self._heard.remove(mine)
            return mine.reason
