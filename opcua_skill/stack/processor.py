"""One connection's requests: which session they belong to, who signs in, and exact answers to everything else."""

import asyncio
import logging
import secrets
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import NotEnoughData, ServiceError
from asyncua.server.internal_session import SessionState
from asyncua.server.uaprocessor import UaProcessor
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes
from asyncua.ua.ua_binary import nodeid_from_binary, struct_from_binary
from asyncua.ua.uaerrors import UaStatusCodeError
from cryptography.exceptions import InvalidSignature

from opcua_skill.stack.access import Peer
from opcua_skill.stack.sessions import Channel, Session, current_channel
from opcua_skill.stack.sign_in import prove_identity
from opcua_skill.stack.values import status

if TYPE_CHECKING:
    from opcua_skill.stack.internal import SkillInternalServer

log = logging.getLogger(__name__)

_WITHOUT_SESSION = frozenset(
    {
        Ids.FindServersRequest_Encoding_DefaultBinary,
        Ids.GetEndpointsRequest_Encoding_DefaultBinary,
        Ids.CloseSecureChannelRequest_Encoding_DefaultBinary,
    }
)


CALLS_AT_ONCE = 8
LONG_CALL_SECONDS = 0.05
_CALL = ua.FourByteNodeId(Ids.CallRequest_Encoding_DefaultBinary)


