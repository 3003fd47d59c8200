"""What the checks of our stack cost: the same calls on our server and on bare asyncua, both encrypted, in one run.

Servers run in processes of their own; what counts is their processor time for each call, in nanoseconds of their own
clocks, which other work on the machine does not change much. Rounds alternate between the servers, and the lowest of
each is taken.
"""

import asyncio
import contextlib
import json
import logging
import os
import struct
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import asyncua
from asyncua import ua
from asyncua.client.client import Client
from asyncua.common.subscription import DataChangeNotificationHandler
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.ua.object_ids import ObjectIds as Ids

from benchmarks.server_peers import SERVER_URI
from opcua_skill.security import ensure_client_certificate, ensure_server_certificate
from opcua_skill.stack.address_space.values import node_id

PEER = f"asyncua {asyncua.__version__}"
CLIENT_URI = "urn:opcua-skill:benchmark"
STARTS, FAN_OUTS, ROUNDS = 3, 2, 8
CALLS, PAYLOADS, CLIENTS = 300, 10, 100
DEMONSTRATIONS, POINTS = 20, 1500
CYCLES, CYCLES_BEFORE = 1000, 100
PAGE = os.sysconf("SC_PAGE_SIZE")
MIB = 1024 * 1024
Measure = Callable[[], Awaitable[float]]


@dataclass(frozen=True)
class Running:
    """A server process."""

    process: asyncio.subprocess.Process
    url: str
    folder: Path
    started_in: float

    def processor_ms(self) -> float:
        """Return the processor time the server has used, from the process's own clock (Linux)."""
        return time.clock_gettime_ns((~self.process.pid) << 3 | 2) / 1e6

    def memory(self) -> float:
        """Return the resident memory in MiB."""
        return int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]) * PAGE / MIB

    async def held(self) -> dict[str, int]:
        """Return how many sessions, subscriptions and tasks the server says it has."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(b"\n")
        return json.loads(await self.process.stdout.readline())


@asynccontextmanager
async def running(which: str, folder: Path) -> AsyncIterator[Running]:
    """Start a server and measure the seconds until its first call is answered; stop it at the end."""
    begun = time.perf_counter()
    command = (sys.executable, "-m", "benchmarks.server_peers", which, str(folder))
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, stderr=asyncio.subprocess.DEVNULL)
    assert process.stdout is not None
    try:
        told = json.loads(await process.stdout.readline())
        url = f"opc.tcp://127.0.0.1:{told['port']}"
        async with signed_in(Running(process, url, folder, 0.0)) as client:
            await calls(client, 1)
        yield Running(process, url, folder, time.perf_counter() - begun)
    finally:
        process.kill()
        await process.communicate()


async def client_of(server: Running) -> Client:
    """Return a client that has not connected yet."""
    client = Client(server.url, timeout=60, watchdog_intervall=60)
    client.application_uri = CLIENT_URI
    client.set_user("admin")
    client.set_password("benchmark")
    own, mode = server.folder / "client.der", ua.MessageSecurityMode.SignAndEncrypt
    theirs = str(server.folder / "server.der")
    key = str(server.folder / "client.pem")
    await client.set_security(SecurityPolicyBasic256Sha256, str(own), key, server_certificate=theirs, mode=mode)
    return client


@asynccontextmanager
async def signed_in(server: Running) -> AsyncIterator[Client]:
    """Connect and sign in."""
    async with await client_of(server) as client:
        yield client


async def calls(client: Client, number: int, name: str = "Double", argument: ua.Variant | None = None) -> None:
    """Call a method a number of times."""
    index = await client.get_namespace_index("urn:benchmark")
    cell = client.get_node(node_id("Cell", index))
    variant = argument or ua.Variant(1.5)
    for _ in range(number):
        await cell.call_method(node_id(f"Cell/{name}", index), variant)


class Listener(DataChangeNotificationHandler):
    """Counts what a subscription brings."""

    def __init__(self) -> None:
        self.heard = 0

    def datachange_notification(self, node: Any, val: Any, data: Any) -> None:
        """Count one."""
        self.heard += 1


class Clients:
    """So and so many clients of one server, each signed in and subscribed."""

    def __init__(self, server: Running) -> None:
        self.server = server
        self.all: list[Client] = []
        self._listeners: list[Listener] = []

    async def sign_in(self, number: int, stack: contextlib.AsyncExitStack) -> None:
        """Sign clients in and subscribe them to the server's time, until the stack is left."""
        for _ in range(number):
            client = await stack.enter_async_context(signed_in(self.server))
            listener = Listener()
            subscription = await client.create_subscription(1000, listener)
            await subscription.subscribe_data_change(client.get_node(node_id(Ids.Server_ServerStatus_CurrentTime)))
            self.all.append(client)
            self._listeners.append(listener)

    def deaf(self) -> int:
        """Return how many have not heard from their subscription."""
        return sum(not listener.heard for listener in self._listeners)

    async def per_call(self, number: int) -> float:
        """Return the milliseconds of the server's processor time for one small call, by all clients at once."""
        each = number // len(self.all)
        before = self.server.processor_ms()
        await asyncio.gather(*(calls(client, each) for client in self.all))
        return (self.server.processor_ms() - before) / (each * len(self.all))

    async def per_payload(self) -> Measure:
        """Return what measures the milliseconds of the server's processor time for a call with all demonstrations."""
        client = self.all[0]
        argument = await payload(client)

        async def measure() -> float:
            before = self.server.processor_ms()
            await calls(client, PAYLOADS, "Count", argument)
            return (self.server.processor_ms() - before) / PAYLOADS

        return measure


