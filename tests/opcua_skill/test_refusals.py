# ruff: noqa: E501 - a row of the table is one line
"""INTERFACE section 6, row by row, through a real client: the exact code, the argument, one sentence of reason.

After every refusal nothing is stored, nothing is queued and nothing has moved.
"""

import asyncio
import contextlib
import sqlite3
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import pytest_asyncio
from asyncua import ua
from small_corner import small_corner

from library.errors import LibraryUnusable, Trouble
from models.demonstration import Demonstration
from opcua_skill.client import LearningOptions, Recipe, Refused, Session, SkillClient
from opcua_skill.stack.services import calls
from opcua_skill.wire import to_server
from opcua_skill.wire.refusals import refusing

if TYPE_CHECKING:
    from tests.conftest import Plant

SETTINGS = """
[[workstations]]
name = "ws1"
driver = "kinematic"
realtime = false

[[workstations]]
name = "slow"
driver = "kinematic"
realtime = true

[[workstations]]
name = "bare"
driver = "kinematic"
equipment = []

[limits]
max_demonstrations = 40
max_points_per_demonstration = 5000
max_queued_jobs = 3
"""
PEOPLE = small_corner(5)
LIBRARY = "SkillLibrary"
WS1 = "Machines/ws1"
NAN, INFINITY = float("nan"), float("inf")
pytestmark = pytest.mark.asyncio(loop_scope="module")
Arguments = dict[str, ua.Variant]


@dataclass(frozen=True)
class World:
    """What was there before the refusals: ids, digests, and the plant."""

    plant: "Plant"
    digest: bytes
    own_digest: bytes
    job_id: str
    recipe: Recipe


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def world(make_plant: Callable[..., "Plant"]) -> World:
    return await prepare(await asyncio.to_thread(make_plant, SETTINGS))


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def people(world: World) -> AsyncIterator[dict[str, SkillClient]]:
    """Everybody, signed in once for all rows."""
    async with contextlib.AsyncExitStack() as stack:
        names = ("visitor", "mes", "teacher", "engineer", "engineer-2")
        yield {name: await stack.enter_async_context(world.plant.sign_in(name)) for name in names}


async def prepare(plant: "Plant") -> World:
    """Teach, approve, deploy and run: `plate` version 1 is deployed, 2 is learned; `own` is an engineer's; `kept` is approved."""
    async with plant.sign_in("teacher") as teacher, plant.sign_in("engineer") as engineer:
        await teacher.learn_to_the_end("plate", PEOPLE, semantic_type="Gluing")
        await teacher.learn_to_the_end("kept", PEOPLE, semantic_type="Gluing")
        skill = await engineer.skill("plate")
        await engineer.approve("plate", 1, skill.model_digest)
        await engineer.approve("kept", 1, (await engineer.skill("kept")).model_digest)
        await engineer.deploy("plate", 1, "ws1")
        await engineer.deploy("plate", 1, "slow")
        await teacher.learn_to_the_end("plate", PEOPLE, semantic_type="Gluing", options=LearningOptions(components=6))
        async with plant.sign_in("engineer-2") as other:
            await other.learn_to_the_end("own", PEOPLE, semantic_type="Gluing")
            own = await other.skill("own")
        started = await engineer.workstation("ws1").execute("plate", mode="production")
        assert (await engineer.follow(started.job_id, on="ws1")).state == "Completed"
        [recipe] = await engineer.recipes("plate")
        await engineer.put_recipe(replace(recipe, recipe_id="far", frame=(2.5, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)))
        await engineer.put_recipe(replace(recipe, recipe_id="fast", duration=0.2))
        await engineer.put_recipe(replace(recipe, recipe_id="long", duration=60.0, time_step=0.02))
    return World(plant, skill.model_digest, own.model_digest, started.job_id, recipe)


def text(value: str) -> ua.Variant:
    return to_server.string(value)


def number(value: int) -> ua.Variant:
    return to_server.uint32(value)


def bad(**changes: Any) -> list[Demonstration]:
    """Return two demonstrations that are bad in the same way, so that none is usable."""
    return [replace(one, **changes) for one in PEOPLE[:2]]


