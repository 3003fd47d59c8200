"""Who is signed in, and ending somebody's session: for administrators."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from asyncua import ua

from opcua_skill.methods.refusals import Code
from opcua_skill.security.access import caller
from opcua_skill.stack.calls import Refused
from opcua_skill.stack.internal import SkillInternalServer
from opcua_skill.stack.sessions import Session


@dataclass(frozen=True)
class SessionMethods:
    """Handlers of ListSessions and EndSession. ``end`` ends a session for a reason."""

    iserver: SkillInternalServer
    end: Callable[[Session, str], Awaitable[None]]

    async def list_sessions(self) -> tuple[Any, ...]:
        """Return who is signed in, the oldest session first: one entry of each array a session."""
        found = sorted((one for one in self.iserver.client_sessions() if one.is_activated()), key=_since)
        return (
            [one.session_id for one in found],
            [one.identity.name for one in found],
            [one.identity.role.value for one in found],
            [str(one.counts.client.ApplicationUri or "") for one in found],
            [str(one.channel.peer) if one.channel else "" for one in found],
            [_since(one) for one in found],
            [one.idle_for() for one in found],
        )

    async def end_session(self, session_id: ua.NodeId) -> tuple[Any, ...]:
        """End a session and its connection at once; what it holds, such as a lock, ends with it."""
        session = self.iserver.session_of(session_id)
        if session is None:
            reason = f"there is no session {session_id.to_string()}: look up the ones there are"
            raise Refused(Code.BadNotFound, reason, arguments={"SessionId": Code.BadNotFound})
        await self.end(session, f"{caller().name} ended it")
        return ()


def _since(session: Session) -> Any:
    return session.counts.since.replace(tzinfo=None)