async def payload(client: Client) -> ua.Variant:
    """Return 20 demonstrations of 1500 points as an argument."""
    index = await client.get_namespace_index("urn:benchmark")
    method = client.get_node(node_id("Cell/Count", index))
    (declared,) = await (await method.get_child("0:InputArguments")).read_value()
    (encoding,) = await client.get_node(declared.DataType).get_referenced_nodes(Ids.HasEncoding)
    times, places = [0.1] * POINTS, [0.2] * 2 * POINTS
    form = f"<i{POINTS}di{2 * POINTS}di{POINTS}?"
    body = struct.pack(form, POINTS, *times, 2 * POINTS, *places, POINTS, *[True] * POINTS)
    kind: Any = ua.ExtensionObject
    one = kind(TypeId=encoding.nodeid, Body=body)
    return ua.Variant([one] * DEMONSTRATIONS, ua.VariantType.ExtensionObject)  # pyright: ignore[reportArgumentType]


async def lowest(ours: Measure, bare: Measure) -> tuple[float, float]:
    """Return the lowest that each gives, measured in turns."""
    found = [(await ours(), await bare()) for _ in range(ROUNDS)]
    return min(mine for mine, _ in found), min(theirs for _, theirs in found)


async def calls_compared(ours: Running, bare: Running) -> list[dict[str, Any]]:
    """Return the rows about calls: one client, a large payload, and a hundred clients that are subscribed too."""
    async with contextlib.AsyncExitStack() as stack:
        mine, theirs = Clients(ours), Clients(bare)
        await mine.sign_in(1, stack)
        await theirs.sign_in(1, stack)
        small = await lowest(lambda: mine.per_call(CALLS), lambda: theirs.per_call(CALLS))
        large = await lowest(await mine.per_payload(), await theirs.per_payload())
        await mine.sign_in(CLIENTS - 1, stack)
        await theirs.sign_in(CLIENTS - 1, stack)
        crowd = await lowest(lambda: mine.per_call(10 * CLIENTS), lambda: theirs.per_call(10 * CLIENTS))
        deaf = mine.deaf() + theirs.deaf()
    together = row(
        f"calls a second of server time, {CLIENTS} subscribed clients",
        1000 / crowd[0],
        1000 / crowd[1],
        "at least 0.8",
        at_least=0.8,
    )
    return [
        row("server time of a small call, ms", *small, "at most 1.25", at_most=1.25),
        row(f"server time of a call with {DEMONSTRATIONS} x {POINTS} points, ms", *large, "at most 1.25", at_most=1.25),
        {**together, "holds": together["holds"] and not deaf},
    ]


async def cycles(server: Running, number: int) -> int:
    """Connect, sign in, subscribe, drop; return how often it did not come to the dropping."""
    failed = 0
    for _ in range(number):
        client = await client_of(server)
        try:
            await client.connect()
            subscription = await client.create_subscription(500, Listener())
            await subscription.subscribe_data_change(client.nodes.server_state)
        except (ua.UaError, OSError, TimeoutError):
            failed += 1
        protocol: Any = client.uaclient.protocol
        if protocol is not None and protocol.transport is not None:
            protocol.transport.abort()
        await asyncio.gather(client.disconnect(), return_exceptions=True)
    return failed


