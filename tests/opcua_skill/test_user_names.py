"""One person, one name: in every form of accents and every case, at the command line and at sign-in."""

import asyncio
import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from library.store import SkillLibrary
from opcua_skill.commands.verbs import status_of
from opcua_skill.security import Authenticator, hash_password
from opcua_skill.security.access import Peer

NFC, NFD = "Jos\u00e9", "Jose\u0301"
PASSWORD = "correct horse battery"


async def made(data: Path, *names: str) -> None:
    async with await SkillLibrary.open(data / "skills.db") as library:
        for name in names:
            await library.add_user(name, "teacher", hash_password(PASSWORD))


@pytest.mark.parametrize(("first", "second"), [(NFC, NFD), (NFD, NFC), ("tess", "TESS"), ("Stra\u00dfe", "STRASSE")])
def test_the_same_name_typed_otherwise_is_no_second_user(
    first: str, second: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ["--data", str(tmp_path)]
    monkeypatch.setattr("opcua_skill.commands.users.new_password", lambda *_: hash_password(PASSWORD))
    assert status_of(["users", "add", first, "--role", "teacher", *where]) == 0
    assert status_of(["users", "add", second, "--role", "admin", *where]) == 1
    assert "exists already" in capsys.readouterr().err
    assert status_of(["users", "role", second, "operator", *where]) == 0
    capsys.readouterr()
    assert status_of(["users", "list", "--json", *where]) == 0
    [row] = json.loads(capsys.readouterr().out)
    assert (row["name"], row["role"]) == (NFC if first in {NFC, NFD} else first, "operator")
    assert status_of(["users", "remove", second, *where]) == 0


async def test_who_signs_in_is_known_by_the_name_that_is_stored(tmp_path: Path) -> None:
    await made(tmp_path, NFC, "tess")
    async with await SkillLibrary.open(tmp_path / "skills.db") as library:
        authenticator = Authenticator(library)
        for typed, name in ((NFD, NFC), ("JOSE\u0301", NFC), ("TESS", "tess")):
            who = await authenticator.by_password(typed, PASSWORD, Peer("here", b""))
            assert who is not None
            assert who.name == name
        authenticator.close()


def test_doubles_of_an_older_library_are_told_and_never_taken_for_each_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asyncio.run(made(tmp_path, "tess"))
    with closing(sqlite3.connect(tmp_path / "skills.db")) as connection, connection:
        connection.execute("INSERT INTO users SELECT 'TESS', 'admin', '', x'', created_at, created_by FROM users")
    where = ["--data", str(tmp_path)]
    assert status_of(["users", "list", *where]) == 0
    assert "TESS, tess differ in case" in " ".join(capsys.readouterr().err.split())
    assert status_of(["users", "remove", "Tess", *where]) == 1
    assert status_of(["users", "remove", "TESS", *where]) == 0
    capsys.readouterr()
    assert status_of(["users", "list", "--json", *where]) == 0
    assert [row["name"] for row in json.loads(capsys.readouterr().out)] == ["tess"]
