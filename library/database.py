"""The database behind the library: one engine, two kinds of transaction, migrations at opening.

What is particular to one database engine stands in this file and in the migrations, nowhere else.
"""

import asyncio
import contextlib
import os
import secrets
import sqlite3
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, TypeVar

import sqlalchemy as sql
from sqlalchemy import event
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine

from library.errors import LibraryUnusable
from library.migrations import check_ours, migrate
from library.private_files import make_private

Result = TypeVar("Result")
Work = Callable[[sql.Connection], Result]
BUSY_SECONDS = 30.0
_WRITES = "library_writes"


class Database:
    """Transactions over one engine. A transaction, once begun, runs to its end even when its caller is cancelled."""

    def __init__(self, engine: AsyncEngine, where: str) -> None:
        self._engine = engine
        self._where = where
        self._writer = asyncio.Lock()
        self._running: set[asyncio.Task[Any]] = set()

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
            engine = create_async_engine(url, pool_size=4, max_overflow=4, pool_timeout=BUSY_SECONDS)
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
        await self._engine.dispose()

    async def read(self, work: Work[Result]) -> Result:
        """Return what ``work`` finds, all of it at one moment."""
        return await self._to_the_end(self._transaction(work, writes=False))

    async def write(self, work: Work[Result]) -> Result:
        """Run ``work`` and commit; if it raises, nothing of it stays. Returns after the commit has reached the disk."""
        return await self._to_the_end(self._write(work))

    async def _write(self, work: Work[Result]) -> Result:
        async with self._writer:
            return await self._transaction(work, writes=True)

    async def _transaction(self, work: Work[Result], *, writes: bool) -> Result:
        try:
            async with self._engine.connect() as connection:
                await connection.execution_options(**{_WRITES: writes})
                async with connection.begin():
                    return await connection.run_sync(work)
        except DBAPIError as error:
            raise _unusable(self._where, error) from error

    async def _to_the_end(self, work: Coroutine[Any, Any, Result]) -> Result:
        task = asyncio.ensure_future(work)
        self._running.add(task)
        task.add_done_callback(self._ended)
        return await asyncio.shield(task)

    def _ended(self, task: asyncio.Task[Any]) -> None:
        self._running.discard(task)
        # A caller that was cancelled no longer asks for the outcome; asking here keeps asyncio from complaining.
        if not task.cancelled():
            task.exception()


def _url(url_or_path: str | Path) -> sql.URL:
    text = str(url_or_path)
    if isinstance(url_or_path, Path) or "://" not in text:
        return sql.URL.create("sqlite+aiosqlite", database=str(Path(text).expanduser().absolute()))
    try:
        url = sql.make_url(text)
    except ArgumentError as error:
        raise LibraryUnusable(text, str(error), "write it as sqlite:///path/to/file or name a file") from error
    drivers = {"sqlite": "sqlite+aiosqlite", "postgresql": "postgresql+asyncpg"}
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


def _configure_sqlite(engine: AsyncEngine) -> None:
    @event.listens_for(engine.sync_engine, "connect")
    def connected(connection: Any, record: object) -> None:  # pyright: ignore[reportUnusedFunction]
        # Without this the driver would begin transactions by itself, and not before data definition.
        connection.isolation_level = None
        cursor = connection.cursor()
        cursor.execute(f"PRAGMA busy_timeout = {int(BUSY_SECONDS * 1000)}")
        for setting in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON", "trusted_schema = OFF"):
            cursor.execute(f"PRAGMA {setting}")
        cursor.close()

    @event.listens_for(engine.sync_engine, "begin")
    def begun(connection: sql.Connection) -> None:  # pyright: ignore[reportUnusedFunction]
        # A writer that began by reading could find its view outdated and fail: it takes the lock first.
        writes = connection.get_execution_options().get(_WRITES, True)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _unusable(where: str, error: DBAPIError) -> LibraryUnusable:
    reason = str(error.orig or error)
    remedies = {
        "locked": "another program holds it for long: close that program, then try again",
        "full": "free space on its disk, then try again",
        "not a database": "the file is damaged or something else: restore it from a backup or name another file",
        "malformed": "the file is damaged: restore it from a backup",
        "readonly": "give this user the right to write it and its folder",
        "unable to open": "give this user the right to read and write it and its folder",
    }
    remedy = next((remedy for word, remedy in remedies.items() if word in reason), "see the log for the statement")
    return LibraryUnusable(where, reason, remedy)
