"""What a tracker sends, kept sample by sample and cut into demonstrations: each press of the push button is one.

A press shorter than 50 ms or three samples is somebody touching the button, and a release shorter than 50 ms is the
button bouncing: neither begins or ends a demonstration. Nothing here knows OPC UA, a clock or a session.
"""

from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np

from models.demonstration import Bools, Demonstration, Floats

SHORTEST_PRESS = 0.05
SHORTEST_RELEASE = 0.05
FEWEST_SAMPLES = 3
FARTHEST = 20.0
UNIT_TOLERANCE = 0.01
ONE_ANSWER = 20_000
ONE_APPEND = 10_000
ALL_SAMPLES = 2_000_000


class InvalidSamples(Exception):
    """Samples that cannot be taken: which ``argument`` is at fault, and the reason in one sentence."""

    def __init__(self, argument: str, reason: str) -> None:
        super().__init__(reason)
        self.argument = argument


class LimitExceeded(Exception):
    """More than the limits allow; the sentence says what to do."""


@dataclass(frozen=True, slots=True)
class Press:
    """One press of the button that is a demonstration: samples ``first`` to ``end``, the latter not included."""

    demonstration_id: str
    first: int
    end: int


@dataclass(frozen=True, slots=True)
class Button:
    """Where the push button is: not pressed, pressed since a sample, or perhaps released since one.

    ``presses`` counts the demonstrations there have been, so that a discarded one's name is not used again.
    """

    pressed: int | None = None
    released: int | None = None
    presses: int = 0
    ignored: int = 0
    last_ignored: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples from the first of their recording on: ``times`` (n,) in s, ``positions`` (n, d) in m, ``triggers`` (n,).

    ``orientations`` (n, 4) are unit quaternions x y z w, or None where the tracker tells none.
    """

    times: Floats
    positions: Floats
    triggers: Bools
    orientations: Floats | None = None


class _Column:
    """An array that grows at its end: room is doubled, so that appending costs the same however long it is."""

    def __init__(self, width: int, kind: type[np.generic]) -> None:
        self._room = np.empty((1024, width) if width else 1024, dtype=kind)
        self._used = 0

    def append(self, values: np.ndarray) -> None:
        wanted = self._used + len(values)
        if wanted > len(self._room):
            larger = np.empty((max(wanted, 2 * len(self._room)), *self._room.shape[1:]), dtype=self._room.dtype)
            larger[: self._used] = self._room[: self._used]
            self._room = larger
        self._room[self._used : wanted] = values
        self._used = wanted

    def cut_back(self, used: int) -> None:
        """Forget what was appended last, down to ``used`` rows."""
        self._used = used

    @property
    def all(self) -> np.ndarray:
        return self._room[: self._used]


@dataclass(frozen=True, slots=True)
class Bounds:
    """How much one recording may hold."""

    demonstrations: int
    samples_of_one: int


@dataclass(eq=False)
class Recording:
    """One recording on one workstation. Samples are appended while it is open; presses can be discarded at any time.

    Times are kept from the first sample on, so that a tracker may count from wherever it likes.
    """

    recording_id: str
    dimension: int
    operator: str
    source: str
    started_at: datetime
    bounds: Bounds
    is_open: bool = True
    presses: tuple[Press, ...] = ()
    button: Button = field(default_factory=Button)

    def __post_init__(self) -> None:
        self._origin: float | None = None
        self._times = _Column(0, np.float64)
        self._positions = _Column(self.dimension, np.float64)
        self._triggers = _Column(0, np.bool_)
        self._orientations: _Column | None = None

    @property
    def samples(self) -> int:
        """How many samples there are."""
        return len(self._times.all)

    @property
    def trigger(self) -> bool:
        """The push button as the last sample tells it."""
        return bool(self.samples) and bool(self._triggers.all[-1])

    @property
    def going_on(self) -> Press | None:
        """The demonstration that is being shown now, once its press is long enough to be one."""
        return self._pressed_so_far(self.button, self._times.all)

    @property
    def all_presses(self) -> tuple[Press, ...]:
        """The demonstrations, the one being shown included."""
        return self.presses if self.going_on is None else (*self.presses, self.going_on)

    def append(
        self, times: Floats, positions: Floats, triggers: Bools | None, orientations: Floats, button: bool
    ) -> None:
        """Take samples, all of them or, raising SamplesWrong or TooMuch, none.

        ``times`` (n,) in s; ``positions`` flat; ``triggers`` None: the button is where ``button`` says;
        ``orientations`` flat, empty for none.
        """
        count = len(times)
        if len(positions) != count * self.dimension:
            needed = f"{count} times need {count * self.dimension} values"
            raise InvalidSamples(
                "Positions", f"{needed} of a recording in {self.dimension} dimensions: {len(positions)}"
            )
        if triggers is not None and len(triggers) != count:
            raise InvalidSamples("Triggers", f"{count} times need {count} triggers or none, {len(triggers)} were sent")
        turned = self._checked_orientations(orientations, count)
        if count == 0:
            return
        origin = float(times[0]) if self._origin is None else self._origin
        with np.errstate(over="ignore", invalid="ignore"):
            since = times - origin
        self._check_times(since)
        self._check_positions(positions)
        pressed = np.full(count, button) if triggers is None else triggers
        state, ended = self._cut_into_presses(since, pressed)
        self._origin = origin
        self._positions.append(positions.reshape(count, self.dimension))
        self._triggers.append(pressed)
        if turned is not None:
            if self._orientations is None:
                self._orientations = _Column(4, np.float64)
            self._orientations.append(turned)
        self.button, self.presses = state, (*self.presses, *ended)

    def close(self) -> None:
        """End the recording: a button still pressed is released with the last sample."""
        if not self.is_open:
            return
        self.is_open = False
        state, ended = _ended(self.button, self._times.all, self.samples)
        self.button, self.presses = state, (*self.presses, *ended)

    def after(self, samples: int, most: int = ONE_ANSWER) -> Samples:
        """Return the samples after the first ``samples`` ones, ``most`` at most."""
        return self._cut(samples, samples + most)

    def discard(self, demonstration_id: str) -> None:
        """Forget one demonstration; its samples stay where they are."""
        self.presses = tuple(one for one in self.presses if one.demonstration_id != demonstration_id)

    def demonstration(self, press: Press) -> Demonstration:
        """Return a press as a demonstration: times from its first sample, the button pressed all along."""
        cut = self._cut(press.first, press.end)
        return Demonstration(
            demonstration_id=press.demonstration_id,
            times=cut.times - cut.times[0],
            points=cut.positions.copy(),
            triggers=np.ones(len(cut.times), dtype=np.bool_),
            operator=self.operator,
            source=self.source,
            recorded_at=self.started_at,
            orientations=None if cut.orientations is None else cut.orientations.copy(),
        )

    def _cut(self, first: int, end: int) -> Samples:
        turned = self._orientations
        return Samples(
            self._times.all[first:end],
            self._positions.all[first:end],
            self._triggers.all[first:end],
            None if turned is None else turned.all[first:end],
        )

    def _cut_into_presses(self, since: Floats, pressed: Bools) -> tuple[Button, tuple[Press, ...]]:
        """Add times and return the button after them, and the demonstrations that ended; all or nothing."""
        known, was_pressed = self.samples, self.trigger
        self._times.append(since)
        state, ended = _advanced(self.button, was_pressed, self._times.all, known, pressed)
        try:
            self._check_bounds(state, ended, self._times.all)
        except LimitExceeded:
            self._times.cut_back(known)
            raise
        return state, ended

    def _check_times(self, since: Floats) -> None:
        """Check times in s from the recording's first sample on."""
        if not np.isfinite(since).all():
            raise InvalidSamples("Times", f"time {int(np.argmin(np.isfinite(since)))} of the append is NaN or infinite")
        rising = np.diff(since) > 0
        if not rising.all():
            place = int(np.argmin(rising)) + 1
            raise InvalidSamples(
                "Times", f"time {place} of the append does not come after the one before: nothing taken"
            )
        if self.samples and not since[0] > self._times.all[-1]:
            raise InvalidSamples(
                "Times",
                f"the append begins {since[0]:g} s after the recording's start, which has come to"
                f" {self._times.all[-1]:g} s: times have to rise from append to append",
            )

    def _check_positions(self, positions: Floats) -> None:
        good = np.isfinite(positions)
        if not good.all():
            place = int(np.argmin(good)) // self.dimension
            raise InvalidSamples(
                "Positions", f"the position of sample {place} is NaN or infinite: leave out what was not seen"
            )
        farthest = float(np.abs(positions).max())
        if farthest > FARTHEST:
            raise InvalidSamples(
                "Positions", f"a position is {farthest:g} m away from the origin: positions are in metres, up to 20 m"
            )

    def _checked_orientations(self, orientations: Floats, count: int) -> Floats | None:
        """Return the quaternions (n, 4) with length 1, or None where there are none."""
        told = len(orientations) > 0
        if not told and (self._orientations is None or count == 0):
            return None
        if not told:
            raise InvalidSamples("Orientations", "the samples before had orientations: send them with all or with none")
        if self.samples and self._orientations is None:
            raise InvalidSamples(
                "Orientations", "the samples before had no orientations: send them with all or with none"
            )
        if self.dimension != 3:
            raise InvalidSamples("Orientations", "orientations need a recording in three dimensions")
        if len(orientations) != 4 * count:
            raise InvalidSamples(
                "Orientations", f"{count} times need {4 * count} values, {len(orientations)} were sent"
            )
        turned = orientations.reshape(count, 4)
        lengths = np.sqrt((turned * turned).sum(axis=1))
        if not (np.abs(lengths - 1.0) <= UNIT_TOLERANCE).all():
            place = int(np.argmax(~(np.abs(lengths - 1.0) <= UNIT_TOLERANCE)))
            raise InvalidSamples("Orientations", f"the quaternion x y z w of sample {place} has not length 1")
        return turned / lengths[:, None]

    def _pressed_so_far(self, button: Button, times: Floats) -> Press | None:
        if button.pressed is None:
            return None
        end = len(times) if button.released is None else button.released
        return _press(button, times, button.pressed, end)

    def _check_bounds(self, state: Button, ended: tuple[Press, ...], times: Floats) -> None:
        going_on = self._pressed_so_far(state, times)
        new = ended if going_on is None else (*ended, going_on)
        if len(self.presses) + len(new) > self.bounds.demonstrations:
            raise LimitExceeded(
                f"a recording holds {self.bounds.demonstrations} demonstrations: finish it, or discard some of them"
            )
        longest = max((one.end - one.first for one in new), default=0)
        if longest > self.bounds.samples_of_one:
            raise LimitExceeded(
                f"this demonstration has {longest} samples, {self.bounds.samples_of_one} are allowed: release the"
                " button, or record fewer samples a second"
            )


