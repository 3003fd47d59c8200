"""The server behind the endpoint: sessions, trust in clients, who may write what, and the checked services."""

import asyncio
import dataclasses
import logging
import secrets
from collections.abc import Awaitable, Callable, Coroutine
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User
from asyncua.server.internal_server import InternalServer
from asyncua.server.user_managers import UserManager
from asyncua.ua.status_codes import StatusCodes as Codes
from cryptography import x509

from opcua_skill.security.access import Identity, Role, SignIn
from opcua_skill.security.chains import CertificateFault, Known, fault
from opcua_skill.security.settings import SecuritySettings
from opcua_skill.security.trust import TrustList
from opcua_skill.stack.address_space.events import deliver
from opcua_skill.stack.address_space.languages import Languages
from opcua_skill.stack.address_space.values import SERVER, status_name
from opcua_skill.stack.diagnostics.audit import (
    OnSignIn,
    OnWrite,
    SignInRecord,
    WriteRecord,
    certificate_event,
    claimed,
    session_ended_event,
    sign_in_event,
    write_event,
)
from opcua_skill.stack.diagnostics.server_diagnostics import Diagnostics
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.services.calls import CheckedMethods
from opcua_skill.stack.services.writing import READABLE, WRITABLE
from opcua_skill.stack.sessions.sessions import Channel, Session, internal_user
from opcua_skill.stack.subscriptions.subscriptions import Subscription, Subscriptions

CLOSING_SECONDS = 0.1
log = logging.getLogger(__name__)
RECORDED_WITHIN = 2.0


class _NobodyByDefault(UserManager):
    """asyncua's synchronous hook. Sign-in never comes here; if it did, the answer would be no."""

    def get_user(
        self, iserver: Any, username: Any = None, password: Any = None, certificate: Any = None
    ) -> User | None:
        return None


