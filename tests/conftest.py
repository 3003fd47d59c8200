"""A real server in a process of its own, for every test that speaks OPC UA to it."""

import asyncio
import contextlib
import json
import os
import shutil
import signal
import socket
import sqlite3
import sys
import time
import tomllib
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from library.store import SkillLibrary
from opcua_skill.client import APPLICATION_URI, SkillClient
from opcua_skill.security import TrustList, ensure_client_certificate, hash_password
from tests import prepared
from tests.processes import living

HERE = Path(__file__).parent
PASSWORD = "correct horse battery"
USERS = {
    "teacher": "teacher",
    "engineer": "engineer",
    "engineer-2": "engineer",
    "mes": "operator",
    "visitor": "observer",
    "admin": "admin",
}
TABLES = ("skills", "versions", "recipes", "jobs", "deployments", "recordings")
# Without bytecode on disk every server would compile asyncua's address space anew: five seconds of processor time.
NOT_PASSED_ON = ("PYTEST", "OPCUA_SKILL", "PYTHONDONTWRITEBYTECODE")
sys.dont_write_bytecode = False
START_LIMIT = 90.0
LONGEST_FIRST = (
    "opcua_skill/test_motion_model.py",
    "faults/test_motion_server.py",
    "faults/test_killed_server.py",
    "browser/test_run.py",
    "faults/hostile/test_mutations.py",
    "opcua_skill/test_demo.py",
    "browser/test_pages.py",
    "browser/test_review.py",
    "models/test_bad_input.py",
    "opcua_skill/test_cli_record.py",
    "opcua_skill/test_cli_server.py",
    "opcua_skill/test_three_arms.py",
    "opcua_skill/test_bad_runs.py",
    "interop/test_milo.py",
    "interop/test_node_opcua.py",
    "faults/hostile/test_after_sign_in.py",
    "faults/hostile/test_before_sign_in.py",
    "browser/test_teach.py",
    "browser/test_recovery.py",
    "story/test_story_bare_client.py",
    "story/test_story_twenty_people.py",
)
STOP_LIMIT = 30.0
ORPHAN_LIMIT = 10.0


def _without_tools() -> dict[Path, list[str]]:
    """Return the test folders and files that need a tool this machine lacks, with the tools."""
    needs = tomllib.loads((HERE.parent / "pyproject.toml").read_text())["tool"]["test-tools"]["needs"]
    missing = {HERE / name: [tool for tool in tools if shutil.which(tool) is None] for name, tools in needs.items()}
    return {path: tools for path, tools in missing.items() if tools}


WITHOUT_TOOLS = _without_tools()


def _left_out() -> str:
    names = (f"tests/{path.relative_to(HERE)} (needs {', '.join(tools)})" for path, tools in WITHOUT_TOOLS.items())
    return f"left out: {'; '.join(names)}"


def pytest_configure() -> None:
    """What has to hold before a change lands is tested whole."""
    if WITHOUT_TOOLS and os.environ.get("CI") == "true":
        raise pytest.UsageError(_left_out())


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    return True if collection_path in WITHOUT_TOOLS else None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if WITHOUT_TOOLS:
        terminalreporter.write_line(_left_out())


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest, so that none of them is left to one worker when the other has ended."""
    places = {HERE / name: place for place, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: places.get(item.path, len(places)))


def free_port() -> int:
    """Return a loopback port that nobody uses now."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