def _press(button: Button, times: Floats, first: int, end: int) -> Press | None:
    """Return samples ``first`` to ``end`` as the next demonstration, or None if they are too few or too short."""
    if end - first < FEWEST_SAMPLES or times[end - 1] - times[first] < SHORTEST_PRESS:
        return None
    return Press(f"demonstration-{button.presses + 1:02d}", first, end)


def _ended(button: Button, times: Floats, end: int) -> tuple[Button, tuple[Press, ...]]:
    """Return the button once what was pressed has ended, and the demonstration it was, if it was one."""
    if button.pressed is None:
        return button, ()
    end = end if button.released is None else button.released
    found = _press(button, times, button.pressed, end)
    up = replace(button, pressed=None, released=None)
    if found is not None:
        return replace(up, presses=button.presses + 1), (found,)
    lasted, count = float(times[end - 1] - times[button.pressed]), end - button.pressed
    told = f"a press at {times[button.pressed]:.2f} s of {1000 * lasted:.0f} ms, {count} samples, is no demonstration"
    return replace(up, ignored=button.ignored + 1, last_ignored=told), ()


def _advanced(
    button: Button, was_pressed: bool, times: Floats, known: int, pressed: Bools
) -> tuple[Button, tuple[Press, ...]]:
    """Return the button after more samples, and the demonstrations that ended with them.

    ``times`` (known + n,) are all times, ``pressed`` (n,) the trigger of the new samples, ``was_pressed`` of the last
    known one.
    """
    found: list[Press] = []
    for edge in np.flatnonzero(np.diff(np.concatenate([[was_pressed], pressed]))):
        at = known + int(edge)
        if not pressed[edge]:
            button = replace(button, released=at)
        elif button.released is not None and times[at] - times[button.released] < SHORTEST_RELEASE:
            button = replace(button, released=None)
        else:
            button, ended = _ended(button, times, at)
            found += ended
            button = replace(button, pressed=at)
    if button.released is not None and times[-1] - times[button.released] >= SHORTEST_RELEASE:
        button, ended = _ended(button, times, len(times))
        found += ended
    return button, tuple(found)
