"""Reading the audit trail: who asked for what, and what came of it. Nothing can change it, here or anywhere."""

import json
from dataclasses import dataclass
from typing import Any

from asyncua import ua

from library.records import AuditEntry
from library.store import SkillLibrary
from opcua_skill.methods.refusals import refusing
from opcua_skill.methods.values import wire_moment

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
