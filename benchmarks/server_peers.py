"""The servers that ``benchmarks.server`` compares, each in a process of its own: ours, and asyncua as it comes.

Both load the same NodeSets and have the same methods. A line on stdin asks a server how much it holds; it serves until
stdin closes.
"""

import asyncio
import json
import sys
import time
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.structures104 import new_struct, new_struct_field
from asyncua.server.internal_server import InternalServer
from asyncua.server.server import Server
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.ua_binary import struct_to_binary

from opcua_skill.security import SecuritySettings
from opcua_skill.security.access import Identity, Peer, Role
from opcua_skill.server.nodesets import load_node_sets
from opcua_skill.stack.address_space.values import node_id
from opcua_skill.stack.internal_server import SkillInternalServer
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.server import SkillServer
from opcua_skill.stack.services.calls import Argument, MethodSpec, add_method

SERVER_URI = "urn:opcua-skill:server"
SUBSCRIBERS, ITEMS, CHANGES = 50, 100, 10


class Everybody:
    """A sign-in that lets everybody in, as the peer does: password hashing is not what is compared."""

    async def by_password(self, name: str, password: str, peer: Peer) -> Identity | None:
        """Return the user."""
        return Identity(name, Role.ADMIN)

    async def by_certificate(self, certificate: bytes, peer: Peer) -> Identity | None:
        """Return nobody."""
        return None


async def _demonstration_type(server: Server, index: int) -> ua.NodeId:
    fields = [
        new_struct_field("Times", ua.VariantType.Double, array=True),
        new_struct_field("Positions", ua.VariantType.Double, array=True),
        new_struct_field("Triggers", ua.VariantType.Boolean, array=True),
    ]
    kind, _ = await new_struct(server, index, "BenchmarkDemonstration", fields)
    await server.load_data_type_definitions()
    return kind.nodeid


async def _ours(folder: Path) -> Server:
    security = SecuritySettings(
        folder,
        endpoint="opc.tcp://127.0.0.1:0",
        application_uri=SERVER_URI,
        policies=("Basic256Sha256",),
        insecure_trust_every_client=True,
    )
    limits = Limits(connections=300, connections_per_address=300, sessions=300)
    server = SkillServer(Everybody(), security, limits=limits)
    await server.init()
    index = await server.register_namespace("urn:benchmark")
    kind = await _demonstration_type(server, index)
    cell = await server.nodes.objects.add_object(node_id("Cell", index), ua.QualifiedName("Cell", index))

    async def double(value: float) -> tuple[float]:
        return (2.0 * value,)

    async def count(values: list[Any]) -> tuple[int]:
        return (len(values),)

    number, int32 = node_id(Ids.Double), node_id(Ids.Int32)
    for name, inputs, outputs, handler in (
        ("Double", Argument("Value", number), Argument("Result", number), double),
        ("Count", Argument("Values", kind, 1), Argument("Result", int32), count),
    ):
        spec = MethodSpec(name, (inputs,), (outputs,), handler, Role.OBSERVER.and_above, changes=False)
        await add_method(server, cell, spec, node_id(f"Cell/{name}", index), ua.QualifiedName(name, index))
    return server


