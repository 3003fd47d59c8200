"""Four eyes over the whole ancestry: everybody who taught, edited or imported anything a version comes from counts."""

import sqlite3
from collections.abc import Awaitable, Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from sqlalchemy import create_engine

from library.description import SkillDescription
from library.errors import OwnVersion
from library.lifecycle import VersionState
from library.migrations import migrate
from library.names import normal, same_user
from library.store import SkillLibrary

Teach = Callable[..., Awaitable[SkillDescription]]


def digest(described: SkillDescription) -> bytes:
    return bytes.fromhex(described.model_digest)


async def add_users(library: SkillLibrary, *names: str) -> None:
    for name in names:
        await library.add_user(name, "engineer", "hash")


async def approve(library: SkillLibrary, version: SkillDescription, actor: str) -> VersionState:
    return await library.approve(version.name, version.version, digest(version), actor)


async def refused(library: SkillLibrary, version: SkillDescription, *actors: str) -> None:
    for actor in actors:
        with pytest.raises(OwnVersion, match=f"{actor} .*{version.name} version {version.version} and cannot approve"):
            await approve(library, version, actor)


async def test_who_taught_counts_however_many_edits_follow(
    library: SkillLibrary, teach: Teach, make_motion: Any
) -> None:
    steps = [await teach(library, actor="erik")]
    for number, actor in enumerate(("tess", "tom", "tess"), start=1):
        steps.append(await teach(library, actor=actor, based_on=steps[-1].version, motion=make_motion(number)))
    last = steps[-1]
    assert last.contributors == ("erik", "tess", "tom")
    assert (await library.description("glue")).contributors == last.contributors
    await refused(library, last, "erik", "ERIK", "tom", "tess")
    assert await approve(library, last, "vera") is VersionState.APPROVED


async def test_a_version_of_its_own_inherits_nothing(library: SkillLibrary, teach: Teach, make_motion: Any) -> None:
    await teach(library, actor="erik", name="other")
    assert (await teach(library, actor="tess", motion=make_motion(3), brought_by=("tom",))).contributors[-2:] == (
        "tess", "tom",
    )  # fmt: skip


async def test_who_brought_the_same_recordings_first_counts(
    library: SkillLibrary, teach: Teach, make_motion: Any
) -> None:
    await teach(library, actor="erik", name="first")
    await teach(library, actor="paul", name="second")
    assert (await teach(library, actor="tess", motion=make_motion(5))).contributors == ("erik", "tess")


async def test_who_demonstrated_counts_where_that_is_a_user(library: SkillLibrary, teach: Teach) -> None:
    assert "anna" not in (await teach(library, actor="tess")).contributors
    await add_users(library, "Anna")
    again = await teach(library, actor="tess", name="again")
    await refused(library, again, "Anna")


async def test_an_import_of_what_is_here_keeps_the_people_of_here_whatever_names_it_claims(
    library: SkillLibrary, teach: Teach
) -> None:
    await add_users(library, "erik", "tess", "vera")
    stored = await teach(library, actor="erik")
    claims = stored.provenance.model_copy(update={"taught_by": "nobody known"})
    forged = stored.model_copy(update={"provenance": claims, "contributors": (), "name": "renamed"})
    imported = await library.import_version(forged, "tess")
    assert imported.approvals_needed == 1
    await refused(library, imported, "erik", "tess")
    assert await approve(library, imported, "vera") is VersionState.APPROVED


async def test_an_import_by_somebody_unknown_needs_a_third_person(
    library: SkillLibrary, teach: Teach, tmp_path: Path
) -> None:
    stored = await teach(library, actor="somebody elsewhere")
    async with await SkillLibrary.open(tmp_path / "other.db") as other:
        await add_users(other, "tess", "erik", "vera")
        imported = await other.import_version(stored, "tess")
        assert imported.approvals_needed == 2
        await refused(other, imported, "tess", "somebody elsewhere")
        assert await approve(other, imported, "erik") is VersionState.LEARNED
        assert (await other.description("glue")).approval is None
        await refused(other, imported, "erik")
        assert await approve(other, imported, "vera") is VersionState.APPROVED
        approval = (await other.description("glue")).approval
        assert approval is not None
        assert approval.actor == "vera"


async def test_an_import_by_people_who_are_users_here_needs_one_who_is_none_of_them(
    library: SkillLibrary, teach: Teach, tmp_path: Path
) -> None:
    stored = await teach(library, actor="Erik")
    async with await SkillLibrary.open(tmp_path / "other.db") as other:
        await add_users(other, "erik", "tess", "vera")
        imported = await other.import_version(stored, "tess")
        assert (imported.contributors, imported.approvals_needed) == (("Erik", "tess"), 1)
        await refused(other, imported, "erik")
        assert await approve(other, imported, "vera") is VersionState.APPROVED


async def test_contributors_are_guarded_by_the_database(
    library: SkillLibrary, teach: Teach, database_file: Path
) -> None:
    await teach(library)
    with closing(sqlite3.connect(database_file)) as connection:
        for change in ("contributors = '[]'", "approvals_needed = 0"):
            with pytest.raises(sqlite3.IntegrityError, match="never changed"):
                connection.execute(f"UPDATE versions SET {change}")


def test_older_versions_get_their_contributors_along_what_they_are_based_on(tmp_path: Path) -> None:
    file = tmp_path / "old.db"
    with create_engine(f"sqlite:///{file}").begin() as connection:
        migrate(connection, str(file), to="0004")
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute("INSERT INTO skills VALUES ('glue', 'r', '2026-01-01', 'tina')")
        columns = [row[1] for row in connection.execute("PRAGMA table_info(versions)")]
        for version, actor, based in ((1, "erik", "null"), (2, "tess", "1"), (3, "tom", "2"), (4, "vera", "null")):
            row = dict.fromkeys(columns, "0") | {"skill_name": "glue", "version": version, "created_by": actor}
            row |= {"created_at": "2026-01-01 00:00:00.000000"}
            row["provenance"] = f'{{"taught_by": "{actor}", "based_on": {based}}}'
            marks = ", ".join("?" for _ in columns)
            connection.execute(f"INSERT INTO versions VALUES ({marks})", [row[name] for name in columns])
    with create_engine(f"sqlite:///{file}").begin() as connection:
        migrate(connection, str(file), to="0005")
    with closing(sqlite3.connect(file)) as connection:
        found = [row[0] for row in connection.execute("SELECT contributors FROM versions ORDER BY version")]
    assert found == ['["erik"]', '["erik", "tess"]', '["erik", "tess", "tom"]', '["vera"]']


@settings(deadline=None, max_examples=200)
@given(some.text(max_size=20))
def test_a_name_is_the_same_in_every_form_and_case(name: str) -> None:
    import unicodedata

    assert normal(normal(name)) == normal(name)
    assert same_user(same_user(name)) == same_user(name)
    for form in ("NFC", "NFD"):
        assert same_user(unicodedata.normalize(form, name)) == same_user(name)


async def test_a_skill_is_the_same_in_every_form_of_its_name(library: SkillLibrary, teach: Teach) -> None:
    composed, apart = "K\u00fchler", "Ku\u0308hler"
    await teach(library, name=apart)
    again = await teach(library, name=composed)
    assert (again.name, again.version) == (composed, 2)
    assert (await library.description(apart)).version == 2
    assert (await library.recipe(await library.default_recipe_id(apart))).skill_name == composed
