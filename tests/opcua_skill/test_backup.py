"""A backup is whole or not there, and what is restored from it goes on where it was."""

import asyncio
import dataclasses
import json
import os
import resource
import shutil
import sqlite3
import stat
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from small_corner import small_corner

from library.recipe import Recipe
from library.store import SkillLibrary
from opcua_skill.backup.backups import MANIFEST
from opcua_skill.commands.verbs import status_of
from opcua_skill.configuration.data_lock import DataLock
from opcua_skill.configuration.settings import Settings
from opcua_skill.security import ensure_server_certificate

if TYPE_CHECKING:
    from opcua_skill.client import SkillClient
    from tests.conftest import MakePlant, Plant

LIMIT = 120.0


@pytest.mark.timeout(600)
def test_backup_under_writes_kill_9_restore_and_the_story_goes_on(make_plant: "MakePlant", tmp_path: Path) -> None:
    plant = make_plant()
    (plant.data / "certificates" / "trusted" / "crl").mkdir(exist_ok=True)
    written, runs = asyncio.run(story_and_backup(plant, tmp_path / "kept"))
    plant.kill()
    shutil.rmtree(plant.data)
    assert status_of(["restore", str(tmp_path / "kept"), "--data", str(plant.data)]) == 0
    assert sorted(file.name for file in (plant.data / "traces").iterdir()) == runs
    plant.start()
    asyncio.run(goes_on(plant, written))


async def story_and_backup(plant: "Plant", folder: Path) -> tuple[list[str], list[str]]:
    """Learn, approve, deploy, run; back up while recipes are written. Return the recipes there before, and traces."""
    written: list[str] = []
    async with plant.sign_in("teacher") as teacher, plant.sign_in("engineer") as engineer:
        learned = await teacher.learn("corner", small_corner(), semantic_type="Gluing")
        await teacher.follow(learned.job_id, limit=LIMIT)
        skill = await engineer.skill("corner")
        await engineer.approve("corner", 1, skill.model_digest)
        await engineer.deploy("corner", 1, "ws1")
        await run(teacher)
        async with asyncio.timeout(LIMIT):  # files of a trace are written after the job's end
            while not {".csv", ".json", ".parquet"} <= {one.suffix for one in (plant.data / "traces").glob("run-*")}:
                await asyncio.sleep(0.05)
        recipe = (await engineer.recipes("corner"))[0]
        writing = asyncio.create_task(write_recipes(engineer, recipe, written))
        while len(written) < 3:
            await asyncio.sleep(0.01)
        while True:
            shutil.rmtree(folder, ignore_errors=True)
            before = list(written)
            words = ["backup", str(folder), "--data", str(plant.data)]
            assert await asyncio.to_thread(status_of, words) == 0
            if len(written) > len(before):  # something was written while that backup was made
                break
        writing.cancel()
        await asyncio.gather(writing, return_exceptions=True)
    return before, sorted(file.name for file in (plant.data / "traces").iterdir())


async def write_recipes(engineer: "SkillClient", recipe: Recipe, written: list[str]) -> None:
    while True:
        made = dataclasses.replace(recipe, recipe_id=f"corner-{len(written)}")
        await engineer.put_recipe(made)
        written.append(made.recipe_id)


async def run(client: "SkillClient") -> None:
    started = await client.workstation("ws1").execute("corner", mode="production")
    ended = await client.follow(started.job_id, on="ws1", limit=LIMIT)
    assert ended.state == "Completed", ended


