"""Reading in a process of its own, with limits: what a stranger's file does to its reader it does to nobody else.

Parsers trust what they read: a damaged file may crash them, and a small one that unpacks to gigabytes take all memory.
"""

import contextlib
import io
import json
import os
import re
import signal
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Self

import numpy as np

from library.errors import ChoiceNeeded, ReaderError
from library.readers.import_options import Choices
from models.demonstration import Demonstration

MOST_MEMORY = 1_000_000_000
MOST_SECONDS = 60
LONGEST = 5 * MOST_SECONDS
MOST_AT_ONCE = 2
OUT_OF_MEMORY = 3
SMALLER = "cut out what is needed"
SIZES = struct.Struct("<QQ")

_seats = threading.BoundedSemaphore(MOST_AT_ONCE)


class Reader:
    """A process that reads one file after another, within 1 GB and 60 s of computing each; once ended, replaced."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def read(self, path: str | Path, choices: Choices | None = None) -> list[Demonstration]:
        """Return the demonstrations in a file, or raise what its reader raises."""
        path = Path(path)
        asked = json.dumps({"path": str(path.absolute()), "choices": asdict(choices or Choices())}).encode()
        with _seats:
            head, arrays = self._answer(path, asked + b"\n")
        told: dict[str, Any] = json.loads(head)
        if "complaint" in told:
            raise _complaint(path, told["complaint"])
        return _unpacked(told["names"], told["source"], arrays)

    def _answer(self, path: Path, asked: bytes) -> tuple[bytes, bytes]:
        """Return what the process answers: a head in JSON, and arrays. Where it does not, say why."""
        process = self._started()
        assert process.stdin is not None and process.stdout is not None
        late = threading.Event()
        # A process may wait as well as compute.
        timer = threading.Timer(LONGEST, lambda: (late.set(), process.kill()))
        timer.start()
        try:
            process.stdin.write(asked)
            process.stdin.flush()
            sizes = process.stdout.read(SIZES.size)
            if len(sizes) == SIZES.size:
                parts = [process.stdout.read(size) for size in SIZES.unpack(sizes)]
                if [len(part) for part in parts] == list(SIZES.unpack(sizes)):
                    return parts[0], parts[1]
        except BrokenPipeError:
            # It has ended: its status says why.
            pass
        finally:
            timer.cancel()
        status = process.wait()
        self._end()
        if status == OUT_OF_MEMORY:
            raise ReaderError(
                path,
                f"it takes more than {MOST_MEMORY // 10**6} MB of memory to read",
                "export it again, or " + SMALLER,
            )
        if late.is_set() or status == -int(getattr(signal, "SIGXCPU", 0)):
            raise ReaderError(path, f"it cannot be read within {MOST_SECONDS} s", SMALLER)
        raise ReaderError(path, "its reader crashed", "the file is damaged: export it again")

    def _started(self) -> "subprocess.Popen[bytes]":
        if self._process is None:
            roots = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
            # A second thread of the linear algebra would cost memory and gain nothing.
            told = {**os.environ, "PYTHONPATH": os.pathsep.join(roots), "OPENBLAS_NUM_THREADS": "1"}
            command = [sys.executable, "-P", "-m", "library.readers.reading_process"]
            pipe = subprocess.PIPE
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=told)
        return self._process

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                # What was not written yet cannot be: the process is gone.
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()


def read_apart(path: str | Path, choices: Choices | None = None) -> list[Demonstration]:
    """Return the demonstrations in a file, read in a process of its own."""
    with Reader() as reader:
        return reader.read(path, choices)


def read_upload(
    name: str,
    content: bytes,
    choices: Choices | None = None,
    reading: Callable[[Path, Choices | None], list[Demonstration]] = read_apart,
) -> list[Demonstration]:
    """Return the demonstrations in a file that came as its name and its bytes; complaints name it by that name.

    The name is never used as a path: only its last part, and of that only harmless characters.
    """
    last = PureWindowsPath(PurePosixPath(name).name).name
    harmless = re.sub(r"[^\w.-]", "_", last, flags=re.ASCII).lstrip(".")[-80:] or "upload"
    with tempfile.TemporaryDirectory(prefix="opcua-skill-upload-") as folder:
        path = Path(folder) / harmless
        path.write_bytes(content)
        try:
            return reading(path, choices)
        except ReaderError as error:
            raise error.named(Path(last or "upload"), path) from None


def _complaint(path: Path, told: dict[str, Any]) -> ReaderError:
    if "choice" in told:
        options = tuple(told["options"])
        return ChoiceNeeded(path, told["problem"], told["remedy"], told["choice"], options, told["line"])
    return ReaderError(path, told["problem"], told["remedy"], told["line"])


def _unpacked(names: list[str], source: str, blob: bytes) -> list[Demonstration]:
    with np.load(io.BytesIO(blob), allow_pickle=False) as arrays:
        return [
            Demonstration(
                name,
                arrays[f"times{number}"],
                arrays[f"points{number}"],
                arrays[f"triggers{number}"],
                source=source,
                orientations=arrays.get(f"orientations{number}"),
            )
            for number, name in enumerate(names)
        ]
