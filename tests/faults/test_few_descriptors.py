"""Where a process may open few files only, connections leave it some of its own."""

import contextlib
import socket
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.start import answers
from opcua_skill.demo.plant import free_port
from opcua_skill.stack.transport.transport import ROOM_FOR_FILES

LIMIT, FILES = 120.0, 96


def test_connections_never_take_the_files_that_the_server_needs(tmp_path: Path) -> None:
    port = free_port()
    serve = f"{sys.executable} -m opcua_skill.cli serve --data {tmp_path}/data --endpoint opc.tcp://127.0.0.1:{port}"
    with (tmp_path / "log").open("wb") as log:
        process = subprocess.Popen(["sh", "-c", f"ulimit -n {FILES}; exec {serve}"], stdout=log, stderr=log)
    open_files = Path(f"/proc/{process.pid}/fd")
    try:
        until = time.monotonic() + LIMIT
        while not answers(port):
            assert process.poll() is None and time.monotonic() < until, (tmp_path / "log").read_text()
            time.sleep(0.05)
        with contextlib.ExitStack() as held:
            for number in range(2 * FILES):
                one = held.enter_context(socket.socket())
                one.settimeout(LIMIT)
                one.bind((f"127.0.0.{2 + number // 18}", 0))  # of one address only some may be half open
                one.connect(("127.0.0.1", port))
            # each is taken in before it can be turned away: counted is what stays
            while sum(1 for _ in open_files.iterdir()) > FILES - ROOM_FOR_FILES // 2:
                assert time.monotonic() < until, "the connections keep the files that the server needs"
                time.sleep(0.05)
        while not answers(port):
            assert time.monotonic() < until
        process.terminate()
        assert process.wait(LIMIT) == 0
    finally:
        process.kill()
        process.wait()
    told = (tmp_path / "log").read_text(encoding="utf-8")
    assert f"this process may open {FILES} files" in " ".join(told.split())
    assert "Traceback" not in told
