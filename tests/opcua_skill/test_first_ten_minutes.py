"""A newcomer's terminals: every block of the first page is run as it stands, and at its end the arm has run a path."""

import csv
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from urllib.request import urlopen

import pytest

from opcua_skill.messages import catalogue_of
from tests.conftest import free_port

DOCS = Path(__file__).parents[2] / "docs"
PAGE = DOCS / "first-ten-minutes.md"
BLOCK = re.compile(r"^```sh( refused)?\n(.*?)^```$", re.S | re.M)
LIMIT = 300.0
QUICK = '[{"name": "ws1", "driver": "kinematic", "realtime": false}]'


@dataclass
class Newcomer:
    """Somebody with a folder, its `.venv`, and as many terminals as needed."""

    folder: Path
    environment: dict[str, str]
    first: str = "set -e\n"
    left: list[subprocess.Popen[str]] = field(default_factory=list)

    def run(self, block: str, *, refused: bool = False) -> str:
        """Run a block in the first terminal, which keeps what was exported; return what was said."""
        block_of_all = f"{self.first}exec 2>&1\n{block}"
        done = subprocess.run(
            ["bash", "-c", block_of_all], cwd=self.folder, env=self.environment, text=True, capture_output=True,
            timeout=LIMIT, stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
        assert done.returncode == (1 if refused else 0), f"{block}\n{done.stdout}"
        self.first += "".join(f"{line}\n" for line in block.splitlines() if line.startswith("export "))
        return done.stdout

    def leave_running(self, block: str, ready: str) -> Path:
        """Run a block in a terminal of its own until it says that it is ready; return the file with all it says."""
        said = self.folder / f"terminal-{len(self.left) + 2}.txt"
        with said.open("w", encoding="utf-8") as stream:
            process = subprocess.Popen(
                ["bash", "-c", block], cwd=self.folder, env=self.environment, text=True, stdin=subprocess.DEVNULL,
                stdout=stream, stderr=stream, start_new_session=True,
            )  # fmt: skip
        self.left.append(process)
        deadline = time.monotonic() + LIMIT
        while ready not in said.read_text(encoding="utf-8"):
            assert process.poll() is None and time.monotonic() < deadline, said.read_text(encoding="utf-8")
            time.sleep(0.05)
        return said

    def leave(self) -> None:
        """Press Ctrl-C in every terminal."""
        for process in self.left:
            os.killpg(process.pid, signal.SIGINT)
        for process in self.left:
            process.wait(LIMIT)


@pytest.fixture
def newcomer(tmp_path: Path) -> Iterator[Newcomer]:
    (tmp_path / ".venv").symlink_to(sys.prefix)
    port = free_port()
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "OPCUA_SKILL"))}
    kept |= {"HOME": str(tmp_path / "home"), "OPCUA_SKILL_ENDPOINT": f"opc.tcp://127.0.0.1:{port}"}
    kept |= {"OPCUA_SKILL_SERVER": f"opc.tcp://127.0.0.1:{port}", "OPCUA_SKILL_PANEL_PORT": str(free_port())}
    kept |= {"OPCUA_SKILL_WORKSTATIONS": QUICK}
    kept = {name: value for name, value in kept.items() if name not in {"PYTHONDONTWRITEBYTECODE", "XDG_DATA_HOME"}}
    person = Newcomer(tmp_path, kept)
    try:
        yield person
    finally:
        person.leave()


def blocks(page: Path) -> list[tuple[bool, str]]:
    return [(bool(refused), block) for refused, block in BLOCK.findall(page.read_text(encoding="utf-8"))]


@pytest.mark.timeout(900)
def test_the_first_page_ends_with_a_run_and_the_backup_page_with_a_library(newcomer: Newcomer) -> None:
    said: list[str] = []
    server = newcomer.folder
    for refused, block in blocks(PAGE):
        if "opcua-skill serve" in block:
            server = newcomer.leave_running(block, "listening on ")
        elif "opcua-skill panel" in block:
            panel = newcomer.leave_running(block, "panel on http")
            address = panel.read_text(encoding="utf-8").split()[2]
            with urlopen(f"{address}/sign-in", timeout=LIMIT) as answer:
                assert answer.status == 200
        else:
            said.append(newcomer.run(block, refused=refused))
    (turned_away,) = (one for one in said if one.startswith("error:"))
    assert "certificates trust" in turned_away
    hint = f"--data {newcomer.folder / 'plant'}"
    log = " ".join(server.read_text(encoding="utf-8").split())
    assert re.search(rf"to let it in: opcua-skill certificates trust [0-9a-f]{{12}} {re.escape(hint)}", log), log
    assert "zigzag version 1 is Learned" in " ".join(" ".join(said).split())
    assert "Completed, 100%" in said[-2]
    with (newcomer.folder / "trace.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) > 100
    assert float(rows[-1]["t_s"]) > 1.0
    assert (newcomer.folder / "zigzag.png").stat().st_size > 10_000

    page = DOCS / "reference" / "library.md"
    for _, block in blocks(page):
        newcomer.run(block)
    (statement,) = re.findall(r'^    sqlite3 skills\.db "(.*)"$', page.read_text(encoding="utf-8"), re.M)
    with closing(sqlite3.connect(newcomer.folder / "plant-again" / "skills.db")) as connection:
        assert [row[:3] for row in connection.execute(statement)] == [("zigzag", 1, "Approved")]


def test_the_buttons_that_the_first_page_names_are_those_of_the_panel() -> None:
    _, _, section = PAGE.read_text(encoding="utf-8").partition("## 7. The same in the panel")
    names = re.findall(r"\*\*(.+?)\*\*", section.replace("\n   ", " "))
    assert len(names) > 8
    assert [name for name in names if name not in catalogue_of("de").words] == []
