"""What the checks of our stack cost: the same calls on our server and on bare asyncua, both encrypted, in one run.

Servers run in processes of their own; what counts is their processor time for each call, which other work on the
machine does not change much. Rounds alternate between the servers, and the lowest of each is taken.
"""

import asyncio
import contextlib
import json
import os
import struct
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import asyncua
from asyncua import ua
from asyncua.client.client import Client
from asyncua.common.structures104 import new_struct, new_struct_field
from asyncua.common.subscription import DataChangeNotificationHandler
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.server.internal_server import InternalServer
from asyncua.server.server import Server
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.ua_binary import struct_to_binary

from opcua_skill.security import SecuritySettings, ensure_client_certificate, ensure_server_certificate
from opcua_skill.stack.access import Identity, Peer, Role
from opcua_skill.stack.calls import Argument, MethodSpec, add_method
from opcua_skill.stack.internal import SkillInternalServer
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.server import SkillServer
from opcua_skill.stack.values import node_id

PEER = f"asyncua {asyncua.__version__}"
SERVER_URI, CLIENT_URI = "urn:opcua-skill:server", "urn:opcua-skill:benchmark"
ROUNDS, CALLS, PAYLOADS, CLIENTS = 3, 1000, 60, 100
DEMONSTRATIONS, POINTS = 20, 1500
SUBSCRIBERS, ITEMS, CHANGES = 50, 100, 10
CYCLES = 1000
TICK = os.sysconf("SC_CLK_TCK")
PAGE = os.sysconf("SC_PAGE_SIZE")
MIB = 1024 * 1024


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
    async with server:
        assert server.bserver is not None
        print(json.dumps({"port": server.bserver.port}), flush=True)
        await asyncio.to_thread(sys.stdin.read)


