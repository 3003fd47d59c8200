"""A library in one SQLite file: its making, its settings, one writer at a time and readers beside it."""

import asyncio
import contextlib
import os
import secrets
import sqlite3
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import sqlalchemy as sql
from sqlalchemy import event
from sqlalchemy.exc import DBAPIError

from library.errors import LibraryUnusable, Trouble
from library.migrations import check_ours
from library.private_files import make_private
from library.turns import BUSY_SECONDS, READERS, REMEDY_LOCKED, Turn, Work, busy

TRY_AGAIN_MS = 50
"""ms that SQLite itself waits for the lock, after which it is seen whether the caller still waits."""
_WRITES = "library_writes"


class SqliteTransactions:
    """Transactions on a file, in threads of their own: one that writes, and some that read."""

    def __init__(self, url: sql.URL, where: str) -> None:
        self._where = where
        self._engine = sql.create_engine(url, pool_size=READERS + 1, max_overflow=2, pool_timeout=BUSY_SECONDS)
        _configure(self._engine)
        self._readers = ThreadPoolExecutor(READERS, thread_name_prefix="library-reads")
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="library-writes")

    def begin(self, work: Work, turn: Turn, writes: bool) -> "asyncio.Future[Any]":
        """Return what ``work`` will have returned once its transaction has been committed."""
        executor = self._writer if writes else self._readers
        return asyncio.get_running_loop().run_in_executor(executor, self._in_turn, work, turn, writes)

    def listen(self, heard: Callable[[str], None]) -> None:
        """Hear nothing: one server has a file for itself."""

    async def close(self) -> None:
        """Close all connections; nothing runs any more."""
        self._writer.shutdown(wait=False)
        self._readers.shutdown(wait=False)
        await asyncio.to_thread(self._engine.dispose)

    def _in_turn(self, work: Work, turn: Turn, writes: bool) -> Any:
        """Do one transaction in this thread, trying until it gets the lock or its time is over."""
        while True:
            turn.check()
            try:
                return self._transaction(work, turn, writes)
            except DBAPIError as error:
                trouble = _trouble(error)
                if trouble is not Trouble.LOCKED:
                    raise _unusable(self._where, error, trouble) from error
                if time.monotonic() >= turn.until:
                    raise busy(self._where) from error

    def _transaction(self, work: Work, turn: Turn, writes: bool) -> Any:
        with self._engine.connect() as connection:
            connection.execution_options(**{_WRITES: writes})
            with connection.begin():
                result = work(connection)
                turn.commit()
                return result


def make_file(where: str, must_exist: bool) -> None:
    """Make the file of a library if it is missing and may be; raises LibraryUnusable for one that cannot be used."""
    _check_file(where, must_exist)
    _make_file(where)


def _check_file(where: str, must_exist: bool) -> None:
    """Raise LibraryUnusable for a file that is missing though it must exist, or that has nothing in it."""
    file = Path(where)
    beside = [one for one in (Path(f"{where}-wal"), Path(f"{where}-journal")) if one.exists() and one.stat().st_size]
    if file.exists():
        if file.is_file() and file.stat().st_size == 0:
            remedy = "restore it from a backup, or delete it to begin with an empty library"
            raise LibraryUnusable(where, "it is empty (0 bytes)", remedy)
        with contextlib.suppress(sqlite3.Error):  # what is wrong otherwise is told when it is opened to write
            check_ours(_tables(where), where)
    elif must_exist:
        raise LibraryUnusable(where, "there is no such file", "check the name of the data folder (--data)")
    elif beside:
        remedy = f"restore it from a backup, or move {beside[0].name} away to begin with an empty library"
        raise LibraryUnusable(where, f"it is missing though {beside[0].name} is there", remedy)


def _tables(where: str) -> set[str]:
    """Return the names of a file's tables without changing a byte of it: it may be another program's."""
    with contextlib.closing(sqlite3.connect(f"{Path(where).as_uri()}?mode=ro", uri=True, timeout=1.0)) as connection:
        return {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}


