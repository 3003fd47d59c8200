"""The tool's orientation over OPC UA: sent, checked, kept bit for bit, learned, given back, sent on."""

import contextlib
import json
from collections.abc import AsyncIterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import pytest_asyncio
from asyncua import ua
from scipy.spatial.transform import Rotation

from models.demonstration import Demonstration, Floats
from models.people import ZIGZAG_IN_SPACE, simulated_people, true_orientations
from opcua_skill.client import LearningOptions, Refused, SkillClient, wire

if TYPE_CHECKING:
    from tests.conftest import Plant

PEOPLE, TRUTH = simulated_people(5, 3, corners=ZIGZAG_IN_SPACE, orientation=True)
FLAT, _ = simulated_people(3, 4, orientation=True)
LIBRARY = "SkillLibrary"
pytestmark = pytest.mark.asyncio(loop_scope="module")


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def clients(plant: "Plant") -> AsyncIterator[tuple[SkillClient, SkillClient]]:
    """A teacher and an engineer, signed in once."""
    async with contextlib.AsyncExitStack() as stack:
        yield (
            await stack.enter_async_context(plant.sign_in("teacher")),
            await stack.enter_async_context(plant.sign_in("engineer")),
        )


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


async def call(client: SkillClient, name: str, sent: list[Any], preset: str = "") -> list[Any]:
    """Call LearnFromDemonstration with plain structures and return its outputs."""
    options = ua.LearningOptionsDataType(Preset=preset, RejectOutliers=True)  # type: ignore[attr-defined]
    return list(
        await client.session.call(
            LIBRARY,
            "LearnFromDemonstration",
            SkillName=wire.string(name),
            SemanticType=wire.string("Gluing"),
            Demonstrations=wire.structure_array(sent),
            Options=wire.structure(options),
        )
    )


def angle(one: Floats, other: Floats) -> Floats:
    """Return the angle in radians between orientations (n, 4)."""
    return np.asarray((Rotation.from_quat(one).inv() * Rotation.from_quat(other)).magnitude())


async def test_orientation_is_learned_and_everything_comes_back(clients: tuple[SkillClient, SkillClient]) -> None:
    teacher, engineer = clients
    job_id, *_ = await call(teacher, "posed", [bare(one) for one in PEOPLE])
    assert (await teacher.follow(job_id)).state == "Completed"
    kept = await engineer.recordings("posed")
    for sent, back in zip(PEOPLE, kept.raw, strict=True):
        assert back.orientations is not None
        assert back.orientations.tobytes() == sent.orientations.tobytes()
        assert back.points.tobytes() == sent.points.tobytes()
    skill = await engineer.skill("posed")
    assert skill.means.shape[1] == 2 + 3 + 4
    motion = skill.motion()
    assert motion.has_orientation
    phases = np.linspace(0.0, 1.0, 101)
    away = angle(motion.orientations_at(phases), true_orientations(phases))
    assert np.degrees(np.sqrt((away**2).mean())) < 2.0


async def test_a_skill_with_orientation_moves_to_another_library_bit_for_bit(
    clients: tuple[SkillClient, SkillClient],
) -> None:
    teacher, engineer = clients
    await teacher.learn_to_the_end("sent on", PEOPLE, semantic_type="Gluing")
    content = await engineer.export_skill("sent on")
    assert (await teacher.import_skill(content))[1] == 2
    first, second = await engineer.skill("sent on", 1), await engineer.skill("sent on", 2)
    assert first.model_digest == second.model_digest
    assert first.means.tobytes() == second.means.tobytes()
    assert first.covariances.tobytes() == second.covariances.tobytes()
    phases = np.linspace(0.0, 1.0, 50)
    np.testing.assert_array_equal(first.motion().orientations_at(phases), second.motion().orientations_at(phases))


async def test_the_path_of_a_skill_with_orientation_is_given_as_before(
    clients: tuple[SkillClient, SkillClient],
) -> None:
    teacher, engineer = clients
    await teacher.learn_to_the_end("shown", PEOPLE, semantic_type="Gluing")
    path = await engineer.path("shown")
    assert path.points.shape[1] == 3
    assert path.covariances.shape[1:] == (3, 3)


