"""Recipes, users and the audit trail."""

import math
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from library.errors import AlreadyExists, InUse, InvalidValue, NotFound
from library.queries.audit import add as add_entry
from library.recipe import Recipe
from library.records import AuditEntry
from library.store import SkillLibrary


async def test_recipes_are_put_changed_listed_and_deleted(library: SkillLibrary, teach: Any) -> None:
    await teach(library)
    await teach(library, name="weld")
    one = Recipe(recipe_id="r1", skill_name="glue", parameters={"pressure": 2.5})
    await library.put_recipe(one, "erik")
    await library.put_recipe(one.model_copy(update={"duration": 9.0}), "erik")
    assert (await library.recipe("r1")).duration == 9.0
    assert [found.recipe_id for found in await library.recipes("glue")] == ["glue-default", "r1"]
    assert [found.recipe_id for found in await library.recipes()] == ["glue-default", "r1", "weld-default"]
    await library.delete_recipe("r1", "erik")
    with pytest.raises(NotFound):
        await library.recipe("r1")
    with pytest.raises(NotFound):
        await library.delete_recipe("r1", "erik")
    with pytest.raises(NotFound):
        await library.recipes("paint")


async def test_a_recipe_belongs_to_a_skill_that_exists_and_keeps_to_its_parameters(
    library: SkillLibrary, teach: Any
) -> None:
    await teach(library)
    await teach(library, name="weld")
    for recipe, error in (
        (Recipe(recipe_id="r1", skill_name="paint"), NotFound),
        (Recipe(recipe_id="r1", skill_name="glue", skill_version=2), NotFound),
        (Recipe(recipe_id="r1", skill_name="glue", parameters={"colour": "red"}), InvalidValue),
        (Recipe(recipe_id="r1", skill_name="glue", parameters={"pressure": 7.0}), InvalidValue),
        (Recipe(recipe_id="r1", skill_name="glue", parameters={"pressure": "high"}), InvalidValue),
        (Recipe(recipe_id="weld-default", skill_name="glue"), AlreadyExists),
    ):
        with pytest.raises(error):
            await library.put_recipe(recipe, "erik")
    assert [found.recipe_id for found in await library.recipes()] == ["glue-default", "weld-default"]


async def test_a_default_recipe_may_be_changed_but_not_deleted(library: SkillLibrary, teach: Any) -> None:
    await teach(library)
    await library.put_recipe(Recipe(recipe_id="glue-default", skill_name="glue", time_step=0.02), "erik")
    assert (await library.recipe("glue-default")).time_step == 0.02
    with pytest.raises(InUse, match="as the default of glue"):
        await library.delete_recipe("glue-default", "erik")


async def test_users_are_added_found_and_removed(library: SkillLibrary) -> None:
    await library.add_user("erik", "engineer", "$argon2id$x", actor="root")
    await library.add_user("mes", "operator", certificate=b"\x30\x82\x00\x01")
    assert [user.name for user in await library.users()] == ["erik", "mes"]
    mes = await library.user("mes")
    assert (mes.role, mes.password_hash, mes.certificate) == ("operator", "", b"\x30\x82\x00\x01")
    await library.set_password_hash("erik", "$argon2id$y")
    assert (await library.user("erik")).password_hash == "$argon2id$y"
    with pytest.raises(AlreadyExists):
        await library.add_user("erik", "observer")
    await library.remove_user("erik")
    for ask in (library.user("erik"), library.remove_user("erik"), library.set_password_hash("erik", "")):
        with pytest.raises(NotFound):
            await ask
    with pytest.raises(InvalidValue):
        await library.add_user("er/ik", "observer")


async def test_of_a_list_of_users_all_are_added_with_their_entries_or_none(library: SkillLibrary) -> None:
    entries = [AuditEntry(actor="root", action="AddUser", target=name) for name in ("ada", "bo")]
    rows = [("ada", "engineer", "$argon2id$x"), ("bo", "operator", "$argon2id$y")]
    with pytest.raises(AlreadyExists):
        await library.add_users([*rows, ("ADA", "observer", "$argon2id$z")], "root", entries)
    assert (await library.users(), await library.audit_trail(9)) == ([], [])
    await library.add_users(rows, "root", entries)
    assert [(user.name, user.created_by) for user in await library.users()] == [("ada", "root"), ("bo", "root")]
    assert [entry.target for entry in await library.audit_trail(9)] == ["bo", "ada"]


async def test_the_audit_trail_is_read_backwards_in_pages(library: SkillLibrary) -> None:
    ids = [await library.audit(AuditEntry(actor="erik", action=f"step {number}")) for number in range(7)]
    assert ids == sorted(ids)
    newest = await library.audit_trail(3)
    assert [entry.action for entry in newest] == ["step 6", "step 5", "step 4"]
    rest = await library.audit_trail(100, before=newest[-1].entry_id)
    assert [entry.action for entry in rest] == ["step 3", "step 2", "step 1", "step 0"]
    with pytest.raises(InvalidValue):
        await library.audit_trail(1001)


async def test_an_audit_entry_comes_back_as_it_was_given(library: SkillLibrary) -> None:
    entry = AuditEntry(
        actor="erik",
        role="engineer",
        action="Approve",
        target="SkillLibrary",
        arguments={"SkillName": "glue", "Version": 3, "Comment": "good", "Flag": True, "None": None},
        status="Good",
        reason="",
        at=datetime(2026, 5, 4, 3, 2, 1, 987654, tzinfo=UTC),
    )
    entry_id = await library.audit(entry)
    assert await library.audit_trail() == [replace(entry, entry_id=entry_id)]


async def test_what_was_sent_to_break_things_is_recorded_all_the_same(library: SkillLibrary) -> None:
    await library.audit(
        AuditEntry(
            actor="x\x00y",
            reason="\ud800" * 10_000,
            arguments={
                "nan": math.nan,
                "inf": -math.inf,
                "text": "\x00\udfff",
                "bytes": b"\x00\xff",
                "when": datetime(2026, 1, 1, tzinfo=UTC),
                "long": list(range(100_000)),
                "array": np.zeros(3),
                "deep": {"k\x00": [{"v": object}]},
                "\ud800": 1,
            },
        )
    )
    (entry,) = await library.audit_trail()
    assert entry.actor == "x\\u0000y"
    assert len(entry.reason) <= 4000
    assert entry.arguments["nan"] == "nan"
    assert entry.arguments["bytes"] == "00ff"
    assert entry.arguments["long"][-1] == "… 100000 in all"
    assert entry.arguments["\\ud800"] == 1


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.binary() | st.text(st.characters()),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(st.characters()), inner),
    max_leaves=20,
)


@given(arguments=st.dictionaries(st.text(st.characters()), anything), text=st.text(st.characters()))
@settings(deadline=None)
def test_any_arguments_can_be_written_down(arguments: dict[str, Any], text: str) -> None:
    import sqlalchemy as sql

    from library.tables import audit, metadata

    engine = sql.create_engine("sqlite://")
    with engine.begin() as connection:
        metadata.create_all(connection, tables=[audit])
        add_entry(connection, AuditEntry(actor=text, arguments=arguments))
        assert connection.scalar(sql.select(sql.func.count()).select_from(audit)) == 1
    engine.dispose()
