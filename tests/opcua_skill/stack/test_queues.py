"""A queue that is too short never loses anything in silence: the Overflow bit, the overflow event, and a least size."""

import pytest
from asyncua import Client, ua
from asyncua.common.event_objects import BaseEvent
from hypothesis import given
from hypothesis import strategies as st

from opcua_skill.stack.address_space.events import make_notifier
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.subscriptions.queues import OVERFLOW, make_room
from tests.opcua_skill.stack.small_server import Bench, small_server, until

pytestmark = pytest.mark.asyncio(loop_scope="package")
LOST = ua.NodeId(ua.ObjectIds.EventQueueOverflowEventType)
FIELDS = ("EventType", "SourceName", "Message", "Severity", "Time")


class Told:
    """What comes, with its status: (value, code)."""

    def __init__(self) -> None:
        self.values: list[tuple] = []

    def datachange_notification(self, node, content, data) -> None:
        self.values.append((content, data.monitored_item.Value.StatusCode.value))


class Heard:
    """Events as they come: the kind of each, and what it says."""

    def __init__(self) -> None:
        self.events: list = []

    def event_notification(self, event) -> None:
        self.events.append(event)

    @property
    def messages(self) -> list[str]:
        return ["lost" if event.EventType == LOST else event.Message.Text for event in self.events]


def selected() -> ua.EventFilter:
    wanted = ua.EventFilter()
    for name in FIELDS:
        clause = ua.SimpleAttributeOperand(TypeDefinitionId=ua.NodeId(ua.ObjectIds.BaseEventType))
        clause.BrowsePath, clause.AttributeId = [ua.QualifiedName(name)], ua.AttributeIds.Value
        wanted.SelectClauses.append(clause)
    return wanted


def request(node: ua.NodeId, *, of_events: bool, queue: int, oldest_goes: bool = True) -> ua.MonitoredItemCreateRequest:
    """Return the wish to monitor a value, or the events of an object, with a queue of a certain size."""
    attribute = ua.AttributeIds.EventNotifier if of_events else ua.AttributeIds.Value
    wanted = ua.MonitoredItemCreateRequest(MonitoringMode=ua.MonitoringMode.Reporting)
    wanted.ItemToMonitor = ua.ReadValueId(NodeId=node, AttributeId=attribute)
    wanted.RequestedParameters = ua.MonitoringParameters(ClientHandle=1, QueueSize=queue, DiscardOldest=oldest_goes)
    if of_events:
        wanted.RequestedParameters.Filter = selected()
    return wanted


async def monitored(client: Client, told, wanted: ua.MonitoredItemCreateRequest):
    """Monitor as wished in a subscription that is not published until it is switched on."""
    subscription = await client.create_subscription(50, told)
    await publishing(client, subscription.subscription_id, False)
    await subscription.create_monitored_items([wanted])
    return subscription


async def publishing(client: Client, number: int, on: bool) -> None:
    params = ua.SetPublishingModeParameters(PublishingEnabled=on, SubscriptionIds=[number])
    await client.uaclient.set_publishing_mode(params)


@given(st.integers(1, 6), st.booleans(), st.lists(st.integers(), max_size=30))
async def test_a_queue_keeps_the_first_or_the_last_and_the_newest(size: int, oldest_goes: bool, entries: list[int]):
    queue: list[int] = []
    lost = 0
    for entry in entries:
        lost += make_room(queue, size, oldest_goes)
        queue.append(entry)
    kept = entries[-size:] if oldest_goes else entries[: size - 1] + entries[max(size - 1, len(entries) - 1) :]
    assert queue == kept
    assert lost == max(len(entries) - size, 0)


