"""A peer that keeps to no rules: raw chunks before sign-in, and raw requests inside a signed-in, encrypted channel."""

import asyncio
import contextlib
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from asyncua import Client, ua
from asyncua.ua.ua_binary import nodeid_to_binary, struct_to_binary

from tests.faults.hostile.scene import Scene
from tests.faults.hostile.witness import client_of

POLICY_NONE = b"http://opcfoundation.org/UA/SecurityPolicy#None"
CLOSED = (ConnectionError, asyncio.IncompleteReadError, EOFError, BrokenPipeError)


def string(content: bytes | None) -> bytes:
    return struct.pack("<i", -1) if content is None else struct.pack("<i", len(content)) + content


def hello(*, receive: int = 65535, send: int = 65535, largest: int = 0, chunks: int = 0) -> bytes:
    body = struct.pack("<IIIII", 0, receive, send, largest, chunks) + string(b"opc.tcp://127.0.0.1/")
    return b"HELF" + struct.pack("<I", 8 + len(body)) + body


def open_channel(*, sequence: int = 1, renew: bool = False, channel: int = 0) -> bytes:
    request = ua.OpenSecureChannelRequest()
    request.Parameters.RequestType = ua.SecurityTokenRequestType(int(renew))
    request.Parameters.SecurityMode = ua.MessageSecurityMode.None_
    request.Parameters.RequestedLifetime = 60_000
    security = string(POLICY_NONE) + string(None) + string(None)
    body = security + struct.pack("<II", sequence, sequence) + struct_to_binary(request)
    return b"OPNF" + struct.pack("<II", 12 + len(body), channel) + body


def chunk(body: bytes, *, channel: int, token: int, sequence: int, request: int, final: bytes = b"F") -> bytes:
    content = struct.pack("<IIII", channel, token, sequence, request) + body
    return b"MSG" + final + struct.pack("<I", 8 + len(content)) + content


def header(additional: bytes = b"\x00\x00\x00") -> bytes:
    """Return a RequestHeader with a null token and an additional header of one's own making."""
    return b"\x00\x00" + struct.pack("<qII", 0, 1, 0) + string(None) + struct.pack("<I", 0) + additional


def service(identifier: int) -> bytes:
    return nodeid_to_binary(ua.FourByteNodeId(identifier))


class Stranger:
    """A connection that has not signed in."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer
        self.channel, self.token, self.sequence = 0, 0, 1

    async def send(self, content: bytes) -> None:
        self.writer.write(content)
        with contextlib.suppress(*CLOSED):
            await self.writer.drain()

    async def answer(self, seconds: float = 5.0) -> bytes:
        """Return the next message with its header, b"" when the server has closed the connection."""
        try:
            async with asyncio.timeout(seconds):
                start = await self.reader.readexactly(8)
                return start + await self.reader.readexactly(struct.unpack("<I", start[4:])[0] - 8)
        except CLOSED:
            return b""

    async def greet(self) -> None:
        await self.send(hello())
        assert (await self.answer())[:3] == b"ACK"

    async def open(self) -> None:
        await self.greet()
        await self.send(open_channel())
        answer = await self.answer()
        assert answer[:3] == b"OPN"
        (self.channel,) = struct.unpack_from("<I", answer, 8)
        self.token = 13

    async def request(self, body: bytes, *, final: bytes = b"F") -> None:
        self.sequence += 1
        await self.send(
            chunk(body, channel=self.channel, token=self.token, sequence=self.sequence, request=7, final=final)
        )

    async def closed(self, seconds: float = 8.0) -> bool:
        """Return whether the server closes the connection within a time, whatever it says before."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                while await self.answer(seconds):
                    pass
                return True
        return False

    def close(self) -> None:
        self.writer.transport.abort()


@asynccontextmanager
async def stranger(scene: Scene, *, opened: bool = False) -> AsyncIterator[Stranger]:
    reader, writer = await asyncio.open_connection(*scene.address)
    peer = Stranger(reader, writer)
    try:
        if opened:
            await peer.open()
        yield peer
    finally:
        peer.close()


@asynccontextmanager
async def insider(scene: Scene, user: str = "operator") -> AsyncIterator[Client]:
    """A client that has signed in, and may then misbehave inside its encrypted channel."""
    client = await client_of(scene.url, Path(scene.folder))
    client.set_user(user)
    await client.connect()
    transport = client.uaclient.protocol.transport
    try:
        yield client
    finally:
        with contextlib.suppress(ua.UaError, OSError, TimeoutError, asyncio.TimeoutError):
            async with asyncio.timeout(5):
                await client.disconnect()
        if transport is not None:
            transport.abort()
            await asyncio.sleep(0)


async def raw_request(client: Client, kind: int, body: bytes, *, timestamp: int | None = None) -> int:
    """Send a request of one's own making in a client's session; return the service result, -1 if the server closed."""
    protocol = client.uaclient.protocol
    begun = ua.RequestHeader()
    begun.AuthenticationToken = protocol.authentication_token
    begun.RequestHandle = 1
    head = bytearray(struct_to_binary(begun))
    if timestamp is not None:
        place = len(ua.ua_binary.nodeid_to_binary(begun.AuthenticationToken))
        head[place : place + 8] = struct.pack("<q", timestamp)
    content = service(kind) + head + body
    protocol._request_id += 1
    waiting = asyncio.get_running_loop().create_future()
    protocol._callbackmap[protocol._request_id] = waiting
    protocol.transport.write(protocol._connection.message_to_binary(content, request_id=protocol._request_id))
    try:
        async with asyncio.timeout(15):
            answer = await waiting
    except (ConnectionError, asyncio.CancelledError, ua.UaError):
        return -1
    ua.ua_binary.nodeid_from_binary(answer)
    return ua.ua_binary.struct_from_binary(ua.ResponseHeader, answer).ServiceResult.value