@dataclass(frozen=True)
class Running:
    """A server process."""

    pid: int
    url: str
    folder: Path
    started_in: float

    def processor_seconds(self) -> float:
        """Return the processor time the server has used."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / TICK

    def memory(self) -> float:
        """Return the resident memory in MiB."""
        return int(Path(f"/proc/{self.pid}/statm").read_text().split()[1]) * PAGE / MIB


@asynccontextmanager
async def running(which: str, folder: Path) -> AsyncIterator[Running]:
    """Start a server and measure the seconds until its first call is answered; stop it at the end."""
    begun = time.perf_counter()
    command = (sys.executable, "-m", "benchmarks.server", which, str(folder))
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe)
    assert process.stdout is not None
    try:
        told = json.loads(await process.stdout.readline())
        url = f"opc.tcp://127.0.0.1:{told['port']}"
        early = Running(process.pid, url, folder, 0.0)
        async with signed_in(early) as client:
            await calls(client, 1)
        yield Running(process.pid, url, folder, time.perf_counter() - begun)
    finally:
        process.kill()
        await process.communicate()


@asynccontextmanager
async def signed_in(server: Running) -> AsyncIterator[Client]:
    """Connect and sign in."""
    client = Client(server.url, timeout=60, watchdog_intervall=60)
    client.application_uri = CLIENT_URI
    client.set_user("admin")
    client.set_password("benchmark")
    own, mode = server.folder / "client.der", ua.MessageSecurityMode.SignAndEncrypt
    theirs = str(server.folder / "server.der")
    key = str(server.folder / "client.pem")
    await client.set_security(SecurityPolicyBasic256Sha256, str(own), key, server_certificate=theirs, mode=mode)
    async with client:
        yield client


async def calls(client: Client, number: int, name: str = "Double", argument: ua.Variant | None = None) -> None:
    """Call a method a number of times."""
    index = await client.get_namespace_index("urn:benchmark")
    cell = client.get_node(node_id("Cell", index))
    variant = argument or ua.Variant(1.5)
    for _ in range(number):
        await cell.call_method(node_id(f"Cell/{name}", index), variant)


async def _per_call(server: Running, clients: Sequence[Client], number: int) -> float:
    """Return the milliseconds of processor time of one small call."""
    before = server.processor_seconds()
    await asyncio.gather(*(calls(client, number // len(clients)) for client in clients))
    return (server.processor_seconds() - before) / number * 1000


async def _per_payload(server: Running) -> float:
    """Return the milliseconds of processor time of a call with 20 demonstrations of 1500 points."""
    async with signed_in(server) as client:
        index = await client.get_namespace_index("urn:benchmark")
        method = client.get_node(node_id("Cell/Count", index))
        (declared,) = await (await method.get_child("0:InputArguments")).read_value()
        (encoding,) = await client.get_node(declared.DataType).get_referenced_nodes(Ids.HasEncoding)
        times, places = [0.1] * POINTS, [0.2] * 2 * POINTS
        form = f"<i{POINTS}di{2 * POINTS}di{POINTS}?"
        body = struct.pack(form, POINTS, *times, 2 * POINTS, *places, POINTS, *[True] * POINTS)
        kind: Any = ua.ExtensionObject
        one = kind(TypeId=encoding.nodeid, Body=body)
        payload: Any = ua.Variant([one] * DEMONSTRATIONS, ua.VariantType.ExtensionObject)
        await calls(client, 1, "Count", payload)
        before = server.processor_seconds()
        await calls(client, PAYLOADS, "Count", payload)
        return (server.processor_seconds() - before) / PAYLOADS * 1000


async def _lowest(ours: Running, bare: Running, measure: Any) -> tuple[float, float]:
    found: dict[int, list[float]] = {ours.pid: [], bare.pid: []}
    for _ in range(ROUNDS):
        for server in (bare, ours):
            found[server.pid].append(await measure(server))
    return min(found[ours.pid]), min(found[bare.pid])


async def _one_client(server: Running) -> float:
    async with signed_in(server) as client:
        return await _per_call(server, [client], CALLS)


async def _many_clients(server: Running) -> float:
    async with contextlib.AsyncExitStack() as stack:
        clients = []
        for _ in range(CLIENTS):
            client = await stack.enter_async_context(signed_in(server))
            subscription = await client.create_subscription(1000, _Ignores())
            await subscription.subscribe_data_change(client.nodes.server_state)
            clients.append(client)
        return await _per_call(server, clients, 10 * CLIENTS)


class _Ignores(DataChangeNotificationHandler):
    def datachange_notification(self, node: Any, val: Any, data: Any) -> None: ...


async def _cycles(server: Running) -> tuple[float, int]:
    """Return the growth in MiB over connect, sign in, subscribe, drop; and how many cycles failed."""
    failed = 0

    async def cycle() -> None:
        async with signed_in(server) as client:
            subscription = await client.create_subscription(500, _Ignores())
            await subscription.subscribe_data_change(client.nodes.server_state)
            protocol: Any = client.uaclient.protocol
            protocol.transport.abort()

    for _ in range(CYCLES // 10):
        await asyncio.gather(cycle(), return_exceptions=True)
    before = server.memory()
    for _ in range(CYCLES):
        (result,) = await asyncio.gather(cycle(), return_exceptions=True)
        failed += isinstance(result, Exception) and not isinstance(result, (ua.UaError, ConnectionError))
    return server.memory() - before, failed


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


async def _fan_out_rate(which: str, folder: Path) -> float:
    command = (sys.executable, "-m", "benchmarks.server", f"fan-out-{which}", str(folder))
    process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    told, _ = await process.communicate()
    return json.loads(told)["rate"]


def row(
    name: str, ours: float, theirs: float, goal: str, *, at_most: float = 0.0, at_least: float = 0.0
) -> dict[str, Any]:
    """Return one line of the table; the ratio is ours to theirs, and the goal bounds it from above or from below."""
    ratio = ours / theirs if theirs else float("inf")
    holds = ratio <= at_most if at_most else ratio >= at_least
    numbers = {"ours": round(ours, 4), "theirs": round(theirs, 4), "ratio": round(ratio, 3)}
    return {"name": name, "peer": PEER, **numbers, "goal": goal, "holds": holds, "runs": ROUNDS}


async def measured() -> list[dict[str, Any]]:
    """Return all rows."""
    with tempfile.TemporaryDirectory(prefix="opcua-skill-benchmark-") as name:
        folder = Path(name)
        ensure_server_certificate(folder, SERVER_URI, "benchmark")
        ensure_client_certificate(folder, CLIENT_URI)
        starts: dict[str, list[float]] = {"ours": [], "bare": []}
        for _ in range(ROUNDS):
            for which in starts:
                async with running(which, folder) as server:
                    starts[which].append(server.started_in)
        rates: dict[str, list[float]] = {"ours": [], "bare": []}
        for _ in range(ROUNDS):
            for which in rates:
                rates[which].append(await _fan_out_rate(which, folder))
        async with running("ours", folder) as ours, running("bare", folder) as bare:
            small = await _lowest(ours, bare, _one_client)
            payload = await _lowest(ours, bare, _per_payload)
            many = await _lowest(ours, bare, _many_clients)
            grown, failed = await _cycles(ours)
    start = min(starts["ours"]), min(starts["bare"])
    fan = max(rates["ours"]), max(rates["bare"])
    cycles = row(f"growth over {CYCLES} dropped sessions, MiB, against 16 MiB", grown, 16.0, "at most 1", at_most=1.0)
    return [
        row("server time of a small call, ms", *small, "at most 1.25", at_most=1.25),
        row("server time of a call with 20 x 1500 points, ms", *payload, "at most 1.25", at_most=1.25),
        row("calls a server second, 100 clients", 1000 / many[0], 1000 / many[1], "at least 0.8", at_least=0.8),
        row("notifications a second, 50 x 100 values", *fan, "at least 2", at_least=2.0),
        row("start to first answered call, s", *start, "at most 1.5", at_most=1.5),
        {**cycles, "peer": "the limit", "runs": 1, "holds": cycles["holds"] and failed == 0},
    ]


def rows() -> Iterator[dict[str, Any]]:
    """Yield one row a figure, for the table of ``opcua-skill bench server``."""
    yield from asyncio.run(measured())


if __name__ == "__main__":
    if len(sys.argv) > 2:
        what, place = sys.argv[1], Path(sys.argv[2])
        asyncio.run(
            _fan_out(what.removeprefix("fan-out-"), place) if what.startswith("fan-out") else _serve(what, place)
        )
    else:
        for line in rows():
            print(json.dumps(line), flush=True)