async def _bare(folder: Path) -> Server:
    server = Server()
    await server.init()
    server.set_endpoint("opc.tcp://127.0.0.1:0")
    await server.set_application_uri(SERVER_URI)
    await server.load_certificate(folder / "server.der")
    await server.load_private_key(folder / "server.pem")
    server.set_security_policy([ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
    index = await server.register_namespace("urn:benchmark")
    kind = await _demonstration_type(server, index)
    cell = await server.nodes.objects.add_object(node_id("Cell", index), ua.QualifiedName("Cell", index))

    async def double(parent: ua.NodeId, value: ua.Variant) -> list[ua.Variant]:
        return [ua.Variant(2.0 * value.Value, ua.VariantType.Double)]

    async def count(parent: ua.NodeId, values: ua.Variant) -> list[ua.Variant]:
        return [ua.Variant(len(values.Value), ua.VariantType.Int32)]

    for name, inputs, handler in (("Double", ua.VariantType.Double, double), ("Count", kind, count)):
        place = node_id(f"Cell/{name}", index)
        await cell.add_method(place, ua.QualifiedName(name, index), handler, [inputs], [ua.VariantType.Double])
    return server


async def _serve(which: str, folder: Path) -> None:
    server = await (_ours if which == "ours" else _bare)(folder)
    await load_node_sets(server)
    async with server:
        assert server.bserver is not None
        print(json.dumps({"port": server.bserver.port}), flush=True)
        while await asyncio.to_thread(sys.stdin.readline):
            print(json.dumps(_held(server)), flush=True)


def _held(server: Server) -> dict[str, int]:
    """Return how many sessions, subscriptions and tasks there are now."""
    inside = server.iserver
    return {
        "sessions": len(inside._external_sessions),
        "subscriptions": len(inside.subscription_service.subscriptions),
        "tasks": len(asyncio.all_tasks()),
    }


async def fan_out(server: InternalServer) -> float:
    """Return the notifications a second that a server makes and encodes for 50 subscriptions to 100 values each."""
    nodes = []
    for number in range(ITEMS):
        added: Any = ua.AddNodesItem()
        added.RequestedNewNodeId = node_id(f"v{number}", 1)
        added.BrowseName = ua.QualifiedName(f"v{number}", 1)  # pyright: ignore[reportArgumentType]
        added.NodeClass = ua.NodeClass.Variable
        added.ParentNodeId, added.ReferenceTypeId = node_id(Ids.ObjectsFolder), node_id(Ids.Organizes)
        added.NodeAttributes = ua.VariableAttributes()
        added.NodeAttributes.Value = ua.Variant(0.0)
        server.node_mgt_service.add_nodes([added])[0].StatusCode.check()
        nodes.append(added.RequestedNewNodeId)
    sent = 0

    async def publish(result: ua.PublishResult, request: Any) -> None:
        nonlocal sent
        response = ua.PublishResponse()
        response.Parameters = result
        sent += len(struct_to_binary(response)) > 100

    subscriptions = []
    for _ in range(SUBSCRIBERS):
        wanted: Any = ua.CreateSubscriptionParameters()
        wanted.RequestedPublishingInterval, wanted.PublishingEnabled = 3_600_000.0, True
        wanted.RequestedLifetimeCount = wanted.RequestedMaxKeepAliveCount = 1000
        made = await server.subscription_service.create_subscription(
            wanted, publish, server.isession.session_id, request_callback=lambda _: object()
        )
        items: Any = ua.CreateMonitoredItemsParameters()
        items.SubscriptionId = made.SubscriptionId
        for number, node in enumerate(nodes):
            item: Any = ua.MonitoredItemCreateRequest()
            item.ItemToMonitor.NodeId, item.ItemToMonitor.AttributeId = node, AttributeIds.Value
            item.MonitoringMode = ua.MonitoringMode.Reporting
            item.RequestedParameters.ClientHandle, item.RequestedParameters.QueueSize = number, 1
            items.ItemsToCreate.append(item)
        await server.subscription_service.create_monitored_items(items)
        subscriptions.append(server.subscription_service.subscriptions[made.SubscriptionId])
    await asyncio.sleep(0.1)  # the first values have gone out
    sent, begun = 0, time.process_time()
    for change in range(1, CHANGES + 1):
        for node in nodes:
            await server.write_attribute_value(node, ua.DataValue(ua.Variant(float(change))))
        for subscription in subscriptions:
            await subscription.publish_results()
    spent = time.process_time() - begun
    await server.subscription_service.delete_subscriptions([s.data.SubscriptionId for s in subscriptions])
    assert sent == SUBSCRIBERS * CHANGES
    return SUBSCRIBERS * ITEMS * CHANGES / spent


async def _fan_out(which: str, folder: Path) -> None:
    """Measure in a process of its own: installing our decoders must not speed the peer up or slow it down."""
    if which == "ours":
        server: InternalServer = SkillInternalServer(Everybody(), SecuritySettings(folder), Limits())
    else:
        server = InternalServer()
    await server.init()
    print(json.dumps({"rate": await fan_out(server)}), flush=True)
    server.method_service.stop()


if __name__ == "__main__":
    what, place = sys.argv[1], Path(sys.argv[2])
    fanning_out = what.removeprefix("fan-out-")
    asyncio.run(_fan_out(fanning_out, place) if fanning_out != what else _serve(what, place))
