"""Subscriptions and their monitored items; event filters that know type hierarchies."""

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.address_space import AddressSpace
from asyncua.server.internal_subscription import InternalSubscription
from asyncua.server.monitored_item_service import MonitoredItemService, WhereClauseEvaluator
from asyncua.server.subscription_service import SubscriptionService
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.types import is_subtype
from opcua_skill.stack.values import status

if TYPE_CHECKING:
    from opcua_skill.stack.internal import SkillInternalServer

log = logging.getLogger(__name__)


class EventFilter(WhereClauseEvaluator):
    """A where-clause whose OfType also holds for subtypes, and whose faults say no without a traceback."""

    def eval(self, event: Any) -> bool:
        """Return whether the event passes; an event that lacks a field the clause asks for does not."""
        if not self.elements:
            return True
        try:
            return bool(self._eval_el(0, event))
        except (AttributeError, LookupError, TypeError, ValueError, NotImplementedError, RecursionError) as error:
            log.info("an event filter does not fit an event: %s", type(error).__name__)
            return False

    def _eval_el(self, index: int, event: Any) -> Any:
        element = self.elements[index]
        if element.FilterOperator == ua.FilterOperator.OfType:
            wanted = self._eval_op(element.FilterOperands[0], event)
            return isinstance(wanted, ua.NodeId) and is_subtype(self._aspace, event.EventType, wanted)
        return super()._eval_el(index, event)


class Items(MonitoredItemService):
    """The monitored items of one subscription."""

    def _create_events_monitored_item(self, params: ua.MonitoredItemCreateRequest) -> ua.MonitoredItemCreateResult:
        if not isinstance(params.RequestedParameters.Filter, ua.EventFilter):
            result = ua.MonitoredItemCreateResult()
            result.StatusCode = status(Codes.BadMonitoredItemFilterInvalid)
            return result
        result = super()._create_events_monitored_item(params)
        item = self._monitored_items.get(result.MonitoredItemId)
        if item is not None:
            item.where_clause_evaluator = EventFilter(self.logger, self.aspace, item.filter.WhereClause)
        return result


class Subscription(InternalSubscription):
    """One subscription."""

    def __init__(self, data: Any, aspace: AddressSpace, *arguments: Any, **options: Any) -> None:
        super().__init__(data, aspace, *arguments, **options)
        self.monitored_item_srv = Items(self, aspace)


class Subscriptions(SubscriptionService):
    """All subscriptions of the server."""

    iserver: "SkillInternalServer"  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, aspace: AddressSpace, iserver: "SkillInternalServer") -> None:
        super().__init__(aspace, iserver)

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
        if len(self.subscriptions) >= self.iserver.max_subscriptions:
            raise ServiceError(Codes.BadTooManySubscriptions)
        result = ua.CreateSubscriptionResult()
        result.RevisedPublishingInterval = params.RequestedPublishingInterval
        result.RevisedLifetimeCount = self._clamp_lifetime_count(params.RequestedLifetimeCount)
        result.RevisedMaxKeepAliveCount = self._clamp_keep_alive_count(params.RequestedMaxKeepAliveCount)
        self._sub_id_counter += 1
        result.SubscriptionId = self._sub_id_counter
        subscription = Subscription(
            result,
            self.aspace,
            callback,
            session_id,
            request_callback=request_callback,
            delete_callback=lambda: self.subscriptions.pop(result.SubscriptionId, None),
            no_acks_limit=self.iserver.max_unacked_messages_per_subscription,
            max_queue_size=self.iserver.max_monitored_item_queue_size,
            publishing_enabled=params.PublishingEnabled,
        )
        await subscription.start()
        self.subscriptions[result.SubscriptionId] = subscription
        return result
