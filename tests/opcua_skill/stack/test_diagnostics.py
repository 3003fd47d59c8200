"""The server's diagnostics: figures that are true when they are read, told to those whom they concern."""

import struct

import pytest
from asyncua import Client, ua
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import nodeid_from_binary

from opcua_skill.stack.diagnostics.server_diagnostics import FLAG, SAMPLING, SECURITY, SESSIONS, SUBSCRIPTIONS, SUMMARY
from opcua_skill.stack.limits import Limits
from tests.opcua_skill.stack.small_server import CLIENT_URI, Bench, small_server, until

pytestmark = pytest.mark.asyncio(loop_scope="package")
FIELDS = list(ua.ServerDiagnosticsSummaryDataType.__dataclass_fields__)


class Told:
    def __init__(self) -> None:
        self.seen: list = []

    def datachange_notification(self, node, value, data) -> None:
        self.seen.append(value)

    def event_notification(self, event) -> None:
        pass


async def summary(client: Client) -> dict[str, int]:
    """Return the summary's figures, after seeing that the structure and its variables say the same."""
    whole = await client.get_node(SUMMARY).read_value()
    below = {(await one.read_browse_name()).Name: one for one in await client.get_node(SUMMARY).get_children()}
    assert sorted(below) == sorted(FIELDS)
    single = await client.read_values([below[name] for name in FIELDS])
    told = {name: getattr(whole, name) for name in FIELDS}
    assert dict(zip(FIELDS, single, strict=True)) == told
    return told


async def gained(client: Client, before: dict[str, int]) -> dict[str, int]:
    after = await summary(client)
    return {name: after[name] - before[name] for name in FIELDS if after[name] != before[name]}


async def test_sessions_and_subscriptions_are_counted(bench: Bench):
    async with bench.client() as client:
        before = await summary(client)
        assert before["CurrentSessionCount"] == 1
        async with bench.client("observer") as other:
            await other.create_subscription(75, Told())
            await other.create_subscription(85, Told())
            await other.create_subscription(85, Told())
            assert await gained(client, before) == {
                "CurrentSessionCount": 1,
                "CumulatedSessionCount": 1,
                "CurrentSubscriptionCount": 3,
                "CumulatedSubscriptionCount": 3,
                "PublishingIntervalCount": 2,
            }
        assert await gained(client, before) == {
            "CumulatedSessionCount": 1,
            "CumulatedSubscriptionCount": 3,
            "RejectedRequestsCount": 1,  # the publish request that waited
        }


async def test_what_is_rejected_is_counted_and_what_for(bench: Bench):
    async with bench.client() as client:
        before = await summary(client)
        with pytest.raises(ua.uaerrors.BadSubscriptionIdInvalid):
            await client.uaclient.session.republish(9_999, 1)
        assert await gained(client, before) == {"RejectedRequestsCount": 1}
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            async with bench.client("operator", "wrong"):
                pass
        told = await gained(client, before)
        assert told["SecurityRejectedRequestsCount"] == told["RejectedSessionCount"] == 1
        assert told["SecurityRejectedSessionCount"] == 1
        assert told["RejectedRequestsCount"] == 2


async def test_how_sessions_end_is_told_apart(tmp_path):
    async with small_server(tmp_path, limits=Limits(session_timeout_ms=300)) as small:
        diagnostics = small.server.iserver.diagnostics
        async with small.client("observer"):
            (session,) = small.server.iserver.client_sessions()
            await small.server.iserver.end_session(session, "tried")
            assert diagnostics.summary().SessionAbortCount == 1
        dropped = await small.new_client("observer")
        await dropped.connect()
        dropped.uaclient.protocol.transport.abort()
        await until(lambda: diagnostics.summary().SessionTimeoutCount == 1)
        async with small.client("observer"):
            pass
        told = diagnostics.summary()
        assert (told.CumulatedSessionCount, told.SessionAbortCount, told.SessionTimeoutCount) == (3, 1, 1)
        assert told.CurrentSessionCount == 0


