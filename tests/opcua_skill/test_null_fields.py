"""A field that a client leaves null is an empty one: the same answer, whatever the structure; never a fault inside."""

import copy
from collections.abc import AsyncIterator, Callable
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import pytest
import pytest_asyncio
from asyncua import ua
from small_corner import small_corner

from opcua_skill.client import LearningOptions, Refused, SkillClient
from opcua_skill.wire import to_server

if TYPE_CHECKING:
    from tests.conftest import Plant

LIBRARY = "SkillLibrary"
EMPTY = (str, bytes, list)
pytestmark = pytest.mark.asyncio(loop_scope="module")
Make = Callable[[], dict[str, ua.Variant]]


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def engineer(plant: "Plant") -> AsyncIterator[SkillClient]:
    async with plant.sign_in("engineer") as client:
        await client.learn_to_the_end("corner", small_corner(), semantic_type="Gluing")
        yield client


async def calls(client: SkillClient) -> dict[str, tuple[str, Make, Any]]:
    """Return for each structure that a method takes: the method, its arguments, and the structure within them."""
    structure = client.session.structure
    [recipe] = await client.recipes("corner")
    stored = to_server.recipe_out(structure, recipe)
    stored.Parameters = [ua.KeyValuePair(ua.QualifiedName("corner_radius"), ua.Variant(0.001))]
    options = to_server.options_out(structure, LearningOptions())
    shown = [to_server.demonstration_out(structure, one) for one in small_corner()[:3]]
    pose = structure("PoseDemonstrationDataType")(
        **{one.name: getattr(shown[0], one.name) for one in fields(shown[0])}, Orientations=[]
    )
    edit = structure("DemonstrationEditsDataType")(DemonstrationId=small_corner()[0].demonstration_id, Struck=[1])

    def learning(first: Any, chosen: Any) -> dict[str, ua.Variant]:
        return {
            "SkillName": to_server.string("other"),
            "SemanticType": to_server.string("Gluing"),
            "Demonstrations": to_server.structure_array([first, *shown[1:]]),
            "Options": to_server.structure(chosen),
        }

    return {
        "recipe": ("PutRecipe", lambda: {"Recipe": to_server.structure(stored)}, stored),
        "parameter": ("PutRecipe", lambda: {"Recipe": to_server.structure(stored)}, stored.Parameters[0].Key),
        "options": ("LearnFromDemonstration", lambda: learning(shown[0], options), options),
        "demonstration": ("LearnFromDemonstration", lambda: learning(shown[0], options), shown[0]),
        "pose": ("LearnFromDemonstration", lambda: learning(pose, options), pose),
        "edit": ("LearnAgain", lambda: again(edit), edit),
    }


def again(edit: Any) -> dict[str, ua.Variant]:
    return {
        "SkillName": to_server.string("corner"),
        "Version": to_server.uint32(1),
        "Edits": to_server.structure_array([edit]),
        "Comment": to_server.string(""),
    }


async def outcome(client: SkillClient, method: str, arguments: dict[str, ua.Variant]) -> tuple[str, Any]:
    """Return how a call ended and which argument was at fault."""
    try:
        answer = await client.session.call(LIBRARY, method, **arguments)
    except Refused as refused:
        return refused.status, refused.argument
    if method in {"LearnFromDemonstration", "LearnAgain"}:
        await client.follow(answer[0])  # on a slow machine it still runs, and only so many may wait
    return "Good", ""


@pytest.mark.parametrize("name", ["recipe", "parameter", "options", "demonstration", "pose", "edit"])
async def test_a_null_field_is_an_empty_one(engineer: SkillClient, name: str):
    method, make, structure = (await calls(engineer))[name]
    nullable = [one.name for one in fields(structure) if isinstance(getattr(structure, one.name), EMPTY)]
    assert nullable
    kept = copy.copy(structure)
    for names in ([one] for one in nullable):
        told = []
        for null in (False, True):
            for field in names:
                setattr(structure, field, None if null else type(getattr(kept, field))())
            told.append(await outcome(engineer, method, make()))
        assert told[0] == told[1] and told[0][0] != "BadInternalError", (names, told)
        for field in names:
            setattr(structure, field, getattr(kept, field))


@pytest.mark.parametrize("name", ["recipe", "parameter", "options", "demonstration", "pose", "edit"])
async def test_with_every_field_null_there_is_an_answer_of_its_own(engineer: SkillClient, name: str):
    method, make, structure = (await calls(engineer))[name]
    for one in fields(structure):
        if isinstance(getattr(structure, one.name), EMPTY):
            setattr(structure, one.name, None)
    assert (await outcome(engineer, method, make()))[0] in {"Good", "BadInvalidArgument", "BadNotFound"}
