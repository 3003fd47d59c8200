"""One connection's chunks and requests: its secure channel, one request after another, and exact answers."""

import asyncio
import logging
import secrets
import time
from collections.abc import Callable
from typing import Any

from asyncua import ua
from asyncua.common.utils import Buffer, ServiceError
from asyncua.server.internal_session import SessionState
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes
from asyncua.ua.ua_binary import nodeid_from_binary, struct_to_binary, uatcp_to_binary
from asyncua.ua.uaerrors import UaStatusCodeError
from cryptography.exceptions import InvalidSignature

from opcua_skill.security.access import audit_entry_id
from opcua_skill.stack.address_space.values import status, status_name
from opcua_skill.stack.services.reading import weight_of
from opcua_skill.stack.services.services import SERVICES
from opcua_skill.stack.sessions.session_services import SessionServices
from opcua_skill.stack.sessions.sessions import Session
from opcua_skill.stack.subscriptions.publishing import PUBLISH
from opcua_skill.stack.transport.chunks import Request, SecureChannel
from opcua_skill.stack.transport.decoding import MALFORMED, decode

log = logging.getLogger(__name__)

CALLS_AT_ONCE = 8
CHUNKS_AT_ONCE = 16
REFERENCE_BYTES = 150
# In bytes: the smallest elements take one each and some two microseconds, and the loop is not to be held for 20 ms.
HEAVY_REQUEST = 8192
LONG_CALL_SECONDS = 0.05
HEAVY_SECONDS, LONGEST_PAUSE = 0.02, 0.25
CLOSE = 0
LONGEST_AUDIT_ENTRY_ID = 200
CHUNK_TOLERANCE = 1024
UNKNOWN_SERVICE = 0
LIFETIME_MS = (10_000, 3_600_000)
_CALL = Ids.CallRequest_Encoding_DefaultBinary