async def test_a_session_is_described_with_what_it_asked(bench: Bench):
    async with bench.client("teacher") as client, bench.client("engineer") as engineer:
        subscription = await client.create_subscription(100, Told())
        await subscription.subscribe_data_change(client.get_node(ua.NodeId("Cell/Speed", bench.index)))
        with pytest.raises(ua.uaerrors.BadSubscriptionIdInvalid):
            await client.uaclient.session.republish(9_999, 1)
        await client.get_node(bench.cell).call_method(f"{bench.index}:WhoAmI")
        (own,) = await client.get_node(SESSIONS).read_value()
        everybody = await engineer.get_node(SESSIONS).read_value()
        assert {one.SessionId for one in everybody} == {
            one.session_id for one in bench.server.iserver.client_sessions()
        }
        assert (own.ClientDescription.ApplicationUri, own.SessionName) == (CLIENT_URI, f"{client.description} Session1")
        assert own.EndpointUrl == client.server_url.geturl()
        assert own.ActualSessionTimeout == bench.server.iserver.limits.session_timeout_ms
        assert (own.CurrentSubscriptionsCount, own.CurrentMonitoredItemsCount) == (1, 1)
        assert (own.CallCount.TotalCount, own.CallCount.ErrorCount) == (1, 0)
        assert (own.RepublishCount.TotalCount, own.RepublishCount.ErrorCount) == (1, 1)
        assert own.CreateMonitoredItemsCount.TotalCount == own.CreateSubscriptionCount.TotalCount == 1
        assert own.TotalRequestCount.TotalCount >= own.ReadCount.TotalCount + 4
        assert own.TotalRequestCount.ErrorCount == 1
        assert own.ClientConnectionTime <= own.ClientLastContactTime


async def test_a_subscription_is_described_with_what_it_sent(bench: Bench):
    node = bench.server.get_node(ua.NodeId("Cell/Speed", bench.index))
    async with bench.client() as client, bench.client("observer") as stranger:
        told = Told()
        subscription = await client.create_subscription(60, told)
        handle = await subscription.subscribe_data_change(client.get_node(node.nodeid), queuesize=2)
        await until(lambda: len(told.seen) == 1)
        for value in (71.0, 72.0, 73.0):
            await node.write_value(value)
        await until(lambda: told.seen[-1] == 73.0)
        mode = ua.SetMonitoringModeParameters(SubscriptionId=subscription.subscription_id, MonitoredItemIds=[handle])
        mode.MonitoringMode = ua.MonitoringMode.Disabled
        await client.uaclient.set_monitoring_mode(mode)
        publishing = ua.SetPublishingModeParameters(
            PublishingEnabled=False, SubscriptionIds=[subscription.subscription_id]
        )
        await client.uaclient.set_publishing_mode(publishing)
        (own,) = await client.get_node(SUBSCRIPTIONS).read_value()
        assert own.SubscriptionId == subscription.subscription_id
        assert (own.PublishingInterval, own.PublishingEnabled, own.DisableCount) == (60.0, False, 1)
        assert own.DataChangeNotificationsCount == own.NotificationsCount == len(told.seen) == 3
        assert (own.MonitoringQueueOverflowCount, own.EventNotificationsCount) == (1, 0)
        assert (own.MonitoredItemCount, own.DisabledMonitoredItemCount) == (1, 1)
        assert own.NextSequenceNumber == 3
        assert await stranger.get_node(SUBSCRIPTIONS).read_value() == []


def security_fields(body: bytes) -> list:
    """Read a SessionSecurityDiagnosticsDataType as the standard lays it out."""
    data = Buffer(body)

    def content() -> bytes | None:
        (length,) = struct.unpack("<i", data.read(4))
        return None if length < 0 else data.read(length)

    session = nodeid_from_binary(data)
    user = content()
    history = [content() for _ in range(struct.unpack("<i", data.read(4))[0])]
    mechanism, encoding, transport = content(), content(), content()
    (mode,) = struct.unpack("<i", data.read(4))
    fields = [session, user, history, mechanism, encoding, transport, mode, content(), content()]
    assert not len(data)
    return fields


