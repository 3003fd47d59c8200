"""The methods of the Server object, and ConditionRefresh: what clients ask about subscriptions of their own."""

from typing import TYPE_CHECKING, Any

from asyncua.common import event_objects
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.security.access import Role, caller
from opcua_skill.stack.address_space.events import completed
from opcua_skill.stack.address_space.values import SERVER, node_id
from opcua_skill.stack.services.calls import Argument, MethodSpec, Refused
from opcua_skill.stack.subscriptions.subscriptions import Subscription

if TYPE_CHECKING:
    from opcua_skill.stack.internal_server import SkillInternalServer

_UINT32 = node_id(Ids.UInt32)
_SUBSCRIPTION = Argument("SubscriptionId", _UINT32)
_ITEM = Argument("MonitoredItemId", _UINT32)
_EVERYBODY = Role.OBSERVER.and_above


class ServerMethods:
    """What a client may ask about its subscriptions by a method call (OPC 10000-5, 9.1 and 9.2; OPC 10000-9, 5.5.7)."""

    def __init__(self, iserver: "SkillInternalServer") -> None:
        self._iserver = iserver

    def offer(self) -> None:
        """Bind the standard nodes to what is behind them."""
        handles = (Argument("ServerHandles", _UINT32, 1), Argument("ClientHandles", _UINT32, 1))
        one, both = (_SUBSCRIPTION,), (_SUBSCRIPTION, _ITEM)
        for method, name, inputs, outputs, handler in (
            (Ids.Server_GetMonitoredItems, "GetMonitoredItems", one, handles, self.get_monitored_items),
            (Ids.Server_ResendData, "ResendData", one, (), self.resend_data),
            (Ids.ConditionType_ConditionRefresh, "ConditionRefresh", one, (), self.condition_refresh),
            (Ids.ConditionType_ConditionRefresh2, "ConditionRefresh2", both, (), self.condition_refresh),
        ):
            spec = MethodSpec(name, inputs, outputs, handler, _EVERYBODY, changes=False)
            self._iserver.method_service.register(node_id(method), spec)

    def _own(self, subscription_id: int) -> Subscription:
        found = self._iserver.subscription_service.subscriptions.get(subscription_id)
        if found is None:
            raise Refused(Codes.BadSubscriptionIdInvalid, f"there is no subscription {subscription_id}")
        if found.session_id.to_string() != caller().session_id:
            raise Refused(Codes.BadUserAccessDenied, f"subscription {subscription_id} is another session's")
        return found

    async def get_monitored_items(self, subscription_id: int) -> tuple[list[int], list[int]]:
        """Return the items of a subscription: what the server calls them, and what the client does."""
        return self._own(subscription_id).monitored_item_srv.handles()

    async def resend_data(self, subscription_id: int) -> tuple[()]:
        """Queue the value that each reporting item has now, once more."""
        self._own(subscription_id).monitored_item_srv.tell_again()
        return ()

    async def condition_refresh(self, subscription_id: int, item: int | None = None) -> tuple[()]:
        """Tell a subscription's items of events, or one of them, which conditions are on: there are none here."""
        items = self._own(subscription_id).monitored_item_srv
        if item is not None and not items.hears_events(item):
            raise Refused(Codes.BadMonitoredItemIdInvalid, f"subscription {subscription_id} has no item {item}")
        for kind in (event_objects.RefreshStartEvent, event_objects.RefreshEndEvent):
            event: Any = kind()
            event.SourceName, event.SourceNode = "Server", SERVER
            items.tell_event(completed(self._iserver.aspace, SERVER, event), item)
        return ()
