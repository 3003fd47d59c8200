"""Where samples come from: a tracker that sends lines by UDP, or files replayed at their own speed."""

import asyncio
import socket
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from models.demonstration import Demonstration
from opcua_skill.gateway.lines import BATCH_SAMPLES, FORMAT, Intake, Losses, parse
from opcua_skill.server.recording import Samples

BATCH_SECONDS = 0.1
BETWEEN_FILES = 0.5
RECEIVE_BUFFER = 4 * 1024 * 1024
SETTLED = 0.3
MOST_EARLY = 20_000
STOPPED = "stopped"


class SourceFault(Exception):
    """A source that gives nothing that could be recorded: one sentence, with what to do."""


class Source(Protocol):
    """Where samples come from."""

    name: str
    ended: str

    @property
    def losses(self) -> Losses:
        """What was not taken so far."""
        ...

    async def begin(self) -> int:
        """Return the dimension of the positions once it is known; raises SourceFault if nothing comes."""
        ...

    async def next(self, stop: asyncio.Event) -> Samples | None:
        """Return the next samples; None at the end, or once asked to stop: then ``ended`` says why."""
        ...


class UdpSource(asyncio.DatagramProtocol):
    """Lines of text that come by UDP. ``silence`` s without a sample end the recording, ``wait`` s before the first.

    One sender is listened to: the one at the address ``only``, or if none is named the one that sends most that can be
    read in the first SETTLED s. Who happens to come first does not shut the tracker out.
    """

    def __init__(self, *, silence: float = 5.0, wait: float = 60.0, only: str = "") -> None:
        self.name = ""
        self.ended = ""
        self._intake = Intake()
        self._silence, self._wait = silence, wait
        self._news = asyncio.Event()
        self._transport: asyncio.DatagramTransport | None = None
        self._last_batch = 0.0
        self._only = only
        self._early: list[tuple[bytes, tuple[Any, ...], float]] | None = []
        self._other = ""
        self._heard = False

    @property
    def losses(self) -> Losses:
        """What was not taken so far."""
        return self._intake.losses

    async def open(self, host: str, port: int) -> tuple[str, int]:
        """Listen; return address and port. Raises SourceFault if that cannot be."""
        loop = asyncio.get_running_loop()
        try:
            self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=(host, port))
        except OSError as error:
            raise SourceFault(
                f"{host}:{port} cannot be listened to ({error.strerror or error}): choose another port"
            ) from error
        bound: socket.socket = self._transport.get_extra_info("socket")
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        address = bound.getsockname()
        self.name = f"UDP {address[0]}:{address[1]}"
        return address[0], address[1]

    def close(self) -> None:
        """Listen no more."""
        if self._transport is not None:
            self._transport.close()

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        """Take a datagram from the loop."""
        sender, arrived = addr[:2], time.monotonic()
        if self._only and sender[0] != self._only:
            self._intake.losses.foreign += 1
            self._other = f"{sender[0]}:{sender[1]}"
        elif self._early is None:
            before = self._intake.losses.foreign
            self._intake.feed(data, sender, arrived)
            if self._intake.losses.foreign > before:
                self._other = f"{sender[0]}:{sender[1]}"
        elif len(self._early) < MOST_EARLY:
            self._early.append((data, sender, arrived))
            self._heard = self._heard or _readable(data) > 0
        self._news.set()

    async def begin(self) -> int:
        """Wait for the first sample that can be read."""
        try:
            async with asyncio.timeout(self._wait):
                while not self._heard and self._intake.shape is None:
                    self._news.clear()
                    await self._news.wait()
            await asyncio.sleep(SETTLED)
        except TimeoutError:
            pass
        self._choose()
        if self._intake.shape is None:
            losses = self.losses
            if losses.garbled:
                raise SourceFault(
                    f"{losses.garbled} lines came to {self.name} and none could be read, the last"
                    f" {losses.last_garbled}; a line is {FORMAT}"
                )
            raise SourceFault(
                f"nothing came to {self.name} within {self._wait:g} s{self._elsewhere}: does the tracker send there?"
            )
        return self._intake.shape[0]

    async def next(self, stop: asyncio.Event) -> Samples | None:
        """Return what came within the last tenth of a second or so."""
        while not self.ended:
            due = self._last_batch + BATCH_SECONDS - time.monotonic()
            if due <= 0 or self._intake.waiting >= BATCH_SAMPLES:
                found = self._intake.take(all_of_it=self._quiet > BATCH_SECONDS)
                if found is not None:
                    self._last_batch = time.monotonic()
                    return found
            self.ended = self._why_to_end(stop)
            if not self.ended:
                await _either(stop, max(due, 0.05))
        return self._intake.take(all_of_it=True)

    def _choose(self) -> None:
        """Listen to the sender that has sent most that can be read; what the others have sent is counted."""
        early, self._early = self._early or [], None
        lines: Counter[tuple[Any, ...]] = Counter()
        for data, sender, _ in early:
            lines[sender] += _readable(data)
        chosen = max(lines, key=lambda one: lines[one], default=None)
        for data, sender, arrived in sorted(early, key=lambda one: one[1] != chosen):
            self._intake.feed(data, sender, arrived)
            if sender != chosen:
                self._other = f"{sender[0]}:{sender[1]}"

    @property
    def _elsewhere(self) -> str:
        """Who sent and was not listened to, as part of a sentence."""
        return f" ({self._other} sent and was not listened to: --sender says to whom)" if self._other else ""

    @property
    def _quiet(self) -> float:
        """How long in s no sample has been taken."""
        return time.monotonic() - (self._intake.last_taken_at or 0.0)

    def _why_to_end(self, stop: asyncio.Event) -> str:
        if stop.is_set():
            return STOPPED
        if self._intake.fault:
            return f"{self._intake.fault}: start the recording again after the tracker"
        if self._quiet < self._silence:
            return ""
        nothing = f"no sample came for {self._silence:g} s{self._elsewhere}"
        if self._intake.last_refused_at < (self._intake.last_taken_at or 0.0):
            return nothing
        return f"{nothing} that could be taken: {self.losses.words()}; {self.losses.last_garbled}"


