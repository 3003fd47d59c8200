"""Subscriptions: owned by their session, within bounds, and every value delivered."""

import asyncio
import math

import pytest
from asyncua import Client, ua

from opcua_skill.stack.limits import Limits
from tests.opcua_skill.stack.small_server import Bench, small_server, until

pytestmark = pytest.mark.asyncio(loop_scope="package")


class Values:
    def __init__(self) -> None:
        self.seen: list = []

    def datachange_notification(self, node, value, data) -> None:
        self.seen.append(value)


async def monitor(client: Client, *nodes, queue: int = 1) -> tuple:
    values = Values()
    subscription = await client.create_subscription(50, values)
    handles = await subscription.subscribe_data_change(nodes, queuesize=queue)
    return subscription, handles, values


async def test_every_client_gets_every_value(bench: Bench):
    speed = bench.server.get_node(ua.NodeId("Cell/Speed", bench.index))
    async with bench.client() as one, bench.client() as other:
        watched = [(await monitor(c, c.get_node(speed.nodeid), queue=20))[2] for c in (one, other)]
        await until(lambda: all(values.seen for values in watched))
        for value in range(10):
            await speed.write_value(float(value))
        await until(lambda: all(values.seen[-1] == 9.0 for values in watched))
        assert all(values.seen[1:] == [float(value) for value in range(10)] for values in watched)


async def test_a_queue_of_one_keeps_the_newest(bench: Bench):
    speed = bench.server.get_node(ua.NodeId("Cell/Speed", bench.index))
    async with bench.client() as client:
        _, _, values = await monitor(client, client.get_node(speed.nodeid))
        await until(lambda: bool(values.seen))
        for value in range(100, 110):
            await speed.write_value(float(value))
        await until(lambda: values.seen[-1] == 109.0)
        assert len(values.seen) < 10


async def test_a_value_is_told_gone_when_its_node_is(bench: Bench):
    node = await bench.server.get_node(bench.cell).add_variable(bench.index, "Passing", 1.0)
    async with bench.client() as client:
        _, _, values = await monitor(client, client.get_node(node.nodeid))
        await until(lambda: values.seen == [1.0])
        await bench.server.delete_nodes([node])
        await until(lambda: len(values.seen) == 2)
        assert values.seen[1] is None


async def test_others_subscriptions_cannot_be_touched(bench: Bench):
    async with bench.client("operator") as owner, bench.client("engineer") as thief:
        speed = owner.get_node(ua.NodeId("Cell/Speed", bench.index))
        subscription, handles, values = await monitor(owner, speed)
        number = subscription.subscription_id
        (code,) = await thief.uaclient.delete_subscriptions([number])
        assert code.name == "BadSubscriptionIdInvalid"
        transfer = ua.TransferSubscriptionsParameters(SubscriptionIds=[number], SendInitialValues=True)
        (result,) = await thief.uaclient.transfer_subscriptions(transfer)
        assert result.StatusCode.name == "BadUserAccessDenied"
        for attempt in (
            thief.uaclient.modify_subscription(ua.ModifySubscriptionParameters(SubscriptionId=number)),
            thief.uaclient.delete_monitored_items(
                ua.DeleteMonitoredItemsParameters(SubscriptionId=number, MonitoredItemIds=handles)
            ),
            thief.uaclient.session.republish(number, 1),
        ):
            with pytest.raises(ua.uaerrors.BadSubscriptionIdInvalid):
                await attempt
        before = len(values.seen)
        await bench.server.get_node(speed.nodeid).write_value(77.0)
        await until(lambda: len(values.seen) > before)


@pytest.mark.parametrize("wanted", [math.nan, math.inf, -1.0, 0.0, 0.001, 1e308])
async def test_a_publishing_interval_is_brought_into_bounds(bench: Bench, wanted: float):
    async with bench.client() as client:
        params = ua.CreateSubscriptionParameters(RequestedPublishingInterval=wanted, RequestedLifetimeCount=2**32 - 1)
        result = await client.uaclient.create_subscription(params, lambda *_: None)
        assert 50 <= result.RevisedPublishingInterval <= 3_600_000
        assert result.RevisedLifetimeCount * result.RevisedPublishingInterval <= max(600_000, 3 * 3_600_000)
        assert result.RevisedLifetimeCount >= 3 * result.RevisedMaxKeepAliveCount


