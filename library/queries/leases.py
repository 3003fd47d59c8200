"""Which server has which workstation, where several servers share a library: for a while, and then again."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

import sqlalchemy as sql

from library.errors import ServedElsewhere
from library.tables import Moment, leases
from library.values import now


@dataclass(frozen=True, slots=True)
class Server:
    """A server of a shared library: a name that no other has and that it keeps, and where clients find it."""

    name: str
    endpoint: str


@dataclass(frozen=True, slots=True)
class Lease:
    """A workstation and the server that has it until then, by the database's clock."""

    workstation: str
    server: str
    endpoint: str
    until: datetime


def renew(connection: sql.Connection, me: Server, workstations: Sequence[str], seconds: float) -> list[Lease]:
    """Take or keep every workstation that nobody else has, for ``seconds`` s; return those that somebody else has."""
    moment = _moment(connection)
    found = {lease.workstation: lease for lease in everyone(connection)}
    others = [
        found[name]
        for name in workstations
        if name in found and found[name].server != me.name and found[name].until > moment
    ]
    free = set(workstations) - {lease.workstation for lease in others}
    until = moment + timedelta(seconds=seconds)
    for name in sorted(free):
        values = {"server": me.name, "endpoint": me.endpoint, "until": until}
        if name in found:
            connection.execute(leases.update().where(leases.c.workstation == name).values(values))
        else:
            connection.execute(leases.insert().values(workstation=name, **values))
    return others


def give_back(connection: sql.Connection, me: Server) -> None:
    """Let others have what a server had."""
    connection.execute(leases.delete().where(leases.c.server == me.name))


def everyone(connection: sql.Connection) -> list[Lease]:
    """Return every lease in the order of the workstations, also one that has run out: nobody else has taken it."""
    found = connection.execute(sql.select(leases).order_by(leases.c.workstation))
    return [Lease(row.workstation, row.server, row.endpoint, row.until) for row in found]


def check(connection: sql.Connection, me: Server | None, workstation: str) -> None:
    """Raise ServedElsewhere unless a workstation is the asking server's; a library of one server alone asks nobody."""
    if me is None or not workstation:
        return
    row = connection.execute(sql.select(leases).where(leases.c.workstation == workstation)).one_or_none()
    if row is None or row.server != me.name:
        raise ServedElsewhere(workstation, row.endpoint if row is not None else "nobody")


def _moment(connection: sql.Connection) -> datetime:
    """Return the time of the clock that all servers of a library share."""
    if connection.dialect.name != "postgresql":
        return now()
    return connection.scalars(sql.select(sql.func.clock_timestamp(type_=Moment))).one()