@pytest.mark.parametrize(("oldest_goes", "kept"), [(True, [4.0, 5.0, 6.0]), (False, [0.0, 1.0, 6.0])])
async def test_the_value_beside_lost_ones_says_so(bench: Bench, oldest_goes: bool, kept: list[float]):
    node = bench.server.get_node(ua.NodeId("Cell/Speed", bench.index))
    await node.write_value(0.0)
    async with bench.client() as client:
        told = Told()
        wanted = request(node.nodeid, of_events=False, queue=3, oldest_goes=oldest_goes)
        subscription = await monitored(client, told, wanted)
        for value in range(1, 7):
            await node.write_value(float(value))
        await publishing(client, subscription.subscription_id, True)
        await until(lambda: len(told.values) == 3)
        assert [value for value, _ in told.values] == kept
        beside = 0 if oldest_goes else 2
        assert [code for _, code in told.values] == [OVERFLOW if place == beside else 0 for place in range(3)]
        await node.write_value(7.0)
        await until(lambda: told.values[-1] == (7.0, 0))


async def test_a_queue_of_one_is_a_newest_value_and_loses_nothing(bench: Bench):
    node = bench.server.get_node(ua.NodeId("Cell/Speed", bench.index))
    async with bench.client() as client:
        told = Told()
        subscription = await monitored(client, told, request(node.nodeid, of_events=False, queue=1))
        for value in (61.0, 62.0):
            await node.write_value(value)
        await publishing(client, subscription.subscription_id, True)
        await until(lambda: told.values == [(62.0, 0)])


@pytest.mark.parametrize(("oldest_goes", "kept"), [(True, ["lost", "3", "4", "5"]), (False, ["0", "1", "5", "lost"])])
async def test_lost_events_are_told_as_one_event_beside_the_queue(tmp_path, oldest_goes: bool, kept: list[str]):
    async with small_server(tmp_path, limits=Limits(queue_for_events=3)) as bench, bench.client() as client:
        cell = bench.server.get_node(bench.cell)
        await make_notifier(cell)
        heard = Heard()
        wanted = request(bench.cell, of_events=True, queue=3, oldest_goes=oldest_goes)
        subscription = await monitored(client, heard, wanted)
        for number in range(6):
            await bench.server.raise_event(cell, BaseEvent(message=str(number)))
        await publishing(client, subscription.subscription_id, True)
        await until(lambda: len(heard.events) == 4)
        assert heard.messages == kept
        lost = heard.events[kept.index("lost")]
        assert (lost.SourceName, lost.Severity) == ("Internal/EventQueueOverflow", 500)
        assert "events were lost" in lost.Message.Text
        assert lost.Time is not None
        await bench.server.raise_event(cell, BaseEvent(message="after"))
        await until(lambda: heard.messages[4:] == ["after"])


async def test_a_client_that_names_no_size_hears_every_event_of_a_busy_moment(bench: Bench):
    """Many clients ask for a queue of 1 unless told otherwise: that is the least this server holds to be enough."""
    cell = bench.server.get_node(bench.cell)
    await make_notifier(cell)
    async with bench.client() as client:
        heard = Heard()
        subscription = await monitored(client, heard, request(bench.cell, of_events=True, queue=1))
        for number in range(30):
            await bench.server.raise_event(cell, BaseEvent(message=str(number)))
        await publishing(client, subscription.subscription_id, True)
        await until(lambda: len(heard.events) == 30)
        assert heard.messages == [str(number) for number in range(30)]


@pytest.mark.parametrize(("asked", "given_"), [(0, 100), (1, 50), (49, 50), (70, 70), (5_000, 100)])
async def test_the_size_that_an_item_for_events_has_is_told(bench: Bench, asked: int, given_: int):
    async with bench.client() as client:
        number = (await client.create_subscription(1000, None)).subscription_id
        wanted = request(ua.NodeId(ua.ObjectIds.Server), of_events=True, queue=asked)
        params = ua.CreateMonitoredItemsParameters(SubscriptionId=number, ItemsToCreate=[wanted])
        (made,) = await client.uaclient.create_monitored_items(params)
        assert made.RevisedQueueSize == given_
        change = ua.MonitoredItemModifyRequest(MonitoredItemId=made.MonitoredItemId)
        change.RequestedParameters = wanted.RequestedParameters
        changes = ua.ModifyMonitoredItemsParameters(SubscriptionId=number, ItemsToModify=[change])
        (changed,) = await client.uaclient.modify_monitored_items(changes)
        assert changed.RevisedQueueSize == given_