async def test_in_the_plane_too(clients: tuple[SkillClient, SkillClient]) -> None:
    teacher, engineer = clients
    await teacher.learn_to_the_end("in the plane", FLAT, semantic_type="Gluing")
    skill = await engineer.skill("in the plane")
    assert skill.means.shape[1] == 2 + 2 + 4
    assert skill.motion().has_orientation


async def test_a_recording_without_orientation_among_those_with_it_is_told(
    clients: tuple[SkillClient, SkillClient],
) -> None:
    teacher, engineer = clients
    mixed = [replace(PEOPLE[0], orientations=None), *PEOPLE[1:]]
    await teacher.learn_to_the_end("mixed", mixed, semantic_type="Gluing")
    skill = await engineer.skill("mixed")
    assert not skill.motion().has_orientation
    assert any("carry no tool orientation" in note for note in skill.report["notes"])
    kept = await engineer.recordings("mixed")
    assert [one.orientations is None for one in kept.raw] == [True, False, False, False, False]


def broken(**changes: Any) -> Any:
    return bare(replace(PEOPLE[0], demonstration_id="broken"), **changes)


TURNS = PEOPLE[0].orientations.ravel().tolist()
BAD = {
    "too few": (TURNS[:-4], "values of orientation"),
    "three a sample": (TURNS[: 3 * len(PEOPLE[0].times)], "values of orientation"),
    "zero": ([0.0] * len(TURNS), "has length 0"),
    "not of length one": ([2.0 * value for value in TURNS], "has length 2"),
    "NaN": ([float("nan"), *TURNS[1:]], "NaN or infinity"),
    "infinite": ([*TURNS[:-1], float("inf")], "NaN or infinity"),
}


@pytest.mark.parametrize("case", BAD)
async def test_a_bad_orientation_leaves_that_recording_out(case: str, clients: tuple[SkillClient, SkillClient]) -> None:
    values, reason = BAD[case]
    sent = [broken(Orientations=values), *(bare(one) for one in PEOPLE[:3])]
    job_id, state, _, results, report = await call(clients[0], f"one bad: {case}", sent)
    assert (await clients[0].follow(job_id)).state == "Completed"
    if state == "Completed":
        assert [code.name for code in results] == ["BadOutOfRange", "Good", "Good", "Good"]
        assert reason in json.loads(report)["demonstrations"][0]["reason"]


@pytest.mark.parametrize("case", BAD)
async def test_bad_orientations_throughout_are_refused(case: str, clients: tuple[SkillClient, SkillClient]) -> None:
    values, reason = BAD[case]
    sent = [broken(Orientations=values), broken(DemonstrationId="other", Orientations=values)]
    with pytest.raises(Refused) as refused:
        await call(clients[0], "never", sent)
    assert refused.value.status == "BadInvalidArgument"
    assert (refused.value.argument, refused.value.argument_status) == ("Demonstrations", "BadOutOfRange")
    assert reason in refused.value.reason


async def test_poses_and_plain_demonstrations_may_be_mixed_in_one_call(
    clients: tuple[SkillClient, SkillClient],
) -> None:
    plain = wire.demonstration_out(clients[0].session.structure, replace(PEOPLE[0], orientations=None))
    assert type(plain).__name__ == "DemonstrationDataType"
    job_id, *_ = await call(clients[0], "both kinds", [plain, *(bare(one) for one in PEOPLE[1:3])])
    assert (await clients[0].follow(job_id)).state == "Completed"


async def test_shown_anywhere_at_any_size_is_one_shape_with_the_preset_free(
    clients: tuple[SkillClient, SkillClient],
) -> None:
    teacher, engineer = clients
    spread = []
    for index, one in enumerate(FLAT + simulated_people(6, 5)[0][3:]):
        turn = np.radians(25.0 * index)
        moved = one.points @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        spread.append(
            replace(
                one,
                demonstration_id=f"free-{index}",
                points=(1.0 + 0.1 * index) * moved + [0.05 * index, -0.03 * index],
                orientations=None,
            )
        )
    report = await teacher.learn_to_the_end(
        "anywhere", spread, semantic_type="Gluing", options=LearningOptions(preset="free")
    )
    assert report.state == "Completed", report.message
    found = await engineer.skill("anywhere")
    assert found.report["preset"] == "free"
    assert found.report["components"] == 4
    assert max(found.report["repeatability"]["deviation"]) < 0.01
