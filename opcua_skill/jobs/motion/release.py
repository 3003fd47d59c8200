"""Whether the next job of an arm may begin: held by whatever went wrong, released by a person and by nothing else.

A hold counts at once, whatever the database does; it is written down as soon as that is possible, and told. A release
is written down first and counts afterwards.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from library.description import Cause, StationRecord
from library.errors import LibraryError, NotAllowedInState
from library.store import SkillLibrary

GRAVER = frozenset({Cause.PROTECTIVE_STOP, Cause.ARM_LOST})
"""Causes that are shown in place of another one: they need more than a release."""
PATIENCE = 0.2
WRITE_AGAIN, WRITE_AGAIN_AT_MOST = 0.1, 5.0

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class QueueStatus:
    """A queue as clients see it. ``because`` is Cause.NONE while it is released; ``waiting`` counts its jobs."""

    because: Cause = Cause.NONE
    by: str = ""
    since: datetime = field(default_factory=lambda: datetime.now(UTC))
    waiting: int = 0

    @property
    def held(self) -> bool:
        """Whether no further job begins."""
        return self.because is not Cause.NONE

    @property
    def state(self) -> str:
        """Held or Released."""
        return "Held" if self.held else "Released"


class ArmQueue:
    """The state of one arm's queue: in memory for whoever asks, in the library for after a restart."""

    def __init__(
        self, workstation: str, library: SkillLibrary, tell: Callable[[str, QueueStatus], Awaitable[None]]
    ) -> None:
        self._workstation = workstation
        self._library = library
        self._tell = tell
        self._now = QueueStatus()
        self._holds = 0
        self._written = asyncio.Event()
        self._written.set()
        self._unwritten = asyncio.Event()
        self._changed = asyncio.Event()
        self._writing = asyncio.Lock()
        self._keepers: list[asyncio.Task[None]] = []
        self.on_change: Callable[[], None] = lambda: None

    @property
    def status(self) -> QueueStatus:
        """How the queue is now."""
        return self._now

    @property
    def held(self) -> bool:
        """Whether no further job begins."""
        return self._now.held

    def restore(self, record: StationRecord) -> None:
        """Be as the library remembers it."""
        self._now = replace(self._now, because=record.held_because, by=record.held_by, since=record.held_since)

    def start(self) -> None:
        """Begin to write down and to tell what changes."""
        self._keepers = [asyncio.create_task(work(), name=f"queue of {self._workstation}") for work in (
            self._keep_written, self._keep_told)]  # fmt: skip

    async def stop(self) -> None:
        """Write down what is not written yet, if that goes quickly, and end."""
        await self.written()
        for keeper in self._keepers:
            keeper.cancel()
        await asyncio.gather(*self._keepers, return_exceptions=True)

    def hold(self, because: Cause, by: str) -> None:
        """Let no further job begin, from now on. The first cause stays the one shown, unless a graver one comes."""
        self._holds += 1
        if self.held and (because not in GRAVER or self._now.because in GRAVER):
            return
        self._now = replace(self._now, because=because, by=by, since=datetime.now(UTC))
        _log.warning("the queue of %s is held: %s, by %s", self._workstation, because.value, by)
        self._note_unwritten()
        self._note_change()

    async def release(self, by: str, check: Callable[[], None]) -> None:
        """Let the next job begin. ``check`` raises whatever is in the way; asked before and after it is written down.

        Raises NotAllowedInState if the queue was held anew meanwhile.
        """
        if not self.held:
            return
        check()
        seen, since = self._holds, datetime.now(UTC)
        try:
            async with self._writing:
                await self._library.change_station(
                    self._workstation, held_because=Cause.NONE, held_by=by, held_since=since
                )
            check()
            if self._holds != seen:
                raise NotAllowedInState(f"the queue of {self._workstation}", "held anew", "look first, then release it")
        except BaseException:
            # What was written, or may still be, is not what counts: it is written over.
            self._note_unwritten()
            raise
        self._now = replace(self._now, because=Cause.NONE, by=by, since=since)
        _log.info("the queue of %s is released by %s", self._workstation, by)
        self._note_change()
        self.on_change()

    def count(self, waiting: int) -> None:
        """Note how many jobs wait."""
        if waiting != self._now.waiting:
            self._now = replace(self._now, waiting=waiting)
            self._note_change()

    async def written(self, patience: float | None = None) -> bool:
        """Wait until the state has reached the disk, but not for long: ``patience`` s; return whether it has."""
        try:
            # Not wait_for: in Python 3.11 that loses a cancellation that comes with what it waits for.
            async with asyncio.timeout(PATIENCE if patience is None else patience):
                await self._written.wait()
        except TimeoutError:
            return False
        return True

    def _note_unwritten(self) -> None:
        self._written.clear()
        self._unwritten.set()

    def _note_change(self) -> None:
        self._changed.set()

    async def _keep_written(self) -> None:
        pause = WRITE_AGAIN
        while True:
            await self._unwritten.wait()
            self._unwritten.clear()
            try:
                async with self._writing:
                    now = self._now
                    await self._library.change_station(
                        self._workstation, held_because=now.because, held_by=now.by, held_since=now.since
                    )
            except LibraryError as unusable:
                _log.warning("the queue of %s is not written down yet: %s", self._workstation, unusable)
                await asyncio.sleep(pause)
                pause = min(2.0 * pause, WRITE_AGAIN_AT_MOST)
                self._unwritten.set()
                continue
            pause = WRITE_AGAIN
            if not self._unwritten.is_set():
                self._written.set()

    async def _keep_told(self) -> None:
        """Tell every change once it is written, or at once where that takes longer: a hold must not stay unseen."""
        while True:
            await self._changed.wait()
            self._changed.clear()
            await self.written()
            try:
                await self._tell(self._workstation, self._now)
            except Exception:
                _log.exception("telling of the queue of %s failed", self._workstation)
