"""How a session begins, whose it is, how it moves to another connection, and how it ends."""

import asyncio
import logging
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import Buffer, ServiceError
from asyncua.server.internal_session import SessionState
from asyncua.ua.status_codes import StatusCodes as Codes
from cryptography.exceptions import InvalidSignature

from opcua_skill.security.access import Peer
from opcua_skill.stack.sessions.sessions import Channel, Session, current_channel
from opcua_skill.stack.sessions.sign_in import prove_identity
from opcua_skill.stack.subscriptions.publishing import Publishing
from opcua_skill.stack.transport.decoding import decode

if TYPE_CHECKING:
    from opcua_skill.stack.internal_server import SkillInternalServer

log = logging.getLogger(__name__)
SMALLEST_NONCE = 32


class SessionServices(Publishing):
    """CreateSession, ActivateSession and CloseSession of one connection."""

    iserver: "SkillInternalServer"  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, internal_server: Any, transport: Any, limits: Any) -> None:
        super().__init__(internal_server, transport, limits)
        self.sessions_tried = 0
        self.failed_sign_ins = 0
        self._channel: Channel | None = None

    @property
    def channel(self) -> Channel:
        """Return the security of this connection's channel and who is at the other end."""
        if self._channel is None:
            policy = self._connection.security_policy
            address = str(self.name[0]) if self.name else "?"
            self._channel = Channel(policy.URI, policy.Mode, Peer(address, bytes(policy.peer_certificate or b"")))
        return self._channel

    async def _create_session(self, header: Any, seqhdr: Any, body: Buffer) -> None:
        """Make a session, one at a time per connection; a client may try again after a refused sign-in."""
        if self.session is not None and self.session.is_activated():
            raise ServiceError(Codes.BadTooManySessions)
        self.sessions_tried += 1
        if self.sessions_tried > self.iserver.limits.sessions_tried_per_connection:
            raise ServiceError(Codes.BadTooManySessions)
        params = decode(ua.CreateSessionParameters, body)
        self._check_wishes(params)
        await self._drop_session()
        await self.iserver.make_room_for_session()
        current_channel.set(self.channel)
        session = self.iserver.create_session(str(self.name), external=True)
        self.session, session.processor = session, self
        try:
            result = await session.create_session(params, sockname=self.sockname)
            policy = self._connection.security_policy
            result.ServerCertificate = policy.host_certificate
            proof = (policy.peer_certificate or b"") + (params.ClientNonce or b"")
            result.ServerSignature.Signature = policy.asymmetric_cryptography.signature(proof)
            result.ServerSignature.Algorithm = policy.AsymmetricSignatureURI
        except BaseException:
            await self._drop_session()
            raise
        response = ua.CreateSessionResponse()
        response.Parameters = result
        self.send_response(header.RequestHandle, seqhdr, response)

    def _check_wishes(self, params: ua.CreateSessionParameters) -> None:
        """Refuse a session that is meant for another server, or whose nonce proves nothing (OPC 10000-4, 5.7.2)."""
        if params.ServerUri and params.ServerUri != self.iserver.server_uri:
            raise ServiceError(Codes.BadServerUriInvalid)
        encrypted = self.channel.mode != ua.MessageSecurityMode.None_
        if encrypted and len(params.ClientNonce or b"") < SMALLEST_NONCE:
            raise ServiceError(Codes.BadNonceInvalid)

    async def _close_session(self, header: Any, seqhdr: Any, body: Buffer) -> None:
        session = self.session
        if session is None or header.AuthenticationToken != session.auth_token:
            raise ServiceError(Codes.BadSessionIdInvalid)
        session.closed_by_client = True
        await self._drop_session()
        self.release_publish_requests(Codes.BadSessionClosed)
        self.send_response(header.RequestHandle, seqhdr, ua.CloseSessionResponse())

    async def _drop_session(self) -> None:
        session, self.session = self.session, None
        if session is not None:
            await session.close_session(True)

    async def _activate_session(self, header: Any, seqhdr: Any, body: Buffer) -> None:
        """Sign a user in. A session that comes back on a new channel is attached only after all is proven."""
        params = decode(ua.ActivateSessionParameters, body)
        channel = self.channel
        session = self._session_to_activate(header.AuthenticationToken, channel)
        policy = self._connection.security_policy
        nonce = session.nonce or b""
        try:
            own = policy.host_certificate or b""
            policy.asymmetric_cryptography.verify(own + nonce, params.ClientSignature.Signature or b"")
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
            if session.state is SessionState.Closed or session.nonce != nonce:
                raise ServiceError(Codes.BadSessionIdInvalid)
        except (ServiceError, InvalidSignature) as error:
            code = error.code if isinstance(error, ServiceError) else Codes.BadApplicationSignatureInvalid
            self.iserver.beside(self.iserver.told_sign_in(session, params, code))
            await self._failed_sign_in()
            raise
        result = session.activate(identity, params)
        if session.processor is not self:
            self._take_over(session)
        log.info("%s (%s) signed in from %s", identity.name or "anonymous", identity.role, channel.peer)
        response = ua.ActivateSessionResponse()
        response.Parameters = result
        self.send_response(header.RequestHandle, seqhdr, response)
        self.iserver.beside(self.iserver.told_sign_in(session, params, Codes.Good))

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
        if session.processor is not self and not session.can_come_back():
            raise ServiceError(Codes.BadSessionIdInvalid)
        return session

    def _take_over(self, session: Session) -> None:
        """Move a session of the same client and user from its old connection to this one."""
        old, session.processor = session.processor, self
        self.session = session  # pyright: ignore[reportIncompatibleVariableOverride]
        self.iserver.subscription_service.rebind(
            session.session_id, self.forward_publish_response, self.get_publish_request
        )
        if old is not None:
            old.session = None
            old._transport.close()

    async def _failed_sign_in(self) -> None:
        self.failed_sign_ins += 1
        limits = self.iserver.limits
        await asyncio.sleep(limits.failed_sign_in_delay * self.failed_sign_ins)
        if self.failed_sign_ins >= limits.failed_sign_ins_per_connection:
            asyncio.get_running_loop().call_later(0.05, self._transport.close)
