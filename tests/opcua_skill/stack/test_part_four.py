"""Each service against the codes that OPC 10000-4 names for it: tables of requests, each with what it must come to."""

import dataclasses
import math
from collections.abc import AsyncIterator, Callable
from datetime import UTC, datetime
from typing import Any

import pytest
import pytest_asyncio
from asyncua import ua

from tests.opcua_skill.stack.door import (
    BOTH,
    SERVER,
    Attribute,
    Door,
    Ids,
    absolute,
    drop,
    events,
    items,
    monitored,
    open_door,
    percent,
)
from tests.opcua_skill.stack.small_server import Bench

pytestmark = pytest.mark.asyncio(loop_scope="package")
NOWHERE = ua.NodeId("nowhere", 9)


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def door(shared_bench: Bench) -> AsyncIterator[Door]:
    async with open_door(shared_bench) as opened:
        yield opened


NOTHING: dict[str, Callable[[Door], dict[str, Any]]] = {
    "Read": lambda door: {"NodesToRead": [], "TimestampsToReturn": BOTH},
    "Write": lambda door: {"NodesToWrite": []},
    "HistoryRead": lambda door: {"NodesToRead": []},
    "Browse": lambda door: {"NodesToBrowse": []},
    "BrowseNext": lambda door: {"ContinuationPoints": []},
    "TranslateBrowsePathsToNodeIds": lambda door: {"BrowsePaths": []},
    "RegisterNodes": lambda door: {"NodesToRegister": []},
    "UnregisterNodes": lambda door: {"NodesToUnregister": []},
    "Call": lambda door: {"MethodsToCall": []},
    "CreateMonitoredItems": lambda door: {"SubscriptionId": door.subscription, "TimestampsToReturn": BOTH},
    "ModifyMonitoredItems": lambda door: {"SubscriptionId": door.subscription, "TimestampsToReturn": BOTH},
    "DeleteMonitoredItems": lambda door: {"SubscriptionId": door.subscription},
    "SetMonitoringMode": lambda door: {
        "SubscriptionId": door.subscription,
        "MonitoringMode": ua.MonitoringMode.Reporting,
    },
    "SetTriggering": lambda door: {"SubscriptionId": door.subscription, "TriggeringItemId": door.items[0]},
    "SetPublishingMode": lambda door: {"PublishingEnabled": True},
    "TransferSubscriptions": lambda door: {},
    "DeleteSubscriptions": lambda door: {},
}


async def test_a_request_for_nothing_is_told_so_by_every_service(door: Door):
    told = {name: await door.codes(name, **fields(door)) for name, fields in NOTHING.items()}
    assert told == dict.fromkeys(NOTHING, "!BadNothingToDo")


UNSUPPORTED = (
    "AddNodes",
    "AddReferences",
    "DeleteNodes",
    "DeleteReferences",
    "QueryFirst",
    "QueryNext",
    "HistoryUpdate",
    "RegisterServer",
    "RegisterServer2",
    "FindServersOnNetwork",
)


async def test_a_service_that_is_not_there_is_unsupported(door: Door):
    assert {await door.codes(name) for name in UNSUPPORTED} == {"!BadServiceUnsupported"}


UNKNOWN_SUBSCRIPTION: dict[str, dict[str, Any]] = {
    "ModifySubscription": {},
    "Republish": {},
    "CreateMonitoredItems": {"TimestampsToReturn": BOTH},
    "ModifyMonitoredItems": {"TimestampsToReturn": BOTH},
    "DeleteMonitoredItems": {"MonitoredItemIds": [1]},
    "SetMonitoringMode": {"MonitoredItemIds": [1]},
    "SetTriggering": {"LinksToAdd": [1]},
}


async def test_a_subscription_that_is_not_there_is_named(door: Door):
    told = {
        name: await door.codes(name, SubscriptionId=999_999, **fields) for name, fields in UNKNOWN_SUBSCRIPTION.items()
    }
    assert told == dict.fromkeys(UNKNOWN_SUBSCRIPTION, "!BadSubscriptionIdInvalid")
    for name in ("SetPublishingMode", "TransferSubscriptions", "DeleteSubscriptions"):
        assert await door.codes(name, SubscriptionIds=[999_999]) == "BadSubscriptionIdInvalid", name


def reading(name: Any, attribute: int = Attribute.Value, **more: Any) -> Callable[[Door], ua.ReadValueId]:
    return lambda door: ua.ReadValueId(door.node(name) if isinstance(name, str) else name, attribute, **more)


