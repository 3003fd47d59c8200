"""Transactions on a PostgreSQL server: writers take turns over all servers of a library, readers never wait for them.

A writer first takes one lock of the whole library, so that what it reads stays true until its commit, as on SQLite: two
approvals, edits or deployments at once end in one that is stored and one that is refused for what it then finds.
"""

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import sqlalchemy as sql
from sqlalchemy.exc import DBAPIError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncTransaction, create_async_engine

from library.errors import LibraryUnusable, Trouble
from library.postgresql.faults import lost, unusable
from library.queries.news import CHANNEL
from library.turns import BUSY_SECONDS, READERS, Turn, Work, busy

CONNECT_SECONDS = 5.0
"""s for a connection: a server that is there answers within one."""
OUTCOME_SECONDS = 10.0
"""s to find out what became of a commit whose connection broke."""
ALIVE_EVERY, LISTEN_AGAIN = 5.0, 0.5
"""s after which a silent connection is asked whether it is still there, and after which a lost one is made anew."""
WRITERS_LOCK = 0x6F706373
"""Key of the advisory lock of those who write: "opcs". PostgreSQL keeps it apart per database."""
SESSION = {
    "application_name": "opcua-skill",
    # A writer looks every second whether somebody still waits for it.
    "lock_timeout": "1s",
    # A server that was cut off in the middle of writing would keep all others from it; none of ours computes so long.
    "idle_in_transaction_session_timeout": "15s",
    "timezone": "UTC",
}
_log = logging.getLogger(__name__)
_TAKE_TURN = sql.text(f"SELECT pg_advisory_xact_lock({WRITERS_LOCK}), pg_current_xact_id()::text")
_OUTCOME = sql.text("SELECT pg_xact_status(CAST(CAST(:number AS text) AS xid8))")


class PostgresTransactions:
    """Transactions in an event loop of their own, in a thread: what they compute does not hold up the server's loop."""

    def __init__(self, url: sql.URL, where: str) -> None:
        self._where = where
        self._engine = create_async_engine(
            url,
            pool_size=READERS + 3,
            max_overflow=2,
            pool_timeout=BUSY_SECONDS,
            connect_args={"timeout": CONNECT_SECONDS, "command_timeout": BUSY_SECONDS, "server_settings": SESSION},
        )
        self._listening: asyncio.Task[None] | None = None
        self._loop = asyncio.new_event_loop()
        self._reading, self._writing = asyncio.Semaphore(READERS), asyncio.Semaphore(1)
        self._thread = threading.Thread(target=self._loop.run_forever, name="library-postgresql", daemon=True)
        self._thread.start()

    def begin(self, work: Work, turn: Turn, writes: bool) -> "asyncio.Future[Any]":
        """Return what ``work`` will have returned once its transaction has been committed."""
        return asyncio.wrap_future(asyncio.run_coroutine_threadsafe(self._in_turn(work, turn, writes), self._loop))

    def listen(self, heard: Callable[[str], None]) -> None:
        """Have ``heard`` called in this thread with what other servers tell, and with "" after every new connection."""
        self._loop.call_soon_threadsafe(self._begin_to_listen, heard)

    def _begin_to_listen(self, heard: Callable[[str], None]) -> None:
        self._listening = self._loop.create_task(self._listen(heard), name="listen to other servers")

    async def _listen(self, heard: Callable[[str], None]) -> None:
        while True:
            try:
                async with self._engine.connect() as connection:
                    await self._hear(connection, heard)
            except Exception as error:  # of the pool, the driver or the socket: whatever it is, it is tried again
                _log.warning("what other servers change is not heard: %s", str(error).partition("\n")[0])
            await asyncio.sleep(LISTEN_AGAIN)

    async def _hear(self, connection: AsyncConnection, heard: Callable[[str], None]) -> None:
        """Pass on what is told until the connection ends."""
        gone = asyncio.Event()

        def ended(_connection: object) -> None:
            gone.set()

        def passed_on(_connection: object, _process: int, _channel: str, told: str) -> None:
            heard(told)

        found: Any = (await connection.get_raw_connection()).driver_connection
        try:
            found.add_termination_listener(ended)
            await found.add_listener(CHANNEL, passed_on)
            heard("")
            while not gone.is_set():
                await found.fetchval("SELECT 1", timeout=CONNECT_SECONDS)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(ALIVE_EVERY):
                        await gone.wait()
        finally:
            await connection.invalidate()

    async def close(self) -> None:
        """Close all connections; nothing runs any more."""
        await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(self._end(), self._loop))
        self._loop.call_soon_threadsafe(self._loop.stop)
        await asyncio.to_thread(self._thread.join)
        self._loop.close()

    async def _end(self) -> None:
        if self._listening is not None:
            self._listening.cancel()
            await asyncio.wait({self._listening})
        await self._engine.dispose()

    async def _in_turn(self, work: Work, turn: Turn, writes: bool) -> Any:
        """Do one transaction, trying until it gets its lock or its time is over; over a broken connection once more."""
        fresh = False
        async with self._writing if writes else self._reading:
            while True:
                turn.check()
                try:
                    return await self._transaction(work, turn, writes)
                except (DBAPIError, OSError, PoolTimeout) as error:
                    if lost(error) and not fresh and isinstance(error, DBAPIError):
                        fresh = True  # it had been kept since before the server was started anew
                        continue
                    told = busy(self._where) if isinstance(error, PoolTimeout) else unusable(self._where, error)
                    if told.trouble is not Trouble.LOCKED or time.monotonic() >= turn.until:
                        raise told from error
                except Exception as error:
                    if not hasattr(error, "sqlstate"):
                        raise
                    raise unusable(self._where, error) from error  # of the driver: refused while connecting

    async def _transaction(self, work: Work, turn: Turn, writes: bool) -> Any:
        async with self._engine.connect() as connection:
            if writes:
                await connection.execution_options(isolation_level="READ COMMITTED")
            else:
                await connection.execution_options(isolation_level="REPEATABLE READ", postgresql_readonly=True)
            transaction = await connection.begin()
            try:
                number = (await connection.execute(_TAKE_TURN)).one()[1] if writes else ""
                turn.check()
                result = await connection.run_sync(work)
                turn.commit()
            except BaseException:
                await _given_up(connection, transaction)
                raise
            try:
                await transaction.commit()
            except (DBAPIError, OSError) as error:
                if not writes or not await self._was_committed(number, error):
                    raise unusable(self._where, error) from error
            return result

    async def _was_committed(self, number: str, error: BaseException) -> bool:
        """Return what became of a transaction whose commit was not answered; raises LibraryUnusable if nobody knows."""
        until = time.monotonic() + OUTCOME_SECONDS
        while time.monotonic() < until:
            try:
                async with self._engine.connect() as connection:
                    found = await connection.scalar(_OUTCOME, {"number": number})
            except Exception as still:
                if isinstance(still, DBAPIError) and not lost(still):
                    break  # a server that does not know this number: another one has taken over
            else:
                if found in {"committed", "aborted"}:
                    return found == "committed"
            await asyncio.sleep(0.1)
        remedy = "look up what is there before trying again"
        raise LibraryUnusable(
            self._where, "the connection broke while it was stored, maybe it is", remedy, Trouble.OUTCOME_UNKNOWN
        ) from error


async def _given_up(connection: AsyncConnection, transaction: AsyncTransaction) -> None:
    """Roll back; where even that fails the server does it, once it sees that the connection is gone."""
    try:
        await transaction.rollback()
    except (DBAPIError, OSError):
        await connection.invalidate()
