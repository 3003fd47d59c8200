"""What one server of a shared library has changed, told to the others at the commit; nobody else is asked to look."""

import json
from dataclasses import asdict, dataclass
from typing import Literal

import sqlalchemy as sql

from library.queries.leases import Server

CHANNEL = "opcua_skill_library"


@dataclass(frozen=True, slots=True)
class News:
    """A version that was stored or decided on, or one that was deployed on a workstation or withdrawn from it."""

    kind: Literal["version", "deployed", "withdrawn", "leases"]
    skill_name: str = ""
    version: int = 0
    workstation: str = ""
    actor: str = ""
    server: str = ""


def announce(connection: sql.Connection, me: Server | None, news: News) -> None:
    """Tell every other server of the library, if and when the transaction is committed."""
    if connection.dialect.name == "postgresql":
        told = {**asdict(news), "server": me.name if me is not None else ""}
        connection.execute(sql.select(sql.func.pg_notify(CHANNEL, json.dumps(told, ensure_ascii=False))))


def read(payload: str) -> News | None:
    """Return what was told; None for what another version of this program told, or somebody else."""
    try:
        return News(**json.loads(payload))
    except (ValueError, TypeError):
        return None
