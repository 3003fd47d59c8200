"""`SkillLibrary/ListSessions` and `EndSession`: who is signed in, for administrators."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds

from opcua_skill.security.access import Role, caller
from opcua_skill.server.address_space import Tree, standard
from opcua_skill.server.features.library_nodes import PATH, method
from opcua_skill.server.types import DATE_TIME, DOUBLE, STRING
from opcua_skill.stack.internal_server import SkillInternalServer
from opcua_skill.stack.services.calls import Argument, Refused, add_method
from opcua_skill.stack.sessions.sessions import Session
from opcua_skill.wire.refusals import Code

ADMINS = Role.ADMIN.and_above
NODE_ID = standard(ObjectIds.NodeId)


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


async def add_sessions(tree: Tree, methods: SessionMethods) -> None:
    """Add the methods to the library."""
    for spec in (
        method(
            "ListSessions",
            methods.list_sessions,
            ADMINS,
            (),
            (
                Argument("SessionIds", NODE_ID, 1, "as in the server's diagnostics"),
                Argument("Users", STRING, 1, "empty: anonymous"),
                Argument("Roles", STRING, 1),
                Argument("Clients", STRING, 1, "application URI the client gives itself"),
                Argument("Addresses", STRING, 1),
                Argument("Since", DATE_TIME, 1),
                Argument("Idle", DOUBLE, 1, "s since the last request"),
            ),
            changes=False,
        ),
        method("EndSession", methods.end_session, ADMINS, (Argument("SessionId", NODE_ID),), ()),
    ):
        tree.declare_method("SkillLibraryType", spec)
        await add_method(tree.server, tree.id(PATH), spec, tree.id(f"{PATH}/{spec.name}"), tree.name(spec.name))