def learning(session: Session, shown: Sequence[Demonstration], **options: Any) -> Arguments:
    structure = session.structure
    sent = [to_server.demonstration_out(structure, one) for one in shown]
    return {
        "SkillName": text("new"),
        "SemanticType": text("Gluing"),
        "Demonstrations": to_server.structure_array(sent),
        "Options": to_server.structure(to_server.options_out(structure, LearningOptions(**options))),
    }


def learning_with(session: Session, **fields: Any) -> Arguments:
    """Return a call whose demonstrations all have these wire fields."""
    arguments = learning(session, PEOPLE)
    for one in arguments["Demonstrations"].Value:
        for name, value in fields.items():
            setattr(one, name, value)
    return arguments


def put(session: Session, world: World, **changes: Any) -> Arguments:
    return {"Recipe": to_server.structure(to_server.recipe_out(session.structure, replace(world.recipe, **changes)))}


def judging(name: str, version: int, digest: bytes) -> Arguments:
    return {
        "SkillName": text(name),
        "Version": number(version),
        "ModelDigest": to_server.byte_string(digest),
        "Comment": text(""),
    }


def placing(name: str, version: int, workstation: str) -> Arguments:
    return {"SkillName": text(name), "Version": number(version), "Workstation": text(workstation)}


def running(name: str, recipe: str, mode: int) -> Arguments:
    return {"SkillName": text(name), "RecipeId": text(recipe), "Mode": to_server.int32(mode)}


def of_version(name: str, version: int) -> Arguments:
    return {"SkillName": text(name), "Version": number(version)}


def steering(job_id: str) -> Arguments:
    return {"JobId": text(job_id), "Comment": text("")}


def trajectory(**changes: ua.Variant) -> Arguments:
    arguments = {**of_version("plate", 1), "RecipeId": text(""), "TimeStep": to_server.double(0.0)}
    return {**arguments, **changes}


def removing(name: str, indices: ua.Variant, one: str = "") -> Arguments:
    return {**of_version(name, 1), "DemonstrationId": text(one), "Indices": indices, "Comment": text("")}


def undecodable(session: Session) -> ua.Variant:
    """Return an options structure whose bytes end too early."""
    known = session.structure("LearningOptionsDataType")
    encoding = next(number for number, cls in ua.extension_objects_by_typeid.items() if cls is known)
    return ua.Variant(ua.ExtensionObject(TypeId=encoding, Body=b"\xff\x01"), ua.VariantType.ExtensionObject)


@dataclass(frozen=True)
class Row:
    """Who calls what with what, and what has to come back. ``argument``: name and code of the one at fault."""

    case: str
    user: str
    place: str
    method: str
    arguments: Callable[[Session, World], Arguments]
    status: str
    argument: tuple[str, str] = ("", "")

    def __str__(self) -> str:
        return f"{self.method}: {self.case}"


def row(
    case: str,
    user: str,
    target: str,
    arguments: Callable[[Session, World], Arguments],
    status: str,
    argument: str = "",
    code: str = "",
) -> Row:
    place, _, method = target.rpartition("/")
    return Row(case, user, place, method, arguments, status, (argument, code))


LEARN, FIND, GET = f"{LIBRARY}/LearnFromDemonstration", f"{LIBRARY}/FindSkills", f"{LIBRARY}/GetSkill"
APPROVE, REJECT, DEPLOY = f"{LIBRARY}/Approve", f"{LIBRARY}/Reject", f"{LIBRARY}/Deploy"
TRAJECTORY, REMOVE, PUT = f"{LIBRARY}/GetTrajectory", f"{LIBRARY}/RemovePoints", f"{LIBRARY}/PutRecipe"
RUN = f"{WS1}/ExecuteSkill"
INVALID, RANGE, TYPE, MISSING = "BadInvalidArgument", "BadOutOfRange", "BadTypeMismatch", "BadNotFound"
DENIED, STATE, EXECUTABLE = "BadUserAccessDenied", "BadInvalidState", "BadNotExecutable"


