"""How long the event loop is held: what holds it too long is told, with the place where it stood."""

import asyncio
import logging
import sys
import threading
import time
import traceback
from collections import deque
from dataclasses import dataclass

log = logging.getLogger(__name__)
MOST_SECONDS = 0.020
LOOK_EVERY = 0.005
TOLD_AT_MOST_EVERY = 10.0
REMEMBERED = 50


@dataclass(frozen=True, slots=True)
class Hold:
    """The loop was held for so many seconds of processor time; ``where``: the line it stood at then."""

    seconds: float
    where: str


class Watchdog:
    """Looks from a thread of its own how long the loop has been doing one thing.

    Counted is the processor time of the loop's thread, so that a machine which lets it wait is not taken for a loop
    that is held.
    """

    def __init__(self, most: float = MOST_SECONDS) -> None:
        self._most = most
        self.longest = 0.0
        self.holds = 0
        self.latest: deque[Hold] = deque(maxlen=REMEMBERED)
        self._begun: tuple[int, float] = (0, 0.0)
        self._turn = 0
        self._clock = 0
        self._thread_id = 0
        self._told_at = 0.0
        self._stopped = threading.Event()
        self._beating: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin to look. Called on the loop's thread."""
        self._thread_id = threading.get_ident()
        self._clock = time.pthread_getcpuclockid(self._thread_id)
        self._begun = (0, time.clock_gettime(self._clock))
        self._beating = asyncio.create_task(self._beat(), name="watchdog of the loop")
        threading.Thread(target=self._watch, name="watchdog of the loop", daemon=True).start()

    async def stop(self) -> None:
        """Look no more."""
        self._stopped.set()
        if self._beating is not None:
            self._beating.cancel()
            await asyncio.gather(self._beating, return_exceptions=True)

    async def _beat(self) -> None:
        """Mark each turn of the loop, as far as it is asked for one every few milliseconds."""
        while True:
            self._turn += 1
            self._begun = (self._turn, time.clock_gettime(self._clock))
            await asyncio.sleep(LOOK_EVERY)

    def _watch(self) -> None:
        noticed, where, held = 0, "", 0.0
        while not self._stopped.wait(LOOK_EVERY):
            turn, begun = self._begun
            busy = time.clock_gettime(self._clock) - begun
            if noticed and turn != noticed:
                self._tell(Hold(held, where))
                noticed = 0
            if busy > self._most and turn == self._begun[0]:
                frame = sys._current_frames().get(self._thread_id)
                last = traceback.extract_stack(frame)[-1] if frame is not None and not noticed else None
                where = f"{last.filename}:{last.lineno} {last.name}" if last is not None else where
                noticed, held = turn, busy

    def _tell(self, hold: Hold) -> None:
        self.holds += 1
        self.longest = max(self.longest, hold.seconds)
        self.latest.append(hold)
        now = time.monotonic()
        if now - self._told_at >= TOLD_AT_MOST_EVERY:
            self._told_at = now
            log.warning(
                "the loop was held for %.0f ms at %s (%d times so far)", 1e3 * hold.seconds, hold.where, self.holds
            )
