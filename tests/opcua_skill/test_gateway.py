"""Lines from a tracker: whatever the network does to them, what comes out is what was sent, or less."""

import asyncio
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.demonstration import Demonstration
from opcua_skill.client import Recorded, Refused
from opcua_skill.gateway import Intake, Losses, ReplaySource, SourceFault, UdpSource, parse, pass_on
from opcua_skill.server.recording import Samples

TRACKER, STRANGER = ("127.0.0.1", 5000), ("127.0.0.1", 5001)
RATE = 100.0


def sent(number: int, *, numbered: bool = False) -> str:
    """Return the line of a sample: where it is and when it was follow from its number."""
    head = f"#{number} " if numbered else ""
    return f"{head}{10 + number / RATE:.4f} {0.001 * (number % 300):.4f} {0.002 * (number % 100):.4f} {number % 7 % 2}"


def taken(intake: Intake) -> list[tuple[float, float, float, bool]]:
    """Return everything that waits in an intake, in order."""
    rows: list[tuple[float, float, float, bool]] = []
    while (found := intake.take(all_of_it=True)) is not None:
        rows += [
            (float(t), float(x), float(y), bool(b))
            for t, (x, y), b in zip(found.times, found.positions, found.triggers, strict=True)
        ]
    return rows


def truth(number: int) -> tuple[float, float, float, bool]:
    line = parse(sent(number))
    return line.time, line.place[0], line.place[1], line.trigger


def feed(intake: Intake, lines: list[str], *, start: float = 0.0) -> None:
    """Feed lines that arrive as they were sent, a hundred a second."""
    for place, line in enumerate(lines):
        intake.feed(line.encode(), TRACKER, start + place / RATE)


@pytest.mark.parametrize(
    ("line", "place", "turn", "trigger"),
    [
        ("0.1 0.2 0.3 1", (0.2, 0.3), (), True),
        ("0.1 0.2 0.3 0.4 0", (0.2, 0.3, 0.4), (), False),
        ("1e-1 .2 -0.3 +4e-1 0 0 0.6 0.8 1\n", (0.2, -0.3, 0.4), (0.0, 0.0, 0.6, 0.8), True),
        ("#12 0.1\t0.2 0.3 1", (0.2, 0.3), (), True),
    ],
)
def test_a_line_is_a_time_a_place_perhaps_a_turn_and_the_button(
    line: str, place: tuple[float, ...], turn: tuple[float, ...], trigger: bool
) -> None:
    read = parse(line)
    assert (read.time, read.place, read.turn, read.trigger) == (0.1, place, turn, trigger)
    assert read.number == (12 if line.startswith("#") else None)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("", "0 values"),
        ("0.1 0.2 0.3", "3 values"),
        ("0.1 0.2 0.3 0 0 0 1 1", "8 values"),
        ("0.1 0.2 0.3 0.5", "trigger is '0.5'"),
        ("0.1 0.2 nan 1", "'nan' is no number"),
        ("0.1 inf 0.2 1", "no number"),
        ("0.1 0,2 0.2 1", "'0,2' is no number"),
        ("0x1 0.2 0.2 1", "no number"),
        ("1_0 0.2 0.2 1", "no number"),
        ("1e999 0.2 0.2 1", "infinite"),
        ("0.1 210.5 90 1", "metres"),
        ("0.1 0 0 0 0 0 0 2 1", "length 1"),
    ],
)
def test_a_line_that_is_no_sample_is_told(line: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse(line)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["good", "lost", "twice", "swap", "cut", "byte", "foreign", "glued"]), st.integers(0, 10**6)
        ),
        min_size=1,
        max_size=60,
    ),
    st.booleans(),
)
@settings(deadline=None, max_examples=200)
def test_whatever_the_network_does_only_true_samples_come_out_in_order(
    fates: list[tuple[str, int]], numbered: bool
) -> None:
    stream: list[tuple[bytes, Any]] = []
    for number, (fate, where) in enumerate(fates):
        line = sent(number, numbered=numbered).encode()
        if fate == "lost":
            continue
        if fate == "cut":
            line = line[: where % (len(line) - 1)]
        if fate == "byte":
            line = line[: where % len(line)] + bytes([128 + where % 128]) + line[where % len(line) + 1 :]
        stream.append((line, STRANGER if fate == "foreign" else TRACKER))
        if fate == "twice":
            stream.append((line, TRACKER))
        if fate == "swap" and len(stream) > 1:
            stream[-1], stream[-2] = stream[-2], stream[-1]
        if fate == "glued" and len(stream) > 1 and stream[-2][1] == TRACKER:
            stream[-2:] = [(stream[-2][0] + b"\n" + line, TRACKER)]
    intake = Intake()
    for place, (datagram, sender) in enumerate([(sent(0, numbered=numbered).encode(), TRACKER), *stream]):
        intake.feed(datagram, sender, place / RATE)
    rows = taken(intake)
    assert [row[0] for row in rows] == sorted({row[0] for row in rows})
    true = {truth(number) for number in range(len(fates))}
    assert set(rows) <= true
    whole = {truth(number) for number, (fate, _) in enumerate(fates) if fate in ("good", "twice", "swap")}
    if not any(fate in ("byte", "glued") for fate, _ in fates):
        assert whole <= set(rows)
    assert intake.losses.foreign == sum(fate == "foreign" for fate, _ in fates)


