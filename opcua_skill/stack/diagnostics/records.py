"""Diagnostics as OPC UA structures (OPC 10000-5, 12.9 to 12.15), filled from what was counted and what is there now."""

import struct
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, TypeVar, cast

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.ua_binary import pack_uatype, pack_uatype_array

from opcua_skill.stack.address_space.values import node_id
from opcua_skill.stack.diagnostics.counters import Totals

if TYPE_CHECKING:
    from opcua_skill.stack.internal_server import SkillInternalServer
    from opcua_skill.stack.sessions.sessions import Session
    from opcua_skill.stack.subscriptions.subscriptions import Subscription

_Record = TypeVar("_Record")
MECHANISMS = {"password": "UserName", "certificate": "X509", "anonymous": "Anonymous"}
_COUNTED = {
    field: getattr(Ids, request)
    for field in ua.SessionDiagnosticsDataType.__dataclass_fields__
    if hasattr(Ids, request := f"{field.removesuffix('Count')}Request_Encoding_DefaultBinary")
}
_SECURITY = node_id(Ids.SessionSecurityDiagnosticsDataType_Encoding_DefaultBinary)


def summary(iserver: "SkillInternalServer", totals: Totals) -> ua.ServerDiagnosticsSummaryDataType:
    """Return the figures of the whole server."""
    subscriptions = iserver.client_subscriptions()
    return _made(
        ua.ServerDiagnosticsSummaryDataType,
        CurrentSessionCount=len(iserver.client_sessions()),
        CumulatedSessionCount=totals.sessions,
        SecurityRejectedSessionCount=totals.sessions_rejected_for_security,
        RejectedSessionCount=totals.sessions_rejected,
        SessionTimeoutCount=totals.sessions_timed_out,
        SessionAbortCount=totals.sessions_aborted,
        CurrentSubscriptionCount=len(subscriptions),
        CumulatedSubscriptionCount=totals.subscriptions,
        PublishingIntervalCount=len({one.data.RevisedPublishingInterval for one in subscriptions}),
        SecurityRejectedRequestsCount=totals.requests_rejected_for_security,
        RejectedRequestsCount=totals.requests_rejected,
    )


def session_records(iserver: "SkillInternalServer", sessions: "list[Session]") -> list[ua.SessionDiagnosticsDataType]:
    """Return the figures of sessions."""
    subscriptions: dict[ua.NodeId, list[Subscription]] = {}
    for subscription in iserver.client_subscriptions():
        subscriptions.setdefault(subscription.session_id, []).append(subscription)
    return [_session_record(session, subscriptions.get(session.session_id, [])) for session in sessions]


def _session_record(session: "Session", own: "list[Subscription]") -> ua.SessionDiagnosticsDataType:
    counts = session.counts
    asked, failed = counts.requests, counts.errors
    by_service = {name: _counter(asked.get(one, 0), failed.get(one, 0)) for name, one in _COUNTED.items()}
    return _made(
        ua.SessionDiagnosticsDataType,
        SessionId=session.session_id,
        SessionName=counts.name,
        ClientDescription=counts.client,
        ServerUri=counts.server_uri,
        EndpointUrl=counts.endpoint_url,
        LocaleIds=list(counts.locales),
        ActualSessionTimeout=(session.session_timeout or 0) * 1000,
        MaxResponseMessageSize=counts.largest_response,
        ClientConnectionTime=counts.since,
        ClientLastContactTime=datetime.now(UTC) - timedelta(seconds=session.idle_for()),
        CurrentSubscriptionsCount=len(own),
        CurrentMonitoredItemsCount=sum(len(one.monitored_item_srv) for one in own),
        CurrentPublishRequestsInQueue=len(session.processor._publish_requests) if session.processor else 0,
        TotalRequestCount=_counter(sum(asked.values()), sum(failed.values())),
        UnauthorizedRequestCount=counts.unauthorized,
        **by_service,
    )


def subscription_record(subscription: "Subscription") -> ua.SubscriptionDiagnosticsDataType:
    """Return the figures of one subscription."""
    counts, data, items = subscription.counts, subscription.data, subscription.monitored_item_srv
    return _made(
        ua.SubscriptionDiagnosticsDataType,
        SessionId=subscription.session_id,
        SubscriptionId=data.SubscriptionId,
        Priority=subscription.priority,
        MaxNotificationsPerPublish=subscription.most_notifications,
        PublishingInterval=data.RevisedPublishingInterval,
        MaxKeepAliveCount=data.RevisedMaxKeepAliveCount,
        MaxLifetimeCount=data.RevisedLifetimeCount,
        PublishingEnabled=subscription._publishing_enabled,
        ModifyCount=counts.modified,
        EnableCount=counts.enabled,
        DisableCount=counts.disabled,
        RepublishRequestCount=counts.republish_requests,
        RepublishMessageRequestCount=counts.republish_requests,
        RepublishMessageCount=counts.republished,
        TransferRequestCount=counts.transfers,
        TransferredToSameClientCount=counts.transfers,  # others may not take one over
        PublishRequestCount=counts.publish_requests,
        DataChangeNotificationsCount=counts.values,
        EventNotificationsCount=counts.events,
        NotificationsCount=counts.values + counts.events,
        LatePublishRequestCount=counts.late,
        CurrentKeepAliveCount=subscription._keep_alive_count,
        CurrentLifetimeCount=subscription._publish_cycles_count,
        UnacknowledgedMessageCount=len(subscription._not_acknowledged_results),
        DiscardedMessageCount=counts.discarded_messages,
        MonitoredItemCount=len(items),
        DisabledMonitoredItemCount=items.disabled(),
        MonitoringQueueOverflowCount=counts.value_overflows,
        NextSequenceNumber=subscription._notification_seq,
        EventQueueOverflowCount=counts.event_overflows,
    )


def security_record(session: "Session") -> ua.ExtensionObject:
    """Return how one session is secured, as encoded bytes: asyncua's class takes its field Encoding for a byte."""
    name = session.identity.name if session.is_activated() else None
    channel = session.channel
    mode = channel.mode if channel is not None else ua.MessageSecurityMode.Invalid
    body = b"".join(
        (
            pack_uatype(ua.VariantType.NodeId, session.session_id),
            pack_uatype(ua.VariantType.String, name),
            pack_uatype_array(ua.VariantType.String, [name] if name is not None else []),
            pack_uatype(ua.VariantType.String, MECHANISMS.get(session.counts.mechanism)),
            pack_uatype(ua.VariantType.String, "UA Binary"),
            pack_uatype(ua.VariantType.String, "opc.tcp"),
            struct.pack("<i", mode),
            pack_uatype(ua.VariantType.String, channel.policy_uri if channel is not None else None),
            pack_uatype(ua.VariantType.ByteString, channel.peer.certificate if channel is not None else None),
        )
    )
    return ua.ExtensionObject(TypeId=_SECURITY, Body=body)  # pyright: ignore[reportArgumentType]


def _counter(total: int, errors: int) -> ua.ServiceCounterDataType:
    """Return a counter; that of a service nobody has asked for is one and the same, since most are."""
    return _made(ua.ServiceCounterDataType, TotalCount=total, ErrorCount=errors) if total or errors else _NEVER


def _made(kind: type[_Record], **values: Any) -> _Record:
    """Return a structure; asyncua's classes declare their fields with types of their own that plain values lack."""
    return cast(Any, kind)(**values)


_NEVER = ua.ServiceCounterDataType()
