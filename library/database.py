"""The database behind the library: one of two engines, two kinds of transaction, migrations at opening.

What is particular to one engine stands in `sqlite.py` and `snapshots.py`, in `postgresql/`, and in the migrations.
"""

import asyncio
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, TypeVar, cast

import sqlalchemy as sql
from sqlalchemy.exc import ArgumentError, NoSuchModuleError

from library.errors import LibraryUnusable
from library.migrations import migrate
from library.sqlite import SqliteTransactions, make_file
from library.turns import Turn, Work, busy

Result = TypeVar("Result")


class Transactions(Protocol):
    """An engine as the library needs it."""

    def begin(self, work: Work, turn: Turn, writes: bool) -> "asyncio.Future[Any]":
        """Return what ``work`` will have returned once its transaction has been committed."""
        ...

    def listen(self, heard: Callable[[str], None]) -> None:
        """Have ``heard`` called in a thread with what other servers tell, and with "" whenever some may be missed."""
        ...

    async def close(self) -> None:
        """Close all connections; nothing runs any more."""
        ...


class Database:
    """Transactions over one engine, in threads of their own: the event loop neither waits nor computes for them.

    A transaction waits for its turn as long as ``waiting_at_most`` says. One whose caller was told that it waited too
    long, or has gone, leaves nothing, now or later.
    """

    def __init__(self, transactions: Transactions, where: str) -> None:
        self._transactions = transactions
        self.where = where
        self._running: set[asyncio.Future[Any]] = set()
        self._written = 0.0

    @classmethod
    async def open(cls, url_or_path: str | Path, *, must_exist: bool = False) -> "Database":
        """Return the database at a file path or SQLAlchemy URL.

        Its folder, file and tables are made if missing, unless it ``must_exist``. What is there and is no database of
        this program's is never replaced.
        """
        url = address(url_or_path)
        where = url.database if url.get_backend_name() == "sqlite" and url.database else url.render_as_string()
        try:
            database = cls(_transactions(url, where, must_exist), where)
        except (ArgumentError, NoSuchModuleError, ModuleNotFoundError) as error:
            raise LibraryUnusable(where, str(error), _DRIVER) from error
        try:
            await database.write(lambda connection: migrate(connection, where, must_exist=must_exist))
        except BaseException:
            await database.close()
            raise
        return database

    async def close(self) -> None:
        """Let what is running finish, then close all connections."""
        while self._running:
            await asyncio.wait(set(self._running))
        await self._transactions.close()

    @property
    def shared(self) -> bool:
        """Whether other servers may use the database at the same time."""
        return not isinstance(self._transactions, SqliteTransactions)

    def listen(self, heard: Callable[[str], None]) -> None:
        """Have ``heard`` called with what other servers tell, and with "" whenever some of it may have been missed."""
        loop = asyncio.get_running_loop()
        self._transactions.listen(lambda told: loop.call_soon_threadsafe(heard, told) and None)

    async def read(self, work: Callable[[sql.Connection], Result]) -> Result:
        """Return what ``work`` finds, all of it at one moment."""
        return cast(Result, await self._asked(work, writes=False))

    async def write(self, work: Callable[[sql.Connection], Result]) -> Result:
        """Run ``work`` and commit; if it raises, nothing of it stays. Returns after the commit has reached the disk."""
        result = cast(Result, await self._asked(work, writes=True))
        self._written = time.monotonic()
        return result

    async def check_writable(self) -> None:
        """Raise LibraryUnusable if nothing could be written now; a write that has just been done is proof enough."""
        if time.monotonic() - self._written > 1.0:
            await self.write(lambda connection: connection.exec_driver_sql("SELECT 1").close())

    async def _asked(self, work: Work, *, writes: bool) -> Any:
        turn = Turn()
        done = self._transactions.begin(work, turn, writes)
        self._running.add(done)
        done.add_done_callback(self._ended)
        try:
            async with asyncio.timeout_at(asyncio.get_running_loop().time() + turn.until - time.monotonic() + 0.2):
                return await asyncio.shield(done)
        except TimeoutError:
            if turn.void():
                raise busy(self.where) from None
            return await asyncio.shield(done)
        except asyncio.CancelledError:
            if not turn.void():
                await asyncio.wait({done})
            raise

    def _ended(self, done: "asyncio.Future[Any]") -> None:
        self._running.discard(done)
        # A caller that has gone no longer asks for the outcome; asking here keeps asyncio from complaining.
        if not done.cancelled():
            done.exception()


_DRIVER = "name a file, or a database whose driver is installed"


def address(url_or_path: str | Path) -> sql.URL:
    """Return the URL of a database that is named by a file or a URL; raises LibraryUnusable for what is neither."""
    text = str(url_or_path)
    if isinstance(url_or_path, Path) or "://" not in text:
        return sql.URL.create("sqlite", database=str(Path(text).expanduser().absolute()))
    try:
        url = sql.make_url(text)
    except ArgumentError as error:
        raise LibraryUnusable(text, str(error), "write it as sqlite:///path/to/file or name a file") from error
    return url.set(drivername="postgresql+asyncpg") if url.drivername == "postgresql" else url


def _transactions(url: sql.URL, where: str, must_exist: bool) -> Transactions:
    if url.drivername == "postgresql+asyncpg":
        from library.postgresql.transactions import PostgresTransactions  # its driver is an extra

        return PostgresTransactions(url, where)
    if url.get_backend_name() != "sqlite":
        reason = f"{url.drivername} is none of sqlite, postgresql+asyncpg"
        raise LibraryUnusable(where, reason, _DRIVER)
    make_file(where, must_exist)
    return SqliteTransactions(url, where)