def test_numbered_lines_make_losses_exact() -> None:
    intake = Intake()
    kept = [n for n in range(200) if n % 10 != 3]
    feed(intake, [sent(n, numbered=True) for n in kept])
    assert intake.losses.lost == 20
    assert len(taken(intake)) == 180


def test_a_steady_rate_tells_about_how_many_were_lost() -> None:
    intake = Intake()
    kept = [n for n in range(200) if not 100 <= n < 108]
    feed(intake, [sent(n) for n in kept])
    taken(intake)
    assert intake.losses.lost == 8


def test_stragglers_are_put_in_order_while_they_can_be_and_counted_where_not() -> None:
    intake = Intake()
    order = [*range(50), 51, 50, *range(52, 60)]
    feed(intake, [sent(n, numbered=True) for n in order])
    assert [row[0] for row in taken(intake)] == [truth(n)[0] for n in range(60)]
    assert (intake.losses.put_in_order, intake.losses.lost) == (1, 0)
    feed(intake, [sent(20).replace("0.0200", "0.0201")], start=0.6)
    assert intake.losses.late == 1
    assert intake.take(all_of_it=True) is None


@pytest.mark.parametrize("rate", [10.0, 100.0, 1000.0])
def test_a_clock_that_is_set_back_ends_the_recording_and_joins_nothing(rate: float) -> None:
    intake = Intake()
    for n in range(round(1.5 * rate)):
        intake.feed(f"{n / rate} 0.1 0.1 1".encode(), TRACKER, n / rate)
    before = len(taken(intake))
    for n in range(round(1.4 * rate)):
        intake.feed(f"{n / rate} 0.9 0.9 1".encode(), TRACKER, 2.0 + n / rate)
    assert before == round(1.5 * rate)
    assert "went back" in intake.fault
    assert taken(intake) == []


def test_times_that_do_not_go_with_the_clock_are_not_taken() -> None:
    intake = Intake()
    for n in range(1000):
        intake.feed(f"{10 * n} 0.1 0.1 1".encode(), TRACKER, n / 100)
    assert len(taken(intake)) == 1
    assert intake.losses.garbled == 999
    assert "t is in s" in intake.losses.last_garbled


def test_what_waited_while_the_machine_was_busy_is_taken() -> None:
    intake = Intake()
    for n in range(1000):
        intake.feed(f"{n / 100} 0.1 0.1 1".encode(), TRACKER, n / 100 if n < 100 else 10.0 + n / 1e5)
    assert len(taken(intake)) == 1000
    assert intake.losses.garbled == 0


def test_two_motions_are_never_mixed_while_samples_wait_for_a_slow_server() -> None:
    intake = Intake()
    for n in range(200):
        intake.feed(f"{n / 100} 0.1 0.1 1".encode(), TRACKER, n / 100)
    for n in range(50, 150):
        intake.feed(f"{n / 100 + 0.005} 0.9 0.9 1".encode(), TRACKER, 2.0 + n / 100)
    assert "went back" in intake.fault
    assert {row[1] for row in taken(intake)} == {0.1}


async def test_a_source_that_says_nothing_or_nonsense_is_told_so() -> None:
    source = UdpSource(wait=0.2)
    _, port = await source.open("127.0.0.1", 0)
    with pytest.raises(SourceFault, match="nothing came"):
        await source.begin()
    with pytest.raises(SourceFault, match="cannot be listened to"):
        await UdpSource().open("127.0.0.1", port)
    source.datagram_received(b"hello 1 2 3", TRACKER)
    with pytest.raises(SourceFault, match=r"1 lines came .* none could be read, the last 'hello 1 2 3'"):
        await source.begin()
    source.close()


async def test_who_sends_first_does_not_shut_the_tracker_out() -> None:
    source = UdpSource(wait=20.0)
    await source.open("127.0.0.1", 0)
    source.datagram_received(sent(0).encode(), STRANGER)
    for number in range(1, 40):
        source.datagram_received(sent(number).encode(), TRACKER)
    assert await source.begin() == 2
    source.datagram_received(sent(41).encode(), STRANGER)
    found = await source.next(asyncio.Event())
    assert found is not None
    assert found.times[0] == pytest.approx(truth(1)[0])
    assert source.losses.foreign == 2
    source.close()


