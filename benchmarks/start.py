"""How long a start takes: the server to its first answer, and the command line to its help page.

The peer is a bare Python that imports asyncua, which no OPC UA program in Python does without. The two take turns, and
the quickest of several starts counts on both sides: whatever else the machine does only ever adds.
"""

import os
import resource
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from opcua_skill.demo.plant import free_port

Row = dict[str, Any]
REPEATS = 5
LIMIT = 120.0
PEER = "a bare Python that imports asyncua"
OPCUA_SKILL = Path(sys.executable).with_name("opcua-skill")
HELP = [str(OPCUA_SKILL), "--help"]
IMPORTS = [sys.executable, "-c", "import asyncua"]


def rows() -> Iterator[Row]:
    """Yield the figures as they are measured."""
    with tempfile.TemporaryDirectory() as folder:
        first_answer(Path(folder))  # makes library, key and certificate, and every .pyc that is missing
        starts, imports, helps = [], [], []
        for _ in range(REPEATS):
            starts.append(first_answer(Path(folder)))
            imports.append(ran(IMPORTS))
            helps.append(ran(HELP))
    seconds, processor = (min(column) for column in zip(*starts, strict=True))
    bare_seconds, bare_processor = (min(column) for column in zip(*imports, strict=True))
    yield row("server to its first answer, s", seconds, bare_seconds, 4.5)
    yield row("server to its first answer, processor s of its own process", processor, bare_processor, 4.0)
    yield row("help page, processor s", min(used for _, used in helps), bare_processor, 0.5)


def row(name: str, ours: float, theirs: float, most: float) -> Row:
    """Return one line of the table: the ratio says how many times as long as the peer ours takes."""
    ratio = ours / theirs
    return {
        "name": name, "ours": ours, "peer": PEER, "theirs": theirs, "ratio": ratio,
        "goal": f"at most {most:g} times", "holds": ratio <= most, "runs": REPEATS,
    }  # fmt: skip


def first_answer(data: Path) -> tuple[float, float]:
    """Start a server; return after how many s it answered, and the processor time of its own process until then."""
    port = free_port()
    began = time.monotonic()
    command = [str(OPCUA_SKILL), "serve", "--data", str(data), "--endpoint", f"opc.tcp://127.0.0.1:{port}"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while not answers(port):
            if process.poll() is not None or time.monotonic() - began > LIMIT:
                raise RuntimeError("the server did not start")
            time.sleep(0.01)
        seconds = time.monotonic() - began
        ticks = Path(f"/proc/{process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[11:13]
        return seconds, sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")
    finally:
        process.terminate()
        process.wait(LIMIT)


def answers(port: int) -> bool:
    """Return whether a server says Acknowledge to a Hello (OPC 10000-6, 7.1.2)."""
    url = f"opc.tcp://127.0.0.1:{port}".encode()
    hello = struct.pack("<5I", 0, 65536, 65536, 0, 0) + struct.pack("<I", len(url)) + url
    try:
        with socket.create_connection(("127.0.0.1", port), LIMIT) as connection:
            connection.sendall(b"HELF" + struct.pack("<I", len(hello) + 8) + hello)
            return connection.recv(4) == b"ACKF"
    except OSError:
        return False


def ran(command: list[str]) -> tuple[float, float]:
    """Return how many s a command took, and how much processor time."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    seconds, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
