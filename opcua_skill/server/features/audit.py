"""`SkillLibrary/GetAuditTrail`: who asked for what, and what came of it. Nothing can change it, here or anywhere."""

import json
from dataclasses import dataclass
from typing import Any

from asyncua import ua

from library.records import AuditEntry
from library.store import SkillLibrary
from opcua_skill.server.address_space import Tree
from opcua_skill.server.features.library_nodes import ENGINEERS, PATH, method
from opcua_skill.server.types import UINT32, UINT64
from opcua_skill.stack.services.calls import Argument, add_method
from opcua_skill.wire.from_client import wire_moment
from opcua_skill.wire.refusals import refusing

ROWS_HELD = 2**63 - 1


@dataclass(frozen=True)
class AuditMethods:
    """The handler of GetAuditTrail."""

    library: SkillLibrary

    @refusing(blame="Limit")
    async def get_audit_trail(self, before: int, limit: int) -> tuple[Any, ...]:
        """Return the newest entries of the audit trail, or those before an entry, the newest first."""
        found = await self.library.audit_trail(limit, min(before, ROWS_HELD))
        return ([wire_entry(one) for one in found],)


def wire_entry(one: AuditEntry) -> Any:
    """Return an entry as it goes over the wire."""
    return ua.AuditEntryDataType(  # type: ignore[attr-defined]
        EntryId=one.entry_id,
        At=wire_moment(one.at),
        Actor=one.actor,
        Role=one.role,
        Action=one.action,
        Target=one.target,
        Arguments=json.dumps(dict(one.arguments), ensure_ascii=False),
        Status=one.status,
        Reason=one.reason,
    )


async def add_audit(tree: Tree, methods: AuditMethods) -> None:
    """Add the method to the library."""
    spec = method(
        "GetAuditTrail",
        methods.get_audit_trail,
        ENGINEERS,
        (
            Argument("Before", UINT64, description="only entries older than the one of this id; 0: the newest"),
            Argument("Limit", UINT32, description="0: 100; at most 1000"),
        ),
        (Argument("Entries", tree.type_id("AuditEntryDataType"), 1, "the newest first"),),
        changes=False,
    )
    tree.declare_method("SkillLibraryType", spec)
    await add_method(tree.server, tree.id(PATH), spec, tree.id(f"{PATH}/{spec.name}"), tree.name(spec.name))
