"""The Server object as clients find it: methods work, variables have values, and nothing stands for nothing."""

import time

import pytest
from asyncua import Client, ua

from opcua_skill.stack.diagnostics.server_diagnostics import SECURITY
from tests.opcua_skill.stack.door import SERVER, Door, Ids, events, items, monitored, open_door
from tests.opcua_skill.stack.small_server import Bench

pytestmark = pytest.mark.asyncio(loop_scope="package")
FORWARD, HIERARCHICAL = ua.BrowseDirection.Forward, ua.NodeId(Ids.HierarchicalReferences)
METHODS = {Ids.Server_GetMonitoredItems, Ids.Server_ResendData}


async def below(client: Client, start: ua.NodeId) -> dict[ua.NodeId, ua.ReferenceDescription]:
    """Return every node below one, by how it was reached."""
    found: dict[ua.NodeId, ua.ReferenceDescription] = {}
    waiting = [start]
    while waiting:
        asked = [ua.BrowseDescription(node, FORWARD, HIERARCHICAL, True, ResultMask=63) for node in waiting[:10]]
        results = await client.uaclient.browse(ua.BrowseParameters(NodesToBrowse=asked))
        waiting = waiting[10:]
        for reference in [each for result in results for each in result.References]:
            if reference.NodeId not in found:
                found[reference.NodeId] = reference
                waiting.append(reference.NodeId)
    return found


async def test_no_node_below_the_server_is_a_stub(bench: Bench):
    async with bench.client() as client:
        found = await below(client, SERVER)
        variables = [node for node, how in found.items() if how.NodeClass == ua.NodeClass.Variable]
        variables.remove(SECURITY)  # for engineers only, and tested there
        told = await client.uaclient.read_attributes(variables, ua.AttributeIds.Value)
        empty = [
            found[node].BrowseName.Name
            for node, value in zip(variables, told, strict=True)
            if not value.StatusCode.is_good() or value.Value is None or value.Value.Value is None
        ]
        objects = await below(client, ua.NodeId(Ids.ObjectsFolder))
    assert empty == []
    methods = {node for node, how in found.items() if how.NodeClass == ua.NodeClass.Method}
    assert {node.Identifier for node in methods if not node.NamespaceIndex} == METHODS
    standard = {how.BrowseName.Name for node, how in objects.items() if node not in found and not node.NamespaceIndex}
    assert standard == {"Server"}
    nodes = bench.server.iserver.aspace._nodes
    assert all(one.NodeId in nodes for node in nodes.values() for one in node.references)


async def test_what_the_server_tells_of_itself_is_true(bench: Bench):
    async with bench.client() as client:

        async def read(number: int):
            return await client.get_node(ua.NodeId(number)).read_value()

        assert await read(Ids.Server_ServerRedundancy_RedundancySupport) == 0
        assert await read(Ids.Server_ServerCapabilities_LocaleIdArray) == ["en"]
        zone = await read(Ids.Server_LocalTime)
        now = time.localtime()
        assert (zone.Offset, zone.DaylightSavingInOffset) == (now.tm_gmtoff // 60, now.tm_isdst > 0)


async def called(door: Door, method: int, *arguments: int, on: int = Ids.Server) -> tuple[str, list]:
    request = ua.CallMethodRequest(ObjectId=ua.NodeId(on), MethodId=ua.NodeId(method))
    request.InputArguments = [ua.Variant(one, ua.VariantType.UInt32) for one in arguments]
    (result,) = (await door.send("Call", MethodsToCall=[request])).Results
    return result.StatusCode.name, [one.Value for one in result.OutputArguments or []]


async def test_a_client_finds_its_items_again_and_has_their_values_told_again(bench: Bench):
    async with open_door(bench, RequestedPublishingInterval=50.0) as door, open_door(bench, "observer") as other:
        told = await called(door, Ids.Server_GetMonitoredItems, door.subscription)
        assert told == ("Good", [list(door.items), [0, 0]])
        first = (await door.send("Publish")).Parameters.NotificationMessage.NotificationData[0].MonitoredItems
        assert await called(door, Ids.Server_ResendData, door.subscription) == ("Good", [])
        again = (await door.send("Publish")).Parameters.NotificationMessage.NotificationData[0].MonitoredItems
        assert [one.Value.Value for one in again] == [one.Value.Value for one in first]
        for method in METHODS:
            assert (await called(other, method, door.subscription))[0] == "BadUserAccessDenied"
            assert (await called(door, method, 999_999))[0] == "BadSubscriptionIdInvalid"


async def test_a_refresh_of_conditions_begins_and_ends(bench: Bench):
    async with open_door(bench, RequestedPublishingInterval=50.0) as door:
        await door.send("Publish")
        wanted = [monitored(door, SERVER, 12, Filter=events("EventType")) for _ in range(2)]
        first, _ = (await items(door, *wanted)).Results
        kinds = [ua.NodeId(one) for one in (Ids.RefreshStartEventType, Ids.RefreshEndEventType)]
        refresh = Ids.ConditionType_ConditionRefresh, Ids.ConditionType_ConditionRefresh2
        assert (await called(door, refresh[0], door.subscription, on=Ids.ConditionType))[0] == "Good"
        heard = (await door.send("Publish")).Parameters.NotificationMessage.NotificationData[0].Events
        assert [one.EventFields[0].Value for one in heard] == [*kinds, *kinds]
        one = (door.subscription, first.MonitoredItemId)
        assert (await called(door, refresh[1], *one, on=Ids.ConditionType))[0] == "Good"
        heard = (await door.send("Publish")).Parameters.NotificationMessage.NotificationData[0].Events
        assert [one.EventFields[0].Value for one in heard] == kinds
        wrong = (door.subscription, 999_999)
        assert (await called(door, refresh[1], *wrong, on=Ids.ConditionType))[0] == "BadMonitoredItemIdInvalid"