async def goes_on(plant: "Plant", written: list[str]) -> None:
    async with plant.sign_in("engineer") as engineer:
        assert (await engineer.skill("corner")).state == "Approved"
        assert set(written) <= {one.recipe_id for one in await engineer.recipes("corner")}
        assert [one.state for one in await engineer.workstation("ws1").jobs()] == ["Completed"]
        await run(engineer)
    with closing(sqlite3.connect(plant.database)) as connection:
        actions = [one for (one,) in connection.execute("SELECT action FROM audit")]
    assert actions.index("Deploy") < actions.index("Restore") < len(actions) - 1


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the data folder of a server that does not run, with a user, a certificate and a trace."""
    folder = tmp_path_factory.mktemp("plant") / "data"

    async def add() -> None:
        async with await SkillLibrary.open(folder / "skills.db") as library:
            await library.add_user("ada", "engineer", "hash")

    asyncio.run(add())
    ensure_server_certificate(folder / "certificates", "urn:test", "test")
    (folder / "traces").mkdir()
    (folder / "traces" / "a.csv").write_text("t_s\n0.0\n")
    (folder / "traces" / ".b.csv.part").write_text("unfinished")
    (folder / "server.lock").write_text("{}")
    return folder


@pytest.fixture(scope="module")
def kept(data: Path) -> Path:
    """Return a good backup of that folder."""
    folder = data.with_name("kept")
    assert status_of(["backup", str(folder), "--data", str(data), "--json"]) == 0
    return folder


def everything(folder: Path) -> dict[str, bytes]:
    """Return the content of all files below a folder by their paths."""
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_a_backup_holds_what_has_to_come_back_for_its_owner_alone(data: Path, kept: Path) -> None:
    manifest = json.loads((kept / MANIFEST).read_text())
    names = {f"data/{file.relative_to(data)}" for file in (data / "certificates").rglob("*") if file.is_file()}
    assert {"data/certificates/server.der", "data/certificates/server.pem"} <= names
    names |= {"data/traces/a.csv", "skills.db"}
    assert {one["path"] for one in manifest["files"]} == names
    assert set(everything(kept)) == {*names, MANIFEST}
    assert (manifest["revision"], manifest["data"]) == ("0005", str(data)) or manifest["revision"] > "0005"
    for file in (kept, *kept.rglob("*")):
        assert stat.S_IMODE(file.stat().st_mode) & 0o077 == 0, file


def test_modes_come_back_though_a_disk_has_lost_them(data: Path, kept: Path, tmp_path: Path) -> None:
    shutil.copytree(kept, tmp_path / "stick")
    for file in (tmp_path / "stick").rglob("*"):
        file.chmod(0o777)
    where = tmp_path / "new" / "data"
    assert status_of(["restore", os.path.relpath(tmp_path / "stick"), "--data", os.path.relpath(where)]) == 0
    for file in (data / "certificates").rglob("*"):
        assert (where / file.relative_to(data)).stat().st_mode == file.stat().st_mode, file
    modes = {str(file.relative_to(where)): stat.S_IMODE(file.stat().st_mode) for file in where.rglob("*")}
    kept_private = ("certificates/server.pem", "skills.db", "server.lock", "skills.db.lock")
    assert {modes[name] for name in kept_private} == {0o600}
    assert modes["traces/a.csv"] == stat.S_IMODE((data / "traces" / "a.csv").stat().st_mode)


@contextmanager
def held(folder: Path) -> Iterator[None]:
    folder.mkdir(exist_ok=True)
    lock = DataLock(Settings(data=folder))
    lock.take()
    try:
        yield
    finally:
        lock.release()


def filled(name: str, content: bytes) -> Callable[[Path], object]:
    return lambda backup: (backup / name).write_bytes(content)


def said(name: str, old: str, new: str) -> Callable[[Path], object]:
    return lambda backup: (backup / name).write_text((backup / name).read_text().replace(old, new))


def flipped(backup: Path) -> None:
    content = bytearray((backup / "skills.db").read_bytes())
    content[len(content) // 2] ^= 1
    (backup / "skills.db").write_bytes(content)


def from_the_future(backup: Path) -> None:
    """Make the library a newer program's, and the manifest say so truthfully."""
    with closing(sqlite3.connect(backup / "skills.db")) as connection, connection:
        connection.execute("PRAGMA journal_mode = DELETE")
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    describe_again(backup)


def damaged_inside(backup: Path) -> None:
    """Damage pages of the library below a manifest that was written afterwards."""
    content = bytearray((backup / "skills.db").read_bytes())
    content[4096 * 8 : 4096 * 12] = bytes(range(256)) * 64
    (backup / "skills.db").write_bytes(content)
    describe_again(backup)