class Processor(SessionServices):
    """Handles the requests of one connection, one after another but for calls that take long."""

    _connection: SecureChannel

    def __init__(self, internal_server: Any, transport: Any, limits: Any, hand_on: Callable[[], None]) -> None:
        super().__init__(internal_server, transport, limits)
        self._connection = SecureChannel(self._limits)
        self.spent = 0.0
        self._later: list[tuple[Any, Any, Any, Any]] | None = None
        self._hand_on = hand_on
        self._calls: set[asyncio.Task[Any]] = set()
        self._channel_until = float("inf")
        self._largest_message_taken = self._most_response_chunks = 0

    @property
    def has_channel(self) -> bool:
        """Return whether a secure channel is open."""
        return self._connection.is_open()

    @property
    def unfinished_bytes(self) -> int:
        """Return the size of a message of which not all chunks have come."""
        return self._connection.unfinished_bytes

    def channel_expired(self, now: float) -> bool:
        """Return whether the client has let its channel's key grow too old."""
        return now > self._channel_until

    def take(self, frame: bytes) -> Request | int | None:
        """Take one chunk. Return the request that is whole with it, None to go on, or the code to close with."""
        kind = frame[:3]
        try:
            if kind == b"HEL":
                return self._hello(Buffer(frame[8:]))
            if kind == b"OPN":
                return self._open_channel(frame)
            if not self.has_channel:
                return Codes.BadSecureChannelIdInvalid
            request = self._connection.receive(frame, self._largest_message())
        except (ServiceError, UaStatusCodeError) as error:
            return int(error.code)
        except (InvalidSignature, RecursionError, *MALFORMED) as error:
            log.info("a chunk of %s is refused: %s", self.name, type(error).__name__)
            return Codes.BadSecurityChecksFailed
        if kind == b"CLO":
            self._connection.close()
            return CLOSE
        return request

    def _largest_message(self) -> int:
        limits = self.iserver.limits
        signed_in = self.session is not None and self.session.is_activated()
        return limits.largest_message if signed_in else limits.largest_message_before_sign_in

    def _hello(self, frame: Buffer) -> int | None:
        """Agree on chunk sizes. What the client wants to receive limits our answers, not what it may send."""
        hello, limits = decode(ua.Hello, frame), self.iserver.limits
        smallest = limits.smallest_client_buffer
        if hello.ReceiveBufferSize < smallest or hello.SendBufferSize < smallest:
            return Codes.BadTcpNotEnoughResources
        receive = min(hello.SendBufferSize, limits.largest_chunk)
        send = min(hello.ReceiveBufferSize, limits.largest_chunk)
        self._limits.max_recv_buffer = receive + CHUNK_TOLERANCE
        self._limits.max_send_buffer = send
        self._limits.max_message_size = limits.largest_message
        self._limits.max_chunk_count = limits.largest_message // smallest + 1
        self._largest_message_taken, self._most_response_chunks = hello.MaxMessageSize, hello.MaxChunkCount
        answer: Any = ua.Acknowledge()
        answer.ReceiveBufferSize, answer.SendBufferSize = receive, send
        answer.MaxMessageSize, answer.MaxChunkCount = limits.largest_message, self._limits.max_chunk_count
        acknowledge: Any = ua.MessageType.Acknowledge
        self._transport.write(uatcp_to_binary(acknowledge, answer))
        return None

    def _open_channel(self, frame: bytes) -> int | None:
        """Open a channel, once; after that it can only be renewed."""
        was_open = self.has_channel
        message = self._connection.receive_opening(frame)
        algorithm, sequence = message.SecurityHeader(), message.SequenceHeader()
        request = decode(ua.OpenSecureChannelRequest, message.body())
        wanted = request.Parameters
        if not isinstance(wanted.SecurityMode, ua.MessageSecurityMode):
            return Codes.BadSecurityModeRejected
        if not isinstance(wanted.RequestType, ua.SecurityTokenRequestType):
            return Codes.BadRequestTypeInvalid
        if was_open == (wanted.RequestType == ua.SecurityTokenRequestType.Issue):
            return Codes.BadSecurityChecksFailed
        if not was_open:
            self._connection.select_policy(
                algorithm.SecurityPolicyURI, algorithm.SenderCertificate, wanted.SecurityMode
            )
        policy = self._connection.security_policy
        if len(wanted.ClientNonce or b"") < policy.secure_channel_nonce_length:
            return Codes.BadNonceInvalid
        wanted.RequestedLifetime = max(LIFETIME_MS[0], min(wanted.RequestedLifetime or LIFETIME_MS[1], LIFETIME_MS[1]))
        response = ua.OpenSecureChannelResponse()
        response.Parameters = self._connection.open(wanted, self.iserver)
        self.send_response(request.RequestHeader.RequestHandle, sequence, response, ua.MessageType.SecureOpen)
        # a client renews at three quarters of the lifetime, and its old token serves a quarter longer
        self._channel_until = time.monotonic() + wanted.RequestedLifetime / 1000 * 1.25
        return None

    def send_response(
        self, requesthandle: Any, seqhdr: Any, response: Any, msgtype: Any = ua.MessageType.SecureMessage
    ):
        """Send a response; one the client said it cannot take becomes a fault that says so."""
        if self._later is not None:
            self._later.append((requesthandle, seqhdr, response, msgtype))
            return
        response.ResponseHeader.RequestHandle = requesthandle
        if isinstance(response, ua.ServiceFault):
            self.iserver.diagnostics.totals.request_refused(response.ResponseHeader.ServiceResult.value)
        body = struct_to_binary(response)
        if self._too_large(body) and not isinstance(response, ua.ServiceFault):
            self._fault(requesthandle, seqhdr, Codes.BadResponseTooLarge)
            return
        if not self._transport.is_closing():
            data = self._connection.message_to_binary(body, message_type=msgtype, request_id=seqhdr.RequestId)
            self._transport.write(data)

    def _too_large(self, body: bytes) -> bool:
        chunks = len(body) // (self._limits.max_send_buffer - 1024) + 1
        taken = (self._largest_message_taken, self.session.counts.largest_response if self.session is not None else 0)
        return any(0 < most < len(body) for most in taken) or 0 < self._most_response_chunks < chunks

    async def _send(self, handle: int, seqhdr: Any, response: Any) -> None:
        """Send an answer; a large one is put together beside the loop and goes out piece by piece, others after it."""
        heavy = _weight(response)
        if heavy < self.iserver.limits.heavy_answer or self._later is not None:
            self.send_response(handle, seqhdr, response)
            return
        response.ResponseHeader.RequestHandle = handle
        async with self.iserver.one_heavy_at_a_time:
            body = await asyncio.to_thread(struct_to_binary, response)
            if self._too_large(body) or self._later is not None:
                self.send_response(handle, seqhdr, response)
                return
            self._later = []
            try:
                for place, chunk in enumerate(self._connection.chunks(body, seqhdr.RequestId), start=1):
                    if self._transport.is_closing():
                        break
                    self._transport.write(chunk)
                    if place % CHUNKS_AT_ONCE == 0:
                        await asyncio.sleep(0)
            finally:
                later, self._later = self._later, None
        for one in later:
            self.send_response(*one)

    def _fault(self, handle: int, seqhdr: Any, code: int) -> None:
        log.info("fault %s to %s", status_name(code), self.name)
        response = ua.ServiceFault()
        response.ResponseHeader.ServiceResult = status(code)
        self.send_response(handle, seqhdr, response)

    async def answer(self, request: Request) -> int | None:
        """Answer one request; None to go on, CLOSE to close.

        A call that takes long hands the connection on: another task serves the next requests, keep-alives among them.
        """
        body = request.body
        try:
            type_id = nodeid_from_binary(body)
            header = decode(ua.RequestHeader, body)
        except (UaStatusCodeError, *MALFORMED):
            self._fault(0, request, Codes.BadDecodingError)
            return None
        service = type_id.Identifier if type_id.NamespaceIndex == 0 else None
        if service != _CALL:
            closing = await self._answer(service, header, request, body)
            await self.give_way()
            return closing
        while len(self._calls) >= CALLS_AT_ONCE:
            await asyncio.wait(self._calls, return_when=asyncio.FIRST_COMPLETED)
        await self.give_way()
        serving = asyncio.current_task()
        assert serving is not None
        self._calls.add(serving)
        takes_long = asyncio.get_running_loop().call_later(LONG_CALL_SECONDS, self._hand_on)
        try:
            return await self._answer(service, header, request, body)
        finally:
            takes_long.cancel()
            self._calls.discard(serving)

    async def give_way(self) -> None:
        """Let others go first for as long as this peer's heavy messages have kept them waiting."""
        spent, self.spent = self.spent, 0.0
        if spent > HEAVY_SECONDS:
            await asyncio.sleep(min(spent, LONGEST_PAUSE))

    async def _answer(self, service: Any, header: Any, seqhdr: Any, body: Buffer) -> int | None:
        """Answer one request; what goes wrong becomes a service fault with the code that fits."""
        try:
            special = _SPECIAL.get(service)
            if special is not None:
                return await special(self, header, seqhdr, body)
            entry = SERVICES.get(service)
            if entry is None and self.session is None:
                raise ServiceError(Codes.BadServiceUnsupported)
            session = self._session_of(header)
            session.counts.requests[service if entry is not None else UNKNOWN_SERVICE] += 1
            if entry is None:
                raise ServiceError(Codes.BadServiceUnsupported)
            kind, answer = entry
            audit_entry_id.set(str(header.AuditEntryId or "")[:LONGEST_AUDIT_ENTRY_ID])
            begun = time.perf_counter()
            params = await self._decoded(kind, body)
            decoded = time.perf_counter()
            response = await answer(self, session, params)
            answered = time.perf_counter()
            await self._send(header.RequestHandle, seqhdr, response)
            self.spent += decoded - begun + time.perf_counter() - answered
        except (ServiceError, UaStatusCodeError) as error:
            self._refuse(service, header, seqhdr, int(error.code))
        except InvalidSignature:
            self._refuse(service, header, seqhdr, Codes.BadApplicationSignatureInvalid)
        except Exception:
            fault = secrets.token_hex(4)
            log.exception("fault %s in a request of %s", fault, self.name)
            self._refuse(service, header, seqhdr, Codes.BadInternalError)
        return None

    async def _decoded(self, kind: Any, body: Buffer) -> Any:
        """Return a request's parameters; those of a large one are read beside the loop, as answers are put together."""
        if len(body) < HEAVY_REQUEST:
            return decode(kind, body)
        async with self.iserver.one_heavy_at_a_time:
            return await asyncio.to_thread(decode, kind, body)

    def _refuse(self, service: Any, header: Any, seqhdr: Any, code: int) -> None:
        """Answer a request with a fault, and count it."""
        self.iserver.diagnostics.totals.session_refused(service, code)
        if self.session is not None and header.AuthenticationToken == self.session.auth_token:
            known = service in SERVICES or service in _SPECIAL  # a peer must not fill memory with names of its own
            self.session.counts.refused(service if known else UNKNOWN_SERVICE, code)
        self._fault(header.RequestHandle, seqhdr, code)

    def _session_of(self, header: Any) -> Session:
        """Return the activated session a request speaks for: this connection's own, by its token."""
        session = self.session
        if session is None or header.AuthenticationToken != session.auth_token:
            raise ServiceError(Codes.BadSessionIdInvalid)
        if session.state is SessionState.Closed:
            raise ServiceError(Codes.BadSessionClosed)
        if session.state is not SessionState.Activated:
            raise ServiceError(Codes.BadSessionNotActivated)
        session.touch()
        return session

    async def _publish(self, header: Any, seqhdr: Any, body: Buffer) -> None:
        await self.publish(self._session_of(header), header, seqhdr, body)

    async def _find_servers(self, header: Any, seqhdr: Any, body: Buffer) -> None:
        response, wanted = ua.FindServersResponse(), decode(ua.FindServersParameters, body)
        wanted.ServerUris = [uri for uri in wanted.ServerUris or [] if uri]
        response.Servers = self.iserver.find_servers(wanted, sockname=self.sockname)
        self.send_response(header.RequestHandle, seqhdr, response)

    async def _get_endpoints(self, header: Any, seqhdr: Any, body: Buffer) -> None:
        response = ua.GetEndpointsResponse()
        wanted = decode(ua.GetEndpointsParameters, body)
        response.Endpoints = await self.iserver.get_endpoints(wanted, sockname=self.sockname)
        self.send_response(header.RequestHandle, seqhdr, response)

    async def _close_channel(self, header: Any, seqhdr: Any, body: Buffer) -> int:
        self._connection.close()
        return CLOSE

    async def close(self) -> None:
        """Drop what hangs on the connection. A session that can be proven the same lives on until its timeout."""
        self._publish_requests.clear()
        for call in list(self._calls):
            call.cancel()
        session = self.session
        if session is None:
            return
        if not session.can_come_back():
            await self._drop_session()
        else:
            session.processor = None
            await self.iserver.detached(session)


def _weight(response: Any) -> int:
    """Return roughly how many bytes an answer takes, where it can be many."""
    if isinstance(response, ua.CallResponse):
        return sum(weight_of(output.Value) for one in response.Results for output in one.OutputArguments or ())
    if isinstance(response, ua.BrowseResponse):
        return sum(REFERENCE_BYTES * len(one.References or ()) for one in response.Results)
    if isinstance(response, ua.BrowseNextResponse):
        return sum(REFERENCE_BYTES * len(one.References or ()) for one in response.Parameters.Results)
    return 0


_SPECIAL = {
    Ids.FindServersRequest_Encoding_DefaultBinary: Processor._find_servers,
    Ids.GetEndpointsRequest_Encoding_DefaultBinary: Processor._get_endpoints,
    Ids.CreateSessionRequest_Encoding_DefaultBinary: Processor._create_session,
    Ids.ActivateSessionRequest_Encoding_DefaultBinary: Processor._activate_session,
    Ids.CloseSessionRequest_Encoding_DefaultBinary: Processor._close_session,
    Ids.CloseSecureChannelRequest_Encoding_DefaultBinary: Processor._close_channel,
    PUBLISH: Processor._publish,
}
