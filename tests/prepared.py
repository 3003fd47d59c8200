"""Commands of the product in processes forked from one that has imported it, as its own workers are (decision 5).

`start` looks like `subprocess.Popen` of `python -m opcua_skill.cli …` and saves two seconds of processor time each.
The same file is the prepared process: `python -m tests.prepared 3`. It has no threads of its own, and ends with us.
"""

import atexit
import importlib
import json
import os
import select
import selectors
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

ROOT = Path(__file__).resolve().parents[1]
LARGEST_REQUEST = 100_000
STANDARD_STREAMS = 3


@dataclass
class Forked:
    """A running command, used like a `subprocess.Popen` with text streams."""

    pid: int
    stdin: TextIO
    stdout: TextIO
    told: int
    returncode: int | None = None
    _asking: threading.Lock = field(default_factory=threading.Lock)

    def wait(self, timeout: float | None = None) -> int:
        """Return how the command ended; raise TimeoutExpired where it has not within the limit, in s."""
        with self._asking:
            if self.returncode is None:
                if not select.select([self.told], [], [], timeout)[0]:
                    raise subprocess.TimeoutExpired("opcua-skill", timeout or 0.0)
                status = os.read(self.told, 20)
                os.close(self.told)
                assert status, "the prepared process has died"
                self.returncode = os.waitstatus_to_exitcode(int(status))
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal to the command itself, unless it has ended."""
        try:
            self.wait(0.0)
        except subprocess.TimeoutExpired:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class Prepared:
    """The other end of the prepared process."""

    def __init__(self) -> None:
        self._asking = threading.Lock()
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        with theirs:
            command = [sys.executable, "-m", "tests.prepared", str(theirs.fileno())]
            self._process = subprocess.Popen(
                command, cwd=ROOT, env=environment, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL
            )
        atexit.register(self.close)

    def start(self, words: Sequence[str], environment: Mapping[str, str], errors: TextIO) -> Forked:
        """Start `opcua-skill` with these words, in a session of its own."""
        (their_input, our_input), (our_output, their_output), (told, telling) = os.pipe(), os.pipe(), os.pipe()
        given = [their_input, their_output, errors.fileno(), telling]
        request = json.dumps({"words": list(words), "environment": dict(environment), "folder": str(Path.cwd())})
        try:
            with self._asking:
                socket.send_fds(self._socket, [request.encode()], given)
                pid = self._socket.recv(20)
        finally:
            for one in (their_input, their_output, telling):
                os.close(one)
        assert pid, "the prepared process has died: stderr says why"
        return Forked(int(pid), os.fdopen(our_input, "w"), os.fdopen(our_output), told)

    def close(self) -> None:
        self._socket.close()
        self._process.wait()


_starting = threading.Lock()
_prepared: Prepared | None = None


def start(words: Sequence[str], environment: Mapping[str, str], errors: TextIO) -> Forked:
    """Start `opcua-skill` with these words; the prepared process is made when it is asked for first."""
    global _prepared
    with _starting:
        _prepared = _prepared or Prepared()
    return _prepared.start(words, environment, errors)


def serve(asked: socket.socket) -> bool:
    """Fork whenever asked; return True in every forked process, and False in this one when nobody can ask any more."""
    with selectors.DefaultSelector() as ready:
        ready.register(asked, selectors.EVENT_READ)
        while True:
            for key, _ in ready.select():
                if key.data is not None:
                    ready.unregister(key.fd)
                    tell_the_end(key.fd, *key.data)
                    continue
                request, given, _, _ = socket.recv_fds(asked, LARGEST_REQUEST, STANDARD_STREAMS + 1)
                if not request:
                    return False
                if (pid := os.fork()) == 0:
                    forget(list(ready.get_map().values()), asked)
                    become(json.loads(request), given)
                    return True
                for stream in given[:STANDARD_STREAMS]:
                    os.close(stream)
                ready.register(os.pidfd_open(pid), selectors.EVENT_READ, (pid, given[-1]))
                asked.send(str(pid).encode())


def forget(watched: list[selectors.SelectorKey], asked: socket.socket) -> None:
    """Let go of what belongs to the prepared process alone."""
    asked.close()
    for key in watched:
        if key.data is not None:
            os.close(key.fd)
            os.close(key.data[1])


def tell_the_end(descriptor: int, pid: int, telling: int) -> None:
    """Say with which status a command has ended."""
    _, status = os.waitpid(pid, 0)
    try:
        os.write(telling, str(status).encode())
    except BrokenPipeError:
        print(f"nobody waited for the end of {pid}", file=sys.stderr)
    os.close(descriptor)
    os.close(telling)


def become(request: dict, given: list[int]) -> None:
    """Make this process what `python -m opcua_skill.cli` would be: streams, environment, folder, words, signals."""
    os.setsid()
    for stream, descriptor in enumerate(given[:STANDARD_STREAMS]):
        os.dup2(descriptor, stream)
    for descriptor in given:
        os.close(descriptor)
    os.environ.clear()
    os.environ.update(request["environment"])
    os.chdir(request["folder"])
    sys.argv = ["opcua-skill", *request["words"]]
    signal.signal(signal.SIGINT, signal.default_int_handler)


def main() -> None:
    """Import the product, then be asked; where forked, be the product's command line."""
    import opcua_skill.server.app  # noqa: F401
    from opcua_skill.cli import main as command_line
    from opcua_skill.jobs.process_pool import PREPARED

    for name in PREPARED:
        importlib.import_module(name)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if serve(socket.socket(fileno=int(sys.argv[1]))):
        command_line()


if __name__ == "__main__":
    main()
