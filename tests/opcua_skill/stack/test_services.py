"""What foreign clients ask besides calls: writes, timestamps, history, and the limits told are the limits that hold."""

import math

import pytest
from asyncua import Client, ua

from opcua_skill.stack.limits import Limits
from tests.opcua_skill.stack.small_server import Bench, small_server

Ids = ua.ObjectIds
pytestmark = pytest.mark.asyncio(loop_scope="package")


def value(content, **more) -> ua.DataValue:
    return ua.DataValue(content if isinstance(content, ua.Variant) else ua.Variant(content), **more)


async def write(client: Client, node: ua.NodeId, content: ua.DataValue, attribute: int = 13) -> str:
    item = ua.WriteValue(NodeId=node, AttributeId=ua.UInt32(attribute), Value=content)
    (code,) = await client.uaclient.write(ua.WriteParameters(NodesToWrite=[item]))
    return code.name


@pytest.mark.parametrize(
    ("name", "content", "more", "expected"),
    [
        ("Speed", value(2.5), {}, "Good"),
        ("Speed", value("fast"), {}, "BadTypeMismatch"),
        ("Speed", value(ua.Variant(2, ua.VariantType.Int32)), {}, "BadTypeMismatch"),
        ("Speed", value([2.5]), {}, "BadTypeMismatch"),
        ("Speed", value(ua.Variant(None, ua.VariantType.Null)), {}, "BadTypeMismatch"),
        ("Speed", value(2.5, StatusCode=ua.StatusCode(ua.StatusCodes.BadOutOfService)), {}, "BadWriteNotSupported"),
        ("Speed", value(ua.LocalizedText("mine")), {"attribute": 4}, "BadNotWritable"),
        ("Speed", value(1), {"attribute": 21}, "BadAttributeIdInvalid"),
        ("ReadOnly", value(2.5), {}, "BadNotWritable"),
        ("Locked", value(2.5), {}, "BadUserAccessDenied"),
        ("Nowhere", value(2.5), {}, "BadNodeIdUnknown"),
    ],
)
async def test_a_write_is_done_or_refused_with_the_code_that_fits(bench: Bench, name, content, more, expected):
    node = ua.NodeId(f"Cell/{name}", bench.index)
    async with bench.client("operator") as client:
        before = await client.get_node(ua.NodeId("Cell/Speed", bench.index)).read_value()
        assert await write(client, node, content, **more) == expected
        if expected != "Good":
            assert await client.get_node(ua.NodeId("Cell/Speed", bench.index)).read_value() == before


async def test_a_value_of_the_wrong_type_never_reaches_what_obeys_it(bench: Bench):
    obeyed: list = []

    async def obey(speed: float) -> None:
        obeyed.append(speed)

    node = ua.NodeId("Cell/Speed", bench.index)
    bench.server.obey_writes(node, obey)
    try:
        async with bench.client("operator") as client:
            assert await write(client, node, value("fast")) == "BadTypeMismatch"
            assert await write(client, node, value(3.5)) == "Good"
    finally:
        del bench.server.iserver.on_write[node]
    assert obeyed == [3.5]


async def read(client: Client, node: ua.NodeId, which: int, max_age: float = 0.0) -> ua.DataValue:
    params = ua.ReadParameters(MaxAge=max_age, TimestampsToReturn=ua.TimestampsToReturn(which))
    params.NodesToRead = [ua.ReadValueId(NodeId=node, AttributeId=ua.AttributeIds.Value)]
    (told,) = await client.uaclient.read(params)
    return told


async def test_a_value_is_told_with_the_timestamps_asked_for(bench: Bench):
    node = ua.NodeId("Cell/Speed", bench.index)
    async with bench.client() as client:
        await client.get_node(node).write_value(2.0)
        stamps = {}
        for which in (ua.TimestampsToReturn.Source, ua.TimestampsToReturn.Server, ua.TimestampsToReturn.Neither):
            told = await read(client, node, which)
            stamps[which.name] = (told.SourceTimestamp is not None, told.ServerTimestamp is not None)
        assert stamps["Server"] == (False, True)
        assert stamps["Neither"] == (False, False)
        assert stamps["Source"][1] is False
        assert (await read(client, node, ua.TimestampsToReturn.Both)).ServerTimestamp is not None
        with pytest.raises(ua.uaerrors.BadTimestampsToReturnInvalid):
            await read(client, node, ua.TimestampsToReturn.Invalid)


@pytest.mark.parametrize("max_age", [-1.0, math.nan])
async def test_a_negative_age_is_refused(bench: Bench, max_age: float):
    async with bench.client() as client:
        with pytest.raises(ua.uaerrors.BadMaxAgeInvalid):
            await read(client, ua.NodeId("Cell/Speed", bench.index), ua.TimestampsToReturn.Both, max_age)


async def test_there_is_no_history_of_any_node_and_each_is_told_so(bench: Bench):
    async with bench.client() as client:
        params = ua.HistoryReadParameters(HistoryReadDetails=ua.ReadRawModifiedDetails())
        known, unknown = ua.NodeId("Cell/Speed", bench.index), ua.NodeId("nowhere", bench.index)
        params.NodesToRead = [ua.HistoryReadValueId(NodeId=node) for node in (known, unknown)]
        told = [result.StatusCode.name for result in await client.uaclient.history_read(params)]
        assert told == ["BadHistoryOperationUnsupported", "BadNodeIdUnknown"]


