"""`opcua-skill record` and what `learn` asks of files: a real UDP socket, a real server, a real terminal."""

import io
import json
import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from library.readers import read
from library.readers.plain_csv import write
from models.demonstration import Demonstration
from models.synthetic import simulated_people
from opcua_skill.commands.verbs import status_of

if TYPE_CHECKING:
    from tests.conftest import Plant

Run = Callable[..., Any]
PEOPLE = simulated_people(4)[0]
LIMIT = 90.0


@pytest.fixture
def signed_in(plant: "Plant", monkeypatch: pytest.MonkeyPatch) -> "Plant":
    """Sign everything in this process and below it in as the teacher."""
    monkeypatch.setenv("OPCUA_SKILL_CLIENT_DIR", str(plant.client_folder))
    monkeypatch.setenv("OPCUA_SKILL_SERVER", plant.url)
    monkeypatch.setenv("OPCUA_SKILL_PASSWORD", plant.password)
    monkeypatch.setenv("OPCUA_SKILL_USER", "teacher")
    return plant


@pytest.fixture
def run(signed_in: "Plant", capsys: pytest.CaptureFixture[str]) -> Run:
    """Return a function that runs a command with --json and returns what it printed, or its complaint."""

    def run(*words: str, status: int = 0) -> Any:
        capsys.readouterr()
        ended = status_of([*words, "--json"])
        told = capsys.readouterr()
        assert ended == status, told.err
        return json.loads(told.out.splitlines()[-1]) if status == 0 else " ".join(told.err.split())

    return run


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("people")
    for one in PEOPLE:
        write(folder / f"{one.demonstration_id}.csv", one)
    return [str(file) for file in sorted(folder.glob("*.csv"))]


