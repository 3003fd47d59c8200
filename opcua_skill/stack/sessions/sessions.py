"""Sessions that cannot be guessed, taken over or left behind, and that carry who is asking into every call."""

import asyncio
import dataclasses
import logging
import math
import secrets
import time
from collections.abc import Awaitable, Callable
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import ServiceError, create_nonce
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_session import InternalSession, SessionState
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.security.access import Caller, Identity, Peer, Role, calling_as
from opcua_skill.stack.address_space.languages import ENGLISH
from opcua_skill.stack.address_space.values import node_id, status
from opcua_skill.stack.diagnostics.audit import WriteRecord, claimed
from opcua_skill.stack.diagnostics.counters import SessionCounts, short
from opcua_skill.stack.services.browsing import Browser
from opcua_skill.stack.services.calls import Refused
from opcua_skill.stack.services.operations import attempted, attempted_at_once, refused
from opcua_skill.stack.services.reading import narrowed, size_of, stamped
from opcua_skill.stack.services.writing import value_to_write
from opcua_skill.stack.subscriptions.subscribing import SubscribingSession, known_timestamps

if TYPE_CHECKING:
    from opcua_skill.stack.sessions.session_services import SessionServices

log = logging.getLogger(__name__)
MOST_LOCALES = 10
_SERVER_ITSELF = Caller(name="server", role=Role.ADMIN, session_id="internal", peer="")


@dataclass(frozen=True, slots=True)
class Channel:
    """The secure channel a session was created on: what has to be the same when it comes back on another one."""

    policy_uri: str
    mode: ua.MessageSecurityMode
    peer: Peer

    def same_client(self, other: "Channel") -> bool:
        """Return whether another channel has the same security and the same client certificate."""
        mine = (self.policy_uri, self.mode, self.peer.certificate)
        return mine == (other.policy_uri, other.mode, other.peer.certificate)


current_channel: ContextVar[Channel] = ContextVar("opcua_skill_channel")


class SignedIn(User):
    """asyncua's idea of a user, and the identity we know it by. To asyncua every network client is a plain user."""

    def __init__(self, identity: Identity) -> None:
        super().__init__(role=UserRole.User, name=identity.name)
        self.identity = identity


