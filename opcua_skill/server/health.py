"""How well the server serves: what ServiceLevel is lowered for, as a word for programs and a sentence for people."""

import asyncio
import logging
import shutil
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from library.errors import LibraryUnusable, Trouble
from library.store import SkillLibrary
from library.turns import waiting_at_most

CHECK_EVERY, LIMIT = 0.5, 1.0
LEAST_FREE = 20 * 1024 * 1024
LOSSES_SECONDS = 10.0

_log = logging.getLogger(__name__)


class FaultKind(StrEnum):
    """What is wrong, in one word."""

    LIBRARY_SILENT = "LibrarySilent"
    LIBRARY_LOCKED = "LibraryLocked"
    LIBRARY_UNREACHABLE = "LibraryUnreachable"
    LIBRARY_UNUSABLE = "LibraryUnusable"
    AUDIT_BEHIND = "AuditBehind"
    DISK_FULL = "DiskFull"
    TRACES_LOST = "TracesLost"
    RECORDS_DROPPED = "RecordsDropped"
    SERVED_ELSEWHERE = "ServedElsewhere"
    ARM_WAITING = "ArmWaiting"


@dataclass(frozen=True)
class Fault:
    """Something that keeps the server from serving well."""

    kind: FaultKind
    words: str


_TROUBLES = {
    Trouble.LOCKED: Fault(FaultKind.LIBRARY_LOCKED, "another program holds the library's database locked"),
    Trouble.UNREACHABLE: Fault(FaultKind.LIBRARY_UNREACHABLE, "the library's database server cannot be reached"),
    Trouble.OUTCOME_UNKNOWN: Fault(FaultKind.LIBRARY_UNREACHABLE, "the library's database server cannot be reached"),
    Trouble.FULL: Fault(FaultKind.DISK_FULL, "the library cannot be written: its disk is full"),
}


class Health:
    """What keeps the server from its work: the library is asked now and then, and what could not be recorded counts.

    ``writable`` raises when nothing can be written, ``folder`` is where the server's data lie.
    """

    def __init__(
        self,
        library: SkillLibrary,
        *,
        check_every: float = CHECK_EVERY,
        limit: float = LIMIT,
        writable: Callable[[], Awaitable[None]] | None = None,
        folder: Path | None = None,
    ) -> None:
        self._library = library
        self._check_every = check_every
        self._limit = limit
        self._writable = writable
        self._folder = folder
        self._answers = True
        self._write_fault: Fault | None = None
        self._disk_fault: Fault | None = None
        self._recorded = True
        self._lost: dict[FaultKind, tuple[float, str]] = {}
        self._watching: list[asyncio.Task[None]] = []

    def start(self) -> None:
        """Go on asking the library."""
        self._watching = [asyncio.create_task(self._watch(self._ask), name="health of the library")]
        if self._writable is not None:
            self._watching.append(asyncio.create_task(self._watch(self._try_to_write), name="health of writing"))

    async def stop(self) -> None:
        """Ask no more."""
        for task in self._watching:
            task.cancel()
        await asyncio.gather(*self._watching, return_exceptions=True)

    def recorded(self, done: bool) -> None:
        """Say whether the last entry of the audit trail could be written."""
        self._recorded = done

    def lost(self, kind: FaultKind, words: str) -> None:
        """Say that something was lost just now; it is told for a while."""
        self._lost[kind] = (asyncio.get_running_loop().time() + LOSSES_SECONDS, words)

    @property
    def told(self) -> tuple[Fault, ...]:
        """What is wrong now; empty when nothing is."""
        found = []
        if not self._answers:
            found.append(Fault(FaultKind.LIBRARY_SILENT, "the library does not answer"))
        found += [fault for fault in (self._write_fault, self._disk_fault) if fault is not None]
        if not self._recorded:
            found.append(Fault(FaultKind.AUDIT_BEHIND, "the audit trail cannot be written"))
        if self._lost:
            now = asyncio.get_running_loop().time()
            found += [Fault(kind, words) for kind, (until, words) in self._lost.items() if now < until]
        return tuple(found)

    @property
    def faults(self) -> tuple[str, ...]:
        """What is wrong now, in words."""
        return tuple(fault.words for fault in self.told)

    async def _watch(self, look: Callable[[], Awaitable[None]]) -> None:
        while True:
            await asyncio.sleep(self._check_every)
            await look()

    async def _ask(self) -> None:
        try:
            async with asyncio.timeout(self._limit):
                await self._library.audit_trail(limit=1)
        except Exception as error:
            if self._answers:
                _log.error("the library does not answer: %s", error or type(error).__name__)
            self._answers = False
        else:
            self._answers = True

    async def _try_to_write(self) -> None:
        assert self._writable is not None
        before = (self._write_fault, self._disk_fault)
        try:
            with waiting_at_most(self._limit):
                await self._writable()
        except LibraryUnusable as unusable:
            other = Fault(FaultKind.LIBRARY_UNUSABLE, "the library cannot be written")
            self._write_fault = _TROUBLES.get(unusable.trouble, other)
        else:
            self._write_fault = None
        self._disk_fault = await asyncio.to_thread(self._room) if self._folder is not None else None
        for fault in (self._write_fault, self._disk_fault):
            if fault is not None and fault not in before:
                _log.error("%s", fault.words)

    def _room(self) -> Fault | None:
        assert self._folder is not None
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError:
            return Fault(FaultKind.DISK_FULL, "the data folder cannot be reached")
        words = "the disk of the data folder is full: free space on it"
        return Fault(FaultKind.DISK_FULL, words) if free < LEAST_FREE else None
