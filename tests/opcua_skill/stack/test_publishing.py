"""What subscriptions say and when: in bounds, on demand of another item, and that they are over."""

import asyncio
import math
from collections.abc import AsyncIterator
from typing import Any

import pytest
import pytest_asyncio
from asyncua import ua

from tests.opcua_skill.stack.door import (
    SERVER,
    Door,
    Ids,
    absolute,
    drop,
    events,
    field,
    items,
    monitored,
    open_door,
    percent,
)
from tests.opcua_skill.stack.small_server import PASSWORD, Bench, until
from tests.opcua_skill.stack.test_sign_in import session_on_new_channel

pytestmark = pytest.mark.asyncio(loop_scope="package")
FAST = {"RequestedPublishingInterval": 50.0, "RequestedMaxKeepAliveCount": 10_000, "RequestedLifetimeCount": 10_000}


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def door(shared_bench: Bench) -> AsyncIterator[Door]:
    async with open_door(shared_bench, **FAST) as opened:
        yield opened


async def published(door: Door) -> tuple[int, list[Any], bool]:
    """Return whose message comes next, the kinds or the handles of its notifications, and whether more follow."""
    told = (await door.send("Publish")).Parameters
    (one,) = told.NotificationMessage.NotificationData or (None,)
    if isinstance(one, ua.StatusChangeNotification):
        return told.SubscriptionId, [one.Status.name], told.MoreNotifications
    heard = getattr(one, "MonitoredItems", None) or getattr(one, "Events", None) or []
    return told.SubscriptionId, [each.ClientHandle for each in heard], told.MoreNotifications


async def waiting(door: Door) -> asyncio.Task[Any]:
    """Send a publish request and return its task once the server keeps it."""
    (session,) = [one for one in door.bench.server.iserver.client_sessions() if one.session_id == session_id(door)]
    assert session.processor is not None
    queue = session.processor._publish_requests
    before = len(queue)
    task = asyncio.create_task(door.codes("Publish"))
    await until(lambda: len(queue) > before or task.done())
    return task


def session_id(door: Door) -> ua.NodeId:
    subscriptions = door.bench.server.iserver.subscription_service.subscriptions
    return subscriptions[door.subscription].session_id


async def test_a_message_has_as_many_notifications_as_were_asked_for_at_most(door: Door):
    await published(door)
    changed = {"SubscriptionId": door.subscription, "MaxNotificationsPerPublish": 2, **FAST}
    await door.send("ModifySubscription", **changed)
    made = (await items(door, *(monitored(door, ClientHandle=number) for number in range(10, 15)))).Results
    told = [await published(door) for _ in range(3)]
    assert told == [
        (door.subscription, [10, 11], True),
        (door.subscription, [12, 13], True),
        (door.subscription, [14], False),
    ]
    await drop(door, made)
    await door.send("ModifySubscription", **{**changed, "MaxNotificationsPerPublish": 0})
    made = (await items(door, *(monitored(door, ClientHandle=number) for number in range(10, 15)))).Results
    assert await published(door) == (door.subscription, [10, 11, 12, 13, 14], False)
    await drop(door, made)


async def test_an_item_that_samples_reports_when_the_one_it_is_linked_to_does(door: Door):
    node = door.bench.server.get_node(door.node("Speed"))
    wanted = [
        monitored(door, "Speed", ClientHandle=1),
        monitored(door, "Locked", ClientHandle=2, MonitoringMode=ua.MonitoringMode.Sampling),
        monitored(door, "ReadOnly", ClientHandle=3, MonitoringMode=ua.MonitoringMode.Sampling),
    ]
    made = (await items(door, *wanted)).Results
    first, second, third = (one.MonitoredItemId for one in made)
    assert (await published(door))[1] == [1]

    async def link(item: int, add: list[int], remove: list[int]) -> tuple[list[str], list[str]]:
        fields = {"SubscriptionId": door.subscription, "TriggeringItemId": item}
        told = (await door.send("SetTriggering", **fields, LinksToAdd=add, LinksToRemove=remove)).Parameters
        return [one.name for one in told.AddResults or []], [one.name for one in told.RemoveResults or []]

    with pytest.raises(ua.uaerrors.BadMonitoredItemIdInvalid):
        await link(999_999, [second], [])
    assert await link(first, [second, 999_999], [third]) == (
        ["Good", "BadMonitoredItemIdInvalid"],
        ["BadMonitoredItemIdInvalid"],
    )
    await node.write_value(101.0)
    assert set((await published(door))[1]) - {0} == {1, 2}
    assert await link(first, [third], [second]) == (["Good"], ["Good"])
    await door.bench.server.get_node(door.node("Locked")).write_value(4.5)
    await node.write_value(102.0)
    assert set((await published(door))[1]) - {0} == {1, 3}
    await drop(door, made)