XML, BINARY = ua.QualifiedName("Default XML"), ua.QualifiedName("Default Binary")
STATUS = ua.NodeId(Ids.Server_ServerStatus)
URIS = ua.NodeId(Ids.Server_NamespaceArray)
READ = {
    "a value": (reading("Speed"), "Good"),
    "no node": (reading(NOWHERE), "BadNodeIdUnknown"),
    "the null node": (reading(ua.NodeId()), "BadNodeIdUnknown"),
    "no attribute": (reading("Speed", 99), "BadAttributeIdInvalid"),
    "a part of an array": (reading(URIS, IndexRange="0"), "Good"),
    "beyond an array": (reading(URIS, IndexRange="500"), "BadIndexRangeNoData"),
    "a part of a number": (reading("Speed", IndexRange="0"), "BadIndexRangeNoData"),
    "a part backwards": (reading(URIS, IndexRange="2:1"), "BadIndexRangeInvalid"),
    "a part in words": (reading(URIS, IndexRange="x"), "BadIndexRangeInvalid"),
    "a part of a name": (reading("Speed", Attribute.DisplayName, IndexRange="0"), "BadIndexRangeNoData"),
    "a part of a right": (reading("Speed", Attribute.UserAccessLevel, IndexRange="0"), "BadIndexRangeNoData"),
    "a structure": (reading(STATUS, DataEncoding=BINARY), "Good"),
    "a structure in XML": (reading(STATUS, DataEncoding=XML), "BadDataEncodingUnsupported"),
    "an unknown encoding": (reading(STATUS, DataEncoding=ua.QualifiedName("x")), "BadDataEncodingInvalid"),
    "another's encoding": (
        reading(STATUS, DataEncoding=ua.QualifiedName("Default Binary", 7)),
        "BadDataEncodingInvalid",
    ),
    "a number in binary": (reading("Speed", DataEncoding=BINARY), "BadDataEncodingInvalid"),
    "a name in binary": (reading("Speed", Attribute.DisplayName, DataEncoding=BINARY), "BadDataEncodingInvalid"),
    "a right in binary": (reading("Speed", Attribute.UserAccessLevel, DataEncoding=BINARY), "BadDataEncodingInvalid"),
}


async def test_each_read_has_the_code_that_fits(door: Door):
    wanted = [make(door) for make, _ in READ.values()]
    told = await door.codes("Read", NodesToRead=wanted, TimestampsToReturn=BOTH)
    assert dict(zip(READ, told.split(), strict=True)) == {name: code for name, (_, code) in READ.items()}


async def test_ages_and_timestamps_of_a_read_are_looked_at_first(door: Door):
    one = {"NodesToRead": [reading("Speed")(door)], "TimestampsToReturn": BOTH}
    for age, code in ((0.0, "Good"), (math.inf, "Good"), (1e308, "Good"), (-1.0, "!BadMaxAgeInvalid")):
        assert await door.codes("Read", **one, MaxAge=age) == code, age
    for age in (math.nan, -math.inf):
        assert await door.codes("Read", **one, MaxAge=age) == "!BadMaxAgeInvalid", age
    for stamps in (4, 7, -1):
        assert await door.codes("Read", **{**one, "TimestampsToReturn": stamps}) == "!BadTimestampsToReturnInvalid"


def browsed(node: Any = SERVER, **more: Any) -> ua.BrowseDescription:
    wanted = ua.BrowseDescription(NodeId=node, BrowseDirection=ua.BrowseDirection.Forward, ResultMask=63)
    return dataclasses.replace(wanted, **more)


BROWSE = {
    "a node": (browsed(), "Good"),
    "no node": (browsed(NOWHERE), "BadNodeIdUnknown"),
    "in no direction": (browsed(BrowseDirection=3), "BadBrowseDirectionInvalid"),
    "along a type of objects": (browsed(ReferenceTypeId=ua.NodeId(Ids.FolderType)), "BadReferenceTypeIdInvalid"),
    "along an object": (browsed(ReferenceTypeId=SERVER), "BadReferenceTypeIdInvalid"),
    "along nothing known": (browsed(ReferenceTypeId=NOWHERE), "BadReferenceTypeIdInvalid"),
    "along references": (browsed(ReferenceTypeId=ua.NodeId(Ids.HierarchicalReferences)), "Good"),
}


async def test_each_browse_has_the_code_that_fits(door: Door):
    told = await door.codes("Browse", NodesToBrowse=[one for one, _ in BROWSE.values()])
    assert dict(zip(BROWSE, told.split(), strict=True)) == {name: code for name, (_, code) in BROWSE.items()}
    view = ua.ViewDescription(ViewId=SERVER)
    assert await door.codes("Browse", NodesToBrowse=[browsed()], View=view) == "!BadViewIdUnknown"


