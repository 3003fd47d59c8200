"""One server per library, and what a server finds at its start: one sentence each, and nothing replaced in silence."""

import asyncio
import os
import shutil
import socket
import sqlite3
import stat
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from library.records import JobReport, JobState
from library.store import SkillLibrary
from opcua_skill.commands.verbs import status_of
from opcua_skill.configuration.data_lock import DataLock, ServedAlready, holder
from opcua_skill.configuration.settings import Settings
from tests import prepared
from tests.conftest import MakePlant, Plant, free_port

LIMIT = 60.0


def served(folder: Path, *words: str) -> tuple[int, str]:
    """Try to serve; return the exit status and what was said on stderr."""
    log = folder / f"second-{free_port()}.log"
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST", "OPCUA_SKILL"))}
    with log.open("w", encoding="utf-8") as errors:
        process = prepared.start(["serve", "--until-stdin-closes", *words], environment, errors)
    process.stdin.close()
    status = process.wait(LIMIT)
    process.stdout.close()
    said = log.read_text(encoding="utf-8")
    assert "Traceback" not in said
    return status, " ".join(said.split())


def add_running_job(data: Path) -> None:
    async def add() -> None:
        async with await SkillLibrary.open(data / "skills.db") as library:
            await library.add_job(JobReport(job_id="under-way", kind="Execution", workstation="ws1"))
            await library.move_job("under-way", JobState.RUNNING)

    asyncio.run(add())


def job_state(data: Path) -> str:
    with closing(sqlite3.connect(data / "skills.db")) as connection:
        return connection.execute("SELECT state FROM jobs WHERE job_id = 'under-way'").fetchone()[0]


def test_who_comes_second_is_told_who_serves_and_touches_no_job(plant: Plant, tmp_path: Path) -> None:
    add_running_job(plant.data)
    (tmp_path / "link").symlink_to(plant.data)
    assert plant.process is not None
    for data, port in ((str(tmp_path / "link"), plant.port), (os.path.relpath(plant.data), free_port())):
        status, said = served(tmp_path, "--data", data, "--endpoint", f"opc.tcp://127.0.0.1:{port}")
        assert status == 1
        assert f"is served already by process {plant.process.pid} on {socket.gethostname()} since 20" in said
        assert plant.url in said
    status, said = served(
        tmp_path, "--config", str(elsewhere(plant, tmp_path)), "--data", str(tmp_path / "other"),
        "--endpoint", f"opc.tcp://127.0.0.1:{free_port()}",
    )  # fmt: skip
    assert (status, "is served already" in said) == (1, True), said
    assert job_state(plant.data) == "Running"
    told = holder(Settings(data=plant.data))
    assert told is not None
    assert (told.process, told.endpoint) == (plant.process.pid, plant.url)


def elsewhere(plant: Plant, folder: Path) -> Path:
    """Return a configuration that names the plant's database from another data folder."""
    file = folder / "other.toml"
    file.write_text(f'database = "{plant.database}"\n', encoding="utf-8")
    return file


def test_a_taken_port_is_said_before_any_job_is_touched(plant: Plant, tmp_path: Path) -> None:
    data = tmp_path / "own"
    add_running_job(data)
    status, said = served(tmp_path, "--data", str(data), "--endpoint", plant.url)
    assert status == 1
    assert f"cannot serve at {plant.url}" in said
    assert job_state(data) == "Running"


HOLDS = """
import sys, time
from pathlib import Path
from opcua_skill.configuration.data_lock import DataLock
from opcua_skill.configuration.settings import Settings
DataLock(Settings(data=Path(sys.argv[1]))).take()
print("taken", flush=True)
time.sleep(600)
"""