async def test_the_last_publish_request_is_answered_when_there_is_no_subscription_left(bench: Bench):
    async with open_door(bench) as door:
        requests = [await waiting(door), await waiting(door)]  # the first is answered: it tells the items' values
        assert await requests[0] == ""
        assert await door.codes("DeleteSubscriptions", SubscriptionIds=[door.subscription]) == "Good"
        assert await requests[1] == "!BadNoSubscription"
        assert await door.codes("Publish") == "!BadNoSubscription"


async def test_a_subscription_nobody_asks_for_ends_and_its_session_is_told(bench: Bench):
    async with open_door(bench) as door:
        short = {"RequestedPublishingInterval": 50.0, "RequestedLifetimeCount": 3, "RequestedMaxKeepAliveCount": 1}
        number = (await door.send("CreateSubscription", **short)).Parameters.SubscriptionId
        known = bench.server.iserver.subscription_service.subscriptions
        await until(lambda: number not in known)
        assert await published(door) == (number, ["BadTimeout"], False)
        assert (await published(door))[0] == door.subscription
        number = (await door.send("CreateSubscription", **short)).Parameters.SubscriptionId
        await door.send("DeleteSubscriptions", SubscriptionIds=[door.subscription])
        await until(lambda: number not in known)
        assert await published(door) == (number, ["BadTimeout"], False)  # though it has no subscription any more
        assert await door.codes("Publish") == "!BadNoSubscription"


async def test_who_loses_a_subscription_to_another_session_is_told(bench: Bench):
    async with open_door(bench) as old, open_door(bench) as new:
        await published(old)
        request = asyncio.create_task(published(old))
        idle = await waiting(old)
        (session,) = [one for one in bench.server.iserver.client_sessions() if one.session_id == session_id(old)]
        await until(lambda: len(session.processor._publish_requests) == 2)
        moved = {"SubscriptionIds": [old.subscription], "SendInitialValues": True}
        assert await new.codes("TransferSubscriptions", **moved) == "Good"
        assert await request == (old.subscription, ["GoodSubscriptionTransferred"], False)
        assert await idle == "!BadNoSubscription"
        assert {(await published(new))[0] for _ in range(2)} == {old.subscription, new.subscription}


async def test_a_publish_request_is_cancelled_by_its_handle(bench: Bench):
    async with open_door(bench) as door:
        await published(door)
        request = await waiting(door)
        handle = door.client.uaclient.protocol._request_handle
        assert (await door.send("Cancel", RequestHandle=handle + 1000)).Parameters.CancelCount == 0
        assert (await door.send("Cancel", RequestHandle=handle)).Parameters.CancelCount == 1
        assert await request == "!BadRequestCancelledByClient"


async def test_a_deadband_counts_from_what_was_told_last(door: Door):
    node = door.bench.server.get_node(door.node("Speed"))
    cell = door.bench.server.get_node(door.bench.cell)
    row = await cell.add_variable(ua.NodeId("Cell/Row", door.bench.index), "Row", [1.0, 2.0])
    span = ua.Variant(ua.Range(Low=0.0, High=50.0), ua.VariantType.ExtensionObject)
    ranged = await row.add_property(ua.NodeId("Cell/Row/EURange", door.bench.index), ua.QualifiedName("EURange"), span)
    await node.write_value(10.0)
    made = (await items(door, monitored(door, ClientHandle=21, Filter=absolute(1.0)))).Results
    made += (await items(door, monitored(door, "Row", ClientHandle=22, Filter=percent(10.0)))).Results
    assert [one.StatusCode.name for one in made] == ["Good", "Good"]
    assert {21, 22} <= set((await published(door))[1])
    found = door.bench.server.iserver.subscription_service.subscriptions[door.subscription]
    told = {handle: [] for handle in (21, 22)}
    for value in (10.4, 10.8, 11.2, 11.6, math.nan):
        await node.write_value(value)
        told[21] += [len(found._triggered_datachanges.pop(made[0].MonitoredItemId, ()))]
    for value in ([1.0, 6.9], [1.0, 7.1], [6.0, 7.1], [6.0], [6.0, 7.1]):
        await row.write_value(value)
        told[22] += [len(found._triggered_datachanges.pop(made[1].MonitoredItemId, ()))]
    await drop(door, made)
    await door.bench.server.delete_nodes([ranged, row])
    await node.write_value(2.5)
    assert told == {21: [0, 0, 1, 0, 1], 22: [0, 1, 0, 1, 1]}


OF_TYPE = ua.FilterOperator.OfType
EQUALS = ua.FilterOperator.Equals