@dataclass
class Plant:
    """A server on a data folder: it can be started, stopped, killed, and asked what it has stored."""

    folder: Path
    settings: str
    port: int = field(default_factory=free_port)
    process: prepared.Forked | None = None
    password: str = PASSWORD
    library: str = ""
    """Where the library is, if not in the data folder."""

    @property
    def url(self) -> str:
        """The address clients connect to: the same after every start."""
        return f"opc.tcp://127.0.0.1:{self.port}"

    @property
    def data(self) -> Path:
        return self.folder / "data"

    @property
    def client_folder(self) -> Path:
        return self.folder / "client"

    @property
    def database(self) -> Path:
        return self.data / "skills.db"

    def set_up(self) -> None:
        """Write configuration, users and trust, as an administrator does before the first start."""
        self.folder.mkdir(parents=True, exist_ok=True)
        named = f"database = {json.dumps(self.library)}\n" if self.library else ""
        (self.folder / "plant.toml").write_text(named + self.settings, encoding="utf-8")
        mine = ensure_client_certificate(self.client_folder, APPLICATION_URI)
        TrustList(self.data / "certificates").trust(mine.certificate_file)
        asyncio.run(self._add_users())

    async def _add_users(self) -> None:
        secret = hash_password(PASSWORD)
        library = await SkillLibrary.open(self.library or str(self.database))
        try:
            there = {user.name for user in await library.users()}  # of another server that shares the library
            for name, role in USERS.items():
                if name not in there:
                    await library.add_user(name, role, secret)
        finally:
            await library.close()

    def start(self) -> None:
        """Start the server and wait until it listens."""
        environment = {key: value for key, value in os.environ.items() if not key.startswith(NOT_PASSED_ON)}
        words = ["serve", "--config", str(self.folder / "plant.toml"), "--data", str(self.data)]
        with (self.folder / "server.log").open("a", encoding="utf-8") as log:
            self.process = prepared.start([*words, "--endpoint", self.url, "--until-stdin-closes"], environment, log)
        line = self.process.stdout.readline()
        if not line.startswith("listening on "):
            self.kill()
            raise AssertionError(f"the server did not start:\n{self.log()}")

    def log(self) -> str:
        """What the server has said on stderr so far."""
        return (self.folder / "server.log").read_text(encoding="utf-8", errors="replace")

    def stop(self) -> None:
        """Stop the server as Ctrl-C does; it has to end by itself, with status 0 and leave nobody behind."""
        if self.process is None:
            return
        process, self.process = self.process, None
        process.send_signal(signal.SIGINT)
        try:
            status = process.wait(STOP_LIMIT)
            self._group_ends(process.pid)
        finally:
            self._finish(process)
        assert status == 0, f"the server ended with {status}:\n{self.log()}"
        assert PASSWORD not in self.log(), "a password has reached the log"
        assert "PRIVATE KEY" not in self.log(), "a key has reached the log"

    def kill(self) -> None:
        """Kill -9 the server's own process, and only that one."""
        if self.process is None:
            return
        process, self.process = self.process, None
        process.kill()
        process.wait(STOP_LIMIT)
        try:
            self._group_ends(process.pid)
        finally:
            self._finish(process)

    @staticmethod
    def _group_ends(group: int) -> None:
        """Wait until no process that the server has started is left; dead ones that nobody has buried do not count."""
        deadline = time.monotonic() + ORPHAN_LIMIT
        while left := living(group):
            assert time.monotonic() < deadline, f"processes {left} are left {ORPHAN_LIMIT:g} s after the server's end"
            time.sleep(0.02)

    @staticmethod
    def _finish(process: prepared.Forked) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for stream in (process.stdin, process.stdout):
            with contextlib.suppress(BrokenPipeError):
                stream.close()

    def sign_in(self, user: str) -> SkillClient:
        """Return a client for a user, not yet connected."""
        return SkillClient(self.url, user, PASSWORD, folder=self.client_folder)

    def counts(self) -> dict[str, int]:
        """Return the number of rows of every table that holds what clients can change, read past the server."""
        with contextlib.closing(sqlite3.connect(f"file:{self.database}?mode=ro", uri=True)) as connection:
            return {table: connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0] for table in TABLES}


SETTINGS = """
[[workstations]]
name = "ws1"
driver = "{driver}"
realtime = {realtime}

[limits]
max_demonstrations = 40
max_points_per_demonstration = 5000
max_queued_jobs = 3
"""

MakePlant = Callable[..., Plant]


@pytest.fixture(scope="module")
def make_plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MakePlant]:
    """Return a function that makes a running plant; all are stopped when the module has ended."""
    made: list[Plant] = []

    def make(
        settings: str = "", *, driver: str = "kinematic", realtime: bool = False, start: bool = True, library: str = ""
    ) -> Plant:
        words = settings or SETTINGS.format(driver=driver, realtime=str(realtime).lower())
        plant = Plant(tmp_path_factory.mktemp("plant"), words, library=library)
        plant.set_up()
        made.append(plant)
        if start:
            plant.start()
        return plant

    try:
        yield make
    finally:
        for plant in made:
            plant.stop()


@pytest.fixture(scope="module")
def plant(make_plant: MakePlant) -> Plant:
    """Return a running server with a kinematic arm, shared by the tests of a module."""
    return make_plant()


@pytest.fixture
async def teacher(plant: Plant) -> AsyncIterator[SkillClient]:
    """A teacher, signed in."""
    async with plant.sign_in("teacher") as client:
        yield client


@pytest.fixture
async def engineer(plant: Plant) -> AsyncIterator[SkillClient]:
    """An engineer, signed in."""
    async with plant.sign_in("engineer") as client:
        yield client


@pytest.fixture
async def mes(plant: Plant) -> AsyncIterator[SkillClient]:
    """A manufacturing execution system, signed in as operator."""
    async with plant.sign_in("mes") as client:
        yield client