def describe_again(backup: Path) -> None:
    import hashlib

    manifest = json.loads((backup / MANIFEST).read_text())
    (library,) = (one for one in manifest["files"] if one["path"] == "skills.db")
    content = (backup / "skills.db").read_bytes()
    library |= {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    (backup / MANIFEST).write_text(json.dumps(manifest))


def linked(backup: Path) -> None:
    (backup / "data" / "certificates").rename(backup / "elsewhere")
    (backup / "data" / "certificates").symlink_to(backup / "elsewhere")


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (filled("data/traces/a.csv", b"t_s\n1.0\n"), "a.csv is damaged, it is not what was backed up"),
        (filled("skills.db", b""), "skills.db is damaged"),
        (flipped, "skills.db is damaged"),
        (damaged_inside, "skills.db cannot be used, "),
        (from_the_future, "a newer version of this program wrote it (revision 9999)"),
        (lambda backup: (backup / "data/certificates/server.pem").unlink(), "server.pem is missing: use another"),
        (filled("data/server.pem", b"another"), "data/server.pem does not belong to this backup"),
        (linked, "is missing: use another backup, this one is not whole"),
        (filled(MANIFEST, b"{"), f"{MANIFEST} is damaged"),
        (lambda backup: (backup / MANIFEST).unlink(), f"is no backup: it has no {MANIFEST}"),
        (said(MANIFEST, "backup 1", "backup 2"), "was written by another version of this program"),
        (said(MANIFEST, "data/traces/a.csv", "data/../../a.csv"), "leads to no place in a backup"),
        (said(MANIFEST, "data/traces/a.csv", "/etc/a.csv"), "leads to no place in a backup"),
        (said(MANIFEST, "data/traces/a.csv", "data/certificates/server.pem"), f"{MANIFEST} is damaged"),
    ],
    ids=["changed", "emptied", "bit flipped", "library damaged", "newer", "file gone", "file foreign", "link",
         "manifest cut", "manifest gone", "format", "way out", "way to root", "named twice"],
)  # fmt: skip
def test_what_is_not_the_backup_that_was_made_is_refused_and_leaves_nothing(
    spoil: Callable[[Path], object], sentence: str, kept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(kept, tmp_path / "kept")
    spoil(tmp_path / "kept")
    assert status_of(["restore", str(tmp_path / "kept"), "--data", str(tmp_path / "data")]) == 1
    told = capsys.readouterr().err
    assert sentence in " ".join(told.split()), told
    assert told.count("error: ") == 1
    assert not (tmp_path / "data").exists()


def test_nothing_is_replaced_and_no_server_is_disturbed(
    kept: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = everything(data)
    assert status_of(["restore", str(kept), "--data", str(data)]) == 1
    assert "is there already: nothing is replaced" in capsys.readouterr().err
    assert everything(data) == before
    with held(tmp_path / "busy"):
        assert status_of(["restore", str(kept), "--data", str(tmp_path / "busy")]) == 1
        assert f"is served by process {os.getpid()} on " in " ".join(capsys.readouterr().err.split())
        assert {file.name for file in (tmp_path / "busy").iterdir()} == {"server.lock", "skills.db.lock"}
    assert status_of(["restore", str(kept), "--data", str(tmp_path / "busy")]) == 0


def test_a_folder_that_holds_something_or_lies_inside_gets_no_backup(
    data: Path, kept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    refused = {
        kept: "holds ",
        data / "backups" / "monday": "lies in the data folder",
        tmp_path / "file": "is there and no folder",
        Path("/proc"): "holds ",
    }
    before = everything(data)
    for target, sentence in refused.items():
        assert status_of(["backup", str(target), "--data", str(data)]) == 1
        assert sentence in " ".join(capsys.readouterr().err.split())
    assert everything(data) == before
    assert status_of(["backup", str(tmp_path / "b"), "--data", str(tmp_path / "typo")]) == 1
    assert sorted(one.name for one in tmp_path.iterdir()) == ["file"]


@pytest.mark.parametrize("largest", [200, 20_000], ids=["library", "library's pages"])
def test_a_full_disk_leaves_no_backup_and_gets_its_room_back(
    largest: int, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, limits[1]))
    try:
        status = status_of(["backup", str(tmp_path / "b"), "--data", str(data)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert status == 1
    assert "was not written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_backup_that_could_never_fit_is_not_begun(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage._replace(free=1_000))
    assert status_of(["backup", str(tmp_path / "b"), "--data", str(data)]) == 1
    assert "has 0 MB free, the backup needs 1" in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_backup_left_goes_with_the_next_but_not_one_under_way(data: Path, tmp_path: Path) -> None:
    dead, alive = tmp_path / ".b.00000000.part", tmp_path / ".b.11111111.part"
    for folder in (dead, alive):
        folder.mkdir()
        (folder / "skills.db").write_bytes(b"half")
    descriptor = os.open(alive, os.O_RDONLY)
    try:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX)
        (tmp_path / "b").mkdir()
        assert status_of(["backup", str(tmp_path / "b"), "--data", str(data)]) == 0
    finally:
        os.close(descriptor)
    assert sorted(one.name for one in tmp_path.iterdir()) == [".b.11111111.part", "b"]


def test_a_library_of_its_own_place_is_backed_up_and_restored_there(data: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    shutil.copytree(data, tmp_path / "data")
    (tmp_path / "data" / "skills.db").rename(tmp_path / "elsewhere" / "own.db")
    for name in ("data", "back"):
        file = tmp_path / f"{name}.toml"
        place = tmp_path / "elsewhere" / ("own.db" if name == "data" else "back.db")
        file.write_text(f'data = "{tmp_path / name}"\ndatabase = "sqlite:///{place}"\n')
    assert status_of(["backup", str(tmp_path / "b"), "--config", str(tmp_path / "data.toml")]) == 0
    assert status_of(["restore", str(tmp_path / "b"), "--config", str(tmp_path / "back.toml")]) == 0
    assert status_of(["users", "list", "--config", str(tmp_path / "back.toml")]) == 0
    assert not (tmp_path / "back" / "skills.db").exists()
