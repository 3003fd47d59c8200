"""What one call may cost is checked before it begins; nothing holds the loop, and the log has a budget."""

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import pytest_asyncio
from asyncua import ua
from small_corner import small_corner

from opcua_skill.client import Refused, SkillClient
from opcua_skill.wire import to_server

if TYPE_CHECKING:
    from tests.conftest import Plant

pytestmark = pytest.mark.asyncio(loop_scope="module")
SLOWER = 1_000.0  # a corner of a few seconds, drawn over an hour


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def people(plant: "Plant") -> AsyncIterator[dict[str, SkillClient]]:
    async with contextlib.AsyncExitStack() as stack:
        names = ("visitor", "mes", "teacher", "engineer")
        found = {name: await stack.enter_async_context(plant.sign_in(name)) for name in names}
        shown = [replace(one, times=one.times * 3000.0 / one.times[-1]) for one in small_corner()]
        await found["teacher"].learn_to_the_end("long", shown, semantic_type="Gluing")
        yield found


def trajectory(step: float) -> dict[str, ua.Variant]:
    return {
        "SkillName": to_server.string("long"),
        "Version": to_server.uint32(0),
        "RecipeId": to_server.string(""),
        "TimeStep": to_server.double(step),
    }


async def test_a_path_of_millions_of_samples_is_refused_before_it_is_made(people: dict[str, SkillClient]) -> None:
    visitor, mes = people["visitor"], people["mes"]
    [most] = await visitor.session.read("SkillLibrary/Limits/MaxTrajectorySamples")
    asking = [asyncio.create_task(visitor.session.call("SkillLibrary", "GetTrajectory", **trajectory(0.0005)))] * 1
    await mes.workstation("ws1").protective_stop("light curtain")
    for one in asking:
        with pytest.raises(Refused) as refused:
            await one
        assert (refused.value.status, refused.value.argument) == ("BadInvalidArgument", "TimeStep")
        assert str(most) in refused.value.reason
    await mes.workstation("ws1").reset("clear")


async def test_a_long_path_is_answered_whole_and_holds_nobody_up(people: dict[str, SkillClient]) -> None:
    visitor, other = people["visitor"], people["mes"]
    [before] = await other.session.read("SkillLibrary/LongestHold")
    waits: list[float] = []

    async def read_on() -> None:
        while True:
            begun = time.perf_counter()
            await other.session.read("Machines/ws1/Arm/AtRest")
            waits.append(time.perf_counter() - begun)
            await asyncio.sleep(0.005)

    reading = asyncio.create_task(read_on())
    dimension, times, positions, covariances, dispense = await visitor.session.call(
        "SkillLibrary", "GetTrajectory", **trajectory(0.025)
    )
    reading.cancel()
    await asyncio.gather(reading, return_exceptions=True)
    assert len(times) == 120_001 and times[-1] == pytest.approx(3000.0)
    assert len(positions) == dimension * len(times) == len(covariances) / dimension
    assert len(dispense) == len(times)
    assert np.isfinite(positions).all()
    await asyncio.sleep(1.5)
    [after] = await other.session.read("SkillLibrary/LongestHold")
    assert after <= max(before, 0.1), "the loop was held for long; on an idle machine 0.02 s"


def spoilt(document: str, what: str) -> str:
    told = json.loads(document)
    if what == "means":
        told["means"] = (np.array(told["means"]) * 1e200).tolist()
    elif what == "covariances":
        told["covariances"] = (np.array(told["covariances"]) * 0.0 + np.eye(len(told["means"][0])) * 1e-320).tolist()
    elif what == "duration":
        told["duration"] = 1e12
    elif what == "timeStep":
        told["timeStep"] = 1e-9
    return digested(told)


def digested(told: dict[str, Any]) -> str:
    from library.description import SkillDescription

    with contextlib.suppress(Exception):
        read = SkillDescription.from_json(json.dumps(told))
        told["modelDigest"] = read.computed_digest()
    return json.dumps(told)


@pytest.mark.parametrize("what", ["means", "covariances", "duration", "timeStep"])
async def test_a_document_that_cannot_be_run_is_refused_when_it_is_imported(
    what: str, people: dict[str, SkillClient], plant: "Plant"
) -> None:
    session = people["teacher"].session
    version, like_json = to_server.uint32(1), to_server.string("json")
    [content] = await session.call("SkillLibrary", "ExportSkill", N=to_server.string("long"), V=version, F=like_json)
    before = await asyncio.to_thread(plant.counts)
    with pytest.raises(Refused) as refused:
        await session.call(
            "SkillLibrary", "ImportSkill", Content=to_server.string(spoilt(content, what)), Format=like_json
        )
    assert (refused.value.status, refused.value.argument) == ("BadInvalidArgument", "Content"), refused.value
    assert await asyncio.to_thread(plant.counts) == before
    name, number = await session.call(
        "SkillLibrary", "ImportSkill", Content=to_server.string(content), Format=like_json
    )
    assert (name, number > 1) == ("long", True), "a whole one is taken"


async def test_refusals_with_millions_of_characters_leave_little_in_the_log(
    people: dict[str, SkillClient], plant: "Plant"
) -> None:
    visitor, engineer = people["visitor"].session, people["engineer"]
    before, rows = len(plant.log()), len(await engineer.audit_trail(limit=1000))
    client = visitor._client.uaclient
    for name in ["x" * 3_000_000] * 10 + ["x"] * 300:
        call = ua.CallMethodRequest(
            visitor.node("SkillLibrary"), visitor.node("SkillLibrary/GetJob"), [to_server.string(name)]
        )
        [result] = await client.call([call])
        assert result.StatusCode.name == "BadNotFound"
    assert len(plant.log()) - before < 200_000
    assert len(await engineer.audit_trail(limit=1000)) - rows < 200
    async with asyncio.timeout(30):
        while "RecordsDropped" not in (await visitor_kinds(people["visitor"])):
            await asyncio.sleep(0.05)


async def visitor_kinds(client: SkillClient) -> list[str]:
    [kinds] = await client.session.read("SkillLibrary/FaultKinds")
    return kinds