def element(operator: ua.FilterOperator, *operands: Any) -> ua.ContentFilterElement:
    return ua.ContentFilterElement(FilterOperator=operator, FilterOperands=list(operands))


def literal(value: Any) -> ua.LiteralOperand:
    return ua.LiteralOperand(Value=ua.Variant(value))


CLAUSES = {
    "a field": (field("Message"), "Good"),
    "a field of a type below": (field("ActionTimeStamp"), "Good"),
    "a part of a field": (field("Transition/Id", ua.NodeId(Ids.ProgramTransitionEventType)), "Good"),
    "no field": (field("Nothing"), "BadBrowseNameInvalid"),
    "a field without a name": (ua.SimpleAttributeOperand(BrowsePath=[ua.QualifiedName()]), "BadBrowseNameInvalid"),
    "of no node": (field("Message", ua.NodeId("nowhere", 9)), "BadNodeIdUnknown"),
    "of what is no event": (field("Message", ua.NodeId(Ids.FolderType)), "BadTypeDefinitionInvalid"),
    "of no attribute": (field("Message", AttributeId=99), "BadAttributeIdInvalid"),
    "of a wrong part": (field("Message", IndexRange="x"), "BadIndexRangeInvalid"),
}
WHERE = {
    "of a type": (element(OF_TYPE, literal(ua.NodeId(Ids.AuditEventType))), "Good", ["Good"]),
    "of a number": (element(OF_TYPE, literal(5)), "BadFilterOperandInvalid", ["BadFilterOperandInvalid"]),
    "no field": (
        element(EQUALS, field("Nothing"), literal(5)),
        "BadFilterOperandInvalid",
        ["BadBrowseNameInvalid", "Good"],
    ),
    "one operand of two": (element(EQUALS, literal(5)), "BadFilterOperandCountMismatch", []),
    "an operator there is not": (
        element(ua.FilterOperator.InView, literal(5)),
        "BadFilterOperatorUnsupported",
        [],
    ),
    "in circles": (
        element(ua.FilterOperator.Not, ua.ElementOperand(Index=0)),
        "BadFilterOperandInvalid",
        ["BadFilterOperandInvalid"],
    ),
}


async def test_what_is_wrong_in_a_filter_for_events_is_told_clause_by_clause(door: Door):
    wanted = events("Message")
    (good,) = (await items(door, monitored(door, SERVER, 12, Filter=wanted))).Results
    assert good.StatusCode.is_good() and not isinstance(good.FilterResult, ua.EventFilterResult)
    wanted.SelectClauses = [clause for clause, _ in CLAUSES.values()]
    (some,) = (await items(door, monitored(door, SERVER, 12, Filter=wanted))).Results
    assert some.StatusCode.is_good()
    told = dict(zip(CLAUSES, (one.name for one in some.FilterResult.SelectClauseResults), strict=True))
    assert told == {name: code for name, (_, code) in CLAUSES.items()}
    await drop(door, [good, some])
    for name, (clause, code, operands) in WHERE.items():
        (one,) = (await items(door, monitored(door, SERVER, 12, Filter=events("Message", where=[clause])))).Results
        assert one.StatusCode.name == code, name
        if code == "Good":
            await drop(door, [one])
            continue
        (looked,) = one.FilterResult.WhereClauseResult.ElementResults
        assert looked.StatusCode.name == code, name
        assert [each.name for each in looked.OperandStatusCodes or []] == operands, name
    (none,) = (await items(door, monitored(door, SERVER, 12, Filter=events("Nothing")))).Results
    assert none.StatusCode.name == "BadEventFilterInvalid"
    assert [one.name for one in none.FilterResult.SelectClauseResults] == ["BadBrowseNameInvalid"]


async def test_a_session_without_subscriptions_lives_over_a_lost_connection(bench: Bench):
    client = await bench.new_client("engineer")
    await client.connect()
    session = bench.server.iserver._external_sessions[client.uaclient.session.authentication_token]
    client.uaclient.protocol.transport.abort()
    await until(lambda: session.processor is None)
    again = await session_on_new_channel(bench, client, bench.folder / "client", "engineer")
    await again.activate_session("engineer", PASSWORD)
    assert await again.nodes.server_state.read_value() == 0
    await again.close_session()
    again.disconnect_socket()


@pytest.mark.parametrize("wanted", [math.nan, math.inf, -math.inf, -5.0, 0.0, 1e308])
async def test_a_session_s_timeout_is_brought_into_bounds(bench: Bench, wanted: float):
    client = await bench.new_client()
    await client.connect_socket()
    await client.send_hello()
    await client.open_secure_channel()
    client.session_timeout = wanted
    told = await client.create_session()
    client.disconnect_socket()
    assert 5_000 <= told.RevisedSessionTimeout <= 120_000
