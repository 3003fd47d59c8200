"""One server per library: a lock on the data folder and on the database, held by the process that serves them.

The kernel holds the lock (`flock`), so that it ends with its process however that ends: a stale file is no obstacle.
What stands in the file is for people: who holds it, since when, and where it listens.
"""

import contextlib
import fcntl
import json
import os
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from opcua_skill.configuration.settings import Settings

LOCK_FILE = "server.lock"
PATIENCE = 0.5
"""s for which a server tries again: somebody who asks who holds a lock has it for a moment."""


@dataclass(frozen=True, slots=True)
class Holder:
    """Who serves a library: process id, host, since when, at which address, and the database's file."""

    process: int
    host: str
    since: datetime
    endpoint: str
    database: str

    def __str__(self) -> str:
        since = self.since.astimezone().strftime("%Y-%m-%d %H:%M:%S")
        return f"process {self.process} on {self.host} since {since}, at {self.endpoint}"


class ServedAlready(Exception):
    """Another server has the library. ``holder`` says who, None where the lock's file could not be read."""

    def __init__(self, where: Path, holder: Holder | None) -> None:
        who = str(holder) if holder is not None else "another process"
        super().__init__(f"{where} is served already by {who}: stop that server, or name another folder with --data")
        self.where = where
        self.holder = holder


class DataLock:
    """The lock of one server on its data folder and, wherever that lies, on the file of its database."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._held: list[int] = []

    def take(self) -> Holder | None:
        """Take both locks and return who had the folder last, None for a new one; raises ServedAlready or OSError."""
        files = lock_files(self._settings)
        before = last_holder(files[0])
        me = Holder(
            process=os.getpid(),
            host=socket.gethostname(),
            since=datetime.now(UTC),
            endpoint=self._settings.endpoint,
            database=str(database_file(self._settings) or ""),
        )
        try:
            for file in files:
                self._held.append(_taken(file, me))
        except BaseException:
            self.release()
            raise
        return before

    def release(self) -> None:
        """Let others serve the library; what stands in the files stays, to tell who was the last."""
        while self._held:
            os.close(self._held.pop())


def lock_files(settings: Settings) -> tuple[Path, ...]:
    """Return the files a server locks: two paths to one folder, or one database in two folders, lead to the same."""
    files = [settings.data.resolve() / LOCK_FILE]
    if database := database_file(settings):
        files.append(database.with_name(f"{database.name}.lock"))
    return tuple(files)


def database_file(settings: Settings) -> Path | None:
    """Return the file of the database; None where it is no file."""
    address = settings.database_address
    if "://" in address:
        scheme, _, path = address.partition(":///")
        if not scheme.startswith("sqlite") or not path:
            return None
        address = path.partition("?")[0]
    return Path(address).expanduser().resolve()


def holder(settings: Settings) -> Holder | None:
    """Return who serves a library now, None if nobody does; for verbs that work beside a server, or not.

    Nothing is made or changed by asking.
    """
    for file in lock_files(settings):
        with _opened(file) as descriptor:
            if descriptor is not None and not _lock(descriptor, fcntl.LOCK_SH):
                return last_holder(file)
    return None


def last_holder(file: Path) -> Holder | None:
    """Return what stands in a lock's file, None where nothing does that can be read."""
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
        return Holder(**{**told, "since": datetime.fromisoformat(told["since"])})
    except (OSError, ValueError, TypeError, KeyError):
        return None


def _taken(file: Path, me: Holder) -> int:
    """Lock a file and write into it who did; return its descriptor, which holds the lock."""
    descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    deadline = time.monotonic() + PATIENCE
    while not _lock(descriptor, fcntl.LOCK_EX):
        if time.monotonic() > deadline:
            os.close(descriptor)
            raise ServedAlready(file.parent, last_holder(file))
        time.sleep(0.02)
    told = {name: getattr(me, name) for name in ("process", "host", "endpoint", "database")}
    content = json.dumps({**told, "since": me.since.isoformat()}).encode()
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, content, 0)
    return descriptor


def _lock(descriptor: int, kind: int) -> bool:
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


@contextlib.contextmanager
def _opened(file: Path) -> Iterator[int | None]:
    try:
        descriptor = os.open(file, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        yield None
        return
    try:
        yield descriptor
    finally:
        os.close(descriptor)
