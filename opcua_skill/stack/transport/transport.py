"""Connections: limits on size, time and number that hold before anybody has signed in, and back-pressure after."""

import asyncio
import contextlib
import logging
import secrets
import sys
import time
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.ua.status_codes import StatusCodes as Codes
from asyncua.ua.ua_binary import uatcp_to_binary

from opcua_skill.stack.address_space.values import status, status_name
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.services.processor import Processor
from opcua_skill.stack.transport.chunks import Request

if sys.platform != "win32":
    import resource
if TYPE_CHECKING:
    from opcua_skill.stack.internal_server import SkillInternalServer

log = logging.getLogger(__name__)

# What an encrypted chunk may be larger than negotiated: one client rounds up to whole cipher blocks.
TOLERANCE = 1024
SMALLEST_HELLO, LARGEST_HELLO, SMALLEST_MESSAGE = 32, 4096 + 64, 24
QUEUED_BEFORE_SIGN_IN = 4
REAPER_INTERVAL = 0.5
CLOSING_TIMEOUT = 2.0
ROOM_FOR_FILES = 16
"""Files that the process may still open beside its connections: database, traces, log, pipes of its workers."""
_CHUNK_TYPES = {b"HEL": b"F", b"OPN": b"F", b"CLO": b"F", b"MSG": b"FCA"}


class Stage(IntEnum):
    """How far a connection has come; the less far, the sooner it makes room for another."""

    SILENT = 0
    GREETED = 1
    CHANNEL = 2
    SIGNED_IN = 3