class SkillInternalServer(InternalServer):
    """asyncua's internal server with our sessions, methods and subscriptions in it."""

    method_service: CheckedMethods
    subscription_service: Subscriptions  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, sign_in: SignIn, security: SecuritySettings, limits: Limits) -> None:
        self.limits = limits
        self.sign_in = sign_in
        self.anonymous = security.insecure_anonymous
        self.no_encryption = security.insecure_no_encryption
        self.trust = None if security.insecure_trust_every_client else TrustList(security.folder)
        self.on_sign_in: OnSignIn | None = None
        self.on_written: OnWrite | None = None
        self.server_uri = security.application_uri
        self.on_session_closed: list[Callable[[str], Awaitable[None]]] = []
        self.languages = Languages()
        self.diagnostics = Diagnostics(self)
        self.one_heavy_at_a_time = asyncio.Semaphore(1)
        self._beside: set[asyncio.Task[None]] = set()
        self.readers: dict[ua.NodeId, frozenset[Role]] = {}
        self._write_roles: dict[ua.NodeId, frozenset[Role]] = {}
        self.on_write: dict[ua.NodeId, Callable[[Any], Awaitable[None]]] = {}
        super().__init__(user_manager=_NobodyByDefault())
        self.allow_remote_admin = False
        self.method_service.stop()
        self.method_service = CheckedMethods(self.aspace)
        self.method_service.largest_answer = limits.largest_answer
        self.subscription_service = Subscriptions(self.aspace, self)  # pyright: ignore[reportIncompatibleVariableOverride]
        self.isession = Session(
            self, self.aspace, self.subscription_service, "Internal", user=internal_user(), external=False
        )
        self.current_time_node.session = self.isession
        self.server_status_node.session = self.isession
        self.max_session_timeout_ms = limits.session_timeout_ms
        self.max_subscriptions = limits.subscriptions
        self.max_monitored_item_queue_size = limits.queue_of_item
        self.max_unacked_messages_per_subscription = limits.unacknowledged_messages
        self.max_connections = limits.connections
        self.max_pending_activation_seconds = limits.activation_timeout

    async def stop(self) -> None:
        """Stop at once: asyncua would wait for the next tick of its clock, up to a second."""
        if self._beside:
            await asyncio.wait(set(self._beside), timeout=RECORDED_WITHIN)
        if self.time_task is not None:
            self.time_task.cancel()
            (ended,) = await asyncio.gather(self.time_task, return_exceptions=True)
            if isinstance(ended, Exception):
                log.error("the server's clock had failed", exc_info=ended)
            self.time_task = None
        await super().stop()

    def create_session(self, name: str, user: User | None = None, external: bool = False) -> Session:
        """Return a new session; a network client's is nobody's until it is activated."""
        return Session(self, self.aspace, self.subscription_service, name, user=user or User(), external=external)

    async def make_room_for_session(self) -> None:
        """Close the session that has been without a connection for longest, or refuse when there is none."""
        if len(self._external_sessions) < self.limits.sessions:
            return
        left = [s for s in self._external_sessions.values() if isinstance(s, Session) and not _connected(s)]
        if not left:
            raise ServiceError(Codes.BadTooManySessions)
        await max(left, key=Session.idle_for).close_session(True)

    async def admit_client(self, channel: Channel | None, params: ua.CreateSessionParameters) -> None:
        """Refuse a client whose channel is not encrypted, or whose certificate is not its own, valid and trusted."""
        if channel is None or channel.mode != ua.MessageSecurityMode.SignAndEncrypt or not channel.peer.certificate:
            if self.no_encryption:
                return
            raise ServiceError(Codes.BadSecurityModeRejected)
        certificate = x509.load_der_x509_certificate(channel.peer.certificate)
        if code := await self._certificate_fault(certificate, channel, params):
            subject = certificate.subject.rfc4514_string()
            remedy = ""
            if self.trust is not None and code == Codes.BadCertificateUntrusted:
                remedy = f"; to let it in: {self.trust.words_to_trust(certificate)}"
            log.warning("client certificate %s from %s: %s%s", subject, channel.peer, status_name(code), remedy)
            event = certificate_event(code, channel.peer.certificate, subject, str(channel.peer), self.server_uri)
            await deliver(self, SERVER, event)
            raise ServiceError(code)

    async def _certificate_fault(
        self, certificate: x509.Certificate, channel: Channel, params: ua.CreateSessionParameters
    ) -> int:
        der = channel.peer.certificate
        if bytes(params.ClientCertificate or b"")[: len(der)] != der:
            return Codes.BadCertificateInvalid
        if params.ClientDescription.ApplicationUri not in _uris(certificate):
            return Codes.BadCertificateUriInvalid
        if self.trust is None:
            found = fault(certificate, Known(trusted=[certificate], issuers=[], lists=[]), datetime.now(UTC))
        else:
            found = await asyncio.to_thread(self.trust.fault, certificate, bytes(params.ClientCertificate)[len(der) :])
            if found in {CertificateFault.UNTRUSTED, CertificateFault.INCOMPLETE}:
                await asyncio.to_thread(self.trust.reject, certificate)
        return getattr(Codes, found.value) if found is not None else Codes.Good

    def client_sessions(self) -> list[Session]:
        """Return the sessions of clients, signed in or not yet."""
        return [session for session in self._external_sessions.values() if isinstance(session, Session)]

    async def end_session(self, session: Session, why: str) -> None:
        """End a client's session, and a moment later its connection: an answer under way still gets out."""
        user = session.identity.name if session.is_activated() else ""
        peer = str(session.channel.peer) if session.channel is not None else "?"
        log.warning("the session of %s from %s is ended: %s", user or "nobody yet", peer, why)
        processor = session.processor
        await session.close_session(True)
        if processor is not None:
            asyncio.get_running_loop().call_later(CLOSING_SECONDS, processor._transport.close)
        event = session_ended_event(
            session.session_id, user, f"the session of {user} was ended: {why}", self.server_uri
        )
        await deliver(self, SERVER, event)

    def client_subscriptions(self) -> list[Subscription]:
        """Return the subscriptions of clients; the server's own are not among them."""
        return [one for one in self.subscription_service.subscriptions.values() if one.pub_request_callback is not None]

    def session_of(self, session_id: ua.NodeId) -> Session | None:
        """Return an activated session by its id."""
        return next((s for s in self.client_sessions() if s.session_id == session_id and s.is_activated()), None)

    def identity_of(self, session_id: ua.NodeId) -> Identity | None:
        """Return who an activated session belongs to."""
        session = self.session_of(session_id)
        return session.identity if session is not None else None

    def is_connected(self, session_id: str) -> bool:
        """Return whether a session has a connection now; one that lost it may still come back for a while."""
        named = (s for s in self._external_sessions.values() if s.session_id.to_string() == session_id)
        return any(isinstance(session, Session) and _connected(session) for session in named)

    def may_transfer(self, subscription_id: int, to: Session) -> int:
        """Return 0 if a session may take a subscription over from another of the same user and client, or why not."""
        subscription = self.subscription_service.subscriptions.get(subscription_id)
        if subscription is None:
            return Codes.BadSubscriptionIdInvalid
        sessions = (s for s in self._external_sessions.values() if s.session_id == subscription.session_id)
        owner = next(sessions, None)
        if not isinstance(owner, Session) or owner.channel is None or to.channel is None:
            return Codes.BadUserAccessDenied
        if owner is not to and self.subscription_service.full(to.session_id):
            return Codes.BadTooManySubscriptions
        same = owner.is_activated() and owner.identity == to.identity and owner.channel.same_client(to.channel)
        return Codes.Good if same and to.identity.name else Codes.BadUserAccessDenied

    async def detached(self, session: Session) -> None:
        """A session has lost its connection and waits to come back; of one user on one client only a few may wait."""
        if session.channel is None:
            return
        waiting = [
            other
            for other in self._external_sessions.values()
            if isinstance(other, Session)
            and not _connected(other)
            and other.is_activated()
            and other.identity == session.identity
            and other.channel is not None
            and other.channel.same_client(session.channel)
        ]
        waiting.sort(key=Session.idle_for)
        for oldest in waiting[self.limits.detached_sessions_per_user :]:
            await oldest.close_session(True)

    def beside(self, work: Coroutine[Any, Any, None]) -> None:
        """Let something be recorded without anybody waiting for it; when the server stops it is waited for."""
        task = asyncio.create_task(work)
        self._beside.add(task)
        task.add_done_callback(self._beside.discard)

    async def told_sign_in(self, session: Session, params: ua.ActivateSessionParameters, code: int) -> None:
        """Record how a sign-in ended, then tell it as an audit event."""
        name, kind = claimed(params.UserIdentityToken)
        good = code == Codes.Good
        user, role = (session.identity.name, session.identity.role.value) if good else (name, "")
        peer = str(session.channel.peer) if session.channel is not None else "?"
        record = SignInRecord(user, role, kind, peer, session.session_id.to_string(), code)
        payer = ("sign-in", user if good else peer)
        if self.on_sign_in is not None and self.method_service.refusals.admits(payer):
            try:
                await self.on_sign_in(record)
            except Exception:
                log.exception("fault %s: a sign-in was not recorded", secrets.token_hex(4))
        await deliver(self, SERVER, sign_in_event(record, self.server_uri))

    async def written(self, record: WriteRecord) -> None:
        """Record a write that commands something, then tell it as an audit event."""
        if self.on_written is not None:
            try:
                await self.on_written(record)
            except Exception:
                log.exception("fault %s: a write was not recorded", secrets.token_hex(4))
        await deliver(self, record.node_id, write_event(record, self.server_uri))

    async def session_closed(self, session: Session) -> None:
        """Tell those who hold something for a session that it is over. One that fails does not silence the others."""
        for hook in self.on_session_closed:
            try:
                await hook(session.session_id.to_string())
            except Exception:
                log.exception("a hook on the end of a session failed")

    def restrict_writes(self, node_id: ua.NodeId, roles: frozenset[Role]) -> None:
        """Say who may write a variable; without this a writable variable may be written from operator upwards."""
        self._write_roles[node_id] = roles

    def may_write(self, node_id: ua.NodeId, role: Role) -> bool:
        """Return whether a role may write a variable that is writable at all."""
        return role in self._write_roles.get(node_id, Role.OPERATOR.and_above)

    def may_read(self, node_id: ua.NodeId, role: Role) -> bool:
        """Return whether a role may read a variable: nearly all are for everybody who has signed in."""
        return role in self.readers.get(node_id, Role.OBSERVER.and_above)

    def user_access_level(self, node_id: ua.NodeId, role: Role, told: ua.DataValue) -> ua.DataValue:
        """Return a UserAccessLevel without the rights to read and to write that a role does not have."""
        if told.Value is None:
            return told
        taken = 0 if self.may_write(node_id, role) else WRITABLE
        taken |= 0 if self.may_read(node_id, role) else READABLE
        level = told.Value.Value & ~taken
        if level == told.Value.Value:
            return told
        return dataclasses.replace(told, Value=ua.Variant(level, ua.VariantType.Byte))


def _connected(session: Session) -> bool:
    return session.processor is not None and not session.processor._transport.is_closing()


def _uris(certificate: x509.Certificate) -> list[str]:
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return names.get_values_for_type(x509.UniformResourceIdentifier)
