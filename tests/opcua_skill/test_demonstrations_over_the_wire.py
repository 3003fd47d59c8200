"""What people show, over OPC UA: orientations kept and learned, bad recordings answered exactly, versions compared."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import pytest_asyncio
from asyncua import ua
from scipy.spatial.transform import Rotation

from models.demonstration import Demonstration, Edits, Floats
from models.synthetic import ZIGZAG_IN_SPACE, simulated_people, true_orientations
from opcua_skill.client import LearningOptions, Refused, SkillClient
from opcua_skill.wire import to_server

if TYPE_CHECKING:
    from tests.conftest import Plant

POSED, _ = simulated_people(4, 3, corners=ZIGZAG_IN_SPACE, orientation=True)
PEOPLE, TRUTH = simulated_people(5, 0)
FRAME = np.array([[0.005, 0.005], [0.06, 0.005], [0.06, 0.085], [0.005, 0.085]])
LIBRARY = "SkillLibrary"
SETTINGS = """
[[workstations]]
name = "ws1"
driver = "kinematic"
realtime = false
"""
pytestmark = pytest.mark.asyncio(loop_scope="module")


@dataclass(frozen=True)
class Clients:
    """Who is signed in while the module runs."""

    teacher: SkillClient
    engineer: SkillClient


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def clients(make_plant: Callable[..., "Plant"]) -> AsyncIterator[Clients]:
    """A teacher and an engineer; version 1 of `posed` is learned from people who held the tool."""
    plant = await asyncio.to_thread(make_plant, SETTINGS)
    async with contextlib.AsyncExitStack() as stack:
        signed_in = Clients(
            await stack.enter_async_context(plant.sign_in("teacher")),
            await stack.enter_async_context(plant.sign_in("engineer")),
        )
        job_id, *_ = await call(signed_in.teacher, "posed", [bare(one) for one in POSED])
        assert (await signed_in.teacher.follow(job_id)).state == "Completed"
        yield signed_in


def bare(one: Demonstration, **changes: Any) -> Any:
    """Return a demonstration as any foreign client would make it."""
    fields = {
        "DemonstrationId": one.demonstration_id,
        "Dimension": one.dimension,
        "Times": one.times.tolist(),
        "Positions": one.points.ravel().tolist(),
        "Orientations": [] if one.orientations is None else one.orientations.ravel().tolist(),
    }
    return ua.PoseDemonstrationDataType(**{**fields, **changes})  # type: ignore[attr-defined]


async def call(client: SkillClient, name: str, sent: Sequence[Any]) -> list[Any]:
    """Call LearnFromDemonstration with plain structures and return its outputs."""
    options = ua.LearningOptionsDataType(RejectOutliers=True)  # type: ignore[attr-defined]
    return list(
        await client.session.call(
            LIBRARY,
            "LearnFromDemonstration",
            SkillName=to_server.string(name),
            SemanticType=to_server.string("Gluing"),
            Demonstrations=to_server.structure_array(sent),
            Options=to_server.structure(options),
        )
    )


# The tool's orientation


async def test_what_was_sent_comes_back_bit_for_bit(clients: Clients) -> None:
    kept = await clients.engineer.recordings("posed")
    for sent, back in zip(POSED, kept.raw, strict=True):
        assert sent.orientations is not None
        assert back.orientations is not None
        assert back.orientations.tobytes() == sent.orientations.tobytes()
        assert back.points.tobytes() == sent.points.tobytes()


async def test_the_orientation_is_learned_and_the_path_is_given_as_without_it(clients: Clients) -> None:
    skill = await clients.engineer.skill("posed")
    assert skill.means.shape[1] == 2 + 3 + 4
    phases = np.linspace(0.0, 1.0, 101)
    learned, true = skill.motion().orientations_at(phases), true_orientations(phases)
    away: Floats = (Rotation.from_quat(learned).inv() * Rotation.from_quat(true)).magnitude()
    assert np.degrees(np.sqrt((away**2).mean())) < 2.0
    path = await clients.engineer.path("posed")
    assert path.points.shape[1] == 3
    assert path.covariances.shape[1:] == (3, 3)
    np.testing.assert_array_equal(path.points, skill.motion().as_learned().points)


async def test_a_skill_with_orientation_moves_to_another_library_bit_for_bit(clients: Clients) -> None:
    content = await clients.engineer.export_skill("posed", 1)
    name, version = await clients.teacher.import_skill(content)
    first, second = await clients.engineer.skill("posed", 1), await clients.engineer.skill(name, version)
    assert first.model_digest == second.model_digest
    assert first.means.tobytes() == second.means.tobytes()
    assert first.covariances.tobytes() == second.covariances.tobytes()


async def test_a_recording_without_orientation_among_those_with_it_is_told(clients: Clients) -> None:
    mixed = [replace(POSED[0], orientations=None), *POSED[1:]]
    assert (
        type(to_server.demonstration_out(clients.teacher.session.structure, mixed[0])).__name__
        == "DemonstrationDataType"
    )
    await clients.teacher.learn_to_the_end("mixed", mixed, semantic_type="Gluing")
    skill = await clients.engineer.skill("mixed")
    assert not skill.motion().has_orientation
    assert any("carry no tool orientation" in note for note in skill.report["notes"])
    kept = await clients.engineer.recordings("mixed")
    assert [one.orientations is None for one in kept.raw] == [True, False, False, False]


TURNS = np.asarray(POSED[0].orientations).ravel().tolist()
BAD_TURNS = {
    "too few": (TURNS[:-4], "values of orientation"),
    "three a sample": (TURNS[: 3 * len(POSED[0].times)], "values of orientation"),
    "zero": ([0.0] * len(TURNS), "has length 0"),
    "not of length one": ([2.0 * value for value in TURNS], "has length 2"),
    "NaN": ([float("nan"), *TURNS[1:]], "NaN or infinity"),
    "infinite": ([*TURNS[:-1], float("inf")], "NaN or infinity"),
}


async def test_a_bad_orientation_leaves_that_recording_out(clients: Clients) -> None:
    values, reason = BAD_TURNS["zero"]
    sent = [bare(POSED[0], DemonstrationId="broken", Orientations=values), *(bare(one) for one in POSED[:2])]
    job_id, state, _, results, report = await call(clients.teacher, "one bad", sent)
    assert (await clients.teacher.follow(job_id)).state == "Completed"
    if state == "Completed":
        assert [code.name for code in results] == ["BadOutOfRange", "Good", "Good"]
        assert reason in json.loads(report)["demonstrations"][0]["reason"]


@pytest.mark.parametrize("case", BAD_TURNS)
async def test_bad_orientations_throughout_are_refused(case: str, clients: Clients) -> None:
    values, reason = BAD_TURNS[case]
    sent = [bare(POSED[0], Orientations=values), bare(POSED[0], DemonstrationId="other", Orientations=values)]
    with pytest.raises(Refused) as refused:
        await call(clients.teacher, "never", sent)
    assert refused.value.status == "BadInvalidArgument"
    assert (refused.value.argument, refused.value.argument_status) == ("Demonstrations", "BadOutOfRange")
    assert reason in refused.value.reason


# What cannot be learned from, and what can


def drawn(points: Floats, name: str, duration: float = 5.0) -> Demonstration:
    """Return a demonstration of these points at an even pace."""
    times = np.linspace(0.0, duration, len(points))
    return Demonstration(name, times, np.asarray(points, dtype=float), np.ones(len(points), dtype=bool))


def copies(points: Floats, number: int = 3) -> list[Demonstration]:
    """Return the same drawing several times, trembling a little differently, as hands do."""
    generator = np.random.default_rng(0)
    return [drawn(points + generator.normal(0.0, 2e-4, 2), f"copy-{index}") for index in range(number)]


def shapes(ours: int, theirs: int) -> list[Demonstration]:
    """Return zigzags and frames, so many of each."""
    people, _ = simulated_people(ours, 1)
    others, _ = simulated_people(theirs, 2, corners=FRAME)
    named = [replace(one, demonstration_id=f"zigzag-{index}") for index, one in enumerate(people)]
    return named + [replace(one, demonstration_id=f"frame-{index}") for index, one in enumerate(others)]


def twice(one: Demonstration) -> Demonstration:
    """Return a demonstration in which a time stands still."""
    times = one.times.copy()
    times[50] = times[49]
    return replace(one, times=times)


ANGLE = np.linspace(0.0, 2.0 * np.pi, 400)
CIRCLE = 0.03 * np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])
EIGHT = 0.03 * np.column_stack([np.sin(ANGLE), np.sin(2.0 * ANGLE)])
REFUSED: dict[str, tuple[list[Demonstration], dict[str, Any], str, tuple[str, ...]]] = {
    "one demonstration": (PEOPLE[:1], {}, "Demonstrations", ("2 usable demonstrations are needed, 1 came",)),
    "all still": (copies(np.zeros((100, 2))), {}, "Demonstrations", ("nothing moves further than 1 mm", "record")),
    "two points": (copies(np.array([[0.0, 0.0], [0.1, 0.1]])), {}, "Demonstrations", ("2 samples", "record it again")),
    "times twice, throughout": ([twice(one) for one in PEOPLE], {}, "Demonstrations", ("do not increase at sample",)),
    "millimetres as metres": (
        [replace(one, points=1000.0 * one.points) for one in PEOPLE],
        {},
        "Demonstrations",
        ("m wide", "were millimetres sent?", "Divide them by 1000"),
    ),
    "two shapes, half and half": (shapes(3, 3), {}, "Demonstrations", ("different shapes", "frame-0", "zigzag-0")),
    "one of each shape": (shapes(1, 1), {}, "Demonstrations", ("different shapes", "frame-0", "zigzag-0")),
    "65 components": (PEOPLE, {"components": 65}, "Options", ("components is 65", "between 0 and 64")),
    "a filter of a minute": (PEOPLE, {"filter_window": 60.0}, "Options", ("filter_window is 60 s", "between 0 and 5")),
    "an unknown preset": (PEOPLE, {"preset": "best"}, "Options", ("preset is 'best'", "'free'")),
}


@pytest.mark.parametrize("case", REFUSED)
async def test_what_cannot_be_learned_is_refused_with_what_to_do(case: str, clients: Clients) -> None:
    shown, options, argument, words = REFUSED[case]
    chosen = LearningOptions(**options)
    try:
        learned = await clients.teacher.learn("never", shown, semantic_type="Gluing", options=chosen)
    except Refused as refused:
        assert refused.status == "BadInvalidArgument"
        assert (refused.argument, refused.argument_status) == (argument, "BadOutOfRange")
        reason = refused.reason
    else:
        assert learned.state == "Running", "the server answers late only when it is busy"
        job = await clients.teacher.follow(learned.job_id)
        assert (job.state, job.failure) == ("Failed", "ParameterInvalid")
        reason = job.message
    for word in words:
        assert word in reason
    assert "\n" not in reason


LEARNED: dict[str, tuple[list[Demonstration], dict[str, Any], dict[str, tuple[str, str]]]] = {
    "all identical": ([replace(PEOPLE[0], demonstration_id=str(index)) for index in range(3)], {}, {}),
    "a closed loop": (copies(CIRCLE), {}, {}),
    "a path that crosses itself": (copies(EIGHT), {}, {}),
    "as many components as may be asked for": (PEOPLE, {"components": 64}, {}),
    "times twice, once": (
        [twice(PEOPLE[0]), *PEOPLE[1:]],
        {},
        {PEOPLE[0].demonstration_id: ("BadOutOfRange", "do not increase at sample 50")},
    ),
    "one shape among others": (shapes(4, 1), {}, {"frame-0": ("BadNoMatch", "another shape than the others")}),
    "one in millimetres": (
        [replace(PEOPLE[0], points=1000.0 * PEOPLE[0].points), *PEOPLE[1:]],
        {},
        {PEOPLE[0].demonstration_id: ("BadOutOfRange", "is it in another unit?")},
    ),
    "one from the other end": (
        [replace(PEOPLE[0], points=PEOPLE[0].points[::-1].copy()), *PEOPLE[1:]],
        {},
        {PEOPLE[0].demonstration_id: ("BadNoMatch", "in the opposite direction")},
    ),
    "shown anywhere, at any size": (
        [replace(one, points=(1.0 + 0.1 * i) * one.points + 0.05 * i) for i, one in enumerate(PEOPLE)],
        {"preset": "free"},
        {},
    ),
}


@pytest.mark.parametrize("case", LEARNED)
async def test_what_can_be_learned_is_with_the_code_of_each_demonstration(case: str, clients: Clients) -> None:
    shown, options, faults = LEARNED[case]
    learned = await clients.teacher.learn(case, shown, semantic_type="Gluing", options=LearningOptions(**options))
    job = await clients.teacher.follow(learned.job_id)
    assert job.state == "Completed", job.message
    skill = await clients.engineer.skill(case)
    path = await clients.engineer.path(case)
    assert np.isfinite(path.points).all()
    assert skill.report["preset"] == options.get("preset", "recommended")
    if learned.state == "Completed":
        told = {one["demonstrationId"]: one["reason"] for one in learned.report["demonstrations"]}
        for one, code in zip(shown, learned.results, strict=True):
            wanted, words = faults.get(one.demonstration_id, ("Good", ""))
            assert code == wanted
            assert words in told[one.demonstration_id]


async def test_a_million_points_are_refused_with_the_limit_and_the_client_goes_on(clients: Clients) -> None:
    with pytest.raises(Refused) as refused:
        await clients.teacher.learn("never", [drawn(np.zeros((1_000_000, 2)), "long"), *PEOPLE], semantic_type="Gluing")
    assert refused.value.status == "BadRequestTooLarge"
    assert "1000000 samples, 100000 are allowed" in refused.value.reason
    many = [drawn(np.zeros((90_000, 2)), f"long-{index}") for index in range(10)]
    with pytest.raises(Refused, match="a message of 23 MB, the server takes 17 MB"):
        await clients.teacher.learn("never", many, semantic_type="Gluing")
    assert await clients.teacher.find_skills(name_prefix="never") == []


async def test_the_server_itself_refuses_too_many_points(clients: Clients) -> None:
    points = np.zeros((120_000, 2))
    sent = [bare(drawn(points, "long")), *(bare(one) for one in PEOPLE)]
    with pytest.raises(Refused) as refused:
        await call(clients.teacher, "never", sent)
    assert refused.value.status == "BadRequestTooLarge"
    assert "120000 samples, 100000 are allowed" in refused.value.reason


# What a version tells of the one before


async def test_a_version_is_compared_with_the_one_before_and_with_the_paper_s_preset(clients: Clients) -> None:
    teacher, engineer = clients.teacher, clients.engineer
    first = await teacher.learn("compared", PEOPLE, semantic_type="Gluing")
    await teacher.follow(first.job_id)
    if first.state == "Completed":
        assert first.report["quality"]["paper"]["components"] == 4
        assert first.report["quality"]["previous"] is None
    await teacher.learn_to_the_end("compared", PEOPLE[:3], semantic_type="Gluing")
    second = await engineer.skill("compared")
    assert second.report["previous"]["version"] == 1
    assert 0.0 < second.report["previous"]["distance"]["max"] < 0.01
    job_id, _, _ = await teacher.learn_again("compared", 1, Edits(), comment="as it was")
    assert (await teacher.follow(job_id)).state == "Completed"
    again, one = await engineer.skill("compared"), await engineer.skill("compared", 1)
    assert again.report["previous"]["version"] == 1
    assert again.report["previous"]["distance"]["max"] < 1e-5
    assert again.model_digest == one.model_digest
