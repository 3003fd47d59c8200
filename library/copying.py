"""A library carried from one database to another, of either engine, and read back before it counts."""

import asyncio
import hashlib
import queue
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import sqlalchemy as sql

from library.database import Database
from library.errors import AlreadyExists, LibraryUnusable
from library.tables import metadata
from library.turns import waiting_at_most

ROWS = 100
"""Rows carried at a time: a recording may have some MB, and a few of these batches are in memory at once."""
LONGEST = 7 * 24 * 3600.0
"""s that a copy may take in all."""
CARRIED = tuple(table for table in metadata.sorted_tables if table.name != "leases")
"""All that is remembered, each table after those it refers to; which server serves what now is not part of it."""
Batch = tuple[sql.Table, Sequence[dict[str, Any]]]


@dataclass(frozen=True, slots=True)
class Copied:
    """What was carried: rows of each table, and the SHA-256 over all of them, in hexadecimal digits."""

    rows: dict[str, int]
    digest: str


class _Digest:
    """The SHA-256 over rows in the order of their keys, the same for the same content on any engine."""

    def __init__(self) -> None:
        self._sum = hashlib.sha256()
        self.rows = dict.fromkeys((table.name for table in CARRIED), 0)

    def add(self, table: sql.Table, rows: Sequence[dict[str, Any]]) -> None:
        """Take in the next rows of a table."""
        self.rows[table.name] += len(rows)
        for row in rows:
            for name, value in row.items():
                part = _bits(value)
                self._sum.update(f"{table.name}.{name} {type(value).__name__} {len(part)} ".encode() + part)

    @property
    def copied(self) -> Copied:
        """What was taken in so far."""
        return Copied(self.rows, self._sum.hexdigest())


async def copy_library(source: str, target: str) -> Copied:
    """Carry all of the library ``source`` into ``target``, both files or URLs, in one transaction on either side.

    The target is new or empty, and is read back before anything of it counts. Raises AlreadyExists for one that holds
    something and LibraryUnusable for what cannot be opened, or comes back otherwise than it was.
    """
    theirs = await Database.open(source, must_exist=True)
    try:
        ours = await Database.open(target)
        try:
            return await _carry(theirs, ours)
        finally:
            await ours.close()
    finally:
        await theirs.close()


async def _carry(theirs: Database, ours: Database) -> Copied:
    await ours.read(lambda connection: _check_empty(connection, ours.where))
    carried: queue.Queue[Batch | BaseException | None] = queue.Queue(4)
    with waiting_at_most(LONGEST):
        reading = asyncio.create_task(theirs.read(lambda connection: _send(connection, carried)))
        try:
            return await ours.write(lambda connection: _receive(connection, carried, ours.where))
        finally:
            while not reading.done():  # one whose other side has failed must not wait at a full queue
                while not carried.empty():
                    carried.get_nowait()
                await asyncio.wait({reading}, timeout=0.05)
            await asyncio.gather(reading, return_exceptions=True)  # what went wrong there was handed over


def _send(connection: sql.Connection, carried: "queue.Queue[Batch | BaseException | None]") -> None:
    """Hand over all rows, table by table; what goes wrong is handed over too, for the other side waits."""
    try:
        for table in CARRIED:
            for rows in _batches(connection, table):
                carried.put((table, rows))
        carried.put(None)
    except BaseException as error:
        carried.put(error)
        raise


def _receive(connection: sql.Connection, carried: "queue.Queue[Batch | BaseException | None]", where: str) -> Copied:
    """Store all rows that are handed over, and return what they were once they have been read back as the same."""
    _check_empty(connection, where)
    sent, stored = _Digest(), _Digest()
    while (batch := carried.get()) is not None:
        if isinstance(batch, BaseException):
            raise batch
        table, rows = batch
        connection.execute(table.insert(), rows)
        sent.add(table, rows)
    for table in CARRIED:
        for rows in _batches(connection, table):
            stored.add(table, rows)
        _count_on(connection, table)
    if sent.copied != stored.copied:
        raise LibraryUnusable(where, "it gave back other than was stored", "copy into another database")
    return sent.copied


def _batches(connection: sql.Connection, table: sql.Table) -> Iterator[list[dict[str, Any]]]:
    """Yield a table's rows in the order of its key, some at a time."""
    query = sql.select(table).order_by(*table.primary_key.columns)
    found = connection.execution_options(yield_per=ROWS).execute(query)
    for rows in found.mappings().partitions():
        yield [dict(row) for row in rows]


def _check_empty(connection: sql.Connection, where: str) -> None:
    for table in CARRIED:
        if connection.execute(sql.select(sql.literal(1)).select_from(table).limit(1)).first() is not None:
            raise AlreadyExists("library", where, f"its {table.name} are not empty, name a new or empty one")


def _count_on(connection: sql.Connection, table: sql.Table) -> None:
    """Let a counted key go on after the last one that was carried; SQLite does by itself."""
    [key, *more] = table.primary_key.columns
    if connection.dialect.name != "postgresql" or more or not isinstance(key.type, sql.BigInteger):
        return
    last = connection.scalar(sql.select(sql.func.max(key)))
    if last is not None:
        sequence = sql.func.pg_get_serial_sequence(table.name, key.name)
        connection.execute(sql.select(sql.func.setval(sequence, last)))


def _bits(value: Any) -> bytes:
    """Return a value as bytes that no two values of one type share."""
    if isinstance(value, bytes):
        return value
    if isinstance(value, float):
        return value.hex().encode()
    if isinstance(value, datetime):
        return value.isoformat().encode()
    return str(value).encode()
