"""What is remembered of workstations: held queues and speed overrides."""

from typing import Any

import sqlalchemy as sql

from library.queries.encoding import stored
from library.records import Cause, StationRecord
from library.tables import stations


def read(connection: sql.Connection, workstation: str) -> StationRecord:
    """Return what is remembered of a workstation; one nobody has heard of is released and at full speed."""
    row = connection.execute(sql.select(stations).where(stations.c.workstation == workstation)).mappings().one_or_none()
    if row is None:
        return StationRecord(workstation=workstation)
    with stored(f"workstation {workstation}"):
        return StationRecord(**row)


def change(connection: sql.Connection, workstation: str, changes: dict[str, Any]) -> StationRecord:
    """Change the fields named and return what is remembered now."""
    before = read(connection, workstation)
    after = StationRecord(**{**before.model_dump(), **changes})
    connection.execute(stations.delete().where(stations.c.workstation == workstation))
    connection.execute(stations.insert().values(after.model_dump()))
    return after


def hold(connection: sql.Connection, workstation: str, because: Cause, by: str) -> None:
    """Hold a workstation's queue, unless it is held already: the first cause is the one to look at."""
    if read(connection, workstation).held_because is Cause.NONE:
        held = StationRecord(workstation=workstation, held_because=because, held_by=by)
        change(connection, workstation, held.model_dump(include={"held_because", "held_by", "held_since"}))
