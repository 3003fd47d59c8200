"""What the panel needed of the server, through its client: learning again, the way home, and the audit trail."""

import asyncio
from typing import Any

import pytest

from models.demonstration import Edits
from models.synthetic import simulated_people
from opcua_skill.client import Refused, SkillClient

PEOPLE = simulated_people(5, seed=4)[0]


@pytest.fixture(scope="module")
def plant(make_plant: Any) -> Any:
    """A server whose arm takes as long as a real one: a run can be stopped on its way."""
    return make_plant(realtime=True)


async def taught(client: SkillClient, name: str) -> None:
    report = await client.learn_to_the_end(name, PEOPLE, semantic_type="Gluing")
    assert report.state == "Completed", report.message


async def again(client: SkillClient, name: str, version: int, edits: Edits) -> int:
    job_id, _, _ = await client.learn_again(name, version, edits)
    report = await client.follow(job_id)
    assert report.state == "Completed", report.message
    return report.skill_version


async def test_what_was_struck_and_left_out_comes_back_and_gives_the_same_model(teacher: SkillClient) -> None:
    await taught(teacher, "again")
    names = [one.demonstration_id for one in PEOPLE]
    edits = Edits(frozenset({names[0]}), {names[1]: frozenset(range(100, 160))})
    second = await again(teacher, "again", 1, edits)
    provenance = (await teacher.skill("again", second)).document["provenance"]
    assert provenance["excluded"] == [names[0]]
    assert sorted(provenance["struck"][names[1]]) == list(range(100, 160))
    assert provenance["basedOn"] == 1
    third = await again(teacher, "again", second, Edits())
    first, last = await teacher.skill("again", 1), await teacher.skill("again", third)
    assert (second, third) == (2, 3)
    assert last.model_digest == first.model_digest != (await teacher.skill("again", 2)).model_digest


@pytest.mark.parametrize(
    ("edits", "status"),
    [
        (Edits(frozenset({"nobody"})), "BadNotFound"),
        (Edits(frozenset(), {PEOPLE[0].demonstration_id: frozenset({10**6})}), "BadInvalidArgument"),
        (Edits(frozenset(one.demonstration_id for one in PEOPLE)), "BadInvalidArgument"),
    ],
)
async def test_edits_that_make_no_sense_are_refused_and_store_nothing(
    teacher: SkillClient, plant: Any, edits: Edits, status: str
) -> None:
    if not await teacher.find_skills(name_prefix="edits"):
        await taught(teacher, "edits")
    before = plant.counts()["versions"]
    with pytest.raises(Refused) as refused:
        await teacher.learn_again("edits", 1, edits)
    assert refused.value.status == status
    assert plant.counts()["versions"] == before


async def test_an_operator_may_not_learn_again(mes: SkillClient, teacher: SkillClient) -> None:
    await taught(teacher, "not-mine")
    with pytest.raises(Refused, match="BadUserAccessDenied"):
        await mes.learn_again("not-mine", 1, Edits())
    assert await mes.session.may("SkillLibrary/LearnAgain", "Machines/ws1/Arm/GoHome") == [False, True]


async def until(client: SkillClient, what: str) -> None:
    """Wait until the arm is in a mode."""
    async with asyncio.timeout(30):
        while (await client.workstation("ws1").arm()).mode != what:
            await asyncio.sleep(0.05)


async def test_after_a_stop_on_the_path_the_way_home_makes_the_next_run_possible(
    teacher: SkillClient, engineer: SkillClient, mes: SkillClient
) -> None:
    await taught(teacher, "home")
    skill = await engineer.skill("home")
    await engineer.approve("home", skill.version, skill.model_digest)
    await engineer.deploy("home", skill.version, "ws1")
    station = mes.workstation("ws1")
    started = await station.execute("home", mode="production")
    await until(mes, "running")
    with pytest.raises(Refused, match="BadInvalidState"):
        await station.go_home()
    async with asyncio.timeout(30):
        while (await station.job(started.job_id)).progress < 0.2:
            await asyncio.sleep(0.05)
    await station.protective_stop("test")
    await until(mes, "protective stop")
    assert (await mes.follow(started.job_id, on="ws1")).failure == "ProtectiveStop"
    with pytest.raises(Refused, match="BadInvalidState"):
        await station.go_home()
    await station.reset()
    waiting = await station.execute("home", mode="production")
    assert (await station.queue()).state == "Held"
    await station.go_home()
    await until(mes, "running")
    await until(mes, "idle")
    assert (await station.job(waiting.job_id)).state == "Queued"
    assert await station.release_queue() == "Released"
    done = await mes.follow(waiting.job_id, on="ws1")
    assert done.state == "Completed", done.message


async def test_the_audit_trail_tells_who_did_what_and_what_was_refused(
    engineer: SkillClient, teacher: SkillClient
) -> None:
    with pytest.raises(Refused):
        await teacher.skill("never-taught")
    with pytest.raises(Refused):
        await teacher.deploy("never-taught", 1, "ws1")
    newest = await engineer.audit_trail(limit=50)
    refused = next(one for one in newest if one.action == "Deploy" and one.arguments["SkillName"] == "never-taught")
    assert (refused.actor, refused.role, refused.status) == ("teacher", "teacher", "BadUserAccessDenied")
    assert refused.reason and refused.at is not None
    assert refused.arguments == {"SkillName": "never-taught", "Version": 1, "Workstation": "ws1"}
    assert any(one.action == "SignIn" and one.actor == "teacher" for one in await engineer.audit_trail(limit=1000))


async def test_the_audit_trail_is_read_page_by_page(engineer: SkillClient) -> None:
    first = await engineer.audit_trail(limit=2)
    second = await engineer.audit_trail(before=first[-1].entry_id, limit=2)
    numbers = [one.entry_id for one in (*first, *second)]
    assert len(set(numbers)) == len(numbers) and numbers == sorted(numbers, reverse=True)
    assert await engineer.audit_trail(before=1) == []
    assert await engineer.audit_trail(before=2**64 - 1, limit=1) == await engineer.audit_trail(limit=1)
    with pytest.raises(Refused, match="at most 1000"):
        await engineer.audit_trail(limit=1001)


async def test_who_is_no_engineer_does_not_read_the_audit_trail(teacher: SkillClient) -> None:
    with pytest.raises(Refused) as refused:
        await teacher.audit_trail()
    assert refused.value.status == "BadUserAccessDenied"
