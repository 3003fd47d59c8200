"""A server whose library is on PostgreSQL, through the door that clients use; and the command that makes it ready."""

import asyncio
import os
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from small_corner import small_corner

from library.store import SkillLibrary
from opcua_skill.client import SkillClient
from opcua_skill.client.errors import Refused
from tests import postgres, prepared

if TYPE_CHECKING:
    from tests.conftest import Plant

SETTINGS = '[[workstations]]\nname = "ws1"\ndriver = "kinematic"\nrealtime = false\n'
LIMIT = 120.0
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cluster() -> Iterator[postgres.Cluster]:
    """A PostgreSQL server, with a database that the command has made ready."""
    with postgres.cluster() as running:
        make_ready = (
            *(f"CREATE ROLE {role} LOGIN PASSWORD '{postgres.SECRET}'" for role in (postgres.OWNER, postgres.SERVER)),
            f"CREATE DATABASE plant OWNER {postgres.OWNER}",
        )
        asyncio.run(running.execute("postgres", *make_ready))
        yield running


def command(*words: str, status: int = 0) -> str:
    """Run a command and return what it said, on both streams."""
    with tempfile.TemporaryFile("w+") as errors:
        process = prepared.start(words, os.environ, errors)
        process.stdin.close()
        with process.stdout as output:
            said = output.read()
        ended = process.wait(LIMIT)
        errors.seek(0)
        said += errors.read()
    assert ended == status, said
    return said


@pytest.fixture(scope="module")
def plant(cluster: postgres.Cluster, make_plant: Callable[..., "Plant"]) -> "Plant":
    """A running server on that database, under the role that owns nothing."""
    command("library", "prepare", cluster.url("plant", postgres.OWNER), "--role", postgres.SERVER)
    return make_plant(SETTINGS, library=cluster.url("plant"))


@pytest.fixture
async def engineer(plant: "Plant") -> AsyncIterator[SkillClient]:
    async with plant.sign_in("engineer") as signed_in:
        yield signed_in


async def test_the_main_job_runs_on_postgresql_with_nothing_but_the_address_changed(
    plant: "Plant", cluster: postgres.Cluster, engineer: SkillClient
) -> None:
    async with plant.sign_in("teacher") as teacher:
        await teacher.learn_to_the_end("corner", small_corner(), semantic_type="Gluing")
    skill = await engineer.skill("corner")
    await engineer.approve("corner", 1, skill.model_digest)
    await engineer.deploy("corner", 1, "ws1")
    async with plant.sign_in("mes") as mes:
        started = await mes.workstation("ws1").execute("corner", mode="production")
        report = await mes.follow(started.job_id, on="ws1", limit=LIMIT)
    assert report.state == "Completed"
    assert await engineer.insecure() == ()
    [row] = await cluster.execute("plant", "SELECT model_digest, state FROM versions")
    assert (row["model_digest"], row["state"]) == (skill.model_digest.hex(), "Approved")
    assert not plant.database.exists()
    actions = {entry.action for entry in await engineer.audit_trail()}
    assert {"Approve", "Deploy", "ExecuteSkill"} <= actions


async def test_a_plant_s_library_is_carried_into_a_file_that_another_server_could_serve(
    cluster: postgres.Cluster, engineer: SkillClient, tmp_path: Path
) -> None:
    said = await asyncio.to_thread(command, "library", "copy", cluster.url("plant"), str(tmp_path / "skills.db"))
    assert "read back as the same, SHA-256" in " ".join(said.split())
    async with await SkillLibrary.open(tmp_path / "skills.db", must_exist=True) as library:
        copied = await library.description("corner")
    assert copied.model_digest == (await engineer.skill("corner")).model_digest.hex()
    again = await asyncio.to_thread(
        command, "library", "copy", str(tmp_path / "skills.db"), cluster.url("plant"), status=1
    )
    assert "name a new or empty one" in again


async def test_a_database_server_that_goes_and_comes_is_told_and_costs_nothing_stored(
    plant: "Plant", cluster: postgres.Cluster, engineer: SkillClient
) -> None:
    async def faults() -> list[str]:
        [kinds] = await engineer.session.read("SkillLibrary/FaultKinds")
        return list(kinds or [])

    async def told(wanted: bool) -> None:
        async with asyncio.timeout(LIMIT):
            while ("LibraryUnreachable" in await faults()) is not wanted:
                await asyncio.sleep(0.05)

    recipe = (await engineer.recipes("corner"))[0]
    await asyncio.to_thread(cluster.stop)
    await told(True)
    with pytest.raises(Refused) as refused:
        await engineer.put_recipe(recipe)
    assert refused.value.status == "BadResourceUnavailable"
    await asyncio.to_thread(cluster.start)
    await told(False)
    await engineer.put_recipe(recipe)
    assert postgres.SECRET not in plant.log()