class Session(SubscribingSession):
    """A session of a client, or the server's own internal one (``external`` False)."""

    def __init__(self, internal_server: Any, aspace: Any, submgr: Any, name: str, user: User, external: bool) -> None:
        super().__init__(internal_server, aspace, submgr, name, user=user, external=external)
        self.processor: SessionServices | None = None
        self.channel: Channel | None = None
        self.caller = _SERVER_ITSELF
        self.counts = SessionCounts()
        self.closed_by_client = False
        self.language = ENGLISH
        self.sent_along = b""
        self._browser = Browser(aspace, self.iserver.limits)
        if external:
            self.channel = current_channel.get()
            self.iserver.unregister_external_session(self)
            self.auth_token = node_id(secrets.token_bytes(32))
            self.session_id = node_id(secrets.token_bytes(16), 1)
            self.iserver.register_external_session(self)

    @property
    def identity(self) -> Identity:
        """Return who this session belongs to. Before sign-in nobody has asked, so nobody may."""
        if isinstance(self.user, SignedIn):
            return self.user.identity
        raise ServiceError(Codes.BadSessionNotActivated)

    async def create_session(self, params: ua.CreateSessionParameters, sockname: Any = None) -> ua.CreateSessionResult:
        """Answer CreateSession after checking the certificate of the channel, not one the client merely names."""
        await self.iserver.admit_client(self.channel, params)
        if not math.isfinite(params.RequestedSessionTimeout):
            longest: Any = self.iserver.limits.session_timeout_ms
            params.RequestedSessionTimeout = longest
        result = await super().create_session(params, sockname)
        if self.channel is not None:
            self.sent_along = bytes(params.ClientCertificate or b"")[len(self.channel.peer.certificate) :]
        result.MaxRequestMessageSize = self.iserver.limits.largest_message
        self.counts.introduce(params)
        self.iserver.diagnostics.totals.sessions += 1
        return result

    def activate(self, identity: Identity, params: ua.ActivateSessionParameters) -> ua.ActivateSessionResult:
        """Make the session belong to a proven user and return the answer, with a fresh nonce."""
        self.user = SignedIn(identity)
        assert self.channel is not None
        self.caller = Caller(identity.name, identity.role, self.session_id.to_string(), str(self.channel.peer))
        if self.state is SessionState.Created:
            InternalSession._current_connections += 1
        self.state = SessionState.Activated
        self.nonce = create_nonce(32)
        self.counts.locales = tuple(short(locale) for locale in (params.LocaleIds or [])[:MOST_LOCALES])
        if params.LocaleIds:
            self.language = self.iserver.languages.choose(self.counts.locales)
        self.counts.mechanism = claimed(params.UserIdentityToken)[1]
        self.touch()
        self._start_timeout_watchdog()
        result = ua.ActivateSessionResult()
        result.ServerNonce = self.nonce
        result.Results = [status() for _ in params.ClientSoftwareCertificates or []]
        return result

    def change_identity(self, identity: Identity) -> None:
        """Go on as the same user with another role, from the next call on."""
        self.user = SignedIn(identity)
        self.caller = dataclasses.replace(self.caller, role=identity.role)

    async def close_session(self, delete_subs: bool = True) -> None:
        """Close the session and everything that hangs on it; a subscription never outlives its session."""
        if self.state is SessionState.Closed:
            return
        timed_out = self._timeout_task is not None and self._timeout_task is asyncio.current_task()
        await super().close_session(True)
        if self.external:
            self.iserver.diagnostics.totals.session_ended(by_client=self.closed_by_client, timed_out=timed_out)
            await self.iserver.session_closed(self)

    async def read(self, params: ua.ReadParameters) -> list[ua.DataValue]:
        """Read attributes; what the user may do is told by the session's own role."""
        if not self.external:
            return await super().read(params)
        nodes = self.operations(params.NodesToRead)
        if not params.MaxAge >= 0:
            raise ServiceError(Codes.BadMaxAgeInvalid)
        which = known_timestamps(params.TimestampsToReturn)
        with calling_as(self.caller):
            return await self._read_each(nodes, which)

    async def _read_each(self, nodes: list[ua.ReadValueId], which: ua.TimestampsToReturn) -> list[ua.DataValue]:
        results, size = [], 0
        for place, wanted in enumerate(nodes):
            told = attempted_at_once(lambda wanted=wanted: self._read_one(wanted), _no_value, "Read")
            size += size_of(told.Value.Value) if told.Value is not None else 0
            if size > self.iserver.limits.largest_message:
                raise ServiceError(Codes.BadResponseTooLarge)
            results.append(stamped(told, which))
            if place % 200 == 199:
                await asyncio.sleep(0)
        return results

    def _read_one(self, wanted: ua.ReadValueId) -> ua.DataValue:
        told = self.iserver.aspace.read_attribute_value(wanted.NodeId, wanted.AttributeId)
        bad = told.StatusCode is not None and told.StatusCode.is_bad()
        return told if bad or told.Value is None else self._as_told_to_user(wanted, told)

    def _as_told_to_user(self, wanted: ua.ReadValueId, told: ua.DataValue) -> ua.DataValue:
        if wanted.AttributeId == AttributeIds.UserExecutable:
            may = self.iserver.method_service.executable_by(wanted.NodeId, self.identity.role)
            told = ua.DataValue(ua.Variant(may, ua.VariantType.Boolean))
        elif wanted.AttributeId == AttributeIds.UserAccessLevel:
            told = self.iserver.user_access_level(wanted.NodeId, self.identity.role, told)
        if self.language != ENGLISH and told.Value is not None:
            told = dataclasses.replace(told, Value=self.iserver.languages.said(self.language, told.Value))
        if wanted.IndexRange or (wanted.DataEncoding is not None and wanted.DataEncoding.Name):
            return narrowed(told, wanted)
        return told

    async def browse(self, params: ua.BrowseParameters) -> list[ua.BrowseResult]:
        """Browse, in pages for a client."""
        if not self.external:
            return await super().browse(params)
        self.operations(params.NodesToBrowse, self.iserver.limits.browses_per_request)
        return await self._browser.browse(params)

    async def browse_next(self, parameters: ua.BrowseNextParameters) -> list[ua.BrowseResult]:
        """Return the next page of what was browsed before."""
        self.operations(parameters.ContinuationPoints, self.iserver.limits.browses_per_request)
        return await self._browser.browse_next(parameters)

    async def translate_browsepaths_to_nodeids(self, params: list[ua.BrowsePath]) -> list[ua.BrowsePathResult]:
        """Follow paths of browse names."""
        if not self.external:
            return await super().translate_browsepaths_to_nodeids(params)
        return await self._browser.translate(self.operations(params, self.iserver.limits.browses_per_request))

    async def write(self, params: ua.WriteParameters) -> list[ua.StatusCode]:
        """Write values: only where the node may be written at all, and by roles that may write it."""
        if not self.external:
            return await super().write(params)
        with calling_as(self.caller):
            items = self.operations(params.NodesToWrite)
            return [await attempted(lambda item=item: self._write_one(item), status, "Write") for item in items]

    async def _write_one(self, item: ua.WriteValue) -> ua.StatusCode:
        """Write one value; a variable that commands something is obeyed first, or refused with its own code."""
        value = value_to_write(self.aspace, item)
        if isinstance(value, int):
            return status(value)
        obey = self.iserver.on_write.get(item.NodeId)
        if not self.iserver.may_write(item.NodeId, self.identity.role):
            if obey is not None:
                await self._recorded(item, Codes.BadUserAccessDenied, f"the role {self.caller.role} may not write it")
            return status(Codes.BadUserAccessDenied)
        if obey is not None:
            if item.IndexRange:
                return status(Codes.BadWriteNotSupported)  # a command is whole: half of one cannot be obeyed
            return await self._command(obey, item)
        return await self._store(item, value)

    async def _command(self, obey: Callable[[Any], Awaitable[None]], item: ua.WriteValue) -> ua.StatusCode:
        """Carry out what a variable commands, then write it; what was commanded is recorded, and a refusal too."""
        old = self.aspace.read_attribute_value(item.NodeId, AttributeIds.Value).Value
        try:
            await obey(item.Value.Value.Value if item.Value.Value is not None else None)
        except Refused as refusal:
            await self._recorded(item, refusal.code, refusal.reason, old)
            return status(refusal.code)
        done = await self._store(item, item.Value)
        await self._recorded(item, done.value, "", old)
        return done

    async def _recorded(self, item: ua.WriteValue, code: int, reason: str, old: ua.Variant | None = None) -> None:
        if reason:
            log.warning("%s refused to write %s: %s", self.caller.name, item.NodeId.to_string(), reason)
        new = item.Value.Value or ua.Variant()
        await self.iserver.written(WriteRecord(self.caller, item.NodeId, old, new, code, reason))

    async def _store(self, item: ua.WriteValue, value: ua.DataValue) -> ua.StatusCode:
        one = ua.WriteParameters()
        now: Any = datetime.now(UTC)
        told = dataclasses.replace(value, ServerTimestamp=now, ServerPicoseconds=None)
        one.NodesToWrite = [dataclasses.replace(item, Value=told, IndexRange=None)]
        return (await super().write(one))[0]

    async def history_read(self, params: Any) -> list[ua.HistoryReadResult]:
        """Return why there is no history of each node: this server keeps none."""
        known = [wanted.NodeId in self.aspace for wanted in self.operations(params.NodesToRead)]
        codes = {True: Codes.BadHistoryOperationUnsupported, False: Codes.BadNodeIdUnknown}
        return [refused(ua.HistoryReadResult, codes[one]) for one in known]

    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        """Call methods on behalf of this session's user."""
        if self.external:
            self.operations(params, self.iserver.limits.calls_per_request)
        with calling_as(self.caller):
            return await self.iserver.method_service.call(params)

    def can_come_back(self) -> bool:
        """Return whether another connection can be proven to be the same: there is a user, or a certificate."""
        return self.is_activated() and bool(
            self.identity.name or (self.channel is not None and self.channel.peer.certificate)
        )

    def idle_for(self) -> float:
        """Return the seconds since the last request."""
        return time.monotonic() - self._last_activity


def _no_value(code: int) -> ua.DataValue:
    return refused(ua.DataValue, code)


def internal_user() -> User:
    """Return the user of the server's own session."""
    return User(role=UserRole.Admin)
