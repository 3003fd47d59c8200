"""kill -9 of the server at twenty moments of the main job: the acknowledged is there, the rest whole or absent."""

import asyncio
import random
import sqlite3
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager, closing, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pytest
from small_corner import small_corner

from opcua_skill.client import ClientError, SkillClient

if TYPE_CHECKING:
    from tests.conftest import Plant

KILLS = 20
PEOPLE = small_corner()
LIMIT = 120.0
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@dataclass
class Acknowledged:
    """What the server has confirmed of one story before it died."""

    skill: str
    version: int = 0
    state: str = ""
    deployed: bool = False
    jobs: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Stage:
    """The plant, and how long a story takes when nobody kills it, in s."""

    plant: "Plant"
    length: float


@asynccontextmanager
async def signed_in(plant: "Plant") -> AsyncIterator[tuple[SkillClient, SkillClient]]:
    """Sign in a teacher and an engineer; that the server has died meanwhile is no fault when they leave."""
    async with AsyncExitStack() as stack:
        clients = [await plant.sign_in(name).__aenter__() for name in ("teacher", "engineer")]
        for client in clients:
            stack.push_async_callback(left, client)
        yield clients[0], clients[1]


async def left(client: SkillClient) -> None:
    with suppress(ClientError, OSError, TimeoutError, asyncio.CancelledError):
        await client.__aexit__(None, None, None)


async def story(teacher: SkillClient, engineer: SkillClient, told: Acknowledged) -> None:
    """Learn, approve, deploy and run, writing down every confirmation."""
    learned = await teacher.learn(told.skill, PEOPLE, semantic_type="Gluing")
    told.jobs.append(learned.job_id)
    if learned.state == "Completed":
        told.version, told.state = learned.version, "Learned"
    else:
        report = await teacher.follow(learned.job_id, limit=LIMIT)
        assert report.state == "Completed", report
        told.version, told.state = report.skill_version, "Learned"
    skill = await engineer.skill(told.skill)
    told.state = await engineer.approve(told.skill, skill.version, skill.model_digest)
    await engineer.deploy(told.skill, skill.version, "ws1")
    told.deployed = True
    if (await teacher.workstation("ws1").queue()).held:
        await teacher.workstation("ws1").release_queue("looked after the last kill")
    for _ in range(2):
        told.jobs.append((await teacher.workstation("ws1").execute(told.skill, mode="production")).job_id)
    for job_id in told.jobs[1:]:
        await teacher.follow(job_id, on="ws1", limit=LIMIT)


async def rehearsed(plant: "Plant") -> float:
    """Play the story to its end; return how long it took."""
    async with signed_in(plant) as (teacher, engineer):
        began = time.monotonic()
        await story(teacher, engineer, Acknowledged("rehearsal"))
        return time.monotonic() - began


@pytest.fixture(scope="module")
def stage(make_plant: Callable[..., "Plant"]) -> Stage:
    plant = make_plant(driver="pybullet", realtime=True)
    return Stage(plant, asyncio.run(rehearsed(plant)))


async def interrupted(plant: "Plant", told: Acknowledged, after: float) -> None:
    """Play a story and kill the server ``after`` s from its first call."""
    async with signed_in(plant) as (teacher, engineer):
        playing = asyncio.create_task(story(teacher, engineer, told))
        with suppress(TimeoutError):
            await asyncio.wait_for(asyncio.shield(playing), after)
        await asyncio.to_thread(plant.kill)
        playing.cancel()
        with suppress(ClientError, OSError, asyncio.CancelledError):
            await playing


@pytest.mark.parametrize("moment", range(KILLS))
def test_nothing_is_half_done_after_kill_9(moment: int, stage: Stage) -> None:
    plant = stage.plant
    told = Acknowledged(f"skill-{moment}")
    after = (moment + random.Random(moment).random()) / KILLS * stage.length
    asyncio.run(interrupted(plant, told, after))
    with closing(sqlite3.connect(plant.database)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
    plant.start()
    asyncio.run(check(plant, told, everything=moment == KILLS - 1))


async def check(plant: "Plant", told: Acknowledged, *, everything: bool) -> None:
    """Look at what the story touched through OPC UA, as the next shift would; after the last kill at everything."""
    async with plant.sign_in("engineer") as engineer:
        skills = {skill.name: skill for skill in await engineer.find_skills()}
        if told.version:
            assert told.skill in skills, f"{told} is lost"
            kept = await engineer.skill(told.skill, told.version)
            assert kept.state == told.state or (told.state, kept.state) == ("Learned", "Approved"), told
        if told.deployed:
            assert "ws1" in skills[told.skill].workstations, told
        for name, skill in skills.items():
            if everything or name == told.skill:
                await whole(engineer, name, skill.version)
        workstation = engineer.workstation("ws1")
        assert (await workstation.arm()).at_rest
        for job in await workstation.jobs():
            assert job.ended, job
            assert job.state != "Failed" or job.failure == "Interrupted", job
        for job_id in told.jobs:
            job = await engineer.job(job_id) if job_id == told.jobs[0] else await workstation.job(job_id)
            assert job.ended, job
            assert job.state == "Completed" or job.failure == "Interrupted", job
            runs = job_id != told.jobs[0]
            assert not runs or job.state == "Completed" or (job.cause, job.held_queue) == ("UnfinishedAtStart", True), (
                job
            )
        unfinished = [one for one in told.jobs[1:] if (await workstation.job(one)).cause == "UnfinishedAtStart"]
        assert not unfinished or (await workstation.queue()).held, "what a crash left unfinished holds the queue"


async def whole(engineer: SkillClient, name: str, version: int) -> None:
    """Check that a version has all that belongs to it: description, recordings, path, default recipe."""
    skill = await engineer.skill(name, version)
    assert skill.means.shape[1:] == skill.covariances.shape[1:-1]
    assert skill.report
    recordings = await engineer.recordings(name, version)
    assert len(recordings.raw) == len(PEOPLE)
    assert recordings.aligned
    assert len((await engineer.path(name, version)).times) > 10
    assert await engineer.recipes(name)