def without(arguments: Arguments, name: str) -> Arguments:
    return {key: value for key, value in arguments.items() if key != name}


ARGUMENTS = [
    row("missing", "engineer", APPROVE, lambda s, w: without(judging("plate", 2, w.digest), "Comment"), "BadArgumentsMissing"),
    row("none at all", "teacher", LEARN, lambda s, w: {}, "BadArgumentsMissing"),
    row("extra", "visitor", GET, lambda s, w: {**of_version("plate", 1), "More": text("")}, "BadTooManyArguments"),
    row("a number for a text", "visitor", GET, lambda s, w: {**of_version("plate", 1), "SkillName": number(1)}, INVALID, "SkillName", TYPE),
    row("a text for a number", "visitor", GET, lambda s, w: {**of_version("plate", 1), "Version": text("1")}, INVALID, "Version", TYPE),
    row("a list for a text", "visitor", GET, lambda s, w: {**of_version("plate", 1), "SkillName": ua.Variant(["plate"], ua.VariantType.String)}, INVALID, "SkillName", TYPE),
    row("a number for a list", "teacher", REMOVE, lambda s, w: removing("plate", number(1)), INVALID, "Indices", TYPE),
    row("another structure", "teacher", LEARN, lambda s, w: {**learning(s, PEOPLE), "Options": to_server.structure(to_server.recipe_out(s.structure, w.recipe))}, INVALID, "Options", TYPE),
    row("an undecodable structure", "teacher", LEARN, lambda s, w: {**learning(s, PEOPLE), "Options": undecodable(s)}, INVALID, "Options", TYPE),
    row("one structure for a list", "teacher", LEARN, lambda s, w: {**learning(s, PEOPLE), "Demonstrations": to_server.structure(to_server.demonstration_out(s.structure, PEOPLE[0]))}, INVALID, "Demonstrations", TYPE),
]  # fmt: skip
VALUES = [
    row("NaN throughout", "teacher", LEARN, lambda s, w: learning(s, bad(points=np.full_like(PEOPLE[0].points, NAN), times=PEOPLE[0].times, triggers=PEOPLE[0].triggers)), INVALID, "Demonstrations", RANGE),
    row("infinite times", "teacher", LEARN, lambda s, w: learning_with(s, Times=[0.0, INFINITY], Positions=[0.0] * 4, Triggers=[]), INVALID, "Demonstrations", RANGE),
    row("times that do not increase", "teacher", LEARN, lambda s, w: learning_with(s, Times=[0.0, 1.0, 1.0], Positions=[0.0] * 6, Triggers=[]), INVALID, "Demonstrations", RANGE),
    row("lengths that disagree", "teacher", LEARN, lambda s, w: learning_with(s, Positions=[0.0] * 7), INVALID, "Demonstrations", RANGE),
    row("triggers that disagree", "teacher", LEARN, lambda s, w: learning_with(s, Triggers=[True]), INVALID, "Demonstrations", RANGE),
    row("dimension 4", "teacher", LEARN, lambda s, w: learning_with(s, Dimension=4), INVALID, "Demonstrations", RANGE),
    row("no demonstrations", "teacher", LEARN, lambda s, w: learning(s, []), INVALID, "Demonstrations", RANGE),
    row("one demonstration", "teacher", LEARN, lambda s, w: learning(s, PEOPLE[:1]), INVALID, "Demonstrations", RANGE),
    row("an unknown preset", "teacher", LEARN, lambda s, w: learning(s, PEOPLE, preset="magic"), INVALID, "Options", RANGE),
    row("a negative filter window", "teacher", LEARN, lambda s, w: learning(s, PEOPLE, filter_window=-1.0), INVALID, "Options", RANGE),
    row("a skill without a name", "teacher", LEARN, lambda s, w: {**learning(s, PEOPLE), "SkillName": text("")}, INVALID, "SkillName", RANGE),
    row("time step NaN", "visitor", TRAJECTORY, lambda s, w: trajectory(TimeStep=to_server.double(NAN)), INVALID, "TimeStep", RANGE),
    row("a negative time step", "visitor", TRAJECTORY, lambda s, w: trajectory(TimeStep=to_server.double(-0.01)), INVALID, "TimeStep", RANGE),
    row("a sample that is not there", "teacher", REMOVE, lambda s, w: removing("plate", to_server.uint32_array([10**6]), PEOPLE[0].demonstration_id), INVALID, "Indices", RANGE),
    row("an unknown state", "visitor", FIND, lambda s, w: {"SemanticType": text(""), "State": text("Perfect"), "Workstation": text(""), "NamePrefix": text(""), "After": text(""), "Limit": number(0)}, INVALID, "State", RANGE),
    row("an unknown mode", "mes", RUN, lambda s, w: running("plate", "", 7), INVALID, "Mode", RANGE),
    row("time step 0", "engineer", PUT, lambda s, w: put(s, w, time_step=0.0), INVALID, "Recipe", RANGE),
    row("time step NaN", "engineer", PUT, lambda s, w: put(s, w, time_step=NAN), INVALID, "Recipe", RANGE),
    row("an override of 2", "engineer", PUT, lambda s, w: put(s, w, speed_override=2.0), INVALID, "Recipe", RANGE),
    row("an unknown timing", "engineer", PUT, lambda s, w: put(s, w, timing="soon"), INVALID, "Recipe", RANGE),
    row("a frame of 6 numbers", "engineer", PUT, lambda s, w: put(s, w, frame=(0.0,) * 6), INVALID, "Recipe", RANGE),
    row("an infinite frame", "engineer", PUT, lambda s, w: put(s, w, frame=(INFINITY, 0, 0, 0, 0, 0, 1)), INVALID, "Recipe", RANGE),
    row("an unknown format", "visitor", f"{LIBRARY}/ExportSkill", lambda s, w: {**of_version("plate", 1), "Format": text("pdf")}, INVALID, "Format", RANGE),
    row("no skill in the text", "teacher", f"{LIBRARY}/ImportSkill", lambda s, w: {"Content": text("{}"), "Format": text("json")}, INVALID, "Content", RANGE),
    row("no JSON at all", "teacher", f"{LIBRARY}/ImportSkill", lambda s, w: {"Content": text("<skill/>"), "Format": text("json")}, INVALID, "Content", RANGE),
]  # fmt: skip
LIMITS = [
    row("too many demonstrations", "teacher", LEARN, lambda s, w: learning(s, [replace(PEOPLE[0], demonstration_id=str(i)) for i in range(41)]), "BadRequestTooLarge"),
    row("too many samples", "teacher", LEARN, lambda s, w: learning_with(s, Times=[i * 0.01 for i in range(5001)], Positions=[0.0] * 10002, Triggers=[]), "BadRequestTooLarge"),
]  # fmt: skip
UNKNOWN = [
    row("unknown skill", "visitor", GET, lambda s, w: of_version("none", 0), MISSING, "SkillName", MISSING),
    row("unknown version", "visitor", GET, lambda s, w: of_version("plate", 99), MISSING, "Version", MISSING),
    row("unknown skill", "visitor", f"{LIBRARY}/GetDemonstrations", lambda s, w: of_version("none", 0), MISSING, "SkillName", MISSING),
    row("unknown skill", "visitor", TRAJECTORY, lambda s, w: trajectory(SkillName=text("none")), MISSING, "SkillName", MISSING),
    row("unknown recipe", "visitor", TRAJECTORY, lambda s, w: trajectory(RecipeId=text("none")), MISSING, "RecipeId", MISSING),
    row("unknown skill", "teacher", REMOVE, lambda s, w: removing("none", to_server.uint32_array([1])), MISSING, "SkillName", MISSING),
    row("unknown skill", "engineer", APPROVE, lambda s, w: judging("none", 1, w.digest), MISSING, "SkillName", MISSING),
    row("unknown version", "engineer", REJECT, lambda s, w: judging("plate", 99, w.digest), MISSING, "Version", MISSING),
    row("unknown skill", "engineer", DEPLOY, lambda s, w: placing("none", 1, "ws1"), MISSING, "SkillName", MISSING),
    row("unknown workstation", "engineer", DEPLOY, lambda s, w: placing("plate", 1, "none"), MISSING, "Workstation", MISSING),
    row("unknown workstation", "engineer", f"{LIBRARY}/Withdraw", lambda s, w: placing("plate", 1, "none"), MISSING, "Workstation", MISSING),
    row("unknown skill", "engineer", f"{LIBRARY}/Retire", lambda s, w: {**of_version("none", 1), "Comment": text("")}, MISSING, "SkillName", MISSING),
    row("unknown skill", "visitor", f"{LIBRARY}/ExportSkill", lambda s, w: {**of_version("none", 1), "Format": text("json")}, MISSING, "SkillName", MISSING),
    row("unknown recipe", "mes", f"{LIBRARY}/GetRecipe", lambda s, w: {"RecipeId": text("none")}, MISSING, "RecipeId", MISSING),
    row("unknown recipe", "engineer", f"{LIBRARY}/DeleteRecipe", lambda s, w: {"RecipeId": text("none")}, MISSING, "RecipeId", MISSING),
    row("unknown skill", "engineer", PUT, lambda s, w: put(s, w, recipe_id="new", skill_name="none"), MISSING),
    row("unknown job", "visitor", f"{LIBRARY}/GetJob", lambda s, w: {"JobId": text("none")}, MISSING, "JobId", MISSING),
    row("unknown job", "visitor", f"{WS1}/GetJob", lambda s, w: {"JobId": text("none")}, MISSING, "JobId", MISSING),
    row("unknown job", "visitor", f"{WS1}/GetJointTrace", lambda s, w: {"JobId": text("none")}, MISSING, "JobId", MISSING),
    row("unknown job", "visitor", f"{WS1}/GetTrace", lambda s, w: {"JobId": text("none")}, MISSING, "JobId", MISSING),
    row("unknown job", "mes", f"{WS1}/PauseJob", lambda s, w: steering("none"), MISSING, "JobId", MISSING),
    row("unknown job", "mes", f"{WS1}/ResumeJob", lambda s, w: steering("none"), MISSING, "JobId", MISSING),
    row("unknown job", "mes", f"{WS1}/AbortJob", lambda s, w: steering("none"), MISSING, "JobId", MISSING),
    row("unknown skill", "mes", RUN, lambda s, w: running("none", "", 2), MISSING, "SkillName", MISSING),
    row("unknown recipe", "mes", RUN, lambda s, w: running("plate", "none", 2), MISSING, "RecipeId", MISSING),
]  # fmt: skip
STATES = [
    row("approved already", "engineer", APPROVE, lambda s, w: judging("plate", 1, w.digest), STATE),
    row("approved already", "engineer", REJECT, lambda s, w: judging("plate", 1, w.digest), STATE),
    row("no reason", "engineer", APPROVE, lambda s, w: judging("own", 1, w.own_digest), INVALID, "Comment", RANGE),
    row("another digest", "engineer", APPROVE, lambda s, w: judging("plate", 2, w.digest), STATE),
    row("no digest", "engineer", APPROVE, lambda s, w: judging("plate", 2, b""), STATE),
    row("not approved", "engineer", DEPLOY, lambda s, w: placing("plate", 2, "ws1"), STATE),
    row("not deployed there", "engineer", f"{LIBRARY}/Withdraw", lambda s, w: placing("kept", 1, "ws1"), STATE),
    row("deployed", "engineer", f"{LIBRARY}/Retire", lambda s, w: {**of_version("plate", 1), "Comment": text("")}, STATE),
    row("ended", "mes", f"{WS1}/PauseJob", lambda s, w: steering(w.job_id), STATE),
    row("ended", "mes", f"{WS1}/ResumeJob", lambda s, w: steering(w.job_id), STATE),
    row("ended", "mes", f"{WS1}/AbortJob", lambda s, w: steering(w.job_id), STATE),
    row("not deployed, production", "mes", RUN, lambda s, w: running("kept", "", 2), EXECUTABLE),
    row("not approved, test", "engineer", RUN, lambda s, w: running("own", "", 1), EXECUTABLE),
    row("not approved, production", "engineer", RUN, lambda s, w: running("own", "", 2), EXECUTABLE),
    row("equipment lacks Dispense", "engineer", DEPLOY, lambda s, w: placing("plate", 1, "bare"), "BadNotSupported"),
]  # fmt: skip
ROLES = [
    row("an operator", "mes", LEARN, lambda s, w: learning(s, PEOPLE), DENIED),
    row("an operator", "mes", REMOVE, lambda s, w: removing("plate", to_server.uint32_array([1])), DENIED),
    row("an operator", "mes", f"{LIBRARY}/ImportSkill", lambda s, w: {"Content": text("{}"), "Format": text("json")}, DENIED),
    row("a teacher", "teacher", APPROVE, lambda s, w: judging("plate", 2, w.digest), DENIED),
    row("a teacher", "teacher", REJECT, lambda s, w: judging("plate", 2, w.digest), DENIED),
    row("a teacher", "teacher", DEPLOY, lambda s, w: placing("plate", 1, "ws1"), DENIED),
    row("a teacher", "teacher", f"{LIBRARY}/Withdraw", lambda s, w: placing("plate", 1, "ws1"), DENIED),
    row("a teacher", "teacher", f"{LIBRARY}/Retire", lambda s, w: {**of_version("plate", 1), "Comment": text("")}, DENIED),
    row("a teacher", "teacher", PUT, lambda s, w: put(s, w), DENIED),
    row("an operator", "mes", f"{LIBRARY}/DeleteRecipe", lambda s, w: {"RecipeId": text("far")}, DENIED),
    row("an observer", "visitor", f"{LIBRARY}/GetRecipe", lambda s, w: {"RecipeId": text("far")}, DENIED),
    row("an observer", "visitor", RUN, lambda s, w: running("plate", "", 2), DENIED),
    row("an observer", "visitor", f"{WS1}/AbortJob", lambda s, w: steering(w.job_id), DENIED),
    row("an observer", "visitor", f"{WS1}/Arm/ProtectiveStop", lambda s, w: {"Comment": text("")}, DENIED),
    row("an observer, simulation", "visitor", RUN, lambda s, w: running("plate", "", 0), DENIED),
    row("an operator, test", "mes", RUN, lambda s, w: running("plate", "", 1), DENIED),
    row("a teacher, test", "teacher", RUN, lambda s, w: running("plate", "", 1), DENIED),
    row("own version", "engineer-2", APPROVE, lambda s, w: judging("own", 1, w.own_digest), DENIED),
]  # fmt: skip


