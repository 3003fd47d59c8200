"""The audit trail: written to, read, never changed. Writing never fails because of what somebody sent."""

import json
import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from itertools import islice
from typing import Any, cast

import sqlalchemy as sql

from library.errors import InvalidValue
from library.queries.encoding import to_text
from library.records import AuditEntry
from library.tables import audit
from library.values import MAX_TEXT

MAX_LIMIT = 1000
MAX_ITEMS = 20


def add(connection: sql.Connection, entry: AuditEntry) -> int:
    """Store an entry and return its id."""
    result = connection.execute(
        audit.insert().values(
            at=entry.at,
            actor=_shown(entry.actor),
            role=_shown(entry.role),
            action=_shown(entry.action),
            target=_shown(entry.target),
            arguments=to_text(_plain(entry.arguments)),
            status=_shown(entry.status),
            reason=_shown(entry.reason),
        )
    )
    key = result.inserted_primary_key
    assert key is not None
    return int(key[0])


def trail(connection: sql.Connection, limit: int, before: int) -> list[AuditEntry]:
    """Return up to ``limit`` entries, the newest first, with ids below ``before`` (0: from the newest on)."""
    if not 0 <= limit <= MAX_LIMIT:
        raise InvalidValue("limit", limit, f"it is at most {MAX_LIMIT}; 0 stands for 100")
    query = sql.select(audit).order_by(audit.c.entry_id.desc()).limit(limit or 100)
    if before:
        query = query.where(audit.c.entry_id < before)
    found = connection.execute(query).mappings()
    return [AuditEntry(**{**row, "arguments": json.loads(row["arguments"])}) for row in found]


def _plain(value: Any) -> Any:
    """Return ``value`` as JSON can say it, no longer than a reader would want."""
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, str):
        return _shown(value)
    if isinstance(value, bytes):
        return _shown(value[:MAX_TEXT].hex())
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, Mapping):
        items = cast(Mapping[Any, Any], value)
        shown = {_shown(str(key)): _plain(item) for key, item in islice(items.items(), MAX_ITEMS)}
        return shown if len(items) <= MAX_ITEMS else {**shown, "…": f"{len(items)} in all"}
    if isinstance(value, Sequence):
        sequence = cast(Sequence[Any], value)
        shown = [_plain(item) for item in islice(sequence, MAX_ITEMS)]
        return shown if len(sequence) <= MAX_ITEMS else [*shown, f"… {len(sequence)} in all"]
    return _shown(repr(value))


def _shown(text: str) -> str:
    """Return ``text`` as any database can keep it: what it cannot is written as an escape, what is too long is cut."""
    text = text[: MAX_TEXT + 1]
    safe = "".join(c if c not in "\x00" and not 0xD800 <= ord(c) <= 0xDFFF else f"\\u{ord(c):04x}" for c in text)
    return safe if len(safe) <= MAX_TEXT else f"{safe[: MAX_TEXT - 1]}…"
