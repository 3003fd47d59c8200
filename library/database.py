"""The database behind the library: one engine, two kinds of transaction, migrations at opening.

What is particular to one database engine stands in this file, in `snapshots.py` and in the migrations, nowhere else.
"""

import asyncio
import contextlib
import os
import secrets
import sqlite3
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from enum import Enum, auto
from pathlib import Path
from typing import Any, TypeVar

import sqlalchemy as sql
from sqlalchemy import event
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError

from library.errors import LibraryUnusable, Trouble
from library.migrations import check_ours, migrate
from library.private_files import make_private

Result = TypeVar("Result")
Work = Callable[[sql.Connection], Result]
BUSY_SECONDS = 30.0
TRY_AGAIN_MS = 50
READERS = 6
_WRITES = "library_writes"
_patience: ContextVar[float] = ContextVar("library_patience", default=BUSY_SECONDS)


@contextmanager
def waiting_at_most(seconds: float) -> Generator[None]:
    """Have transactions that are asked for within the block wait no longer for their turn; then they are void."""
    token = _patience.set(seconds)
    try:
        yield
    finally:
        _patience.reset(token)


class _Stage(Enum):
    WAITING = auto()
    VOID = auto()
    COMMITTING = auto()


class _Void(Exception):
    """Nobody waits for the transaction any more: nothing of it may stay."""


class _Turn:
    """One transaction as its caller and its thread see it: either void, or committed, never both."""

    def __init__(self) -> None:
        self._stage = _Stage.WAITING
        self._guard = threading.Lock()
        self.until = time.monotonic() + _patience.get()

    def void(self) -> bool:
        """Give the transaction up; return whether that was possible: not once it is being committed."""
        with self._guard:
            if self._stage is _Stage.WAITING:
                self._stage = _Stage.VOID
            return self._stage is _Stage.VOID

    def check(self) -> None:
        """Raise _Void if it was given up."""
        if self._stage is _Stage.VOID:
            raise _Void

    def commit(self) -> None:
        """Begin to commit: from here on it cannot be given up."""
        with self._guard:
            self.check()
            self._stage = _Stage.COMMITTING


class Database:
    """Transactions over one engine, in threads of their own: the event loop neither waits nor computes for them.

    A transaction waits for its turn as long as ``waiting_at_most`` says. One whose caller was told that it waited too
    long, or has gone, leaves nothing, now or later.
    """

    def __init__(self, engine: sql.Engine, where: str) -> None:
        self._engine = engine
        self._where = where
        self._readers = ThreadPoolExecutor(READERS, thread_name_prefix="library-reads")
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="library-writes")
        self._running: set[asyncio.Future[Any]] = set()
        self._written = 0.0

    @classmethod
    async def open(cls, url_or_path: str | Path, *, must_exist: bool = False) -> "Database":
        """Return the database at a file path or SQLAlchemy URL.

        Its folder, file and tables are made if missing, unless it ``must_exist``. What is there and is no database of
        this program's is never replaced.
        """
        url = _url(url_or_path)
        where = url.database if url.get_backend_name() == "sqlite" and url.database else url.render_as_string()
        if url.get_backend_name() == "sqlite":
            _check_file(where, must_exist)
            _make_file(where)
        try:
            engine = sql.create_engine(url, pool_size=READERS + 1, max_overflow=2, pool_timeout=BUSY_SECONDS)
        except (ArgumentError, NoSuchModuleError, ModuleNotFoundError) as error:
            raise LibraryUnusable(where, str(error), "name a file, or a database whose driver is installed") from error
        if url.get_backend_name() == "sqlite":
            _configure_sqlite(engine)
        database = cls(engine, where)
        try:
            await database.write(lambda connection: migrate(connection, where))
        except BaseException:
            await database.close()
            raise
        return database

    async def close(self) -> None:
        """Let what is running finish, then close all connections."""
        while self._running:
            await asyncio.wait(set(self._running))
        self._writer.shutdown(wait=False)
        self._readers.shutdown(wait=False)
        await asyncio.to_thread(self._engine.dispose)

    async def read(self, work: Work[Result]) -> Result:
        """Return what ``work`` finds, all of it at one moment."""
        return await self._asked(self._readers, work, writes=False)

    async def write(self, work: Work[Result]) -> Result:
        """Run ``work`` and commit; if it raises, nothing of it stays. Returns after the commit has reached the disk."""
        return await self._asked(self._writer, work, writes=True)

    async def check_writable(self) -> None:
        """Raise LibraryUnusable if nothing could be written now; a write that has just been done is proof enough."""
        if time.monotonic() - self._written > 1.0:
            await self.write(lambda connection: connection.exec_driver_sql("SELECT 1").close())

    async def _asked(self, threads: ThreadPoolExecutor, work: Work[Result], *, writes: bool) -> Result:
        turn = _Turn()
        done = asyncio.get_running_loop().run_in_executor(threads, self._in_turn, work, turn, writes)
        self._running.add(done)
        done.add_done_callback(self._ended)
        try:
            async with asyncio.timeout_at(asyncio.get_running_loop().time() + turn.until - time.monotonic() + 0.2):
                return await asyncio.shield(done)
        except TimeoutError:
            if turn.void():
                raise self._busy() from None
            return await asyncio.shield(done)
        except asyncio.CancelledError:
            if not turn.void():
                await asyncio.wait({done})
            raise

    def _in_turn(self, work: Work[Result], turn: _Turn, writes: bool) -> Result:
        """Do one transaction in this thread, trying until it gets the lock or its time is over."""
        while True:
            turn.check()
            try:
                result = self._transaction(work, turn, writes)
            except DBAPIError as error:
                trouble = _trouble(error)
                if trouble is not Trouble.LOCKED:
                    raise _unusable(self._where, error, trouble) from error
                if time.monotonic() >= turn.until:
                    raise self._busy() from error
            else:
                self._written = time.monotonic() if writes else self._written
                return result

    def _transaction(self, work: Work[Result], turn: _Turn, writes: bool) -> Result:
        with self._engine.connect() as connection:
            connection.execution_options(**{_WRITES: writes})
            with connection.begin():
                result = work(connection)
                turn.commit()
                return result

    def _busy(self) -> LibraryUnusable:
        return LibraryUnusable(self._where, "database is locked", _REMEDIES[Trouble.LOCKED], Trouble.LOCKED)

    def _ended(self, done: "asyncio.Future[Any]") -> None:
        self._running.discard(done)
        # A caller that has gone no longer asks for the outcome; asking here keeps asyncio from complaining.
        if not done.cancelled():
            done.exception()


def _url(url_or_path: str | Path) -> sql.URL:
    text = str(url_or_path)
    if isinstance(url_or_path, Path) or "://" not in text:
        return sql.URL.create("sqlite", database=str(Path(text).expanduser().absolute()))
    try:
        url = sql.make_url(text)
    except ArgumentError as error:
        raise LibraryUnusable(text, str(error), "write it as sqlite:///path/to/file or name a file") from error
    drivers = {"postgresql": "postgresql+psycopg"}
    return url.set(drivername=drivers.get(url.drivername, url.drivername))


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


def _configure_sqlite(engine: sql.Engine) -> None:
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
    Trouble.LOCKED: "another program holds it for long: close that program, then try again",
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