async def settled(server: Running) -> dict[str, int]:
    """Return what the server holds when that has stopped changing."""
    held, before = await server.held(), {}
    while held != before:
        await asyncio.sleep(2.0)
        held, before = await server.held(), held
    return held


async def drops_measured(server: Running) -> list[dict[str, Any]]:
    """Return the rows about clients that go away without a word."""
    await cycles(server, CYCLES_BEFORE)
    held, memory = await settled(server), server.memory()
    failed = await cycles(server, CYCLES)
    after, grown = await settled(server), server.memory() - memory
    kept = row(
        f"sessions, subscriptions and tasks after {CYCLES} dropped clients, against before",
        sum(after.values()),
        sum(held.values()),
        "at most 1",
        at_most=1.0,
    )
    space = row(f"MiB grown over {CYCLES} dropped clients, against 16", grown, 16.0, "at most 1", at_most=1.0)
    good = not failed and all(after[name] <= held[name] for name in held)
    itself = {"peer": "the limit", "runs": 1}
    return [{**kept, **itself, "holds": good}, {**space, **itself}]


async def _fan_out_rate(which: str, folder: Path) -> float:
    command = (sys.executable, "-m", "benchmarks.server_peers", f"fan-out-{which}", str(folder))
    process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    told, _ = await process.communicate()
    return json.loads(told)["rate"]


def row(
    name: str, ours: float, theirs: float, goal: str, *, at_most: float = 0.0, at_least: float = 0.0, runs: int = ROUNDS
) -> dict[str, Any]:
    """Return one line of the table; the ratio is ours to theirs, and the goal bounds it from above or from below."""
    ratio = ours / theirs if theirs else float("inf")
    holds = ratio <= at_most if at_most else ratio >= at_least
    numbers = {"ours": round(ours, 4), "theirs": round(theirs, 4), "ratio": round(ratio, 3)}
    return {"name": name, "peer": PEER, **numbers, "goal": goal, "holds": holds, "runs": runs}


async def called(folder: Path) -> list[dict[str, Any]]:
    """Return the rows about calls."""
    async with running("ours", folder) as ours, running("bare", folder) as bare:
        return await calls_compared(ours, bare)


async def fanned_out(folder: Path) -> list[dict[str, Any]]:
    """Return the row about notifications."""
    rates = [(await _fan_out_rate("ours", folder), await _fan_out_rate("bare", folder)) for _ in range(FAN_OUTS)]
    best = max(mine for mine, _ in rates), max(theirs for _, theirs in rates)
    name = "notifications a second of server time, 50 x 100 values"
    return [row(name, *best, "at least 2", at_least=2.0, runs=FAN_OUTS)]


async def started(folder: Path) -> list[dict[str, Any]]:
    """Return the row about starting."""
    seconds: dict[str, list[float]] = {"ours": [], "bare": []}
    for _ in range(STARTS):
        for which in seconds:
            async with running(which, folder) as server:
                seconds[which].append(server.started_in)
    best = min(seconds["ours"]), min(seconds["bare"])
    return [row("start to first answered call, s, same NodeSets", *best, "at most 1.5", at_most=1.5, runs=STARTS)]


async def dropped(folder: Path) -> list[dict[str, Any]]:
    """Return the rows about clients that go away without a word."""
    async with running("ours", folder) as ours:
        return await drops_measured(ours)


def rows() -> Iterator[dict[str, Any]]:
    """Yield one row a figure, for the table of ``opcua-skill bench server``, each as soon as it is known."""
    logging.getLogger("asyncua").setLevel(logging.ERROR)  # the client tells of every value that a server revises
    with tempfile.TemporaryDirectory(prefix="opcua-skill-benchmark-") as name:
        folder = Path(name)
        ensure_server_certificate(folder, SERVER_URI, "benchmark")
        ensure_client_certificate(folder, CLIENT_URI)
        for part in (called, fanned_out, started, dropped):
            yield from asyncio.run(part(folder))


if __name__ == "__main__":
    for line in rows():
        print(json.dumps(line), flush=True)
