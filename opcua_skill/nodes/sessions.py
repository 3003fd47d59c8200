"""`SkillLibrary/ListSessions` and `EndSession`: who is signed in, for administrators."""

from asyncua.ua.object_ids import ObjectIds

from opcua_skill.methods.sessions import SessionMethods
from opcua_skill.nodes.library import PATH, method
from opcua_skill.nodes.tree import Tree, standard
from opcua_skill.nodes.types import DATE_TIME, DOUBLE, STRING
from opcua_skill.security.access import Role
from opcua_skill.stack.calls import Argument, add_method

ADMINS = Role.ADMIN.and_above
NODE_ID = standard(ObjectIds.NodeId)


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
