"""Rights end when they end: what another process does to users and certificates, a server notices within a second."""

import asyncio
import json
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from library.store import SkillLibrary
from opcua_skill.client import APPLICATION_URI, ClientError, Refused, SkillClient, Unreachable
from opcua_skill.commands.verbs import status_of
from opcua_skill.security import TrustList, ensure_client_certificate, hash_password
from tests.conftest import PASSWORD, Plant

LIMIT = 20.0
"""s until a test gives up; the server is meant to notice within one, on a machine that is not busy."""


async def run(plant: Plant, *words: str) -> None:
    assert await asyncio.to_thread(status_of, [*words, "--data", str(plant.data)]) == 0


async def add_user(plant: Plant, name: str, role: str) -> None:
    async with await SkillLibrary.open(plant.database) as library:
        await library.add_user(name, role, hash_password(PASSWORD))


async def until_refused(ask: Callable[[], Awaitable[Any]]) -> ClientError:
    """Ask until it is refused, and return how."""
    deadline = time.monotonic() + LIMIT
    while time.monotonic() < deadline:
        try:
            await ask()
        except ClientError as error:
            return error
        await asyncio.sleep(0.05)
    raise AssertionError(f"still answered after {LIMIT:g} s")


def audited(plant: Plant, capsys: pytest.CaptureFixture[str], action: str, user: str) -> list[dict[str, Any]]:
    capsys.readouterr()
    assert status_of(["audit", "--json", "--data", str(plant.data), "--limit", "200"]) == 0
    entries = json.loads(capsys.readouterr().out)
    return [one for one in entries if one["action"] == action and one["arguments"].get("User") == user]


async def test_a_removed_user_and_one_with_a_new_password_are_out_at_once_and_others_are_not(
    plant: Plant, visitor: SkillClient, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, words in (("removed", ["users", "remove", "removed"]), ("renewed", ["users", "password", "renewed"])):
        await add_user(plant, name, "engineer")
        async with plant.sign_in(name) as client:
            await client.find_skills()
            if name == "renewed":
                monkeypatch.setattr("opcua_skill.commands.users.new_password", lambda *_: hash_password("another one"))
            await run(plant, *words)
            assert isinstance(await until_refused(client.find_skills), Unreachable)
        with pytest.raises(ClientError, match="user name or the password is wrong"):
            async with plant.sign_in(name):
                pass
        [entry] = await asyncio.to_thread(audited, plant, capsys, "EndSession", name)
        assert entry["actor"] == "server"
        assert ("removed" if name == "removed" else "password") in entry["reason"]
    await visitor.find_skills()


async def test_a_user_made_anew_under_an_old_name_does_not_get_the_old_session(plant: Plant) -> None:
    await add_user(plant, "twice", "engineer")
    async with plant.sign_in("twice") as client:
        await client.find_skills()
        async with await SkillLibrary.open(plant.database) as library:
            user = await library.user("twice")
            await library.remove_user("twice")
            await library.add_user("twice", user.role, user.password_hash)
        assert isinstance(await until_refused(client.find_skills), Unreachable)


async def test_another_role_counts_from_the_next_call_in_the_same_session(plant: Plant) -> None:
    await add_user(plant, "changed", "engineer")

    async def look_at_trail() -> None:
        await client.audit_trail(limit=1)

    async with plant.sign_in("changed") as client:
        await look_at_trail()
        await run(plant, "users", "role", "changed", "operator")
        refused = await until_refused(look_at_trail)
        assert isinstance(refused, Refused)
        assert refused.status == "BadUserAccessDenied"
        assert await client.session.may("SkillLibrary/Approve", "SkillLibrary/ListRecipes") == [False, True]
        await client.find_skills()


async def test_a_client_whose_certificate_is_withdrawn_is_out_at_once(plant: Plant, tmp_path: Path) -> None:
    own = ensure_client_certificate(tmp_path / "panel", APPLICATION_URI)
    TrustList(plant.data / "certificates").trust(own.certificate_file)
    async with SkillClient(plant.url, "visitor", PASSWORD, folder=tmp_path / "panel") as client:
        await client.find_skills()
        await run(plant, "certificates", "distrust", own.thumbprint()[:12])
        assert isinstance(await until_refused(client.find_skills), Unreachable)
    async with plant.sign_in("visitor") as other:
        await other.find_skills()


async def test_an_administrator_sees_who_is_signed_in_and_ends_a_session_and_nobody_else_may(
    plant: Plant, visitor: SkillClient, teacher: SkillClient, capsys: pytest.CaptureFixture[str]
) -> None:
    for call in (teacher.sessions, lambda: teacher.session.call("SkillLibrary", "ListSessions")):
        with pytest.raises(Refused, match="BadUserAccessDenied"):
            await call()
    async with plant.sign_in("admin") as admin:
        found = {one.user: one for one in await admin.sessions()}
        assert (found["teacher"].role, found["teacher"].client) == ("teacher", APPLICATION_URI)
        await admin.end_session(found["visitor"].session_id)
        assert isinstance(await until_refused(visitor.find_skills), Unreachable)
        assert "visitor" not in {one.user for one in await admin.sessions()}
        with pytest.raises(ClientError, match="0 sessions"):
            await admin.end_session(found["visitor"].session_id)
    await teacher.find_skills()
    capsys.readouterr()
    entries = await asyncio.to_thread(audited_calls, plant, capsys)
    assert any(one["actor"] == "admin" and one["status"] == "Good" for one in entries)


def audited_calls(plant: Plant, capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    assert status_of(["audit", "--json", "--data", str(plant.data), "--limit", "200"]) == 0
    return [one for one in json.loads(capsys.readouterr().out) if one["action"] == "EndSession"]


async def test_sessions_from_the_command_line(
    plant: Plant, visitor: SkillClient, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("OPCUA_SKILL_CLIENT_DIR", str(plant.client_folder))
    monkeypatch.setenv("OPCUA_SKILL_PASSWORD", PASSWORD)
    where = ["--server", plant.url, "--user", "admin", "--json"]
    assert await asyncio.to_thread(status_of, ["sessions", "list", *where]) == 0
    listed = json.loads(capsys.readouterr().out)
    [mine] = [one["session_id"] for one in listed if one["user"] == "visitor"]
    assert await asyncio.to_thread(status_of, ["sessions", "end", mine[:8], *where]) == 0
    assert json.loads(capsys.readouterr().out) == [mine]
    await until_refused(visitor.find_skills)
    assert await asyncio.to_thread(status_of, ["sessions", "end", "--of", "visitor", *where]) == 1


@pytest.fixture
async def visitor(plant: Plant) -> Any:
    async with plant.sign_in("visitor") as client:
        yield client
