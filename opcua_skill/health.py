"""How well the server serves, in words: what ServiceLevel is lowered for."""

import asyncio
import logging

from library.store import SkillLibrary

CHECK_EVERY, LIMIT = 5.0, 3.0

_log = logging.getLogger(__name__)


class Health:
    """What keeps the server from its work: the library is asked now and then, and what could not be recorded counts."""

    def __init__(self, library: SkillLibrary, *, check_every: float = CHECK_EVERY, limit: float = LIMIT) -> None:
        self._library = library
        self._check_every = check_every
        self._limit = limit
        self._answers = True
        self._recorded = True
        self._watching: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Go on asking the library."""
        self._watching = asyncio.create_task(self._watch(), name="health of the library")

    async def stop(self) -> None:
        """Ask no more."""
        if self._watching is not None:
            self._watching.cancel()
            await asyncio.gather(self._watching, return_exceptions=True)

    def recorded(self, done: bool) -> None:
        """Say whether the last entry of the audit trail could be written."""
        self._recorded = done

    @property
    def faults(self) -> tuple[str, ...]:
        """What is wrong now, in words; empty when nothing is."""
        found = []
        if not self._answers:
            found.append("the library does not answer")
        if not self._recorded:
            found.append("the audit trail cannot be written")
        return tuple(found)

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(self._check_every)
            try:
                async with asyncio.timeout(self._limit):
                    await self._library.audit_trail(limit=1)
            except Exception as error:
                if self._answers:
                    _log.error("the library does not answer: %s", error or type(error).__name__)
                self._answers = False
            else:
                self._answers = True
