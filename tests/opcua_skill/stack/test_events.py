"""Events reach everybody who listens above their source, and filters know type hierarchies."""

import asyncio

import pytest
from asyncua import Client, ua
from asyncua.common.event_objects import BaseEvent, ProgramTransitionEvent

from opcua_skill.stack.address_space.events import make_notifier
from tests.opcua_skill.stack.small_server import Bench

pytestmark = pytest.mark.asyncio(loop_scope="package")


class Heard:
    def __init__(self) -> None:
        self.events: asyncio.Queue = asyncio.Queue()

    def event_notification(self, event) -> None:
        self.events.put_nowait(event)

    async def next(self):
        async with asyncio.timeout(10):
            return await self.events.get()


async def listen(client: Client, node, event_type=ua.ObjectIds.BaseEventType, **options) -> Heard:
    heard = Heard()
    subscription = await client.create_subscription(50, heard)
    await subscription.subscribe_events(node, event_type, **options)
    return heard


async def notifying(bench: Bench):
    cell = bench.server.get_node(bench.cell)
    await make_notifier(cell)
    return cell


async def test_an_event_of_an_object_reaches_its_own_and_the_server_s_subscribers_once(bench: Bench):
    cell = await notifying(bench)
    async with bench.client() as client:
        at_cell = await listen(client, client.get_node(bench.cell))
        at_server = await listen(client, client.nodes.server)
        await bench.server.raise_event(cell, BaseEvent(message="hello", severity=300))
        for heard in (at_cell, at_server):
            event = await heard.next()
            assert (event.Message.Text, event.Severity, event.SourceNode, event.SourceName) == (
                "hello",
                300,
                bench.cell,
                "Cell",
            )
            assert event.Time is not None
            assert len(event.EventId) == 16
        await bench.server.raise_event(cell, BaseEvent(message="marker"))
        assert (await at_server.next()).Message.Text == "marker"


async def test_an_event_rises_through_every_notifier_above_its_source(bench: Bench):
    cell = await notifying(bench)
    part = await cell.add_object(bench.index, "Part")
    await make_notifier(part, cell)
    async with bench.client() as client:
        at_cell = await listen(client, client.get_node(bench.cell))
        await bench.server.raise_event(part, BaseEvent(message="from below"))
        event = await at_cell.next()
        assert (event.Message.Text, event.SourceName) == ("from below", "Part")


async def test_subscribing_to_a_type_hears_its_subtypes(bench: Bench):
    cell = await notifying(bench)
    async with bench.client() as client:
        heard = await listen(
            client, client.nodes.server, ua.ObjectIds.TransitionEventType, where_clause_generation=False
        )
        with_filter = Heard()
        subscription = await client.create_subscription(50, with_filter)
        await subscription._subscribe(
            client.nodes.server, ua.AttributeIds.EventNotifier, of_type(ua.ObjectIds.TransitionEventType)
        )
        await bench.server.raise_event(cell, BaseEvent(message="another kind"))
        await bench.server.raise_event(cell, ProgramTransitionEvent(message="a subtype"))
        assert (await with_filter.next()).Message.Text == "a subtype"
        assert (await heard.next()).Message.Text == "another kind"


def of_type(event_type: int) -> ua.EventFilter:
    """Return a filter as other clients send it: OfType with one literal, which means subtypes too."""
    message = ua.SimpleAttributeOperand(
        TypeDefinitionId=ua.NodeId(ua.ObjectIds.BaseEventType),
        BrowsePath=[ua.QualifiedName("Message")],
        AttributeId=ua.AttributeIds.Value,
    )
    element = ua.ContentFilterElement()
    element.FilterOperator = ua.FilterOperator.OfType
    element.FilterOperands = [ua.LiteralOperand(Value=ua.Variant(ua.NodeId(event_type)))]
    wanted = ua.EventFilter()
    wanted.SelectClauses = [message]
    wanted.WhereClause.Elements = [element]
    return wanted


async def test_every_change_is_told_as_an_audit_event_with_who_what_and_how_it_ended(bench: Bench):
    async with bench.client("engineer") as client:
        heard = await listen(client, client.nodes.server, ua.ObjectIds.AuditUpdateMethodEventType)
        cell = client.get_node(bench.cell)
        await cell.call_method(f"{bench.index}:WhoAmI")
        done = await heard.next()
        assert (done.ClientUserId, done.Status, done.SourceName) == ("engineer", True, "Attribute/Call")
        assert done.MethodId == ua.NodeId("Cell/WhoAmI", bench.index)
        assert done.SourceNode == bench.cell
        with pytest.raises(ua.uaerrors.BadInvalidArgument):
            await cell.call_method(f"{bench.index}:Refuse", "x")
        refused = await heard.next()
        assert (refused.Status, refused.StatusCodeId.name) == (False, "BadInvalidArgument")
        assert "no such name" in refused.Message.Text
        assert [argument.Value for argument in refused.InputArguments] == ["Name=x"]


async def test_what_is_told_has_been_recorded_before(bench: Bench):
    async with bench.client("engineer") as client:
        heard = await listen(client, client.nodes.server, ua.ObjectIds.AuditUpdateMethodEventType)
        await client.get_node(bench.cell).call_method(f"{bench.index}:WhoAmI")
        await heard.next()
        assert [record.method_name for record in bench.records] == ["WhoAmI"]