async def what_is(world: World, session: Session) -> tuple[Any, ...]:
    """Return all that a refusal must not change."""
    counts = await asyncio.to_thread(world.plant.counts)
    return counts, await session.read(f"{WS1}/Arm/Position"), await session.read(f"{WS1}/Arm/AtRest")


@pytest.mark.parametrize("row", ARGUMENTS + VALUES + LIMITS + UNKNOWN + STATES + ROLES, ids=str)
async def test_a_refusal_is_exact_and_changes_nothing(row: Row, world: World, people: dict[str, SkillClient]) -> None:
    session = people[row.user].session
    before = await what_is(world, session)
    with pytest.raises(Refused) as refused:
        await session.call(row.place, row.method, **row.arguments(session, world))
    assert refused.value.status == row.status, refused.value
    if row.argument[0]:
        assert (refused.value.argument, refused.value.argument_status) == row.argument, refused.value
    assert refused.value.reason
    assert "\n" not in refused.value.reason
    assert await what_is(world, session) == before


@pytest.mark.parametrize(
    ("recipe", "failures"),
    [("far", {"NoIkSolution", "WorkspaceLimit", "JointLimit", "Singularity"}), ("fast", {"SpeedLimit"})],
)
async def test_a_motion_that_cannot_be_is_refused_with_failure_and_time_in_the_job(
    recipe: str, failures: set[str], world: World, people: dict[str, SkillClient]
) -> None:
    mes = people["mes"]
    before = await what_is(world, mes.session)
    with pytest.raises(Refused) as refused:
        await mes.workstation("ws1").execute("plate", recipe_id=recipe, mode="production")
    assert refused.value.status == "BadOutOfRange"
    newest = (await mes.workstation("ws1").jobs())[0]
    assert (newest.state, newest.recipe_id) == ("Failed", recipe)
    assert newest.failure in failures
    assert " s" in newest.message, "the time on the path is not told"
    after = await what_is(world, mes.session)
    assert after[1:] == before[1:]
    assert {**after[0], "jobs": before[0]["jobs"]} == before[0]