async def test_subscriptions_and_items_are_limited(tmp_path):
    limits = Limits(subscriptions_per_session=2, items_per_subscription=3, items=5)
    async with small_server(tmp_path, limits=limits) as bench, bench.client() as client:
        speed = client.get_node(ua.NodeId("Cell/Speed", bench.index))
        first = await client.create_subscription(100, Values())
        second = await client.create_subscription(100, Values())
        with pytest.raises(ua.uaerrors.BadTooManySubscriptions):
            await client.create_subscription(100, Values())
        await first.subscribe_data_change([speed] * 3)
        with pytest.raises(ua.uaerrors.BadTooManyMonitoredItems):
            await first.subscribe_data_change([speed])
        with pytest.raises(ua.uaerrors.BadTooManyMonitoredItems):
            await second.subscribe_data_change([speed] * 3)


async def test_nothing_is_left_of_a_session_that_closed(bench: Bench):
    service = bench.server.iserver.subscription_service
    async with bench.client() as client:
        await monitor(client, client.get_node(ua.NodeId("Cell/Speed", bench.index)))
        token = client.uaclient.session.authentication_token
        session = bench.server.iserver._external_sessions[token]
        assert session.session_id in {one.session_id for one in service.subscriptions.values()}
    assert session.session_id not in {one.session_id for one in service.subscriptions.values()}
    assert token not in bench.server.iserver._external_sessions


async def test_lost_connections_leave_only_a_few_sessions_to_come_back(tmp_path):
    async with small_server(tmp_path) as bench:
        for _ in range(8):
            client = await bench.new_client()
            await client.connect()
            await monitor(client, client.get_node(ua.NodeId("Cell/Speed", bench.index)))
            client.uaclient.protocol.transport.abort()
            await asyncio.gather(client.disconnect(), return_exceptions=True)
        left = bench.server.iserver
        await until(lambda: len(left._external_sessions) <= 3)
        assert len(left.subscription_service.subscriptions) <= 3


def filter_of(operator: ua.FilterOperator, *operands) -> ua.EventFilter:
    element = ua.ContentFilterElement()
    element.FilterOperator, element.FilterOperands = operator, list(operands)
    wanted = ua.EventFilter()
    wanted.SelectClauses = [
        ua.SimpleAttributeOperand(
            TypeDefinitionId=ua.NodeId(ua.ObjectIds.BaseEventType),
            BrowsePath=[ua.QualifiedName("Message")],
            AttributeId=ua.AttributeIds.Value,
        )
    ]
    wanted.WhereClause.Elements = [element]
    return wanted


@pytest.mark.parametrize(
    ("node", "attribute", "wanted", "code"),
    [
        ("server", 12, filter_of(ua.FilterOperator.Not, ua.ElementOperand(Index=0)), "BadFilterOperandInvalid"),
        ("server", 12, filter_of(ua.FilterOperator.Equals), "BadFilterOperandCountMismatch"),
        ("server", 12, filter_of(ua.FilterOperator.InView, ua.ElementOperand()), "BadFilterOperatorUnsupported"),
        ("server", 12, ua.DataChangeFilter(), "BadEventFilterInvalid"),
        ("speed", 13, filter_of(ua.FilterOperator.IsNull, ua.LiteralOperand()), "BadFilterNotAllowed"),
        ("speed", 13, ua.DataChangeFilter(DeadbandType=1, DeadbandValue=math.nan), "BadDeadbandFilterInvalid"),
        ("speed", 13, ua.DataChangeFilter(DeadbandType=2, DeadbandValue=5.0), "BadFilterNotAllowed"),
        ("speed", 999, None, "BadAttributeIdInvalid"),
        ("nowhere", 13, None, "BadNodeIdUnknown"),
    ],
)
async def test_a_filter_that_cannot_work_is_refused_when_it_is_set(bench: Bench, node, attribute, wanted, code):
    nodes = {"server": ua.NodeId(ua.ObjectIds.Server), "speed": ua.NodeId("Cell/Speed", bench.index)}
    request = ua.MonitoredItemCreateRequest()
    request.ItemToMonitor.NodeId = nodes.get(node, ua.NodeId(node, 9))
    request.ItemToMonitor.AttributeId = attribute
    request.RequestedParameters.Filter = wanted
    async with bench.client() as client:
        subscription = await client.create_subscription(100, Values())
        params = ua.CreateMonitoredItemsParameters(SubscriptionId=subscription.subscription_id, ItemsToCreate=[request])
        (result,) = await client.uaclient.create_monitored_items(params)
        assert result.StatusCode.name == code