async def test_how_sessions_are_secured_is_for_engineers_only(bench: Bench, monkeypatch: pytest.MonkeyPatch):
    known = ua.NodeId(ua.ObjectIds.SessionSecurityDiagnosticsDataType_Encoding_DefaultBinary)
    monkeypatch.delitem(ua.extension_objects_by_typeid, known)  # asyncua's class would misread its field Encoding
    async with bench.client("operator") as operator, bench.client("engineer") as engineer:
        node = operator.get_node(SECURITY)
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await node.read_value()
        subscription = await operator.create_subscription(100, Told())
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await subscription.subscribe_data_change(node)
        assert not await node.get_user_access_level()
        assert await engineer.get_node(SECURITY).get_user_access_level() == {ua.AccessLevel.CurrentRead}
        told = [security_fields(one.Body) for one in await engineer.get_node(SECURITY).read_value()]
        (mine,) = [fields for fields in told if fields[1] == b"operator"]
        policy = b"http://opcfoundation.org/UA/SecurityPolicy#Basic256Sha256"
        assert mine[2:8] == [[b"operator"], b"UserName", b"UA Binary", b"opc.tcp", 3, policy]
        assert mine[8] == bench.server.iserver.session_of(mine[0]).channel.peer.certificate


async def test_figures_are_told_to_those_who_monitor_them_each_what_it_may_see(bench: Bench):
    async with bench.client("operator") as operator, bench.client("engineer") as engineer:
        watched = []
        for client in (operator, engineer):
            told = Told()
            subscription = await client.create_subscription(100, told)
            await subscription.subscribe_data_change(client.get_node(SUBSCRIPTIONS))
            watched.append(told)
        users = bench.server.iserver

        def own_and_all() -> bool:
            return all(told.seen for told in watched) and [len(told.seen[-1]) for told in watched] == [1, 2]

        await until(own_and_all)
        assert {one.SessionId for one in watched[0].seen[-1]} == {
            one.session_id for one in users.client_sessions() if one.identity.name == "operator"
        }


async def test_an_administrator_switches_diagnostics_off_and_they_begin_at_nothing_again(bench: Bench):
    async with bench.client("admin") as admin, bench.client("engineer") as engineer:
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await engineer.get_node(FLAG).write_value(False)
        assert await admin.get_node(FLAG).read_value() is True
        await admin.get_node(FLAG).write_value(False)
        for node in (SUMMARY, SESSIONS, SECURITY, SUBSCRIPTIONS):
            with pytest.raises(ua.uaerrors.BadNotReadable):
                await engineer.get_node(node).read_value()
        await admin.get_node(FLAG).write_value(True)
        told = await summary(engineer)
        assert (told["CumulatedSessionCount"], told["RejectedRequestsCount"], told["CurrentSessionCount"]) == (0, 0, 2)


async def test_there_are_no_fixed_sampling_intervals_to_tell_of(bench: Bench):
    async with bench.client() as client:
        diagnostics = client.get_node(ua.NodeId(ua.ObjectIds.Server_ServerDiagnostics))
        names = {(await one.read_browse_name()).Name for one in await diagnostics.get_children()}
        expected = {"ServerDiagnosticsSummary", "SubscriptionDiagnosticsArray", "SessionsDiagnosticsSummary"}
        assert names == expected | {"EnabledFlag"}
        assert SAMPLING not in bench.server.iserver.aspace


async def test_requests_of_no_service_are_counted_together(bench: Bench):
    async with bench.client("teacher") as client:
        for number in (70_001, 70_002, 70_003):
            request = ua.ReadRequest()
            request.TypeId = ua.NodeId(number)
            with pytest.raises(ua.uaerrors.BadServiceUnsupported):
                await client.uaclient.protocol.send_request(request)
        (session,) = [s for s in bench.server.iserver.client_sessions() if s.identity.name == "teacher"]
        assert session.counts.requests[0] == session.counts.errors[0] == 3
        assert not {70_001, 70_002, 70_003} & (session.counts.requests.keys() | session.counts.errors.keys())


async def test_long_names_of_clients_are_cut(bench: Bench):
    client = await bench.new_client("teacher")
    client.name = "x" * 20_000
    async with client:
        (own,) = await client.get_node(SESSIONS).read_value()
        assert len(own.ClientDescription.ApplicationName.Text) == 1_000