async def test_a_tracker_that_is_named_is_the_only_one_listened_to() -> None:
    source = UdpSource(wait=0.2, only=str(TRACKER[0]))
    await source.open("127.0.0.1", 0)
    for number in range(40):
        source.datagram_received(sent(number).encode(), ("10.9.9.9", 1))
    with pytest.raises(SourceFault, match=r"10\.9\.9\.9:1 sent and was not listened to: --sender"):
        await source.begin()
    source.datagram_received(sent(1).encode(), TRACKER)
    await source.begin()
    assert source.losses.foreign == 40
    source.close()


def stroke(name: str, count: int = 40, **changes: Any) -> Demonstration:
    times = np.arange(count) / RATE
    given_: dict[str, Any] = {
        "times": times,
        "points": np.column_stack([times, times]),
        "triggers": np.ones(count, dtype=bool),
        **changes,
    }
    return Demonstration(name, **given_)


async def test_a_replay_sends_what_is_in_the_files_and_releases_the_button_between() -> None:
    holes = stroke("b").points.copy()
    holes[5:9] = np.nan
    source = ReplaySource([stroke("a"), stroke("b", points=holes)], "two files", speed=0.0)
    assert await source.begin() == 2
    stop, parts = asyncio.Event(), []
    while (part := await source.next(stop)) is not None:
        parts.append(part)
    times, button = np.concatenate([p.times for p in parts]), np.concatenate([p.triggers for p in parts])
    points = np.concatenate([p.positions for p in parts])
    assert (np.diff(times) > 0).all()
    assert np.isfinite(points).all()
    edges = np.flatnonzero(np.diff(np.concatenate([[0], button.astype(int), [0]])))
    assert [int(e) for e in edges] == [0, 40, 42, 78]
    np.testing.assert_allclose(points[:40], stroke("a").points)
    np.testing.assert_allclose(points[42:78], holes[np.isfinite(holes).all(axis=1)])
    np.testing.assert_allclose(np.diff(times[42:78]).max(), 5 / RATE)


async def test_files_of_two_kinds_are_not_one_recording() -> None:
    solid = stroke("c", points=np.zeros((40, 3)))
    for given_, words in (([], "no demonstrations"), ([stroke("a"), solid], "some in space")):
        with pytest.raises(SourceFault, match=words):
            await ReplaySource(given_, "files").begin()


async def test_a_replay_keeps_its_speed() -> None:
    source = ReplaySource([stroke("a")], "a file", speed=2.0)
    await source.begin()
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    began, first = loop.time(), 0.0
    while (part := await source.next(stop)) is not None:
        first = float(part.times[-1])
        assert first <= 2.0 * (loop.time() - began) + 0.02
    assert loop.time() - began >= 0.5 * first - 0.02


class Script:
    """A source that gives prepared samples, and a recorder that has been told to refuse after some appends."""

    name = "a script"
    ended = ""

    def __init__(self, batches: int, refuse: str = "") -> None:
        self.losses = Losses()
        self._left = batches
        self._refuse = refuse
        self.sent = 0

    async def begin(self) -> int:
        return 2

    async def next(self, stop: asyncio.Event) -> Samples | None:
        if self.sent == self._left:
            self.ended = "all was sent"
            return None
        self.sent += 1
        times = self.sent + np.arange(10) / 100
        return Samples(times, np.zeros((10, 2)), np.ones(10, dtype=np.bool_), None)

    async def start(self, dimension: int, operator: str, source: str) -> str:
        return "r"

    async def append(self, recording_id: str, *samples: Any) -> Recorded:
        if self.sent == self._left and self._refuse:
            raise Refused("AppendSamples", self._refuse, "", "that is enough")
        return Recorded(10 * self.sent, 1)


@pytest.mark.parametrize(
    ("refuse", "why", "pressed"),
    [
        ("", "all was sent", True),
        ("BadRequestTooLarge", "that is enough", True),
        ("BadInvalidState", "that is enough", False),
    ],
)
async def test_a_recording_ends_with_its_source_or_when_the_server_takes_no_more(
    refuse: str, why: str, pressed: bool
) -> None:
    script = Script(3, refuse)
    told: list[int] = []
    ended = await pass_on(
        script,  # pyright: ignore[reportArgumentType]
        script,
        stop=asyncio.Event(),
        on_progress=lambda now: told.append(now.samples),
    )
    assert (ended.why, ended.pressed, ended.has_button) == (why, pressed, False)
    assert told == ([10, 20] if refuse else [10, 20, 30])


async def test_waiting_for_a_tracker_can_be_given_up() -> None:
    source = UdpSource(wait=3600.0)
    await source.open("127.0.0.1", 0)
    stop = asyncio.Event()
    asyncio.get_running_loop().call_later(0.05, stop.set)
    with pytest.raises(SourceFault, match="stopped before anything came"):
        await pass_on(Script(1), source, stop=stop)  # pyright: ignore[reportArgumentType]
    source.close()