async def test_an_arm_locked_by_another_client_is_left_alone(world: World, people: dict[str, SkillClient]) -> None:
    owner, other = people["engineer"], people["mes"]
    assert await owner.workstation("ws1").lock("setting up")
    before = await what_is(world, other.session)
    with pytest.raises(Refused) as refused:
        await other.workstation("ws1").execute("plate", mode="production")
    assert refused.value.status == "BadLocked"
    assert await what_is(world, other.session) == before
    assert await owner.workstation("ws1").unlock()


async def test_a_full_queue_takes_no_more(people: dict[str, SkillClient]) -> None:
    mes = people["mes"]
    slow = mes.workstation("slow")
    started: list[str] = []
    try:
        with pytest.raises(Refused) as refused:
            for _ in range(10):
                started.append((await slow.execute("plate", recipe_id="long", mode="production")).job_id)
        assert refused.value.status == "BadResourceUnavailable"
        assert 3 <= len(started) <= 4
    finally:
        for job_id in reversed(started):
            await slow.abort(job_id)
    for job_id in started:
        assert (await mes.follow(job_id, on="slow", limit=60.0)).state == "Aborted"
    assert (await slow.arm()).at_rest


async def test_a_method_of_another_object_is_not_called(world: World, people: dict[str, SkillClient]) -> None:
    session = people["mes"].session
    before = await what_is(world, session)
    for place, method in ((LIBRARY, f"{WS1}/ExecuteSkill"), (WS1, f"{LIBRARY}/GetSkill"), (WS1, f"{WS1}/Nothing")):
        request = ua.CallMethodRequest(session.node(place), session.node(method), [])
        [result] = await session._client.uaclient.session.call([request])
        assert result.StatusCode.name == "BadMethodInvalid"
    assert await what_is(world, session) == before


