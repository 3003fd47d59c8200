"""A session's subscriptions and monitored items: its own and nobody else's, within the limits."""

from collections import deque
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, cast

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.internal_session import InternalSession
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.security.access import Caller, calling_as
from opcua_skill.stack.address_space.values import status

if TYPE_CHECKING:
    from opcua_skill.stack.internal_server import SkillInternalServer
    from opcua_skill.stack.sessions.session_services import SessionServices
    from opcua_skill.stack.sessions.sessions import Session


NOTICES_KEPT = 100


class SubscribingSession(InternalSession):
    """What a session may do with subscriptions."""

    iserver: "SkillInternalServer"  # pyright: ignore[reportIncompatibleVariableOverride]
    caller: Caller
    processor: "SessionServices | None"

    def __init__(self, *positional: Any, **named: Any) -> None:
        super().__init__(*positional, **named)
        self.notices: deque[ua.PublishResult] = deque(maxlen=NOTICES_KEPT)

    def has_subscriptions(self) -> bool:
        """Return whether there is a subscription that publishes here."""
        return any(one.session_id == self.session_id for one in self.subscription_service.subscriptions.values())

    def tell_ended(self, last_words: ua.PublishResult) -> None:
        """Tell the client that a subscription is over for it, now or when it asks next (OPC 10000-4, 5.14.1)."""
        self.notices.append(last_words)
        if self.processor is not None:
            self.processor.tell_notices()

    def operations(self, items: list[Any] | None, at_most: int | None = None) -> list[Any]:
        """Return the operations of a request, or refuse one that has none or too many."""
        if not items:
            raise ServiceError(Codes.BadNothingToDo)
        if len(items) > (at_most or self.iserver.limits.operations_per_request):
            raise ServiceError(Codes.BadTooManyOperations)
        return items

    def _own(self, subscription_id: int) -> None:
        """Refuse a subscription that is not this session's."""
        found = self.subscription_service.subscriptions.get(subscription_id)
        if found is None or (self.external and found.session_id != self.session_id):
            raise ServiceError(Codes.BadSubscriptionIdInvalid)

    async def create_subscription(
        self, params: Any, callback: Callable[..., Any], request_callback: Callable[..., Any] | None = None
    ) -> ua.CreateSubscriptionResult:
        """Make a subscription of this session, within the limits."""
        if self.external:
            self.iserver.subscription_service.admit(self.session_id)
            self.iserver.subscription_service.revise(params)
        return await super().create_subscription(params, callback, request_callback)

    def modify_subscription(self, params: ua.ModifySubscriptionParameters) -> ua.ModifySubscriptionResult:
        """Change how often an own subscription publishes."""
        self._own(params.SubscriptionId)
        return super().modify_subscription(params)

    async def delete_subscriptions(self, ids: list[int]) -> list[ua.StatusCode]:
        """Delete own subscriptions."""
        if not self.external:
            return await super().delete_subscriptions(ids)
        if not ids:
            return []
        found = self.subscription_service.subscriptions
        own = [i for i in ids if i in found and found[i].session_id == self.session_id]
        done = dict(zip(own, await super().delete_subscriptions(own), strict=True))
        if done and self.processor is not None:
            self.processor.tell_notices()
        return [done.get(i, status(Codes.BadSubscriptionIdInvalid)) for i in ids]

    async def set_publishing_mode(self, params: ua.SetPublishingModeParameters) -> list[ua.StatusCode]:
        """Switch own subscriptions on or off."""
        results = []
        for subscription_id in self.operations(params.SubscriptionIds):
            found = self.iserver.subscription_service.subscriptions.get(subscription_id)
            if found is None or found.session_id != self.session_id:
                results.append(status(Codes.BadSubscriptionIdInvalid))
            else:
                await found.set_publishing_mode(params.PublishingEnabled)
                results.append(status())
        return results

    async def transfer_subscriptions(  # pyright: ignore[reportIncompatibleMethodOverride]
        self,
        params: ua.TransferSubscriptionsParameters,
        callback: Callable[..., Any],
        request_callback: Callable[..., Any] | None = None,
    ) -> list[ua.TransferResult]:
        """Take over subscriptions of another session of the same user on the same client."""
        results = []
        for subscription_id in self.operations(params.SubscriptionIds):
            result = ua.TransferResult()
            code = self.iserver.may_transfer(subscription_id, cast("Session", self))
            if not code:
                subscription = self.iserver.subscription_service.subscriptions[subscription_id]
                before, subscription.session_id = subscription.session_id, self.session_id
                subscription.counts.transfers += 1
                subscription.pub_result_callback = callback
                subscription.pub_request_callback = request_callback
                if params.SendInitialValues:
                    subscription.monitored_item_srv.tell_again()
                result.AvailableSequenceNumbers = sorted(subscription._not_acknowledged_results)
                old = self.iserver.session_of(before)
                if old is not None and old is not self:
                    old.tell_ended(subscription.last_words(Codes.GoodSubscriptionTransferred))
            result.StatusCode = status(code)
            results.append(result)
        return results

    async def create_monitored_items(self, params: Any) -> list[ua.MonitoredItemCreateResult]:
        """Monitor nodes in an own subscription, within the limits."""
        if self.external:
            self._own(params.SubscriptionId)
            known_timestamps(params.TimestampsToReturn)
            self.operations(params.ItemsToCreate, self.iserver.limits.items_per_subscription)
            self.iserver.subscription_service.admit_items(params.SubscriptionId, len(params.ItemsToCreate))
        with calling_as(self.caller):
            return await super().create_monitored_items(params)

    async def modify_monitored_items(self, params: Any) -> list[ua.MonitoredItemModifyResult]:
        """Change monitored items of an own subscription."""
        self._own(params.SubscriptionId)
        if self.external:
            known_timestamps(params.TimestampsToReturn)
            self.operations(params.ItemsToModify, self.iserver.limits.items_per_subscription)
        return await super().modify_monitored_items(params)

    async def delete_monitored_items(self, params: Any) -> list[ua.StatusCode]:
        """Delete monitored items of an own subscription."""
        self._own(params.SubscriptionId)
        if self.external:
            self.operations(params.MonitoredItemIds, self.iserver.limits.items_per_subscription)
        return await super().delete_monitored_items(params)

    async def set_monitoring_mode(self, params: Any) -> list[ua.StatusCode]:
        """Switch monitored items of an own subscription."""
        self._own(params.SubscriptionId)
        if self.external:
            self.operations(params.MonitoredItemIds, self.iserver.limits.items_per_subscription)
        if not isinstance(params.MonitoringMode, ua.MonitoringMode):
            raise ServiceError(Codes.BadMonitoringModeInvalid)
        with calling_as(self.caller):
            return await super().set_monitoring_mode(params)

    async def set_triggering(self, params: ua.SetTriggeringParameters) -> ua.SetTriggeringResult:
        """Let an item of an own subscription decide when others report (OPC 10000-4, 5.13.5)."""
        self._own(params.SubscriptionId)
        self.operations([*(params.LinksToAdd or ()), *(params.LinksToRemove or ())])
        items = self.iserver.subscription_service.subscriptions[params.SubscriptionId].monitored_item_srv
        return items.set_triggering(params.TriggeringItemId, params.LinksToAdd or [], params.LinksToRemove or [])

    def republish(self, params: ua.RepublishParameters) -> ua.NotificationMessage:
        """Return a message of an own subscription that was not acknowledged yet."""
        self._own(params.SubscriptionId)
        subscription = self.iserver.subscription_service.subscriptions[params.SubscriptionId]
        kept, counts = subscription._not_acknowledged_results, subscription.counts
        counts.republish_requests += 1
        if params.RetransmitSequenceNumber not in kept:
            raise ServiceError(Codes.BadMessageNotAvailable)
        counts.republished += 1
        return kept[params.RetransmitSequenceNumber].NotificationMessage

    def publish(self, acks: Iterable[ua.SubscriptionAcknowledgement] | None = None) -> tuple[int, list[ua.StatusCode]]:
        """Acknowledge messages of own subscriptions; return how many subscriptions there are and the results."""
        own = {i: s for i, s in self.subscription_service.subscriptions.items() if s.session_id == self.session_id}
        if not own and not self.notices:
            raise ServiceError(Codes.BadNoSubscription)
        results = []
        for ack in acks or ():
            subscription = own.get(ack.SubscriptionId)
            if subscription is None:
                results.append(status(Codes.BadSubscriptionIdInvalid))
            elif subscription._not_acknowledged_results.pop(ack.SequenceNumber, None) is None:
                results.append(status(Codes.BadSequenceNumberUnknown))
            else:
                results.append(status())
        return len(own), results


def known_timestamps(which: Any) -> ua.TimestampsToReturn:
    """Return which timestamps are asked for, or refuse what is not one of the four answers."""
    try:
        found = ua.TimestampsToReturn(which)
    except ValueError:
        found = ua.TimestampsToReturn.Invalid
    if found is ua.TimestampsToReturn.Invalid:
        raise ServiceError(Codes.BadTimestampsToReturnInvalid)
    return found
