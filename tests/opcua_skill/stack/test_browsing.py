"""Browse in pages, paths, reads of parts of arrays; and the limits the server tells are those that hold."""

import pytest
from asyncua import Client, ua

from tests.opcua_skill.stack.small_server import Bench

Codes = ua.StatusCodes
pytestmark = pytest.mark.asyncio(loop_scope="package")


def everything_below(node: ua.NodeId) -> ua.BrowseDescription:
    description = ua.BrowseDescription()
    description.NodeId = node
    description.BrowseDirection = ua.BrowseDirection.Forward
    description.ReferenceTypeId = ua.NodeId(ua.ObjectIds.HierarchicalReferences)
    description.IncludeSubtypes = True
    description.ResultMask = ua.BrowseResultMask.All
    return description


async def browse(client: Client, node: ua.NodeId, page: int) -> ua.BrowseResult:
    params = ua.BrowseParameters()
    params.NodesToBrowse = [everything_below(node)]
    params.RequestedMaxReferencesPerNode = page
    return (await client.uaclient.browse(params))[0]


async def browse_next(client: Client, point: bytes) -> ua.BrowseResult:
    params = ua.BrowseNextParameters()
    params.ReleaseContinuationPoints = False
    params.ContinuationPoints = [point]
    return (await client.uaclient.browse_next(params))[0]


async def release(client: Client, point: bytes) -> list[ua.BrowseResult]:
    params = ua.BrowseNextParameters(ReleaseContinuationPoints=True, ContinuationPoints=[point])
    return await client.uaclient.browse_next(params)


async def test_pages_together_are_the_whole(bench: Bench):
    async with bench.client() as client:
        whole = await browse(client, bench.cell, 0)
        result = await browse(client, bench.cell, 3)
        found = list(result.References)
        while result.ContinuationPoint:
            assert len(result.References) == 3
            result = await browse_next(client, result.ContinuationPoint)
            found += result.References
        assert [r.NodeId for r in found] == [r.NodeId for r in whole.References]
        assert len(found) > 6


async def test_a_continuation_point_serves_once_and_can_be_released(bench: Bench):
    async with bench.client() as client:
        first = await browse(client, bench.cell, 3)
        await browse_next(client, first.ContinuationPoint)
        again = await browse_next(client, first.ContinuationPoint)
        assert again.StatusCode.value == Codes.BadContinuationPointInvalid
        second = await browse(client, bench.cell, 3)
        assert await release(client, second.ContinuationPoint) == []
        gone = await browse_next(client, second.ContinuationPoint)
        assert gone.StatusCode.value == Codes.BadContinuationPointInvalid


async def test_a_continuation_point_belongs_to_its_session(bench: Bench):
    async with bench.client() as one, bench.client() as other:
        first = await browse(one, bench.cell, 3)
        assert (await browse_next(other, first.ContinuationPoint)).StatusCode.value == Codes.BadContinuationPointInvalid


async def test_only_so_many_continuation_points_are_kept(bench: Bench):
    async with bench.client() as client:
        codes = [(await browse(client, bench.cell, 1)).StatusCode.value for _ in range(12)]
        assert codes == [Codes.Good] * 10 + [Codes.BadNoContinuationPoints] * 2


async def test_nodes_types_and_directions_that_are_not_there_are_told_apart(bench: Bench):
    async with bench.client() as client:
        params = ua.BrowseParameters()
        unknown, kind = everything_below(ua.NodeId("nowhere", 2)), everything_below(bench.cell)
        kind.ReferenceTypeId = ua.NodeId(999_999)
        params.NodesToBrowse = [unknown, kind]
        codes = [result.StatusCode.value for result in await client.uaclient.browse(params)]
        assert codes == [Codes.BadNodeIdUnknown, Codes.BadReferenceTypeIdInvalid]


async def test_paths_lead_to_nodes(bench: Bench):
    async with bench.client() as client:
        found = await client.nodes.objects.get_child([f"{bench.index}:Cell", f"{bench.index}:Speed"])
        assert found.nodeid == ua.NodeId("Cell/Speed", bench.index)
        with pytest.raises(ua.uaerrors.BadNoMatch):
            await client.nodes.objects.get_child([f"{bench.index}:Cell", f"{bench.index}:Nothing"])


async def test_server_capabilities_and_status_are_filled_in(bench: Bench):
    async with bench.client() as client:
        capabilities = await client.nodes.server.get_child("0:ServerCapabilities")
        for name in (
            "ServerProfileArray",
            "LocaleIdArray",
            "MaxBrowseContinuationPoints",
            "MaxArrayLength",
            "MaxSessions",
        ):
            assert await (await capabilities.get_child(f"0:{name}")).read_value(), name
        level = await client.nodes.server.get_child("0:ServiceLevel")
        assert await level.read_value() == 255
        await bench.server.set_service_level(100, because="the arm is gone")
        assert await level.read_value() == 100
        await bench.server.set_service_level(255, because="the arm is back")
        status = await client.get_node(ua.ObjectIds.Server_ServerStatus).read_value()
        assert (status.State, status.BuildInfo.ManufacturerName) == (ua.ServerState.Running, "opcua-skill")


async def test_services_the_server_does_not_have_are_unsupported(bench: Bench):
    async with bench.client() as client:
        with pytest.raises(ua.uaerrors.BadServiceUnsupported):
            await client.nodes.objects.add_object(bench.index, "Mine")
        with pytest.raises(ua.uaerrors.BadServiceUnsupported):
            await client.get_node(bench.cell).delete()