class Connection(OPCUAProtocol):
    """One TCP connection."""

    processor: Processor | None  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, server: "Acceptor") -> None:
        clients: list[Any] = server.clients
        super().__init__(server.iserver, server._policies, clients, server.closing_tasks, server.limits)
        self._server = server
        self._limits: Limits = server.stack_limits
        self._received = bytearray()
        self._greeted = False
        self._paused = False
        self._frames: asyncio.Queue[bytes] = asyncio.Queue()
        self.address = "?"
        self.since = time.monotonic()
        self.unfinished_since: float | None = None
        self.unread_since: float | None = None
        self._may_write = asyncio.Event()
        self._may_write.set()

    @property
    def stage(self) -> Stage:
        """Return how far this connection has come."""
        if self.processor is None or not self._greeted:
            return Stage.SILENT
        if self.processor.session is not None and self.processor.session.is_activated():
            return Stage.SIGNED_IN
        return Stage.CHANNEL if self.processor.has_channel else Stage.GREETED

    def connection_made(self, transport: Any) -> None:
        """Take a connection in if there is room, or if an older one that has not come as far can make room."""
        self.peer_name = transport.get_extra_info("peername")
        self.address = str(self.peer_name[0]) if self.peer_name else "?"
        self.transport = transport
        if not self._server.make_room(self.address):
            self.fail(Codes.BadTcpNotEnoughResources)
            return
        transport.set_write_buffer_limits(high=self._limits.unread_answers)
        self.processor = Processor(self.iserver, transport, self.limits, self._hand_on)  # pyright: ignore[reportIncompatibleVariableOverride]
        self.processor.set_policies(self.policies)
        self.iserver.asyncio_transports.append(transport)
        self.clients.append(self)
        self._task = asyncio.create_task(self._process_received_message_loop())

    def pause_writing(self) -> None:
        """The peer does not read its answers: serve it no further until it does, or until it is cut off."""
        self._may_write.clear()

    def resume_writing(self) -> None:
        """The peer has read."""
        self._may_write.set()

    def connection_lost(self, ex: BaseException | None) -> None:
        """Give back everything the connection held."""
        self._received = bytearray()
        self._may_write.set()
        if self.processor is None:
            return
        if self.transport in self.iserver.asyncio_transports:
            self.iserver.asyncio_transports.remove(self.transport)
        if self in self.clients:
            self.clients.remove(self)
        if self._task is not None:
            self._task.cancel()
        closing = asyncio.create_task(self.processor.close())
        self.closing_tasks.append(closing)
        closing.add_done_callback(self._closed)

    def _closed(self, task: asyncio.Task[Any]) -> None:
        with contextlib.suppress(ValueError):  # the server's own sweep may have taken it already
            self.closing_tasks.remove(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("closing a connection of %s failed", self.address, exc_info=error)

    def fail(self, code: int) -> None:
        """Say why and close. A peer that does not read the reason is cut off a moment later."""
        self._received = bytearray()
        transport = self.transport
        if transport is None or transport.is_closing():
            return
        log.info("closing a connection of %s: %s", self.address, status_name(code))
        transport.write(uatcp_to_binary(ua.MessageType.Error, ua.ErrorMessage(status(code), "")))  # pyright: ignore[reportArgumentType]
        transport.close()
        asyncio.get_running_loop().call_later(CLOSING_TIMEOUT, transport.abort)

    def data_received(self, data: bytes) -> None:
        """Cut the stream into chunks; nothing is kept of one whose header already says that it is not welcome."""
        if self.transport is None or self.transport.is_closing():
            return
        received = self._received
        received += data
        while len(received) >= 8:
            size = int.from_bytes(received[4:8], "little")
            if code := self._refusal(bytes(received[:3]), bytes(received[3:4]), size):
                self.fail(code)
                return
            if len(received) < size:
                return
            frame = bytes(received[:size])
            del received[:size]
            self._greeted = True
            self._frames.put_nowait(frame)
        allowed = self._limits.queued_chunks if self.stage is Stage.SIGNED_IN else QUEUED_BEFORE_SIGN_IN
        if not self._paused and self._frames.qsize() >= allowed:
            self._paused = True
            self.transport.pause_reading()

    def _refusal(self, kind: bytes, chunk_type: bytes, size: int) -> int:
        """Return the code to refuse a chunk header with, 0 for one that is good."""
        if chunk_type not in _CHUNK_TYPES.get(kind, b"") or not chunk_type or (kind == b"HEL") == self._greeted:
            return Codes.BadTcpMessageTypeInvalid
        smallest = SMALLEST_HELLO if kind == b"HEL" else SMALLEST_MESSAGE
        largest = LARGEST_HELLO if kind == b"HEL" else self._limits.largest_chunk + TOLERANCE
        return 0 if smallest <= size <= largest else Codes.BadTcpMessageTooLarge

    def _hand_on(self) -> None:
        """Let another task serve the connection; the one that did so far ends with what it is doing."""
        self._task = asyncio.create_task(self._process_received_message_loop())

    async def _process_received_message_loop(self) -> None:
        serving = asyncio.current_task()
        while self._task is serving:
            frame = await self._frames.get()
            if self._paused and self._frames.qsize() < self._limits.queued_chunks // 4:
                self._paused = False
                if self.transport is not None and not self.transport.is_closing():
                    self.transport.resume_reading()
            try:
                if not await self._process_chunk(frame):
                    return
            except Exception:
                log.exception("fault %s on a connection of %s", secrets.token_hex(4), self.address)
                self.fail(Codes.BadInternalError)
                return
            if not self._frames.empty():
                await asyncio.sleep(0)  # a peer with much to say does not keep others waiting

    async def _process_chunk(self, frame: bytes) -> bool:
        """Process one chunk and return whether to go on."""
        processor, transport = self.processor, self.transport
        if processor is None or transport is None:
            return False
        before = processor.unfinished_bytes
        code = processor.take(frame)
        if before or processor.unfinished_bytes:
            self._server.unfinished_bytes += processor.unfinished_bytes - before
            self._count_unfinished(processor.unfinished_bytes)
        if isinstance(code, Request):
            code = await processor.answer(code)
        if code is not None:
            if code:
                self._server.iserver.diagnostics.totals.request_refused(code)
                self.fail(code)
            else:
                transport.close()
            return False
        if self._server.unfinished_bytes > self._limits.all_unfinished_messages:
            self.fail(Codes.BadTcpNotEnoughResources)
            return False
        if not self._may_write.is_set():
            await self._may_write.wait()
        return not transport.is_closing()

    def _count_unfinished(self, unfinished: int) -> None:
        if not unfinished:
            self.unfinished_since = None
        elif self.unfinished_since is None:
            self.unfinished_since = time.monotonic()

    def overdue(self, now: float) -> int:
        """Return the code to close this connection with, 0 while it behaves."""
        limits, transport = self._limits, self.transport
        if transport is None or transport.is_closing():
            return 0
        stage = self.stage
        if stage is Stage.SIGNED_IN:
            self.since = now
        waited = now - self.since
        if waited > (limits.hello_timeout if stage < Stage.CHANNEL else limits.activation_timeout):
            return Codes.BadTimeout
        if self.unfinished_since is not None and now - self.unfinished_since > limits.chunk_timeout:
            return Codes.BadTimeout
        if self.processor is not None and self.processor.channel_expired(now):
            return Codes.BadSecureChannelClosed
        if transport.get_write_buffer_size() <= limits.unread_answers:
            self.unread_since = None
        elif self.unread_since is None:
            self.unread_since = now
        elif now - self.unread_since > limits.unread_timeout:
            return Codes.BadTcpNotEnoughResources
        return 0


class ReservedPort:
    """A port that is bound, so that nobody else listens on it, and on which nobody is let in yet."""

    def __init__(self) -> None:
        self.make_protocol: Callable[[], OPCUAProtocol] | None = None
        self.server: asyncio.Server

    @classmethod
    async def take(cls, hostname: str, port: int) -> "ReservedPort":
        """Bind the port; raises OSError when somebody has it."""
        reserved = cls()
        loop = asyncio.get_running_loop()
        reserved.server = await loop.create_server(reserved._protocol, hostname, port, start_serving=False)
        return reserved

    def close(self) -> None:
        """Give the port back."""
        self.server.close()

    def _protocol(self) -> OPCUAProtocol:
        assert self.make_protocol is not None
        return self.make_protocol()


def connections_that_fit(most: int) -> int:
    """Return how many connections of ``most`` a process can hold and still open its own files; at least one."""
    if sys.platform == "win32":  # sockets are no files there
        return most
    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if allowed == resource.RLIM_INFINITY:
        return most
    fit = max(1, allowed - sum(1 for _ in Path("/dev/fd").iterdir()) - ROOM_FOR_FILES)
    if fit < most:
        log.warning("%d connections are taken at most, not %d: this process may open %d files", fit, most, allowed)
    return min(most, fit)


class Acceptor(BinaryServer):
    """Accepts connections, keeps their number in bounds, and closes those that do not behave."""

    iserver: "SkillInternalServer"  # pyright: ignore[reportIncompatibleVariableOverride]
    clients: list[Connection]  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, internal_server: "SkillInternalServer", hostname: str, port: int, limits: Any) -> None:
        super().__init__(internal_server, hostname, port, limits)
        self.stack_limits = internal_server.limits
        self.most_connections = self.stack_limits.connections
        self.unfinished_bytes = 0
        self.reserved: ReservedPort | None = None
        self._reaper: asyncio.Task[None] | None = None

    def _make_protocol(self) -> OPCUAProtocol:
        return Connection(self)

    def make_room(self, address: str) -> bool:
        """Return whether one more connection of an address may come in, closing an older, less far one if need be."""
        limits = self.stack_limits
        same = [c for c in self.clients if c.address == address]
        half_open = [c for c in same if c.stage < Stage.CHANNEL]
        if len(half_open) >= limits.half_open_per_address:
            return self._give_way(half_open)
        if len(same) >= limits.connections_per_address:
            return self._give_way(same)
        if len(self.clients) >= self.most_connections:
            return self._give_way(self.clients)
        return True

    def _give_way(self, among: list[Connection]) -> bool:
        """Close the connection that has come least far, the oldest of those; a signed-in one never gives way."""
        least = min(among, key=lambda c: (c.stage, c.since))
        if least.stage is Stage.SIGNED_IN:
            return False
        self.clients.remove(least)
        if least.transport is not None:
            least.transport.abort()
        return True

    async def start(self) -> None:
        """Listen, on the port that was reserved if one was."""
        reserved = self.reserved or await ReservedPort.take(self.hostname, self.port)
        self.most_connections = connections_that_fit(self.stack_limits.connections)
        reserved.make_protocol = self._make_protocol
        self._server = reserved.server
        if self.port == 0 and len(reserved.server.sockets) == 1:
            self.hostname, self.port = reserved.server.sockets[0].getsockname()[:2]
        await reserved.server.start_serving()
        self.cleanup_task = asyncio.create_task(self._close_task_loop())
        self._reaper = asyncio.create_task(self._reap())

    async def _reap(self) -> None:
        while True:
            await asyncio.sleep(REAPER_INTERVAL)
            now = time.monotonic()
            for connection in list(self.clients):
                if code := connection.overdue(now):
                    connection.fail(code)
            # counted afresh: a connection that was lost in the middle of a message has taken its bytes with it
            self.unfinished_bytes = sum(c.processor.unfinished_bytes for c in self.clients if c.processor is not None)

    async def stop(self) -> None:
        """Close all connections and stop listening."""
        if self._reaper is not None:
            self._reaper.cancel()
        for connection in list(self.clients):
            if connection.transport is not None:
                connection.transport.close()
                asyncio.get_running_loop().call_later(CLOSING_TIMEOUT, connection.transport.abort)
        await super().stop()