@contextmanager
def recording(*words: str, **streams: Any) -> Iterator["subprocess.Popen[str]"]:
    """Run `record … --json` in a process of its own; its stderr has told that it listens, or records, before."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST")}
    command = [sys.executable, "-m", "opcua_skill.cli", "record", "--on", "ws1", *words, "--json"]
    given: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stderr": subprocess.PIPE, **streams}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, **given)
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        for stream in (process.stdout, process.stderr):
            if stream is not None:
                stream.close()


def line_with(process: "subprocess.Popen[str]", words: str) -> str:
    """Return the next line on stderr that holds these words."""
    assert process.stderr is not None
    for line in process.stderr:
        if words in line:
            return line
    raise AssertionError(f"the command ended with {process.wait(LIMIT)} and never said {words!r}")


def port_of(process: "subprocess.Popen[str]") -> int:
    return int(line_with(process, "listening on").rsplit(":", 1)[1])


def ended(process: "subprocess.Popen[str]") -> tuple[int, Any, str]:
    """Wait for the end; return the status, the JSON, and what else was said."""
    out, err = process.communicate(timeout=LIMIT)
    lines = out.splitlines()
    return process.returncode, json.loads(lines[-1]) if lines else None, err or ""


class Tracker:
    """Sends samples at 100 Hz of its own clock, numbered, as fast as they can be read."""

    def __init__(self, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._number = 0
        self._clock = 100.0
        self._began = time.monotonic()

    def raw(self, content: bytes) -> None:
        self._socket.send(content)

    def show(self, one: Demonstration, *, spoil: Callable[[int, bytes], list[bytes]] | None = None) -> None:
        """Send half a second with the button released, then a demonstration, at most a second ahead of the clock."""
        count = len(one.times)
        for place in range(-50, count):
            x, y = one.points[max(place, 0)].tolist()
            step = 0.01 if place < 0 else float(one.times[place] - one.times[max(place - 1, 0)]) or 0.01
            self._clock += step
            line = f"#{self._number} {self._clock:.6f} {x!r} {y!r} {int(place >= 0)}\n".encode()
            self._number += 1
            for datagram in spoil(place, line) if spoil else [line]:
                self._socket.send(datagram)
            ahead = self._clock - 100.0 - (time.monotonic() - self._began)
            if ahead > 1.0:
                time.sleep(ahead - 1.0)

    def release(self) -> None:
        for _ in range(20):
            self._clock += 0.01
            self.raw(f"#{self._number} {self._clock:.6f} 0 0 0\n".encode())
            self._number += 1

    def close(self) -> None:
        self._socket.close()


def short(one: Demonstration, seconds: float = 1.0) -> Demonstration:
    """Return a demonstration shown fast, in 100 samples, with few digits: what goes over the wire is what it is."""
    times = np.round(np.linspace(0.0, seconds, 101), 6)
    points = np.column_stack([np.interp(times / seconds, one.times / one.times[-1], axis) for axis in one.points.T])
    return replace(one, times=times, points=np.round(points, 7), triggers=np.ones(101, dtype=bool))


def test_files_are_replayed_and_a_skill_is_learned_from_them(run: Run, files: list[str]) -> None:
    words = [word for file in files for word in ("--from", file)]
    told = run(
        "record", "--on", "ws1", *words, "--speed", "0", "--operator", "Ada", "--learn", "replayed", "--type", "Gluing"
    )
    assert [one["samples"] for one in told["demonstrations"]] == [len(one.times) for one in PEOPLE]
    assert (told["ended"], told["lost"], told["discarded"]) == ("all was sent", 0, False)
    assert (told["skill"]["name"], told["skill"]["state"]) == ("replayed", "Learned")
    recordings = run("skills", "show", "replayed")["provenance"]["recordings"]
    assert {one["operator"] for one in recordings} == {"Ada"}
    assert all(Path(files[0]).name in one["source"] for one in recordings)


def test_a_tracker_is_recorded_with_what_the_network_did_to_it(signed_in: "Plant", tmp_path: Path) -> None:
    shown = [short(one) for one in PEOPLE[:3]]

    def spoil(place: int, line: bytes) -> list[bytes]:
        if place % 20 == 7:
            return []
        if place % 20 == 11:
            return [line, line]
        return [line[: len(line) // 2]] if place % 50 == 13 else [line]

    saved = tmp_path / "saved.csv"
    with recording("--udp", "0", "--silence", "3", "--save", str(saved)) as process:
        tracker = Tracker(port_of(process))
        for one in shown:
            tracker.show(one, spoil=spoil)
        tracker.release()
        tracker.close()
        status, told, said = ended(process)
    assert status == 0, said
    assert "no sample came for 3 s" in told["ended"]
    spoilt = range(-50, 101)
    cut = sum(place % 50 == 13 and place % 20 not in (7, 11) for place in spoilt)
    assert told["garbled"] == 3 * cut
    assert told["lost"] == 3 * (sum(place % 20 == 7 for place in spoilt) + cut)
    assert told["duplicated"] == 3 * sum(place % 20 == 11 for place in spoilt)
    assert (told["late"], told["foreign"]) == (0, 0)
    kept = [place for place in range(101) if len(spoil(place, b"whole")) and b"whole" in spoil(place, b"whole")]
    assert [one["samples"] for one in told["demonstrations"]] == [len(kept)] * 3
    for one, back in zip(shown, read(saved), strict=True):
        np.testing.assert_array_equal(back.points, one.points[kept])
        np.testing.assert_allclose(np.diff(back.times), np.diff(one.times[kept]), atol=2e-6)


def test_a_tracker_that_falls_silent_while_something_is_shown_loses_that_only(signed_in: "Plant") -> None:
    with recording("--udp", "0", "--silence", "3") as process:
        tracker = Tracker(port_of(process))
        for one in PEOPLE[:2]:
            tracker.show(short(one))
        tracker.close()
        status, told, said = ended(process)
    assert status == 0, said
    assert len(told["demonstrations"]) == 1
    assert "demonstration-02 is cut short, it is discarded" in " ".join(said.split())


def test_ctrl_c_keeps_what_was_recorded_and_leaves_no_recording_open(signed_in: "Plant") -> None:
    with recording("--udp", "0", "--silence", "60") as process:
        tracker = Tracker(port_of(process))
        tracker.show(short(PEOPLE[0]))
        tracker.release()
        line_with(process, "Ctrl-C ends it")
        deadline = time.monotonic() + LIMIT
        while samples(signed_in) < 100 and time.monotonic() < deadline:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        status, told, said = ended(process)
        tracker.close()
    assert status == 0, said
    assert (told["ended"], told["discarded"]) == ("stopped", False)
    assert len(told["demonstrations"]) == 1
    assert not state(signed_in).recording


def state(plant: "Plant") -> Any:
    """Return what the recorder shows."""
    import asyncio

    async def ask() -> Any:
        async with plant.sign_in("teacher") as client:
            return await client.workstation("ws1").recorder.state()

    return asyncio.run(ask())


def samples(plant: "Plant") -> int:
    now = state(plant)
    return now.samples if now.recording else 0


def test_ctrl_c_at_a_terminal_asks_first(signed_in: "Plant") -> None:
    ours, theirs = pty.openpty()
    with recording("--udp", "0", "--silence", "60", stdin=theirs, stderr=theirs) as process:
        os.close(theirs)
        found = re.search(r"listening on [0-9.]+:([0-9]+)", heard(ours, "listening on", until="\n"))
        assert found
        tracker = Tracker(int(found.group(1)))
        tracker.show(short(PEOPLE[0]))
        tracker.release()
        heard(ours, "1 demonstration", until="released")
        process.send_signal(signal.SIGINT)
        heard(ours, "keep the 1 demonstration ", until="[Y/n]")
        os.write(ours, b"n\n")
        status, told, _ = ended(process)
        tracker.close()
    os.close(ours)
    assert (status, told["discarded"]) == (0, True)


def heard(terminal: int, words: str, *, until: str) -> str:
    """Read a terminal until it has shown some words and what is to come after; return from those words on."""
    shown = ""
    deadline = time.monotonic() + LIMIT
    while words not in shown or until not in shown[shown.rindex(words) :]:
        assert time.monotonic() < deadline, f"{words!r} never came:\n{shown}"
        if select.select([terminal], [], [], 1.0)[0]:
            shown += os.read(terminal, 4096).decode(errors="replace")
    return shown[shown.rindex(words) :].strip()


REFUSED = [
    (("--on", "ws1"), 2, "give one of --from FILE"),
    (("--on", "ws1", "--udp", "0", "--on-interrupt", "cry"), 2, "ask, finish, discard"),
    (("--on", "ws1", "--udp", "0", "--wait", "0.2"), 1, "nothing came to UDP"),
    (("--on", "ws1", "--udp", "0", "--bind", "203.0.113.7"), 1, "cannot be listened to"),
]


@pytest.mark.parametrize(("words", "status", "said"), REFUSED, ids=[row[2] for row in REFUSED])
def test_what_cannot_be_recorded_is_told_in_a_sentence(
    run: Run, words: tuple[str, ...], status: int, said: str
) -> None:
    told = run("record", *words, status=status)
    assert said in told
    assert "Traceback" not in told


def test_an_unknown_workstation_and_a_role_that_may_not_are_told(run: Run, files: list[str]) -> None:
    assert "Bad" in run("record", "--on", "nowhere", "--from", files[0], "--speed", "0", status=1)
    told = run("record", "--on", "ws1", "--from", files[0], "--speed", "0", "--user", "visitor", status=1)
    assert "BadUserAccessDenied" in told


def motive(folder: Path, number: int) -> str:
    """Write a Motive file of two rigid bodies, y up, of a drawing that lies nearly in a plane; return its path."""
    one = PEOPLE[number]
    times = np.arange(0, one.times[-1], 1 / 120)
    flat = np.column_stack([np.interp(times, one.times, axis) for axis in one.points.T])
    rows = [
        "Format Version,1.23,Take Name,t,Capture Frame Rate,120.000000,Export Frame Rate,120.000000,Rotation Type,"
        "Quaternion,Total Frames in Take,1,Length Units,Meters,Coordinate Space,Global",
        "",
        ",,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body".replace(",,", ",Type,", 1),
        ",Name,Pen,Pen,Pen,Cap,Cap,Cap",
        ",ID,1,1,1,2,2,2",
        ",,Position,Position,Position,Position,Position,Position",
        "Frame,Time (Seconds),X,Y,Z,X,Y,Z",
    ]
    for frame, (moment, (x, y)) in enumerate(zip(times, flat, strict=True)):
        lost = frame in (30, 31)
        pen = ",," if lost else f"{x:.6f},{0.0001 * (frame % 3):.6f},{-y:.6f}"
        rows.append(f"{frame},{moment:.3f},{pen},1,1,1")
    file = folder / f"motive-{number}.csv"
    file.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return str(file)


def test_what_a_file_leaves_open_is_an_option(run: Run, tmp_path: Path) -> None:
    files = [motive(tmp_path, number) for number in range(3)]
    learn = ("learn", "from-motive", *files, "--type", "Gluing")
    told = run(*learn, status=1)
    assert "motive-0.csv: the format does not say which axis points up; give --up-axis, one of x, y, z" in told
    told = run(*learn, "--up-axis", "y", status=1)
    assert "it holds 2 markers; give --marker, one of Pen, Cap" in told
    assert "not one of x, y, z" in run(*learn, "--up-axis", "q", status=2)
    learned = run(*learn, "--up-axis", "y", "--marker", "Pen", "--plane", "--fit-to-plate")
    assert list(learned["results"].values()) == ["Good"] * 3
    description = run("skills", "show", "from-motive")
    assert description["dimension"] == 2
    assert "already" in run(*learn[:2], *csv(tmp_path), "--plane", "--type", "Gluing", status=1)
    assert "add --plane" in run(*learn, "--up-axis", "y", "--marker", "Pen", "--fit-to-plate", status=1)


def csv(folder: Path) -> list[str]:
    for one in PEOPLE[:2]:
        write(folder / f"{one.demonstration_id}.csv", one)
    return [str(folder / f"{one.demonstration_id}.csv") for one in PEOPLE[:2]]


class Terminal(io.StringIO):
    """Somebody at a keyboard who has typed ahead."""

    def isatty(self) -> bool:
        return True


def test_what_a_file_leaves_open_is_asked_at_a_terminal(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [motive(tmp_path, number) for number in range(2)]
    monkeypatch.setattr(sys, "stdin", Terminal("y\n7\nPen\n"))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    ended = status_of(["learn", "asked", *files, "--type", "Gluing", "--json"])
    told = capsys.readouterr()
    assert ended == 0, told.err
    shown = " ".join(told.err.split())
    assert "which of its axes points up?" in shown
    assert "1 Pen 2 Cap" in shown
    assert "a number from 1 to 2" in shown
    assert shown.count("it holds 2 markers") == 1
    assert "2 of" in shown
    assert "samples were not seen" in shown
