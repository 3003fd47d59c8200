"""Another program holds the database locked: what is refused then leaves nothing, now or later; others are served."""

import asyncio
import contextlib
import sqlite3
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
import pytest_asyncio
from small_corner import small_corner

from opcua_skill.client import Refused, SkillClient

if TYPE_CHECKING:
    from tests.conftest import Plant

pytestmark = pytest.mark.asyncio(loop_scope="module")
ANSWER_WITHIN, TOLD_WITHIN, GONE_WITHIN = 20.0, 20.0, 60.0
"""In s, on a busy machine; on an idle one 3.2, 1.5 and 1.5. Who waits for the lock itself waits for 30 s."""
STOPS_WITHIN = 5.0
"""In s, on a busy machine; on an idle one 0.02."""


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def engineer(plant: "Plant") -> AsyncIterator[SkillClient]:
    async with plant.sign_in("teacher") as teacher, plant.sign_in("engineer") as client:
        await teacher.learn_to_the_end("corner", small_corner(), semantic_type="Gluing")
        await client.approve("corner", 1, (await client.skill("corner")).model_digest)
        yield client


@contextlib.contextmanager
def locked(plant: "Plant") -> Any:
    with contextlib.closing(sqlite3.connect(plant.database, isolation_level=None, timeout=30.0)) as other:
        other.execute("BEGIN IMMEDIATE")
        try:
            yield
        finally:
            other.execute("ROLLBACK")


async def service(client: SkillClient) -> tuple[int, list[str], list[str]]:
    level = await client.session._client.get_node("i=2267").read_value()
    words, kinds = await client.session.read("SkillLibrary/Faults", "SkillLibrary/FaultKinds")
    return level, words, kinds


async def until_service(client: SkillClient, wanted: Callable[[int, list[str]], bool], seconds: float) -> None:
    async with asyncio.timeout(seconds):
        while True:
            level, _, kinds = await service(client)
            if wanted(level, kinds):
                return
            await asyncio.sleep(0.02)


async def test_while_the_database_is_locked_calls_are_void_and_all_else_goes_on(
    plant: "Plant", engineer: SkillClient
) -> None:
    [recipe] = await engineer.recipes("corner")
    station = engineer.workstation("ws1")
    calls: dict[str, Callable[[], Awaitable[object]]] = {
        "PutRecipe": lambda: engineer.put_recipe(replace(recipe, recipe_id="late")),
        "ExecuteSkill": lambda: station.execute("corner", mode="test"),
        "Deploy": lambda: engineer.deploy("corner", 1, "ws1"),
        "LearnFromDemonstration": lambda: engineer.learn("late", small_corner(), semantic_type="Gluing"),
    }
    before = await asyncio.to_thread(plant.counts)
    with locked(plant):
        await until_service(engineer, lambda level, kinds: level < 200 and "LibraryLocked" in kinds, TOLD_WITHIN)
        for name, call in calls.items():
            asked = time.monotonic()
            with pytest.raises(Refused) as refused:
                await call()
            assert refused.value.status == "BadTimeout", (name, refused.value)
            assert time.monotonic() - asked < ANSWER_WITHIN, name
        asked = time.monotonic()
        async with plant.sign_in("visitor") as visitor:
            assert (await visitor.skill("corner")).name == "corner"
            await visitor.workstation("ws1").arm()
        assert time.monotonic() - asked < ANSWER_WITHIN, "who signs in waits for the lock"
        asked = time.monotonic()
        await station.protective_stop("light curtain")
        assert time.monotonic() - asked < STOPS_WITHIN
    await until_service(engineer, lambda _, kinds: kinds == ["ArmWaiting"], GONE_WITHIN)
    await station.reset("curtain is clear")
    await until_service(engineer, lambda level, kinds: level == 255 and not kinds, GONE_WITHIN)
    await engineer.put_recipe(replace(recipe, recipe_id="after"))
    after = await asyncio.to_thread(plant.counts)
    assert after == {**before, "recipes": before["recipes"] + 1}, "something that was refused came later"
    done = {one.action for one in await engineer.audit_trail(limit=30)}
    assert {*calls, "ProtectiveStop", "SignIn"} <= done, "what happened meanwhile is not in the audit trail"