class Processor(UaProcessor):
    """Handles the requests of one connection, one after another but for long calls."""

    iserver: "SkillInternalServer"  # pyright: ignore[reportIncompatibleVariableOverride]
    session: Session | None  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, internal_server: Any, transport: Any, limits: Any) -> None:
        super().__init__(internal_server, transport, limits)
        self.sessions_tried = 0
        self.failed_sign_ins = 0
        self._calls: set[asyncio.Task[bool]] = set()

    @property
    def channel(self) -> Channel:
        """Return the security of this connection's channel and who is at the other end."""
        policy = self._connection.security_policy
        address = str(self.name[0]) if self.name else "?"
        return Channel(policy.URI, policy.Mode, Peer(address, bytes(policy.peer_certificate or b"")))

    async def process_message(self, seqhdr: Any, body: Any) -> bool:
        """Answer one request. A call that takes long goes on beside the next requests, so that keep-alives are served."""
        position = body.cur_pos
        try:
            service = nodeid_from_binary(body)
        except NotEnoughData:
            service = None
        body.rewind(position)
        if service != _CALL:
            return await self._answer(seqhdr, body)
        while len(self._calls) >= CALLS_AT_ONCE:
            await asyncio.wait(self._calls, return_when=asyncio.FIRST_COMPLETED)
        call = asyncio.create_task(self._answer(seqhdr, body))
        self._calls.add(call)
        call.add_done_callback(self._calls.discard)
        await asyncio.wait({call}, timeout=LONG_CALL_SECONDS)
        return call.result() if call.done() else True

    async def _answer(self, seqhdr: Any, body: Any) -> bool:
        """Answer one request; what goes wrong becomes a service fault with the code that fits."""
        handle = 0
        try:
            typeid = nodeid_from_binary(body)
            header = struct_from_binary(ua.RequestHeader, body)
            handle = header.RequestHandle
            return bool(await self._process_message(typeid, header, seqhdr, body))
        except (ServiceError, UaStatusCodeError) as error:
            code = error.code
        except InvalidSignature:
            code = Codes.BadApplicationSignatureInvalid
        except NotEnoughData:
            code = Codes.BadDecodingError
        except Exception:
            fault = secrets.token_hex(4)
            log.exception("fault %s in a request of %s", fault, self.name)
            code = Codes.BadInternalError
        log.info("fault %s to %s", status(code).name, self.name)
        response = ua.ServiceFault()
        response.ResponseHeader.ServiceResult = status(code)
        self.send_response(handle, seqhdr, response)
        return True

    async def _process_message(self, typeid: Any, requesthdr: Any, seqhdr: Any, body: Any) -> bool | None:
        service = typeid.Identifier if typeid.NamespaceIndex == 0 else None
        if service in _WITHOUT_SESSION:
            return await super()._process_message(typeid, requesthdr, seqhdr, body)
        if service == Ids.CreateSessionRequest_Encoding_DefaultBinary:
            return await self._create_session(typeid, requesthdr, seqhdr, body)
        if service == Ids.ActivateSessionRequest_Encoding_DefaultBinary:
            return await self._activate_session(requesthdr, seqhdr, body)
        session = self.session
        if session is None or requesthdr.AuthenticationToken != session.auth_token:
            raise ServiceError(Codes.BadSessionIdInvalid)
        if session.state is SessionState.Closed:
            raise ServiceError(Codes.BadSessionClosed)
        return await super()._process_message(typeid, requesthdr, seqhdr, body)

    async def _create_session(self, typeid: Any, requesthdr: Any, seqhdr: Any, body: Any) -> bool | None:
        """Make a session, one at a time per connection; a client may try again after a refused sign-in."""
        if self.session is not None and self.session.is_activated():
            raise ServiceError(Codes.BadTooManySessions)
        self.sessions_tried += 1
        if self.sessions_tried > self.iserver.limits.sessions_tried_per_connection:
            raise ServiceError(Codes.BadTooManySessions)
        await self._drop_session()
        await self.iserver.make_room_for_session()
        current_channel.set(self.channel)
        try:
            done = await super()._process_message(typeid, requesthdr, seqhdr, body)
        except BaseException:
            await self._drop_session()
            raise
        if self.session is not None:
            self.session.processor = self
        return done

    async def _drop_session(self) -> None:
        session, self.session = self.session, None
        if session is not None:
            await session.close_session(True)

    async def _activate_session(self, requesthdr: Any, seqhdr: Any, body: Any) -> bool:
        """Sign a user in. A session that comes back on a new channel is attached only after all is proven."""
        params = struct_from_binary(ua.ActivateSessionParameters, body)
        channel = self.channel
        session = self._session_to_activate(requesthdr.AuthenticationToken, channel)
        policy = self._connection.security_policy
        nonce = session.nonce or b""
        try:
            policy.asymmetric_cryptography.verify(
                (policy.host_certificate or b"") + nonce, params.ClientSignature.Signature
            )
            identity = await prove_identity(
                self.iserver.sign_in,
                channel,
                params,
                nonce=nonce,
                certificate=self.iserver.certificate,
                private_key=self.iserver.private_key,
                anonymous=self.iserver.anonymous,
            )
            if session.is_activated() and session.identity != identity:
                raise ServiceError(Codes.BadIdentityChangeNotSupported)
            if session.state is SessionState.Closed:
                raise ServiceError(Codes.BadSessionClosed)
        except Exception:
            await self._failed_sign_in()
            raise
        result = session.activate(identity, params)
        if session.processor is not self:
            self._take_over(session)
        log.info("%s (%s) signed in from %s", identity.name or "anonymous", identity.role, channel.peer)
        response = ua.ActivateSessionResponse()
        response.Parameters = result
        self.send_response(requesthdr.RequestHandle, seqhdr, response)
        return True

    def _session_to_activate(self, token: ua.NodeId, channel: Channel) -> Session:
        """Return the session a token names, if this channel may speak for it."""
        session = self.session
        if session is None:
            found = self.iserver.lookup_external_session(token)
            session = found if isinstance(found, Session) else None
        if session is None or session.auth_token != token or session.state is SessionState.Closed:
            raise ServiceError(Codes.BadSessionIdInvalid)
        if session.channel is None or not session.channel.same_client(channel):
            raise ServiceError(Codes.BadSecurityChecksFailed)
        if session.processor is not self and not channel.peer.certificate and session.identity.name == "":
            raise ServiceError(Codes.BadSessionIdInvalid)  # an anonymous session without encryption proves nothing
        return session

    def _take_over(self, session: Session) -> None:
        """Move a session of the same client and user from its old connection to this one."""
        old, session.processor = session.processor, self
        self.session = session  # pyright: ignore[reportIncompatibleVariableOverride]
        self._closing = False
        self._session_watchdog_task = asyncio.create_task(self._session_watchdog_loop())
        self.iserver.subscription_service.rebind(
            session.session_id, self.forward_publish_response, self.get_publish_request
        )
        if old is not None and old is not self:
            old.session = None
            old._transport.close()

    async def _failed_sign_in(self) -> None:
        self.failed_sign_ins += 1
        limits = self.iserver.limits
        await asyncio.sleep(limits.failed_sign_in_delay * self.failed_sign_ins)
        if self.failed_sign_ins >= limits.failed_sign_ins_per_connection:
            asyncio.get_running_loop().call_later(0.05, self._transport.close)