class ReplaySource:
    """Demonstrations of files, one after the other at their own speed, the button released in between.

    Samples keep the times they were recorded with whatever the ``speed``; what was not seen (NaN) is not sent.
    """

    def __init__(self, demonstrations: Sequence[Demonstration], name: str, speed: float = 1.0) -> None:
        self.name = name
        self.losses = Losses()
        self.ended = ""
        self._speed = speed
        self._demonstrations = list(demonstrations)
        self._all: Samples | None = None
        self._sent = 0
        self._began = 0.0

    async def begin(self) -> int:
        """Lay the demonstrations behind each other."""
        if not self._demonstrations:
            raise SourceFault(f"{self.name} holds no demonstrations")
        if len({one.dimension for one in self._demonstrations}) > 1:
            raise SourceFault(f"{self.name}: some are in the plane, some in space: record them one after the other")
        if len({one.orientations is None for one in self._demonstrations}) > 1:
            raise SourceFault(f"{self.name}: some have orientations, some have none: record them one after the other")
        self._all = in_a_row(self._demonstrations)
        self._began = time.monotonic()
        return self._demonstrations[0].dimension

    async def next(self, stop: asyncio.Event) -> Samples | None:
        """Return what is due by now."""
        assert self._all is not None
        times = self._all.times
        while not self.ended:
            if stop.is_set():
                self.ended = STOPPED
                break
            if self._sent == len(times):
                self.ended = "all was sent"
                break
            now = (time.monotonic() - self._began) * self._speed if self._speed else np.inf
            due = min(int(np.searchsorted(times, now, side="right")), self._sent + BATCH_SAMPLES)
            if due > self._sent:
                part = slice(self._sent, due)
                self._sent = due
                turned = self._all.orientations
                return Samples(
                    times[part],
                    self._all.positions[part],
                    self._all.triggers[part],
                    None if turned is None else turned[part],
                )
            await _either(stop, max(BATCH_SECONDS, float((times[self._sent] - now) / self._speed)))
        return None


def _readable(data: bytes) -> int:
    """Return how many lines of a datagram are samples."""
    count = 0
    for line in data.decode("ascii", errors="replace").splitlines():
        try:
            parse(line)
        except ValueError:
            continue
        count += 1
    return count


async def _either(stop: asyncio.Event, seconds: float) -> None:
    try:
        async with asyncio.timeout(seconds):
            await stop.wait()
    except TimeoutError:
        return


def in_a_row(demonstrations: Sequence[Demonstration]) -> Samples:
    """Return demonstrations behind each other on one clock, half a second apart, with the button released between."""
    times, places, buttons, turns = [], [], [], []
    clock = 0.0
    for one in demonstrations:
        seen = np.isfinite(one.points).all(axis=1)
        if not seen.any():
            continue
        since, points, pressed = one.times[seen] - one.times[0] + clock, one.points[seen], one.triggers[seen]
        turned = one.orientations[seen] if one.orientations is not None else np.zeros((len(since), 0))
        released = since[-1] + np.array([0.1, 0.2])
        times.append(np.concatenate([since, released]))
        places.append(np.concatenate([points, points[[-1, -1]]]))
        turns.append(np.concatenate([turned, turned[[-1, -1]]]))
        buttons.append(np.concatenate([pressed, [False, False]]))
        clock = float(released[-1]) + BETWEEN_FILES
    turned = np.concatenate(turns) if turns else np.zeros((0, 0))
    return Samples(
        np.concatenate(times) if times else np.zeros(0),
        np.concatenate(places) if places else np.zeros((0, demonstrations[0].dimension)),
        np.concatenate(buttons).astype(np.bool_) if buttons else np.zeros(0, dtype=np.bool_),
        turned if turned.shape[1] else None,
    )