def test_a_lock_ends_with_its_process_however_it_ends(tmp_path: Path) -> None:
    settings = Settings(data=tmp_path)
    process = subprocess.Popen([sys.executable, "-c", HOLDS, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "taken\n"
        told = holder(settings)
        assert told is not None
        assert told.process == process.pid
        with pytest.raises(ServedAlready, match=f"process {process.pid} "):
            DataLock(settings).take()
    finally:
        process.kill()
        process.wait(LIMIT)
        process.stdout.close()
    assert holder(settings) is None
    lock = DataLock(settings)
    assert lock.take() == told
    lock.release()


def test_two_locks_in_one_process_are_two(tmp_path: Path) -> None:
    settings = Settings(data=tmp_path)
    first, second = DataLock(settings), DataLock(settings)
    first.take()
    with pytest.raises(ServedAlready):
        second.take()
    first.release()
    second.take()
    second.release()


@pytest.mark.parametrize(
    "words",
    [("users", "list"), ("users", "remove", "anna"), ("users", "role", "anna", "admin"), ("audit",),
     ("certificates", "list"), ("certificates", "show"), ("certificates", "trust", "0abc")],
    ids=" ".join,
)  # fmt: skip
def test_a_verb_that_needs_a_library_makes_none(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of([*words, "--data", str(tmp_path / "typo")]) == 1
    assert str(tmp_path / "typo") in capsys.readouterr().err.replace("\n", "")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def once_served(make_plant: MakePlant) -> Path:
    """Return the data folder of a server that has been stopped."""
    plant = make_plant()
    plant.stop()
    return plant.data


def cut_key(data: Path) -> None:
    file = data / "certificates" / "server.pem"
    file.write_bytes(file.read_bytes()[:400])


def foreign(data: Path) -> None:
    (data / "skills.db").unlink()
    with closing(sqlite3.connect(data / "skills.db")) as connection:
        connection.execute("CREATE TABLE invoices (number INTEGER)")


def from_the_future(data: Path) -> None:
    with closing(sqlite3.connect(data / "skills.db")) as connection, connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")


def odd_users(data: Path) -> None:
    with closing(sqlite3.connect(data / "skills.db")) as connection, connection:
        connection.execute("ALTER TABLE users DROP COLUMN certificate")


def odd_role(data: Path) -> None:
    with closing(sqlite3.connect(data / "skills.db")) as connection, connection:
        connection.execute("UPDATE users SET role = 'wizard' WHERE name = 'mes'")


def missing(name: str) -> Callable[[Path], None]:
    return lambda data: (data / name).unlink()


def filled(name: str, content: bytes) -> Callable[[Path], None]:
    return lambda data: (data / name).write_bytes(content) and None


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (cut_key, "server.pem is damaged"),
        (missing("certificates/server.pem"), "server.pem is missing, the key of server.der"),
        (filled("certificates/server.der", b"0\x82"), "server.der is damaged"),
        (lambda data: (data / "certificates/server.pem").chmod(0o644), "has mode 644, others may read it: chmod 600"),
        (missing("skills.db"), "is missing, though it was served last on"),
        (filled("skills.db", b""), "it is empty (0 bytes)"),
        (filled("skills.db", b"nothing of the kind" * 99), "not a database"),
        (foreign, "it is the database of another program"),
        (from_the_future, "a newer version of this program wrote it"),
        (odd_users, "its table users lacks certificate"),
        (odd_role, "the user 'mes' has the role 'wizard'"),
    ],
    ids=["key cut", "key gone", "certificate cut", "key open", "library gone", "library empty", "library is text",
         "library of another program", "library of a newer version", "users lack a column", "role of a user"],
)  # fmt: skip
def test_what_is_damaged_missing_or_foreign_at_start_is_one_sentence_and_stays_as_it_is(
    spoil: Callable[[Path], None], sentence: str, once_served: Path, tmp_path: Path
) -> None:
    data = tmp_path / "data"
    shutil.copytree(once_served, data)
    for side in ("-wal", "-shm"):
        (data / f"skills.db{side}").unlink(missing_ok=True)
    (data / "server.lock").write_text(
        (once_served / "server.lock").read_text("utf-8").replace(str(once_served), str(data)), encoding="utf-8"
    )
    spoil(data)
    names = ("skills.db", "certificates/server.pem", "certificates/server.der")
    before = {name: (data / name).read_bytes() if (data / name).exists() else None for name in names}
    status, said = served(tmp_path, "--data", str(data), "--endpoint", f"opc.tcp://127.0.0.1:{free_port()}")
    assert status == 1
    assert sentence in said, said
    assert said.count("error: ") == 1
    assert {name: (data / name).read_bytes() if (data / name).exists() else None for name in names} == before


@pytest.mark.parametrize("content", [b"endpoint = ", b"\xff\xfe", b'endpoint = "http://here"'])
def test_a_broken_configuration_is_one_sentence(
    content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "plant.toml"
    file.write_bytes(content)
    assert status_of(["users", "list", "--config", str(file), "--data", str(tmp_path)]) == 1
    assert str(file) in capsys.readouterr().err.replace("\n", "")


def test_what_a_server_keeps_is_for_its_own_user_alone(once_served: Path) -> None:
    for file in (once_served, *once_served.rglob("*")):
        mode = stat.S_IMODE(file.stat().st_mode)
        assert mode & 0o077 == 0 or file.suffix == ".der", f"{file} has mode {mode:o}"
