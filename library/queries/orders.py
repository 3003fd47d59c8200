"""Job orders: kept as they came until they are cleared, with the job that each became."""

from typing import Any

import sqlalchemy as sql

from library.errors import AlreadyExists, NotFound
from library.lifecycle import FINAL_JOB_STATES
from library.queries.encoding import stored
from library.records import JobOrder
from library.tables import job_orders, jobs


def add(connection: sql.Connection, order: JobOrder, most: int) -> bool:
    """Store a new order; return False, and store nothing, where so many wait for their end already."""
    if _row(connection, order.workstation, order.order_id) is not None:
        raise AlreadyExists("job order", order.order_id)
    if len(_unended(connection, order.workstation)) >= most:
        return False
    connection.execute(job_orders.insert().values(order.model_dump()))
    return True


def read(connection: sql.Connection, workstation: str, order_id: str) -> JobOrder:
    """Return an order of a workstation."""
    row = _row(connection, workstation, order_id)
    if row is None:
        raise NotFound("job order", order_id)
    return _order(row)


def change(connection: sql.Connection, workstation: str, order_id: str, changes: dict[str, Any]) -> JobOrder:
    """Change the fields named and return what the order is now."""
    after = JobOrder(**{**read(connection, workstation, order_id).model_dump(), **changes})
    connection.execute(job_orders.update().where(_same(workstation, order_id)).values(after.model_dump()))
    return after


def remove(connection: sql.Connection, workstation: str, order_id: str) -> None:
    """Forget an order; the job it became is remembered."""
    read(connection, workstation, order_id)
    connection.execute(job_orders.delete().where(_same(workstation, order_id)))


def of_job(connection: sql.Connection, job_id: str) -> JobOrder | None:
    """Return the order that became a job; None where the job was begun in another way."""
    row = connection.execute(sql.select(job_orders).where(job_orders.c.job_id == job_id)).mappings().one_or_none()
    return None if row is None else _order(row)


def newest(connection: sql.Connection, workstation: str, limit: int) -> list[JobOrder]:
    """Return every order that has not ended and the newest of those that have, the newest first."""
    newest_rows = connection.execute(
        sql.select(job_orders)
        .where(job_orders.c.workstation == workstation)
        .order_by(job_orders.c.number.desc())
        .limit(limit)
    ).mappings()
    rows = {row["number"]: row for row in (*newest_rows, *_unended(connection, workstation))}
    return [_order(rows[number]) for number in sorted(rows, reverse=True)]


def _unended(connection: sql.Connection, workstation: str) -> list[sql.RowMapping]:
    """Return the orders that nobody has ended and that became no job, or one that has not ended."""
    ended = sql.select(jobs.c.job_id).where(jobs.c.state.in_([state.value for state in FINAL_JOB_STATES]))
    query = sql.select(job_orders).where(
        job_orders.c.workstation == workstation, job_orders.c.ended == "", job_orders.c.job_id.not_in(ended)
    )
    return list(connection.execute(query).mappings())


def _same(workstation: str, order_id: str) -> sql.ColumnElement[bool]:
    return (job_orders.c.workstation == workstation) & (job_orders.c.order_id == order_id)


def _row(connection: sql.Connection, workstation: str, order_id: str) -> sql.RowMapping | None:
    return connection.execute(sql.select(job_orders).where(_same(workstation, order_id))).mappings().one_or_none()


def _order(row: sql.RowMapping) -> JobOrder:
    with stored(f"job order {row['order_id']}"):
        return JobOrder(**{name: value for name, value in row.items() if name != "number"})