async def test_a_browse_tells_what_it_is_asked_and_releases_what_is_given_back(door: Door):
    bare = (await door.send("Browse", NodesToBrowse=[browsed(ResultMask=0)])).Results[0].References
    full = (await door.send("Browse", NodesToBrowse=[browsed()])).Results[0].References
    assert [one.NodeId for one in bare] == [one.NodeId for one in full]
    assert all(one.ReferenceTypeId.is_null() and not one.BrowseName.Name and not one.NodeClass for one in bare)
    assert all(not one.DisplayName.Text and one.TypeDefinition.is_null() for one in bare)
    named = (await door.send("Browse", NodesToBrowse=[browsed(ResultMask=ua.BrowseResultMask.BrowseName)])).Results[0]
    assert [one.BrowseName for one in named.References] == [one.BrowseName for one in full]
    page = (await door.send("Browse", NodesToBrowse=[browsed()], RequestedMaxReferencesPerNode=1)).Results[0]
    given_back = {"ContinuationPoints": [page.ContinuationPoint], "ReleaseContinuationPoints": True}
    assert await door.codes("BrowseNext", **given_back) == ""
    assert (
        await door.codes("BrowseNext", **{**given_back, "ReleaseContinuationPoints": False})
        == "BadContinuationPointInvalid"
    )


def path(*names: str | None, start: ua.NodeId = SERVER, **more: Any) -> ua.BrowsePath:
    along = {
        "ReferenceTypeId": ua.NodeId(Ids.HierarchicalReferences),
        "IncludeSubtypes": True,
        "IsInverse": False,
        **more,
    }
    elements = [ua.RelativePathElement(TargetName=ua.QualifiedName(name), **along) for name in names]
    return ua.BrowsePath(start, ua.RelativePath(Elements=elements))


PATHS = {
    "a path": (path("ServerStatus", "State"), "Good"),
    "from nowhere": (path("x", start=NOWHERE), "BadNodeIdUnknown"),
    "of no steps": (path(), "BadNothingToDo"),
    "without its last name": (path("ServerStatus", None), "BadBrowseNameInvalid"),
    "without a name between": (path(None, "State"), "BadBrowseNameInvalid"),
    "to nothing": (path("ServerStatus", "x"), "BadNoMatch"),
    "along nothing known": (path("ServerStatus", ReferenceTypeId=NOWHERE), "BadNoMatch"),
    "along an object": (path("ServerStatus", ReferenceTypeId=SERVER), "BadNoMatch"),
    "against its direction": (path("ServerStatus", IsInverse=True), "BadNoMatch"),
    "of too many steps": (path(*["x"] * 500), "BadQueryTooComplex"),
}


async def test_each_path_has_the_code_that_fits(door: Door):
    told = await door.codes("TranslateBrowsePathsToNodeIds", BrowsePaths=[one for one, _ in PATHS.values()])
    assert dict(zip(PATHS, told.split(), strict=True)) == {name: code for name, (_, code) in PATHS.items()}


async def test_a_written_time_is_kept_and_the_servers_own_is_its_own(door: Door):
    early = datetime(2001, 2, 3, 4, 5, 6, tzinfo=UTC)
    given = ua.DataValue(ua.Variant(2.5), SourceTimestamp=early, ServerTimestamp=early)
    item = ua.WriteValue(door.node("Speed"), Attribute.Value, Value=given)
    assert await door.codes("Write", NodesToWrite=[item]) == "Good"
    (told,) = (await door.send("Read", NodesToRead=[reading("Speed")(door)], TimestampsToReturn=BOTH)).Results
    assert told.SourceTimestamp == early
    assert told.ServerTimestamp > early