async def test_a_fault_inside_has_an_id_that_is_found_in_the_log(world: World, people: dict[str, SkillClient]) -> None:
    with contextlib.closing(sqlite3.connect(world.plant.database)) as connection:
        connection.execute("ALTER TABLE traces RENAME TO lost")
        try:
            with pytest.raises(Refused) as refused:
                await people["visitor"].workstation("ws1").trace(world.job_id)
        finally:
            connection.execute("ALTER TABLE lost RENAME TO traces")
    assert refused.value.status == "BadInternalError"
    words = refused.value.reason.replace(",", " ").replace(":", " ").replace(".", " ").split()
    log = world.plant.log()
    assert any(len(word) >= 6 and any(c.isdigit() for c in word) and word in log for word in words), refused.value


async def test_one_bad_demonstration_among_good_ones_is_left_out_with_a_code_of_its_own(
    people: dict[str, SkillClient],
) -> None:
    holes = replace(PEOPLE[1], points=np.full_like(PEOPLE[1].points, NAN))
    learned = await people["teacher"].learn("with-a-hole", [PEOPLE[0], holes, *PEOPLE[2:]], semantic_type="Gluing")
    assert learned.results[1].startswith("Bad")
    assert all(name == "Good" for name in (*learned.results[:1], *learned.results[2:]))


@pytest.mark.parametrize(
    ("trouble", "stored"), [(Trouble.UNREACHABLE, "nothing was stored"), (Trouble.OUTCOME_UNKNOWN, "maybe it is")]
)
async def test_nobody_is_told_that_nothing_was_stored_who_cannot_know(trouble: Trouble, stored: str) -> None:
    @refusing()
    async def method() -> None:
        raise LibraryUnusable("plant", "the connection broke", "look", trouble)

    with pytest.raises(calls.Refused, match=stored):
        await method()
