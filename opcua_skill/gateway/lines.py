"""Lines of text from a tracker: read, put in order, and what was not taken counted."""

import re
from bisect import bisect_left
from collections import OrderedDict, deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.demonstration import Floats
from opcua_skill.server.recording import FARTHEST, UNIT_TOLERANCE, Samples

FORMAT = "[#number] t x y [z] [qx qy qz qw] trigger"
BATCH_SAMPLES = 2_000
MOST_WAITING = 200_000
HELD_BACK = 0.02
CLOCK_TOLERANCE = 3.0
STRAGGLE = 0.2
LATE_IN_A_ROW = 20
FAR_BACK_IN_A_ROW, FAR_BACK = 3, 0.5
REMEMBERED = 5_000
_NUMBER = re.compile(r"[+-]?(?:[0-9]{1,15}(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_COUNT = re.compile(r"#([0-9]{1,15})")


class _Garbled(ValueError):
    """A line that cannot be read."""


@dataclass(frozen=True, slots=True)
class Line:
    """One sample as it came: ``time`` in s on the tracker's clock, ``place`` in m, ``turn`` x y z w or empty."""

    number: int | None
    time: float
    place: tuple[float, ...]
    turn: tuple[float, ...]
    trigger: bool

    @property
    def shape(self) -> tuple[int, int]:
        """How many values position and orientation have: the same in every line of a recording."""
        return len(self.place), len(self.turn)


def parse(text: str) -> Line:
    """Return the sample in a line; raises ValueError with the reason if there is none."""
    words = text.split()
    number = None
    if words and (counted := _COUNT.fullmatch(words[0])):
        number, words = int(counted.group(1)), words[1:]
    if len(words) not in (4, 5, 9):
        raise _Garbled(f"it has {len(words)} values: 4 (t x y trigger), 5 with z, 9 with z and a quaternion")
    *values, button = words
    if button not in ("0", "1"):
        raise _Garbled(f"its trigger is {button[:20]!r}: 0 or 1")
    wrong = next((word for word in values if not _NUMBER.fullmatch(word)), None)
    if wrong is not None:
        raise _Garbled(f"{wrong[:20]!r} is no number")
    moment, *rest = (float(word) for word in values)
    if not np.isfinite(moment):
        raise _Garbled("its time is infinite")
    place, turn = tuple(rest[:3]), tuple(rest[3:])
    if max(abs(value) for value in place) > FARTHEST:
        raise _Garbled(f"its position is more than {FARTHEST:g} m away: positions are in metres")
    if turn and abs(float(np.linalg.norm(turn)) - 1.0) > UNIT_TOLERANCE:
        raise _Garbled("its quaternion has not length 1")
    return Line(number, moment, place, turn, button == "1")


@dataclass(slots=True)
class Losses:
    """What was not taken. ``lost`` is exact where lines are numbered, and an estimate from the rate where not."""

    lost: int = 0
    duplicated: int = 0
    late: int = 0
    garbled: int = 0
    foreign: int = 0
    put_in_order: int = 0
    last_garbled: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the counts by name."""
        names = ("lost", "duplicated", "late", "garbled", "foreign", "put_in_order", "last_garbled")
        return {name: getattr(self, name) for name in names}

    def words(self) -> str:
        """Return what happened as part of a sentence; empty if nothing did."""
        said = {
            "lost": self.lost,
            "twice": self.duplicated,
            "too late": self.late,
            "unreadable": self.garbled,
            "from somebody else": self.foreign,
        }
        return ", ".join(f"{count} {word}" for word, count in said.items() if count)


@dataclass(eq=False)
class Intake:
    """Datagrams in, samples in order of their time out; nothing here waits, and nothing is invented.

    Only the first sender is listened to. ``arrived`` below is the receiver's clock in s.
    """

    losses: Losses = field(default_factory=Losses)
    shape: tuple[int, int] | None = None
    last_taken_at: float | None = None
    last_refused_at: float = 0.0
    fault: str = ""

    def __post_init__(self) -> None:
        self._sender: object = None
        self._now = 0.0
        self._waiting: list[Line] = []
        self._times: list[float] = []
        self._given: float | None = None
        self._known: OrderedDict[float, Line] = OrderedDict()
        self._offset: float | None = None
        self._highest: int | None = None
        self._late_in_a_row = 0
        self._steps: deque[float] = deque(maxlen=200)
        self._counted = 0
        self._previous: float | None = None

    @property
    def waiting(self) -> int:
        """How many samples have come and were not given on yet."""
        return len(self._waiting)

    def feed(self, datagram: bytes, sender: object, arrived: float) -> None:
        """Take a datagram: one line or several."""
        self._now = arrived
        if self.fault:
            return
        if self._sender is not None and sender != self._sender:
            self.losses.foreign += 1
            return
        try:
            text = datagram.decode("ascii")
        except UnicodeDecodeError:
            self._refuse(ascii(datagram[:40]), "it is no plain text")
            return
        for line in text.splitlines():
            if line.strip():
                self._feed_line(line, sender, arrived)

    def take(self, *, all_of_it: bool = False) -> Samples | None:
        """Return the samples that have come, in order, or None; the newest 20 ms wait for stragglers unless asked."""
        count = len(self._waiting)
        if not all_of_it and count:
            count = bisect_left(self._times, self._times[-1] - HELD_BACK)
        count = min(count, BATCH_SAMPLES)
        if count == 0 or self.shape is None:
            return None
        lines, self._waiting, self._times = self._waiting[:count], self._waiting[count:], self._times[count:]
        self._given = lines[-1].time
        times = np.array([line.time for line in lines])
        self._guess_losses(times)
        return Samples(
            times,
            np.array([line.place for line in lines]),
            np.array([line.trigger for line in lines], dtype=np.bool_),
            np.array([line.turn for line in lines]) if self.shape[1] else None,
        )

    def _refuse(self, line: str, reason: str) -> None:
        self.losses.garbled += 1
        self.losses.last_garbled = f"{line[:60].strip()!r}: {reason}"
        self.last_refused_at = self._now

    def _feed_line(self, text: str, sender: object, arrived: float) -> None:
        try:
            line = parse(text)
        except _Garbled as wrong:
            self._refuse(text, str(wrong))
            return
        if self.shape is not None and line.shape != self.shape:
            self._refuse(text, f"it has {sum(line.shape)} values of a pose, the lines before had {sum(self.shape)}")
            return
        known = self._known.get(line.time)
        if known == line:
            self.losses.duplicated += 1
            return
        newest = self._times[-1] if self._times else self._given
        given = self._given is not None and line.time <= self._given
        if newest is not None and (given or line.time < newest - STRAGGLE):
            self._came_late(line, newest)
            return
        if known is not None:
            self._refuse(text, "another sample had this time already")
            return
        if not self._fits_the_clock(line.time, arrived):
            self._refuse(text, "its time does not go with the clock: t is in s, sent as it is measured")
            return
        if len(self._waiting) >= MOST_WAITING:
            self.losses.lost += 1
            return
        self._sender, self.shape, self.last_taken_at = sender, line.shape, arrived
        self._late_in_a_row = 0
        self._count_numbers(line)
        place = bisect_left(self._times, line.time)
        self.losses.put_in_order += place < len(self._times)
        self._times.insert(place, line.time)
        self._waiting.insert(place, line)
        self._known[line.time] = line
        if len(self._known) > REMEMBERED:
            self._known.popitem(last=False)

    def _came_late(self, line: Line, newest: float) -> None:
        """Count a straggler; many in a row, or a few from far back, are a clock that was set back."""
        self.losses.late += 1
        self._count_numbers(line)
        self._late_in_a_row += 1
        needed = FAR_BACK_IN_A_ROW if newest - line.time > FAR_BACK else LATE_IN_A_ROW
        if self._late_in_a_row >= needed and not self.fault:
            self.fault = f"the tracker's clock went back from {newest:g} s to {line.time:g} s"

    def _fits_the_clock(self, time_: float, arrived: float) -> bool:
        """Return whether a time is not ahead of the clock. Behind it may be: datagrams wait while a machine is busy."""
        ahead = time_ - arrived
        if self._offset is None:
            self._offset = ahead
        if ahead - self._offset > CLOCK_TOLERANCE:
            return False
        self._offset = max(self._offset, ahead)
        return True

    def _count_numbers(self, line: Line) -> None:
        """Count numbers that were left out; one that comes after all is not lost."""
        if line.number is None:
            return
        self._counted += 1
        if self._highest is None or line.number > self._highest:
            self.losses.lost += 0 if self._highest is None else line.number - self._highest - 1
            self._highest = line.number
        else:
            self.losses.lost = max(0, self.losses.lost - 1)

    def _guess_losses(self, times: Floats) -> None:
        """Where lines have no numbers but a steady rate, a step of n periods is n - 1 samples that did not come."""
        steps = np.diff(times if self._previous is None else np.concatenate([[self._previous], times]))
        self._previous = float(times[-1])
        known = np.array([*self._steps, *steps])
        self._steps.extend(steps.tolist())
        if self._counted or len(known) < 20:
            return
        period = float(np.median(known))
        if float((np.abs(known - period) <= 0.25 * period).mean()) < 0.8:
            return
        wide = steps[steps > 1.5 * period]
        self.losses.lost += int(np.round(wide / period - 1).sum())