def _make_file(where: str) -> None:
    """Make folder and file, readable by the owner alone: it holds password hashes. SQLite's side files follow suit.

    The file is never seen empty: it is made under another name, with SQLite's first page in it, and then linked.
    """
    file = Path(where)
    try:
        make_private(file.parent)
        if not file.exists():
            scratch = file.with_name(f".{file.name}.{secrets.token_hex(4)}")
            os.close(os.open(scratch, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600))
            with contextlib.closing(sqlite3.connect(scratch)) as connection:
                connection.execute("PRAGMA journal_mode = WAL")
            try:
                os.link(scratch, file)
            except FileExistsError:
                pass  # somebody else was quicker
            except OSError:  # a file system without links
                scratch.rename(file)
            scratch.unlink(missing_ok=True)
        os.close(os.open(where, os.O_RDWR))
    except OSError as error:
        reason = error.strerror or str(error)
        raise LibraryUnusable(where, reason, "name a file in a folder that this user may write") from error


def _configure(engine: sql.Engine) -> None:
    @event.listens_for(engine, "connect")
    def connected(connection: sqlite3.Connection, record: object) -> None:  # pyright: ignore[reportUnusedFunction]
        # Without this the driver would begin transactions by itself, and not before data definition.
        connection.isolation_level = None
        cursor = connection.cursor()
        cursor.execute(f"PRAGMA busy_timeout = {int(BUSY_SECONDS * 1000)}")
        for setting in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON", "trusted_schema = OFF"):
            cursor.execute(f"PRAGMA {setting}")
        cursor.close()

    @event.listens_for(engine, "begin")
    def begun(connection: sql.Connection) -> None:  # pyright: ignore[reportUnusedFunction]
        # A writer that began by reading could find its view outdated and fail: it takes the lock first. It tries for a
        # moment only, so that one whose caller has gone is given up soon.
        writes = connection.get_execution_options().get(_WRITES, True)
        connection.exec_driver_sql(f"PRAGMA busy_timeout = {TRY_AGAIN_MS}")
        try:
            connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
        finally:
            connection.exec_driver_sql(f"PRAGMA busy_timeout = {int(BUSY_SECONDS * 1000)}")


_TROUBLES = {
    sqlite3.SQLITE_BUSY: Trouble.LOCKED,
    sqlite3.SQLITE_LOCKED: Trouble.LOCKED,
    sqlite3.SQLITE_FULL: Trouble.FULL,
    sqlite3.SQLITE_NOTADB: Trouble.DAMAGED,
    sqlite3.SQLITE_CORRUPT: Trouble.DAMAGED,
    sqlite3.SQLITE_READONLY: Trouble.FORBIDDEN,
    sqlite3.SQLITE_PERM: Trouble.FORBIDDEN,
    sqlite3.SQLITE_CANTOPEN: Trouble.FORBIDDEN,
    sqlite3.SQLITE_IOERR: Trouble.DISK,
}
_REMEDIES = {
    Trouble.LOCKED: REMEDY_LOCKED,
    Trouble.FULL: "free space on its disk, then try again",
    Trouble.DAMAGED: "the file is damaged or something else: restore it from a backup or name another file",
    Trouble.FORBIDDEN: "give this user the right to read and write it and its folder",
    Trouble.DISK: "look after its disk, then try again",
    Trouble.OTHER: "see the log for the statement",
}


def _trouble(error: DBAPIError) -> Trouble:
    """Return what is wrong, by SQLite's own code; its lowest byte is the kind."""
    code = getattr(error.orig, "sqlite_errorcode", None)
    return Trouble.OTHER if code is None else _TROUBLES.get(code & 0xFF, Trouble.OTHER)


def _unusable(where: str, error: DBAPIError, trouble: Trouble) -> LibraryUnusable:
    return LibraryUnusable(where, str(error.orig or error), _REMEDIES[trouble], trouble)
