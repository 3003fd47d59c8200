"""A signed-in client that sends requests as they are, and the wishes that tests put to it."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

from asyncua import Client, ua
from asyncua.ua.ua_binary import struct_from_binary

from tests.opcua_skill.stack.small_server import Bench

Ids, Attribute = ua.ObjectIds, ua.AttributeIds
SERVER = ua.NodeId(Ids.Server)
BASE = ua.NodeId(Ids.BaseEventType)
BOTH = ua.TimestampsToReturn.Both


@dataclass
class Door:
    """A signed-in client that sends requests as they are, with a subscription and two items of its own."""

    client: Client
    bench: Bench
    subscription: int = 0
    items: tuple[int, ...] = ()

    def node(self, name: str) -> ua.NodeId:
        return ua.NodeId(f"Cell/{name}", self.bench.index)

    async def send(self, kind: str, **fields: Any) -> Any:
        """Return the response to a request; raises the status code of a service fault."""
        request = getattr(ua, f"{kind}Request")()
        at = request.Parameters if hasattr(request, "Parameters") else request
        for name, value in fields.items():
            assert name in at.__dataclass_fields__, name
            setattr(at, name, value)
        data = await self.client.uaclient._send_request(request)
        response = getattr(ua, f"{kind}Response")
        return struct_from_binary(response, data)

    async def codes(self, kind: str, **fields: Any) -> str:
        """Return the codes of the operations of a request, or of its service fault after an exclamation mark."""
        try:
            response = await self.send(kind, **fields)
        except ua.UaStatusCodeError as fault:
            return f"!{ua.StatusCode(fault.code).name}"
        at = response if hasattr(response, "Results") else getattr(response, "Parameters", None)
        results = getattr(at, "Results", None) or []
        return " ".join(getattr(one, "StatusCode", one).name if one is not None else "None" for one in results)


@asynccontextmanager
async def open_door(bench: Bench, user: str = "engineer", **wanted: Any) -> AsyncIterator[Door]:
    """Sign in and make a subscription that says nothing by itself, with two items."""
    slow = {"RequestedPublishingInterval": 1000.0, "RequestedMaxKeepAliveCount": 600, "PublishingEnabled": True}
    async with bench.client(user) as client:
        door = Door(client, bench)
        made = await door.send("CreateSubscription", **{**slow, **wanted})
        door.subscription = made.Parameters.SubscriptionId
        results = (await items(door, monitored(door, "Speed"), monitored(door, "Locked"))).Results
        door.items = tuple(one.MonitoredItemId for one in results)
        yield door


async def items(door: Door, *wanted: ua.MonitoredItemCreateRequest, stamps: Any = BOTH) -> Any:
    fields = {"SubscriptionId": door.subscription, "TimestampsToReturn": stamps, "ItemsToCreate": list(wanted)}
    return await door.send("CreateMonitoredItems", **fields)


def monitored(door: Door, name: Any = "Speed", attribute: int = Attribute.Value, **more: Any) -> Any:
    node = name if isinstance(name, ua.NodeId) else door.node(name)
    wanted = ua.MonitoredItemCreateRequest(MonitoringMode=ua.MonitoringMode.Reporting)
    wanted.ItemToMonitor = ua.ReadValueId(node, attribute)
    for field, value in more.items():
        at = next(
            one
            for one in (wanted, wanted.ItemToMonitor, wanted.RequestedParameters)
            if field in one.__dataclass_fields__
        )
        setattr(at, field, value)
    return wanted


async def drop(door: Door, results: list[Any]) -> None:
    made = [one.MonitoredItemId for one in results if one.StatusCode.is_good()]
    await door.send("DeleteMonitoredItems", SubscriptionId=door.subscription, MonitoredItemIds=made)


def absolute(value: float = 1.0) -> ua.DataChangeFilter:
    return ua.DataChangeFilter(ua.DataChangeTrigger.StatusValue, DeadbandType=1, DeadbandValue=value)


def percent(value: float = 10.0) -> ua.DataChangeFilter:
    return ua.DataChangeFilter(ua.DataChangeTrigger.StatusValue, DeadbandType=2, DeadbandValue=value)


def events(*paths: str, where: Any = None, **more: Any) -> ua.EventFilter:
    wanted = ua.EventFilter()
    wanted.SelectClauses = [field(one, **more) for one in paths]
    wanted.WhereClause.Elements = where or []
    return wanted


def field(name: str, kind: ua.NodeId = BASE, **more: Any) -> ua.SimpleAttributeOperand:
    steps = [ua.QualifiedName(one) for one in name.split("/") if one]
    return ua.SimpleAttributeOperand(kind, steps, **{"AttributeId": Attribute.Value, **more})
