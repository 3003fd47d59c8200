"""A server as asyncua makes it, in this process and open on loopback, and what its tests share."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from asyncua import Client, Server, ua
from asyncua.common.connection import TransportLimits
from asyncua.server.internal_session import InternalSession
from asyncua.server.uaprocessor import UaProcessor

SEQUENCE = SimpleNamespace(RequestId=1, SequenceNumber=1)


def mended(what: str, ours: str) -> str:
    return f"asyncua mends this: {what}. See whether opcua_skill/stack/{ours} can do without"


@contextmanager
def still_raises(kind: type[Exception], what: str, ours: str) -> Iterator[None]:
    """Fail, with what asyncua has mended, when a block does not raise."""
    try:
        yield
    except kind:
        return
    raise AssertionError(mended(what, ours))


@dataclass
class Stock:
    server: Server
    index: int
    released: asyncio.Event
    waiting: asyncio.Event
    ended: list[str]

    @property
    def iserver(self) -> Any:
        return self.server.iserver

    def node(self, name: str) -> ua.NodeId:
        return ua.NodeId(name, self.index)

    def session(self) -> InternalSession:
        return self.iserver.create_session("test", external=True)


@asynccontextmanager
async def stock_server() -> AsyncIterator[Stock]:
    """Run a server as asyncua makes it, with a few methods and variables."""
    server = Server()
    await server.init()
    server.set_endpoint("opc.tcp://127.0.0.1:0/stock")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    index = await server.register_namespace("urn:test")
    running = Stock(server, index, asyncio.Event(), asyncio.Event(), [])

    async def first(parent, *given):
        return [given[0]] if given else []

    async def refuse(parent):
        raise ua.uaerrors.BadOutOfRange

    async def wait(parent):
        running.waiting.set()
        try:
            await running.released.wait()
            running.ended.append("done")
        except asyncio.CancelledError:
            running.ended.append("cancelled")
            raise
        return []

    cell = await server.nodes.objects.add_object(running.node("Cell"), "Cell")
    for name, handler in (("First", first), ("Refuse", refuse), ("Wait", wait)):
        inputs = [ua.VariantType.Double] if name == "First" else []
        await cell.add_method(running.node(name), name, handler, inputs, inputs)
    for name, value in (("Speed", 1.5), ("Row", [1.0, 2.0, 3.0]), ("Word", "weld")):
        await (await cell.add_variable(running.node(name), name, value)).set_writable()
    async with server:
        yield running


def client(stock: Stock) -> Client:
    return Client(f"opc.tcp://127.0.0.1:{stock.server.bserver.port}/stock", timeout=10)


def call(stock: Stock, method: str, *values: Any, on: str = "Cell") -> ua.CallMethodRequest:
    request = ua.CallMethodRequest(ObjectId=stock.node(on), MethodId=stock.node(method))
    request.InputArguments = [ua.Variant(value) for value in values]
    return request


class Wire:
    """A transport that goes nowhere."""

    def __init__(self) -> None:
        self.written = b""
        self.closed = False

    def get_extra_info(self, name: str) -> tuple[str, int]:
        return "127.0.0.1", 1

    def write(self, data: bytes) -> None:
        self.written += data

    def close(self) -> None:
        self.closed = True


def processor(stock: Stock) -> tuple[UaProcessor, Wire]:
    wire = Wire()
    return UaProcessor(stock.iserver, wire, TransportLimits()), wire
