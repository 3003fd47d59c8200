"""Sessions that cannot be guessed, taken over or left behind, and that carry who is asking into every call."""

import logging
import secrets
import time
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import ServiceError, create_nonce
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_session import InternalSession, SessionState
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.access import Caller, Identity, Peer, Role, SignedIn, calling_as
from opcua_skill.stack.calls import Refused
from opcua_skill.stack.values import node_id, status

if TYPE_CHECKING:
    from opcua_skill.stack.internal import SkillInternalServer
    from opcua_skill.stack.processor import Processor

log = logging.getLogger(__name__)
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


class Session(InternalSession):
    """A session of a client, or the server's own internal one (``external`` False)."""

    iserver: "SkillInternalServer"  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, internal_server: Any, aspace: Any, submgr: Any, name: str, user: User, external: bool) -> None:
        super().__init__(internal_server, aspace, submgr, name, user=user, external=external)
        self.processor: Processor | None = None
        self.channel: Channel | None = None
        self.caller = _SERVER_ITSELF
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
        result = await super().create_session(params, sockname)
        result.MaxRequestMessageSize = self.iserver.limits.largest_message
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
        self.touch()
        self._start_timeout_watchdog()
        result = ua.ActivateSessionResult()
        result.ServerNonce = self.nonce
        result.Results = [status() for _ in params.ClientSoftwareCertificates or []]
        return result

    async def close_session(self, delete_subs: bool = True) -> None:
        """Close the session and everything that hangs on it; a subscription never outlives its session."""
        if self.state is SessionState.Closed:
            return
        await super().close_session(True)
        if self.external:
            await self.iserver.session_closed(self)

    async def read(self, params: ua.ReadParameters) -> list[ua.DataValue]:
        """Read attributes; what the user may do is told by the session's own role."""
        results = await super().read(params)
        if self.external:
            for place, wanted in enumerate(params.NodesToRead):
                if wanted.AttributeId == AttributeIds.UserExecutable and results[place].Value is not None:
                    may = self.iserver.method_service.executable_by(wanted.NodeId, self.identity.role)
                    results[place] = ua.DataValue(ua.Variant(may, ua.VariantType.Boolean))
                elif wanted.AttributeId == AttributeIds.UserAccessLevel and results[place].Value is not None:
                    results[place] = self.iserver.user_access_level(wanted.NodeId, self.identity.role, results[place])
        return results

    async def write(self, params: ua.WriteParameters) -> list[ua.StatusCode]:
        """Write values: only where the node may be written at all, and by roles that may write it."""
        if not self.external:
            return await super().write(params)
        role, refused = self.identity.role, status(Codes.BadUserAccessDenied)
        may = [self.iserver.may_write(item.NodeId, role) for item in params.NodesToWrite]
        allowed = ua.WriteParameters()
        allowed.NodesToWrite = [item for item, good in zip(params.NodesToWrite, may, strict=True) if good]
        with calling_as(self.caller):
            results = iter([await self._write_one(item) for item in allowed.NodesToWrite])
        return [next(results) if good else refused for good in may]

    async def _write_one(self, item: ua.WriteValue) -> ua.StatusCode:
        """Write one value; a variable that commands something is obeyed first, or refused with its own code."""
        one = ua.WriteParameters()
        one.NodesToWrite = [item]
        obey = self.iserver.on_write.get(item.NodeId)
        if obey is not None and item.AttributeId == AttributeIds.Value:
            try:
                await obey(item.Value.Value.Value if item.Value.Value is not None else None)
            except Refused as refusal:
                log.warning("%s refused to write %s: %s", self.caller.name, item.NodeId.to_string(), refusal.reason)
                return status(refusal.code)
        return (await super().write(one))[0]

    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        """Call methods on behalf of this session's user."""
        with calling_as(self.caller):
            return await self.iserver.method_service.call(params)

    def idle_for(self) -> float:
        """Return the seconds since the last request."""
        return time.monotonic() - self._last_activity


def internal_user() -> User:
    """Return the user of the server's own session."""
    return User(role=UserRole.Admin)