ITEMS = {
    "a value": (("Speed",), {}, "Good"),
    "no node": ((NOWHERE,), {}, "BadNodeIdUnknown"),
    "no attribute": (("Speed", 99), {}, "BadAttributeIdInvalid"),
    "an unknown mode": (("Speed",), {"MonitoringMode": 7}, "BadMonitoringModeInvalid"),
    "a part in words": (("Speed",), {"IndexRange": "x"}, "BadIndexRangeInvalid"),
    "an unknown encoding": (("Speed",), {"DataEncoding": XML}, "BadDataEncodingInvalid"),
    "a deadband": (("Speed",), {"Filter": absolute()}, "Good"),
    "a deadband on words": ((URIS,), {"Filter": absolute()}, "BadFilterNotAllowed"),
    "a deadband on a structure": ((STATUS,), {"Filter": absolute()}, "BadFilterNotAllowed"),
    "a deadband on a time": (
        (ua.NodeId(Ids.Server_ServerStatus_StartTime),),
        {"Filter": absolute()},
        "BadFilterNotAllowed",
    ),
    "a deadband on a truth": ((ua.NodeId(Ids.Server_Auditing),), {"Filter": absolute()}, "BadFilterNotAllowed"),
    "a deadband on a name": (("Speed", Attribute.DisplayName), {"Filter": absolute()}, "BadFilterNotAllowed"),
    "a deadband on a right": (("Speed", Attribute.AccessLevel), {"Filter": absolute()}, "BadFilterNotAllowed"),
    "a deadband below zero": (("Speed",), {"Filter": absolute(-1.0)}, "BadDeadbandFilterInvalid"),
    "a deadband of no number": (("Speed",), {"Filter": absolute(math.nan)}, "BadDeadbandFilterInvalid"),
    "a deadband of percent without a range": (("Speed",), {"Filter": percent()}, "BadFilterNotAllowed"),
    "an unknown deadband": (
        ("Speed",),
        {"Filter": ua.DataChangeFilter(DeadbandType=9)},
        "BadMonitoredItemFilterUnsupported",
    ),
    "an unknown trigger": (
        ("Speed",),
        {"Filter": ua.DataChangeFilter(Trigger=9)},
        "BadMonitoredItemFilterInvalid",
    ),
    "a filter for events": (("Speed",), {"Filter": events("Message")}, "BadFilterNotAllowed"),
    "an aggregate": (("Speed",), {"Filter": ua.AggregateFilter()}, "BadMonitoredItemFilterUnsupported"),
    "events": ((SERVER, 12), {"Filter": events("Message", "Severity")}, "Good"),
    "events of what has none": (("Speed", 12), {"Filter": events("Message")}, "BadAttributeIdInvalid"),
    "events without a filter": ((SERVER, 12), {}, "BadEventFilterInvalid"),
    "events by a filter for values": ((SERVER, 12), {"Filter": absolute()}, "BadEventFilterInvalid"),
    "events without fields": ((SERVER, 12), {"Filter": events()}, "BadEventFilterInvalid"),
}


async def test_each_item_has_the_code_that_fits(door: Door):
    wanted = [monitored(door, *where, **more) for where, more, _ in ITEMS.values()]
    results = (await items(door, *wanted)).Results
    told = [one.StatusCode.name for one in results]
    await drop(door, results)
    assert dict(zip(ITEMS, told, strict=True)) == {name: code for name, (_, _, code) in ITEMS.items()}


@pytest.mark.parametrize("interval", [math.nan, math.inf, -math.inf, -1.0, 0.0, 1e308])
async def test_a_sampling_interval_becomes_one_that_is(door: Door, interval: float):
    (made,) = (await items(door, monitored(door, SamplingInterval=interval))).Results
    changed = ua.MonitoredItemModifyRequest(made.MonitoredItemId)
    changed.RequestedParameters.SamplingInterval = interval
    fields = {"SubscriptionId": door.subscription, "TimestampsToReturn": BOTH, "ItemsToModify": [changed]}
    (modified,) = (await door.send("ModifyMonitoredItems", **fields)).Results
    await drop(door, [made])
    for one in (made, modified):
        assert one.StatusCode.is_good()
        assert 0 <= one.RevisedSamplingInterval <= 3_600_000


async def test_items_are_changed_one_by_one(door: Door):
    (made,) = (await items(door, monitored(door, URIS))).Results
    wanted = [ua.MonitoredItemModifyRequest(made.MonitoredItemId), ua.MonitoredItemModifyRequest(999_999)]
    wanted[0].RequestedParameters.Filter = absolute()
    fields = {"SubscriptionId": door.subscription, "ItemsToModify": wanted}
    told = await door.codes("ModifyMonitoredItems", **fields, TimestampsToReturn=BOTH)
    assert told == "BadFilterNotAllowed BadMonitoredItemIdInvalid"
    assert await door.codes("ModifyMonitoredItems", **fields, TimestampsToReturn=5) == "!BadTimestampsToReturnInvalid"
    own = {"SubscriptionId": door.subscription, "MonitoredItemIds": [made.MonitoredItemId, 999_999]}
    assert await door.codes("SetMonitoringMode", **own, MonitoringMode=7) == "!BadMonitoringModeInvalid"
    for name in ("SetMonitoringMode", "DeleteMonitoredItems"):
        assert await door.codes(name, **own) == "Good BadMonitoredItemIdInvalid"
