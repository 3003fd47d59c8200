"""Finding skills among thousands: right, in pages, and by index."""

import sqlite3
from collections.abc import AsyncIterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sql
from sqlalchemy.dialects import postgresql
from sqlalchemy.dialects import sqlite as sqlite_dialect

from library.errors import InvalidValue
from library.queries.search import page
from library.store import SkillLibrary

SKILLS = 3000
STATES = ("Learned", "Approved", "Rejected")


@pytest.fixture
async def crowded(database_file: Path, teach: Any) -> AsyncIterator[SkillLibrary]:
    """A library with three thousand skills: one taught, the rest copied row by row."""
    async with await SkillLibrary.open(database_file) as library:
        await teach(library, "seed")
    with sqlite3.connect(database_file) as plain:
        columns = [row[1] for row in plain.execute("PRAGMA table_info(versions)")]
        copied = [name for name in columns if name not in {"skill_name", "version", "semantic_type", "state"}]
        kept = ", ".join(copied)
        for number in range(SKILLS):
            name, kind, state = f"skill-{number:05d}", f"type-{number % 7}", STATES[number % 3]
            plain.execute(
                "INSERT INTO skills SELECT ?, ?, created_at, created_by FROM skills WHERE name='seed'", (name, "x")
            )
            for version in (1, 2) if number % 10 == 0 else (1,):
                plain.execute(
                    f"INSERT INTO versions (skill_name, version, semantic_type, state, {kept}) "
                    f"SELECT ?, ?, ?, ?, {kept} FROM versions WHERE skill_name='seed'",
                    (name, version, kind, state if version == 1 else "Learned"),
                )
            if number % 100 == 0:
                plain.execute(
                    "INSERT INTO deployments VALUES ('ws1', ?, 1, '2026-01-01 00:00:00.000000', 'erik')", (name,)
                )
    plain.close()
    async with await SkillLibrary.open(database_file) as library:
        yield library


async def everything(library: SkillLibrary, limit: int, **filters: str) -> list[tuple[str, int]]:
    found: list[tuple[str, int]] = []
    after = ""
    while True:
        summaries, after = await library.find(after=after, limit=limit, **filters)
        assert len(summaries) <= limit
        found += [(one.name, one.version) for one in summaries]
        if not after:
            return found


async def test_pages_put_together_are_the_whole_in_order_and_once(crowded: SkillLibrary) -> None:
    names = [name for name, _ in await everything(crowded, 700)]
    assert names == ["seed", *(f"skill-{number:05d}" for number in range(SKILLS))]


async def test_filters_find_what_a_plain_walk_finds(crowded: SkillLibrary, database_file: Path) -> None:
    with sqlite3.connect(database_file) as plain:
        rows = plain.execute("SELECT skill_name, version, semantic_type, state FROM versions").fetchall()
        deployed = set(plain.execute("SELECT skill_name, version FROM deployments"))
    plain.close()
    for kind, state, workstation, prefix in product(("", "type-3"), ("", "Approved"), ("", "ws1"), ("", "skill-01")):
        expected: dict[str, int] = {}
        for name, version, its_kind, its_state in rows:
            fits = (
                (not kind or its_kind == kind)
                and (not state or its_state == state)
                and (not workstation or (name, version) in deployed)
                and name.startswith(prefix)
            )
            if fits:
                expected[name] = max(version, expected.get(name, 0))
        filters = {"semantic_type": kind, "state": state, "workstation": workstation, "name_prefix": prefix}
        assert await everything(crowded, 333, **filters) == sorted(expected.items())


async def test_an_approved_version_is_found_under_a_newer_one_that_is_not(crowded: SkillLibrary) -> None:
    summaries, _ = await crowded.find(state="Approved", name_prefix="skill-00010")
    assert [(one.name, one.version, one.state) for one in summaries] == [("skill-00010", 1, "Approved")]
    summaries, _ = await crowded.find(name_prefix="skill-00010")
    assert [(one.name, one.version, one.state) for one in summaries] == [("skill-00010", 2, "Learned")]


FILTERS = [
    {"semantic_type": kind, "state": state, "workstation": workstation, "name_prefix": prefix, "after": after}
    for kind, state, workstation, prefix, after in product(
        ("", "type-3"), ("", "Approved"), ("", "ws1"), ("", "skill-01"), ("", "skill-00999")
    )
]


async def test_every_search_goes_by_index_and_sorts_nothing(crowded: SkillLibrary, database_file: Path) -> None:
    with sqlite3.connect(database_file) as plain:
        for filters in FILTERS:
            query = page(**filters, limit=101)
            text = query.compile(dialect=sqlite_dialect.dialect(), compile_kwargs={"literal_binds": True})
            plan = [row[3] for row in plain.execute(f"EXPLAIN QUERY PLAN {text}")]
            assert all("INDEX" in step for step in plan), (filters, plan)
            assert not any("TEMP B-TREE" in step for step in plan), (filters, plan)
            assert plan[0].startswith("SEARCH") or not any(filters.values()), (filters, plan)
    plain.close()


async def test_a_prefix_of_odd_letters_finds_only_what_begins_with_it(library: SkillLibrary, teach: Any) -> None:
    names = ["a", "a\ud7ff", "a\ue000", "a\U0010ffff", "a\U0010ffffb", "b", "a%", "a_"]
    for name in names:
        await teach(library, name)
    for prefix in ("a", "a\ud7ff", "a\U0010ffff", "\U0010ffff", "a%", "a_", "b"):
        found = [name for name, _ in await everything(library, 3, name_prefix=prefix)]
        assert found == sorted(name for name in names if name.startswith(prefix))


@pytest.mark.parametrize("wrong", [{"state": "approved"}, {"limit": 1001}, {"limit": -1}])
async def test_a_search_that_cannot_be_meant_is_refused(library: SkillLibrary, wrong: dict[str, Any]) -> None:
    with pytest.raises(InvalidValue):
        await library.find(**wrong)


def test_the_same_query_can_be_put_to_postgresql() -> None:
    query = page(semantic_type="x", state="Learned", workstation="ws1", name_prefix="a", after="b", limit=5)
    assert isinstance(query, sql.Select)
    assert "GROUP BY" in str(query.compile(dialect=postgresql.dialect()))