async def test_registered_nodes_keep_their_ids(bench: Bench):
    nodes = [bench.cell, ua.NodeId("Cell/Speed", bench.index)]
    async with bench.client() as client:
        assert await client.uaclient.register_nodes(nodes) == nodes
        await client.uaclient.unregister_nodes(nodes)


async def told(client: Client, *path: str) -> int:
    node = await client.nodes.server.get_child(["0:ServerCapabilities", *(f"0:{name}" for name in path)])
    return await node.read_value()


async def test_each_operation_limit_holds_as_told(tmp_path):
    limits = Limits(operations_per_request=7, browses_per_request=5, calls_per_request=3, items_per_subscription=9)
    async with small_server(tmp_path, limits=limits) as bench, bench.client() as client:
        ua_client, speed = client.uaclient, ua.NodeId("Cell/Speed", bench.index)
        reads = ua.ReadValueId(NodeId=speed, AttributeId=ua.AttributeIds.Value)
        writes = ua.WriteValue(NodeId=speed, AttributeId=ua.AttributeIds.Value, Value=value(1.0))
        path = ua.BrowsePath(StartingNode=speed)
        path.RelativePath.Elements = [ua.RelativePathElement(TargetName=ua.QualifiedName("x"))]
        call = ua.CallMethodRequest(ObjectId=bench.cell, MethodId=ua.NodeId("Cell/WhoAmI", bench.index))
        history = ua.HistoryReadValueId(NodeId=speed)
        item = ua.MonitoredItemCreateRequest(ItemToMonitor=reads)
        number = (await client.create_subscription(1000, None)).subscription_id

        def monitored(many: list) -> ua.CreateMonitoredItemsParameters:
            return ua.CreateMonitoredItemsParameters(SubscriptionId=number, ItemsToCreate=many)

        asked = {
            "MaxNodesPerRead": (reads, lambda many: ua_client.read(ua.ReadParameters(NodesToRead=many))),
            "MaxNodesPerWrite": (writes, lambda many: ua_client.write(ua.WriteParameters(NodesToWrite=many))),
            "MaxNodesPerBrowse": (
                ua.BrowseDescription(NodeId=speed),
                lambda many: ua_client.browse(ua.BrowseParameters(NodesToBrowse=many)),
            ),
            "MaxNodesPerTranslateBrowsePathsToNodeIds": (path, ua_client.translate_browsepaths_to_nodeids),
            "MaxNodesPerRegisterNodes": (speed, ua_client.register_nodes),
            "MaxNodesPerMethodCall": (call, ua_client.call),
            "MaxNodesPerHistoryReadData": (
                history,
                lambda many: ua_client.history_read(ua.HistoryReadParameters(NodesToRead=many)),
            ),
            "MaxMonitoredItemsPerCall": (item, lambda many: ua_client.create_monitored_items(monitored(many))),
        }
        for name, (one, ask) in asked.items():
            most = await told(client, "OperationLimits", name)
            assert most in {3, 5, 7, 9}, name
            with pytest.raises(ua.uaerrors.BadTooManyOperations):
                await ask([one] * (most + 1))
            assert len(await ask([one] * most)) == most, name


async def test_the_limits_on_arrays_text_and_queues_hold_as_told(tmp_path):
    limits = Limits(array_of_primitives=50, string=200_000, queue_of_item=4, sessions=3)
    async with small_server(tmp_path, limits=limits) as bench, bench.client() as client:
        cell = client.get_node(bench.cell)
        most = await told(client, "MaxArrayLength")
        assert await cell.call_method(f"{bench.index}:Length", [1.0] * most) == most
        with pytest.raises(ua.uaerrors.BadEncodingLimitsExceeded):
            await cell.call_method(f"{bench.index}:Length", [1.0] * (most + 1))
        for name in ("MaxStringLength", "MaxByteStringLength"):
            assert await told(client, name) == 200_000
        with pytest.raises(ua.uaerrors.BadEncodingLimitsExceeded):
            await cell.call_method(f"{bench.index}:Secret", "x" * 200_001)
        subscription = await client.create_subscription(1000, None)
        item = ua.MonitoredItemCreateRequest()
        item.ItemToMonitor = ua.ReadValueId(NodeId=ua.NodeId(Ids.Server_ServerStatus_State), AttributeId=13)
        item.RequestedParameters.QueueSize = 1000
        params = ua.CreateMonitoredItemsParameters(SubscriptionId=subscription.subscription_id, ItemsToCreate=[item])
        (result,) = await client.uaclient.create_monitored_items(params)
        assert result.RevisedQueueSize == await told(client, "MaxMonitoredItemsQueueSize") == 4
        assert await told(client, "MaxSessions") == 3
        async with bench.client(), bench.client():
            with pytest.raises(ua.uaerrors.BadTooManySessions):
                async with bench.client():
                    pass
