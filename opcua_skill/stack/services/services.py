"""The services of an activated session: what each reads from the request, and what it answers."""

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds as Ids

if TYPE_CHECKING:
    from opcua_skill.stack.sessions.sessions import Session
    from opcua_skill.stack.subscriptions.publishing import Publishing

Answer = Callable[["Publishing", "Session", Any], Awaitable[Any]]


async def _read(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.ReadResponse()
    response.Results = await session.read(params)
    return response


async def _write(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.WriteResponse()
    response.Results = await session.write(params)
    return response


async def _history_read(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.HistoryReadResponse()
    response.Results = await session.history_read(params)
    return response


async def _browse(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.BrowseResponse()
    response.Results = await session.browse(params)
    return response


async def _browse_next(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.BrowseNextResponse()
    response.Parameters.Results = await session.browse_next(params)
    return response


async def _translate(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.TranslateBrowsePathsToNodeIdsResponse()
    response.Results = await session.translate_browsepaths_to_nodeids(params.BrowsePaths)
    return response


async def _call(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.CallResponse()
    response.Results = await session.call(params.MethodsToCall)
    return response


async def _create_subscription(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.CreateSubscriptionResponse()
    response.Parameters = await session.create_subscription(
        params, processor.forward_publish_response, request_callback=processor.get_publish_request
    )
    return response


async def _modify_subscription(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.ModifySubscriptionResponse()
    response.Parameters = session.modify_subscription(params)
    return response


async def _delete_subscriptions(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.DeleteSubscriptionsResponse()
    response.Results = await session.delete_subscriptions(session.operations(params.SubscriptionIds))
    return response


async def _transfer_subscriptions(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.TransferSubscriptionsResponse()
    response.Parameters.Results = await session.transfer_subscriptions(
        params, processor.forward_publish_response, processor.get_publish_request
    )
    return response


async def _set_publishing_mode(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.SetPublishingModeResponse()
    response.Parameters.Results = await session.set_publishing_mode(params)
    return response


async def _create_items(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.CreateMonitoredItemsResponse()
    response.Results = await session.create_monitored_items(params)
    return response


async def _modify_items(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.ModifyMonitoredItemsResponse()
    response.Results = await session.modify_monitored_items(params)
    return response


async def _delete_items(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.DeleteMonitoredItemsResponse()
    response.Results = await session.delete_monitored_items(params)
    return response


async def _set_monitoring_mode(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.SetMonitoringModeResponse()
    response.Parameters.Results = await session.set_monitoring_mode(params)
    return response


async def _set_triggering(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.SetTriggeringResponse()
    response.Parameters = await session.set_triggering(params)
    return response


async def _cancel(processor: "Publishing", session: "Session", params: Any) -> Any:
    """Cancel publish requests that wait. Others are carried out by the time they could be cancelled."""
    response: Any = ua.CancelResponse()
    response.Parameters.CancelCount = processor.cancel_publish_requests(params.RequestHandle)
    return response


async def _republish(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.RepublishResponse()
    response.NotificationMessage = session.republish(params)
    return response


async def _register_nodes(processor: "Publishing", session: "Session", params: Any) -> Any:
    response = ua.RegisterNodesResponse()
    response.Parameters.RegisteredNodeIds = session.operations(params.NodesToRegister)
    return response


async def _unregister_nodes(processor: "Publishing", session: "Session", params: Any) -> Any:
    session.operations(params.NodesToUnregister)
    return ua.UnregisterNodesResponse()


SERVICES: dict[int, tuple[type, Answer]] = {
    Ids.ReadRequest_Encoding_DefaultBinary: (ua.ReadParameters, _read),
    Ids.WriteRequest_Encoding_DefaultBinary: (ua.WriteParameters, _write),
    Ids.HistoryReadRequest_Encoding_DefaultBinary: (ua.HistoryReadParameters, _history_read),
    Ids.BrowseRequest_Encoding_DefaultBinary: (ua.BrowseParameters, _browse),
    Ids.BrowseNextRequest_Encoding_DefaultBinary: (ua.BrowseNextParameters, _browse_next),
    Ids.TranslateBrowsePathsToNodeIdsRequest_Encoding_DefaultBinary: (
        ua.TranslateBrowsePathsToNodeIdsParameters,
        _translate,
    ),
    Ids.CallRequest_Encoding_DefaultBinary: (ua.CallParameters, _call),
    Ids.CreateSubscriptionRequest_Encoding_DefaultBinary: (ua.CreateSubscriptionParameters, _create_subscription),
    Ids.ModifySubscriptionRequest_Encoding_DefaultBinary: (ua.ModifySubscriptionParameters, _modify_subscription),
    Ids.DeleteSubscriptionsRequest_Encoding_DefaultBinary: (ua.DeleteSubscriptionsParameters, _delete_subscriptions),
    Ids.TransferSubscriptionsRequest_Encoding_DefaultBinary: (
        ua.TransferSubscriptionsParameters,
        _transfer_subscriptions,
    ),
    Ids.SetPublishingModeRequest_Encoding_DefaultBinary: (ua.SetPublishingModeParameters, _set_publishing_mode),
    Ids.CreateMonitoredItemsRequest_Encoding_DefaultBinary: (ua.CreateMonitoredItemsParameters, _create_items),
    Ids.ModifyMonitoredItemsRequest_Encoding_DefaultBinary: (ua.ModifyMonitoredItemsParameters, _modify_items),
    Ids.DeleteMonitoredItemsRequest_Encoding_DefaultBinary: (ua.DeleteMonitoredItemsParameters, _delete_items),
    Ids.SetMonitoringModeRequest_Encoding_DefaultBinary: (ua.SetMonitoringModeParameters, _set_monitoring_mode),
    Ids.SetTriggeringRequest_Encoding_DefaultBinary: (ua.SetTriggeringParameters, _set_triggering),
    Ids.CancelRequest_Encoding_DefaultBinary: (ua.CancelParameters, _cancel),
    Ids.RepublishRequest_Encoding_DefaultBinary: (ua.RepublishParameters, _republish),
    Ids.RegisterNodesRequest_Encoding_DefaultBinary: (ua.RegisterNodesParameters, _register_nodes),
    Ids.UnregisterNodesRequest_Encoding_DefaultBinary: (ua.UnregisterNodesParameters, _unregister_nodes),
}
"""Request type to its parameters and what answers it. What is not here is BadServiceUnsupported: node management,
Query and changes of history, which this server does not have."""
