"""Subscriptions: owned, bounded, and with one encoding of a value for everybody who monitors it."""

import asyncio
import dataclasses
import logging
import math
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.address_space import AddressSpace
from asyncua.server.internal_subscription import InternalSubscription
from asyncua.server.monitored_item_service import MonitoredItemData
from asyncua.server.subscription_service import SubscriptionService
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes
from asyncua.ua.ua_binary import struct_to_binary

from opcua_skill.stack.address_space.languages import ENGLISH
from opcua_skill.stack.address_space.values import node_id, status
from opcua_skill.stack.diagnostics.counters import SubscriptionCounts
from opcua_skill.stack.services.reading import stamped
from opcua_skill.stack.subscriptions.monitored_items import Items
from opcua_skill.stack.subscriptions.queues import event_fields, make_room, marked_overflowed

if TYPE_CHECKING:
    from opcua_skill.stack.internal_server import SkillInternalServer

log = logging.getLogger(__name__)
KEPT_BYTES = 4 * 1024 * 1024
_UINT32 = struct.Struct("<I")
_DATA_CHANGE = node_id(Ids.DataChangeNotification_Encoding_DefaultBinary)
_NO_DIAGNOSTICS = b"\xff\xff\xff\xff"


class Encodings:
    """The encodings of the values that are on their way now: the same DataValue is encoded once for all."""

    def __init__(self) -> None:
        self._kept: dict[tuple[int, int], tuple[ua.DataValue, bytes]] = {}
        self._bytes = 0

    def of(self, value: ua.DataValue, which: ua.TimestampsToReturn) -> bytes:
        """Return the encoding of a value with the timestamps that are wanted."""
        found = self._kept.get((id(value), which))
        if found is not None and found[0] is value:
            return found[1]
        encoded = struct_to_binary(stamped(value, which))
        self._bytes += len(encoded) + 200
        if self._bytes > KEPT_BYTES:
            self._kept.clear()
            self._bytes = len(encoded)
        self._kept[id(value), which] = (value, encoded)
        return encoded


