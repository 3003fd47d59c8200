"""How asyncua by itself answers calls, reads, writes and browsing.

A test that fails here says which of ours may go; `replacements.py` names it.
"""

import pytest
from asyncua import ua
from asyncua.server.internal_session import InternalSession

from opcua_skill.stack.limits import Limits
from tests.opcua_skill.stack.stock_server import Stock, call, mended, still_raises

pytestmark = pytest.mark.asyncio(loop_scope="package")
Codes, Ids, VALUE = ua.StatusCodes, ua.ObjectIds, ua.AttributeIds.Value
HOUR = 3_600_000.0


async def test_a_call_is_not_checked(stock: Stock):
    await stock.server.get_node(stock.node("First")).write_attribute(
        ua.AttributeIds.Executable, ua.DataValue(ua.Variant(False))
    )
    wrong = [
        call(stock, "First", 1.0, on="Speed"),
        call(stock, "First", "text"),
        call(stock, "First"),
        call(stock, "First", 1.0, 2.0),
    ]
    told = [result.StatusCode.name for result in await stock.session().call(wrong)]
    assert told == ["Good"] * 4, mended("calls are checked", "calls.py: CheckedMethods._call")


async def test_a_handler_s_code_is_lost(stock: Stock):
    (told,) = await stock.session().call([call(stock, "Refuse")])
    assert told.StatusCode.name == "BadUnexpectedError", mended("the code is told", "calls.py: CheckedMethods._run")


async def test_a_request_may_have_any_number_of_calls(stock: Stock):
    most = Limits().calls_per_request
    told = await stock.session().call([call(stock, "First", 1.0)] * (most + 1))
    assert len(told) == most + 1, mended("calls are limited", "sessions.py: Session.call")


async def test_a_read_ignores_range_timestamps_and_number(stock: Stock):
    params = ua.ReadParameters(TimestampsToReturn=ua.TimestampsToReturn.Neither, MaxAge=-1.0)
    wanted = ua.ReadValueId(NodeId=stock.node("Row"), AttributeId=VALUE, IndexRange="1")
    params.NodesToRead = [wanted] * (Limits().operations_per_request + 1)
    await stock.server.get_node(stock.node("Row")).write_value([1.0, 2.0, 3.0])
    told = await InternalSession.read(stock.session(), params)
    assert told[-1].Value.Value == [1.0, 2.0, 3.0], mended("a part is read", "sessions.py: Session.read, reading.py")
    assert told[-1].SourceTimestamp is not None, mended("timestamps are left out", "reading.py: stamped")


async def test_a_write_ignores_range_and_rank(stock: Stock):
    items = [
        ua.WriteValue(NodeId=stock.node("Row"), AttributeId=VALUE, IndexRange="1", Value=ua.DataValue([9.0])),
        ua.WriteValue(NodeId=stock.node("Speed"), AttributeId=VALUE, Value=ua.DataValue([1.0, 2.0])),
    ]
    await stock.session().write(ua.WriteParameters(NodesToWrite=items))
    row, speed = (stock.server.get_node(stock.node(name)) for name in ("Row", "Speed"))
    assert await row.read_value() == [9.0], mended("a part is written", "writing.py and index_ranges.py")
    assert await speed.read_value() == [1.0, 2.0], mended("ranks are checked", "writing.py: fits_variable")
    await row.write_value([1.0, 2.0, 3.0])
    await speed.write_value(1.5)


async def test_a_browse_has_no_pages(stock: Stock):
    params = ua.BrowseParameters(RequestedMaxReferencesPerNode=1)
    wanted = ua.BrowseDescription(NodeId=ua.NodeId(Ids.Server), BrowseDirection=ua.BrowseDirection.Both)
    params.NodesToBrowse = [wanted]
    (told,) = await stock.session().browse(params)
    assert len(told.References) > 1 and not told.ContinuationPoint, mended("browsing has pages", "browsing.py")
    with still_raises(NotImplementedError, "there is BrowseNext", "browsing.py: Browser.browse_next"):
        await stock.session().browse_next(ua.BrowseNextParameters())


async def test_an_unknown_node_is_called_invalid(stock: Stock):
    path = ua.BrowsePath(StartingNode=ua.NodeId("nowhere", 9))
    path.RelativePath.Elements = [ua.RelativePathElement(TargetName=ua.QualifiedName("x"))]
    (told,) = await stock.session().translate_browsepaths_to_nodeids([path])
    assert told.StatusCode.name == "BadNodeIdInvalid", mended("an unknown node is unknown", "browsing.py: translate")


async def test_history_of_a_node_that_is_not_there_is_good(stock: Stock):
    params = ua.HistoryReadParameters(HistoryReadDetails=ua.ReadRawModifiedDetails())
    params.NodesToRead = [ua.HistoryReadValueId(NodeId=ua.NodeId("nowhere", 9))]
    (told,) = await stock.session().history_read(params)
    assert told.StatusCode.is_good(), mended("history says what there is not", "sessions.py: Session.history_read")


async def test_capabilities_and_diagnostics_are_not_told(stock: Stock):
    for name in (
        "Server_ServerCapabilities_ServerProfileArray",
        "Server_ServerCapabilities_MaxArrayLength",
        "Server_ServerDiagnostics_ServerDiagnosticsSummary",
        "Server_ServerDiagnostics_SessionsDiagnosticsSummary_SessionDiagnosticsArray",
    ):
        told = await stock.server.get_node(ua.NodeId(getattr(Ids, name))).read_value()
        assert not told, mended(f"{name} is filled in", "capabilities.py and diagnostics.py")
