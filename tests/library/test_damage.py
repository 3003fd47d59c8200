"""What is stored and cannot be read back is said to be damaged, by name: never that the caller was wrong."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine

from library.errors import Damaged
from library.migrations import migrate
from library.recipe import Recipe
from library.records import JobReport
from library.store import SkillLibrary

DAMAGE = {
    "recipe that is no JSON": "UPDATE recipes SET content = '{'",
    "recipe out of range": "UPDATE recipes SET content = replace(content, '\"timeStep\":0.008', '\"timeStep\":8')",
    "job": "UPDATE jobs SET report = 'gone'",
    "job in no state": "UPDATE jobs SET state = 'Lost'",
    "means": "UPDATE versions SET means = '[[1.0]]'",
    "covariances that are no JSON": "UPDATE versions SET covariances = ''",
    "recording": "UPDATE recordings SET points = x'00'",
    "aligned": "UPDATE aligned SET points = x'00'",
}


def change(file: Path, statement: str) -> None:
    """Change the file behind the library's back, past its guards, as a failing disk does."""
    with closing(sqlite3.connect(file)) as connection, connection:
        for (guard,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
            connection.execute(f"DROP TRIGGER {guard}")
        assert connection.execute(statement).rowcount > 0


@pytest.mark.parametrize("what", DAMAGE)
async def test_damage_is_named_and_never_the_callers_fault(
    what: str, database_file: Path, library: SkillLibrary, teach: Any
) -> None:
    await teach(library)
    recipe_id = await library.default_recipe_id("glue")
    await library.add_job(JobReport(job_id="j1", kind="Execution"))
    change(database_file, DAMAGE[what])
    kind = what.split()[0]
    ask = {
        "recipe": lambda: library.recipe(recipe_id),
        "job": lambda: library.job("j1"),
        "recording": lambda: library.recordings("glue"),
        "aligned": lambda: library.aligned("glue"),
    }.get(kind, lambda: library.description("glue"))
    with pytest.raises(Damaged, match="restore it from a backup"):
        await ask()
    if kind == "recipe":
        with pytest.raises(Damaged, match=recipe_id):
            await library.recipes("glue")
        await library.put_recipe(Recipe(recipe_id=recipe_id, skill_name="glue"), "erik")
        assert (await library.recipe(recipe_id)).time_step == 0.008


async def test_a_recipe_from_before_its_ranges_is_brought_into_them(tmp_path: Path) -> None:
    file = tmp_path / "old.db"
    with create_engine(f"sqlite:///{file}").begin() as connection:
        migrate(connection, str(file), to="0002")
    content = (
        Recipe(recipe_id="r", skill_name="glue", time_step=0.02).to_json().replace('"timeStep":0.02', '"timeStep":0.1')
    )
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute("INSERT INTO skills VALUES ('glue', 'r', '2026-01-01', 'tina')")
        connection.execute("INSERT INTO recipes VALUES ('r', 'glue', ?, '2026-01-01', 'tina')", (content,))
    async with await SkillLibrary.open(file) as library:
        assert (await library.recipe("r")).time_step == 0.02