class Subscription(InternalSubscription):
    """One subscription."""

    monitored_item_srv: Items  # pyright: ignore[reportIncompatibleVariableOverride]
    pub_request_callback: Any

    def __init__(
        self, service: "Subscriptions", data: Any, callback: Any, session_id: ua.NodeId, **options: Any
    ) -> None:
        super().__init__(data, service.aspace, callback, session_id, **options)
        self._encodings = service.encodings
        self._iserver = service.iserver
        self.counts = SubscriptionCounts()
        self.priority = 0
        self.most_notifications = 0
        self._lost_events: set[int] = set()
        self._more = False
        self.monitored_item_srv = Items(self, service.aspace, service.iserver.limits)

    def queue_value(self, mid: int, item: MonitoredItemData, value: ua.DataValue) -> None:
        """Queue a changed value; where the item's queue is full, one goes and its neighbour tells so.

        OPC UA Part 4, 5.13.1.5 (Queue parameters).
        """
        oldest_goes = self.monitored_item_srv.discards_oldest(mid)
        self.monitored_item_srv.trigger(mid)
        queue = self._triggered_datachanges.setdefault(mid, [])
        lost = make_room(queue, item.queue_size, oldest_goes) and item.queue_size > 1
        queue.append(ua.MonitoredItemNotification(ClientHandle=item.client_handle, Value=value))  # pyright: ignore[reportArgumentType]
        if lost:
            self.counts.value_overflows += 1
            beside = 0 if oldest_goes else -1
            queue[beside] = dataclasses.replace(queue[beside], Value=marked_overflowed(queue[beside].Value))

    def queue_event(self, mid: int, item: MonitoredItemData, fields: list[ua.Variant]) -> None:
        """Queue an event; where the item's queue is full, one goes, and an event beside the queue tells so once."""
        oldest_goes = self.monitored_item_srv.discards_oldest(mid)
        self.monitored_item_srv.trigger(mid)
        queue = self._triggered_events.setdefault(mid, [])
        if make_room(queue, item.queue_size, oldest_goes):
            self.counts.event_overflows += 1
            self._lost_events.add(mid)
        queue.append(event_fields(item, fields))

    def may_hear_of(self, user: str) -> bool:
        """Return whether audit events about a user may be told here; the server's own subscriptions hear all."""
        if self.pub_request_callback is None:
            return True
        identity = self._iserver.identity_of(self.session_id)
        return identity is not None and identity.may_hear_of(user)

    def in_its_language(self, fields: list[ua.Variant]) -> list[ua.Variant]:
        """Return an event's fields with their texts in the language that this subscription's session asked for."""
        session = self._iserver.session_of(self.session_id)
        if session is None or session.language == ENGLISH:
            return fields
        return [self._iserver.languages.said(session.language, field) for field in fields]

    def may_read(self, node: ua.NodeId) -> bool:
        """Return whether this subscription's session may read a variable; the server's own may read all."""
        if self.pub_request_callback is None or node not in self._iserver.readers:
            return True
        identity = self._iserver.identity_of(self.session_id)
        return identity is not None and self._iserver.may_read(node, identity.role)

    async def set_publishing_mode(self, enabled: bool) -> None:
        """Switch publishing on or off."""
        if enabled:
            self.counts.enabled += 1
        else:
            self.counts.disabled += 1
        await super().set_publishing_mode(enabled)

    def forget_item(self, mid: int) -> None:
        """Drop what was queued for an item that is deleted."""
        self._triggered_datachanges.pop(mid, None)
        self._triggered_events.pop(mid, None)
        self._lost_events.discard(mid)

    def _pop_triggered_datachanges(self, result: ua.PublishResult) -> None:
        if self.pub_request_callback is None:  # the server's own subscription wants objects, not bytes
            super()._pop_triggered_datachanges(result)
            return
        if not self._triggered_datachanges:
            return
        encoding, parts = self._encodings.of, []
        for mid, queue in self._triggered_datachanges.items():
            which = self.monitored_item_srv.stamps(mid)
            for notification in queue:
                parts += (_UINT32.pack(notification.ClientHandle), encoding(notification.Value, which))
        self.counts.values += len(parts) // 2
        body = b"".join((_UINT32.pack(len(parts) // 2), *parts, _NO_DIAGNOSTICS))
        self._triggered_datachanges = {}
        result.NotificationMessage.NotificationData.append(ua.ExtensionObject(TypeId=_DATA_CHANGE, Body=body))  # pyright: ignore[reportArgumentType]

    def _pop_triggered_events(self, result: ua.PublishResult) -> None:
        self.counts.events += sum(len(queue) for queue in self._triggered_events.values())
        super()._pop_triggered_events(result)

    def _tell_losses(self) -> None:
        """Put an event that tells of those an item has lost where they would have been."""
        for mid in self._lost_events & self._triggered_events.keys():
            queue, told = self._triggered_events[mid], self.monitored_item_srv.overflow(mid)
            queue.insert(0 if self.monitored_item_srv.discards_oldest(mid) else len(queue), told)
        self._lost_events -= self._triggered_events.keys()

    def has_published_results(self) -> bool:
        """Return whether there is something to say: values of items that report, or that we are still here."""
        with self._without_sampling():
            return super().has_published_results()

    async def publish_results(self, requestdata: Any = None) -> bool:
        """Say what there is to say, in as many messages as it takes and requests are there for; end what nobody asks.

        OPC UA Part 4, 5.14.1 (Subscription model).
        """
        if self.pub_request_callback is not None and self._publish_cycles_count > self.data.RevisedLifetimeCount:
            await self._expire()
            return False
        published = await super().publish_results(requestdata)
        more = published
        while more and self._more:
            more = await super().publish_results()
        return published

    async def _expire(self) -> None:
        """End the subscription, and say so to its session."""
        log.warning("subscription %d has expired: nobody asked for it", self.data.SubscriptionId)
        self._iserver.subscription_service.subscriptions.pop(self.data.SubscriptionId, None)
        self._closing = True
        if self._task is not None and self._task is not asyncio.current_task():
            self._task.cancel()
        self.monitored_item_srv.delete_all_monitored_items()
        session = self._iserver.session_of(self.session_id)
        if session is not None:
            session.tell_ended(self.last_words(Codes.BadTimeout))

    def last_words(self, code: int) -> ua.PublishResult:
        """Return what a session is told for which this subscription is over."""
        result: Any = ua.PublishResult()
        result.SubscriptionId, result.MoreNotifications = self.data.SubscriptionId, False
        result.NotificationMessage.SequenceNumber = self._notification_seq
        result.NotificationMessage.NotificationData = [ua.StatusChangeNotification(Status=status(code))]
        return result

    def _pop_publish_result(self) -> ua.PublishResult:
        kept = len(self._not_acknowledged_results)
        with self._without_sampling():
            if self._publishing_enabled:
                self._tell_losses()
            rest = self._hold_back()
            result = super()._pop_publish_result()
            if rest is not None:
                self._triggered_datachanges, self._triggered_events = rest
        if self._publishing_enabled:
            self.monitored_item_srv.triggered &= {mid for kind in rest or () for mid in kind}
        self._more = result.MoreNotifications = rest is not None
        self.counts.publish_requests += 1
        said_something = bool(result.NotificationMessage.NotificationData) and self.pub_request_callback is not None
        self.counts.discarded_messages += said_something and len(self._not_acknowledged_results) <= kept
        return result

    def _hold_back(self) -> tuple[dict[int, Any], dict[int, Any]] | None:
        """Leave as many notifications as one message may have, and return the others; None if there are none."""
        left = self.most_notifications
        queues: tuple[dict[int, Any], dict[int, Any]] = (self._triggered_datachanges, self._triggered_events)
        waiting = sum(len(queue) for kind in queues for queue in kind.values())
        if not left or waiting <= left or not self._publishing_enabled or self.pub_request_callback is None:
            return None
        now: tuple[dict[int, Any], dict[int, Any]] = ({}, {})
        rest: tuple[dict[int, Any], dict[int, Any]] = ({}, {})
        for kind, said, kept in zip(queues, now, rest, strict=True):
            for mid, queue in kind.items():
                if queue[:left]:
                    said[mid] = queue[:left]
                if queue[left:]:
                    kept[mid] = queue[left:]
                left -= min(left, len(queue))
        self._triggered_datachanges, self._triggered_events = now
        return rest

    @contextmanager
    def _without_sampling(self) -> Iterator[None]:
        """Set aside what items in mode Sampling have queued: it is told when they report."""
        silent = self.monitored_item_srv.sampling - self.monitored_item_srv.triggered
        if not silent:
            yield
            return
        aside = []
        for queues in (self._triggered_datachanges, self._triggered_events):
            aside.append({mid: queues.pop(mid) for mid in silent & queues.keys()})
        try:
            yield
        finally:
            self._triggered_datachanges.update(aside[0])
            self._triggered_events.update(aside[1])

    async def _subscription_loop(self) -> None:
        """Publish at the interval, which the client may change meanwhile."""
        due = time.monotonic()
        await self.publish_results()
        while not self._closing:
            due = max(due + self.data.RevisedPublishingInterval / 1000, time.monotonic())
            await asyncio.sleep(due - time.monotonic())
            was_late = self._publish_cycles_count > 0
            await self.publish_results()
            self.counts.late += not was_late and self._publish_cycles_count > 0


class Subscriptions(SubscriptionService):
    """All subscriptions of the server."""

    iserver: "SkillInternalServer"  # pyright: ignore[reportIncompatibleVariableOverride]
    subscriptions: dict[int, Subscription]  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, aspace: AddressSpace, iserver: "SkillInternalServer") -> None:
        super().__init__(aspace, iserver)
        self.encodings = Encodings()

    def admit(self, session_id: ua.NodeId) -> None:
        """Refuse one more subscription when a session, or the server, has as many as it may."""
        if self.full(session_id) or len(self.subscriptions) >= self.iserver.limits.subscriptions:
            raise ServiceError(Codes.BadTooManySubscriptions)

    def full(self, session_id: ua.NodeId) -> bool:
        """Return whether a session has as many subscriptions as it may."""
        own = sum(1 for subscription in self.subscriptions.values() if subscription.session_id == session_id)
        return own >= self.iserver.limits.subscriptions_per_session

    def admit_items(self, subscription_id: int, count: int) -> None:
        """Refuse more items than a subscription, or the server, may have."""
        limits = self.iserver.limits
        here = len(self.subscriptions[subscription_id].monitored_item_srv) + count
        if here > limits.items_per_subscription:
            raise ServiceError(Codes.BadTooManyMonitoredItems)
        if count + sum(len(s.monitored_item_srv) for s in self.subscriptions.values()) > limits.items:
            raise ServiceError(Codes.BadTooManyMonitoredItems)

    def revise(self, params: Any) -> None:
        """Bring the wishes of a client into bounds: interval, keep-alive, lifetime."""
        shortest, longest = self.iserver.limits.publishing_interval_ms
        wanted = params.RequestedPublishingInterval
        interval = min(max(wanted, shortest), longest) if math.isfinite(wanted) else shortest
        most = max(3, int(self.iserver.limits.subscription_lifetime * 1000 / interval))
        alive = min(max(params.RequestedMaxKeepAliveCount or 10, 1), max(1, most // 3))
        params.RequestedPublishingInterval = interval
        params.RequestedMaxKeepAliveCount = alive
        params.RequestedLifetimeCount = min(max(params.RequestedLifetimeCount or most, 3 * alive), most)

    def modify_subscription(self, params: ua.ModifySubscriptionParameters) -> ua.ModifySubscriptionResult:
        """Change interval, keep-alive and lifetime of a subscription."""
        self.revise(params)
        subscription, result = self.subscriptions[params.SubscriptionId], ua.ModifySubscriptionResult()
        subscription.counts.modified += 1
        subscription.priority, subscription.most_notifications = params.Priority, params.MaxNotificationsPerPublish
        data = subscription.data
        data.RevisedPublishingInterval = result.RevisedPublishingInterval = params.RequestedPublishingInterval
        data.RevisedLifetimeCount = result.RevisedLifetimeCount = params.RequestedLifetimeCount
        data.RevisedMaxKeepAliveCount = result.RevisedMaxKeepAliveCount = params.RequestedMaxKeepAliveCount
        return result

    def rebind(self, session_id: ua.NodeId, callback: Callable[..., Any], request_callback: Callable[..., Any]) -> None:
        """Let the subscriptions of a session answer on another connection from now on."""
        for subscription in self.subscriptions.values():
            if subscription.session_id == session_id:
                subscription.pub_result_callback = callback
                subscription.pub_request_callback = request_callback

    async def create_subscription(
        self,
        params: ua.CreateSubscriptionParameters,
        callback: Callable[..., Any],
        session_id: ua.NodeId,
        request_callback: Callable[..., Any] | None = None,
    ) -> ua.CreateSubscriptionResult:
        """Make a subscription that belongs to a session."""
        result = ua.CreateSubscriptionResult()
        result.RevisedPublishingInterval = params.RequestedPublishingInterval
        result.RevisedLifetimeCount = params.RequestedLifetimeCount
        result.RevisedMaxKeepAliveCount = params.RequestedMaxKeepAliveCount
        self._sub_id_counter += 1
        result.SubscriptionId = self._sub_id_counter  # pyright: ignore[reportAttributeAccessIssue]
        limits = self.iserver.limits
        subscription = Subscription(
            self,
            result,
            callback,
            session_id,
            request_callback=request_callback,
            delete_callback=lambda: self.subscriptions.pop(result.SubscriptionId, None),
            no_acks_limit=limits.unacknowledged_messages,
            max_queue_size=limits.queue_of_item,
            publishing_enabled=params.PublishingEnabled,
        )
        subscription.priority, subscription.most_notifications = params.Priority, params.MaxNotificationsPerPublish
        await subscription.start()
        self.subscriptions[result.SubscriptionId] = subscription
        if request_callback is not None:
            self.iserver.diagnostics.totals.subscriptions += 1
        return result
