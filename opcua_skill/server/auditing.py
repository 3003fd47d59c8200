"""What goes into the audit trail: in order, waited for a little, kept and tried again while it cannot be written."""

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Callable

from library.records import AuditEntry
from library.store import SkillLibrary
from library.turns import waiting_at_most

KEPT = 2_000
WAITED_FOR = 1.0
ONE_TRY, BETWEEN_TRIES, LAST_TRY = 2.0, 0.25, 2.0

_log = logging.getLogger(__name__)


class AuditWriter:
    """Writes entries one after another. Who hands one in waits a second at most; ``told`` hears how it goes."""

    def __init__(self, library: SkillLibrary, told: Callable[[bool], None]) -> None:
        self._library = library
        self._told = told
        self._waiting: deque[tuple[AuditEntry, asyncio.Future[None]]] = deque()
        self._arrived = asyncio.Event()
        self._lost = 0
        self._closing = False
        self._task: asyncio.Task[None] | None = None

    @property
    def behind(self) -> int:
        """Return how many entries wait."""
        return len(self._waiting)

    def start(self) -> None:
        """Begin to write."""
        self._task = asyncio.create_task(self._write(), name="audit trail")

    async def stop(self) -> None:
        """Write what waits, if that is possible within two seconds; say how much was lost if it is not."""
        if self._task is None:
            return
        self._closing = True
        self._arrived.set()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._task, LAST_TRY)
        if self._waiting:
            _log.error("%d entries of the audit trail could not be written before the end", len(self._waiting))

    async def add(self, entry: AuditEntry) -> None:
        """Hand an entry in; return once it is written, or after a second: then it is kept and written later."""
        if len(self._waiting) >= KEPT:
            self._lost += 1
            return
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.append((entry, done))
        self._arrived.set()
        await asyncio.wait({done}, timeout=WAITED_FOR)

    async def _write(self) -> None:
        while True:
            while not self._waiting:
                if self._closing:
                    return
                self._arrived.clear()
                await self._arrived.wait()
            if self._lost and len(self._waiting) < KEPT:
                self._mention_lost()
            entry, done = self._waiting[0]
            try:
                with waiting_at_most(ONE_TRY):
                    await self._library.audit(entry)
            except Exception as error:
                self._told(False)
                _log.error("the audit trail cannot be written, %d entries wait: %s", self.behind, error)
                await asyncio.sleep(BETWEEN_TRIES)
                continue
            self._waiting.popleft()
            self._told(True)
            if not done.done():
                done.set_result(None)

    def _mention_lost(self) -> None:
        lost, self._lost = self._lost, 0
        reason = f"{lost} entries were lost here: they could not be written, and more than {KEPT} waited"
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.append((AuditEntry(action="EntriesLost", arguments={"count": lost}, reason=reason), done))
