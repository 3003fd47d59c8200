"""What the server says of itself in ServerCapabilities and OperationLimits: the limits that really hold."""

import logging
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds as Ids

from opcua_skill.security.settings import SecuritySettings
from opcua_skill.stack.address_space.languages import Languages
from opcua_skill.stack.address_space.values import node_id
from opcua_skill.stack.limits import Limits

log = logging.getLogger(__name__)
_TRANSPORT = "http://opcfoundation.org/UA-Profile/Transport/uatcp-uasc-uabinary"
_POLICY = "http://opcfoundation.org/UA/SecurityPolicy#"
_T = ua.VariantType


def capabilities(limits: Limits, security: SecuritySettings, languages: Languages) -> dict[int, ua.Variant]:
    """Return the values of the nodes below ServerCapabilities; 0 stands for something this server does not offer."""
    operations, array, count = limits.operations_per_request, limits.array_of_primitives, _T.UInt32
    policies = [_POLICY + name for name in security.policies]
    offered = [*policies, _POLICY + "None"] if security.insecure_no_encryption else policies
    top = {
        "ServerProfileArray": ([_TRANSPORT, *offered], _T.String),
        "LocaleIdArray": (list(languages.known), _T.String),
        "MinSupportedSampleRate": (limits.publishing_interval_ms[0], _T.Double),
        "MaxBrowseContinuationPoints": (limits.continuation_points, _T.UInt16),
        "MaxQueryContinuationPoints": (0, _T.UInt16),
        "MaxHistoryContinuationPoints": (0, _T.UInt16),
        "MaxArrayLength": (array, count),
        "MaxStringLength": (limits.string, count),
        "MaxByteStringLength": (limits.string, count),
        "MaxSessions": (limits.sessions, count),
        "MaxSubscriptions": (limits.subscriptions, count),
        "MaxMonitoredItems": (limits.items, count),
        "MaxSubscriptionsPerSession": (limits.subscriptions_per_session, count),
        "MaxMonitoredItemsPerSubscription": (limits.items_per_subscription, count),
        "MaxMonitoredItemsQueueSize": (limits.queue_of_item, count),
        "MaxSelectClauseParameters": (limits.selected_fields, count),
        "MaxWhereClauseParameters": (limits.filter_elements, count),
    }
    per_request = {
        "MaxNodesPerRead": operations,
        "MaxNodesPerWrite": operations,
        "MaxNodesPerRegisterNodes": operations,
        "MaxNodesPerMethodCall": limits.calls_per_request,
        "MaxNodesPerBrowse": limits.browses_per_request,
        "MaxNodesPerTranslateBrowsePathsToNodeIds": limits.browses_per_request,
        "MaxMonitoredItemsPerCall": limits.items_per_subscription,
        "MaxNodesPerHistoryReadData": operations,
        "MaxNodesPerHistoryReadEvents": operations,
        "MaxNodesPerHistoryUpdateData": 0,
        "MaxNodesPerHistoryUpdateEvents": 0,
        "MaxNodesPerNodeManagement": 0,
    }
    values = {f"Server_ServerCapabilities_{name}": value for name, value in top.items()}
    below = "Server_ServerCapabilities_OperationLimits_"
    values |= {below + name: (value, count) for name, value in per_request.items()}
    values["Server_Auditing"] = (True, _T.Boolean)
    return {getattr(Ids, name): ua.Variant(value, kind) for name, (value, kind) in values.items()}


async def tell(iserver: Any, values: dict[int, ua.Variant]) -> None:
    """Write values into standard nodes; those that this version of the standard address space lacks are left out."""
    for identifier, value in values.items():
        if node_id(identifier) in iserver.aspace:
            told = ua.DataValue(value, SourceTimestamp=datetime.now(UTC))  # pyright: ignore[reportArgumentType]
            await iserver.write_attribute_value(node_id(identifier), told)


def product_version() -> str:
    """Return the version of this product as installed."""
    try:
        return version("opcua-skill")
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "0"
