"""The file: made, brought up to date, guarded, and readable with nothing but sqlite3."""

import json
import sqlite3
import stat
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sql
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

from library import migrations, tables
from library.database import Database
from library.errors import LibraryError, LibraryUnusable
from library.migrations import known_revisions, migrate
from library.records import AuditEntry, JobReport, JobTrace
from library.store import SkillLibrary


@contextmanager
def plain(path: Path) -> Iterator[sqlite3.Connection]:
    with closing(sqlite3.connect(path)) as connection, connection:
        yield connection


def schema(path: Path) -> list[tuple[str, ...]]:
    with plain(path) as connection:
        return connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_master ORDER BY 1, 2").fetchall()


async def test_opening_makes_folder_file_and_tables(tmp_path: Path) -> None:
    path = tmp_path / "a folder" / "with % and ä" / "library.sqlite"
    async with await SkillLibrary.open(path) as library:
        assert (await library.find())[0] == []
    with plain(path) as connection:
        names = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type='table'")}
    assert set(tables.metadata.tables) <= names


async def test_only_the_owner_may_read_the_file(database_file: Path, library: SkillLibrary, teach: Any) -> None:
    await teach(library)
    for file in database_file.parent.iterdir():
        assert stat.S_IMODE(file.stat().st_mode) == 0o600, file


async def test_opening_again_changes_nothing(database_file: Path, teach: Any) -> None:
    async with await SkillLibrary.open(database_file) as library:
        before = await teach(library)
    shape = schema(database_file)
    async with await SkillLibrary.open(f"sqlite:///{database_file}") as library:
        assert await library.description("glue") == before
    assert schema(database_file) == shape


async def test_an_older_file_is_brought_up_to_date_with_all_that_is_in_it(
    tmp_path: Path, database_file: Path, teach: Any
) -> None:
    old = tmp_path / "old.sqlite"
    engine = sql.create_engine(f"sqlite:///{old}")
    with engine.begin() as connection:
        migrate(connection, str(old), to="0001")
    engine.dispose()
    async with await SkillLibrary.open(database_file) as library:
        before = await teach(library)
    with plain(old) as connection:
        connection.execute("ATTACH DATABASE ? AS new", (str(database_file),))
        for table in tables.metadata.sorted_tables:
            there = ", ".join(f'"{row[1]}"' for row in connection.execute(f"PRAGMA main.table_info({table.name})"))
            if there:
                connection.execute(f"INSERT INTO {table.name} ({there}) SELECT {there} FROM new.{table.name}")
    assert not any(row[0] == "trigger" for row in schema(old))
    async with await SkillLibrary.open(old) as library:
        assert await library.description("glue") == before
        assert len(await library.recordings("glue")) == 2
    assert schema(old) == schema(database_file)


async def test_the_migrations_end_at_the_tables_the_code_knows(database_file: Path, library: SkillLibrary) -> None:
    engine = sql.create_engine(f"sqlite:///{database_file}")
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, tables.metadata) == []
    engine.dispose()


async def test_a_file_of_a_newer_program_is_left_alone(database_file: Path) -> None:
    async with await SkillLibrary.open(database_file):
        pass
    with plain(database_file) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    with pytest.raises(LibraryUnusable, match="a newer version of this program wrote it"):
        await SkillLibrary.open(database_file)


async def test_the_database_of_another_program_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "browser.sqlite"
    with plain(path) as connection:
        connection.execute("CREATE TABLE bookmarks (url TEXT)")
    with pytest.raises(LibraryUnusable, match="another program"):
        await SkillLibrary.open(path)
    assert [row[1] for row in schema(path)] == ["bookmarks"]


async def test_a_file_that_is_no_database_is_refused_in_words(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a database, but long enough to look at " * 50)
    with pytest.raises(LibraryUnusable, match=r"not a database.*backup"):
        await SkillLibrary.open(path)
    with pytest.raises(LibraryUnusable, match="folder"):
        await SkillLibrary.open(tmp_path)
    with pytest.raises(LibraryUnusable, match="driver"):
        await SkillLibrary.open("oracle://nowhere/none")


async def test_every_connection_is_set_to_survive_power_cuts(database_file: Path) -> None:
    database = await Database.open(database_file)

    def settings(connection: sql.Connection) -> list[Any]:
        wanted = ("journal_mode", "synchronous", "foreign_keys", "busy_timeout")
        return [connection.exec_driver_sql(f"PRAGMA {name}").scalar() for name in wanted]

    for _ in range(3):
        assert await database.read(settings) == ["wal", 2, 1, 30000]
        assert await database.write(settings) == ["wal", 2, 1, 30000]
    await database.close()


async def test_a_transaction_that_fails_leaves_nothing(database_file: Path) -> None:
    database = await Database.open(database_file)

    def half(connection: sql.Connection) -> None:
        connection.exec_driver_sql(
            "INSERT INTO users VALUES ('a', 'observer', '', x'', '2026-01-01 00:00:00.000000', '')"
        )
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        await database.write(half)
    count = await database.read(lambda connection: connection.exec_driver_sql("SELECT count(*) FROM users").scalar())
    assert count == 0
    await database.close()


async def test_plain_sqlite3_shows_means_and_covariances(
    database_file: Path, library: SkillLibrary, teach: Any, make_motion: Any
) -> None:
    motion = make_motion(3)
    await teach(library, motion=motion)
    with plain(database_file) as connection:
        means, covariances = connection.execute("SELECT means, covariances FROM versions").fetchone()
    assert np.array(json.loads(means)).tobytes() == motion.means.tobytes()
    assert np.array(json.loads(covariances)).tobytes() == motion.covariances.tobytes()


async def test_there_are_no_priors_anywhere(database_file: Path, library: SkillLibrary, teach: Any) -> None:
    stored = await teach(library)
    words = ("prior", "weight", "mixing")
    for row in schema(database_file):
        assert not any(word in str(row).lower() for word in words), row
    with plain(database_file) as connection:
        for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type='table'").fetchall():
            content = str(connection.execute(f"SELECT * FROM {name}").fetchall()).lower()
            assert not any(word in content for word in words), name
    assert not any(word in stored.to_json().lower() for word in words)


FORBIDDEN = [
    "UPDATE versions SET means = '[]'",
    "UPDATE versions SET covariances = '[]'",
    "UPDATE versions SET model_digest = 'x'",
    "UPDATE versions SET semantic_type = 'x'",
    "UPDATE versions SET report = '{}'",
    "UPDATE versions SET created_by = 'x'",
    "UPDATE versions SET version = 7",
    "DELETE FROM versions",
    "INSERT OR REPLACE INTO versions SELECT * FROM versions",
    "UPDATE recordings SET points = x''",
    "DELETE FROM recordings",
    "INSERT OR REPLACE INTO recordings SELECT * FROM recordings",
    "UPDATE aligned SET points = x''",
    "DELETE FROM aligned",
    "DELETE FROM version_recordings",
    "UPDATE decisions SET actor = 'x'",
    "DELETE FROM decisions",
    "UPDATE traces SET measured = x''",
    "DELETE FROM traces",
    "UPDATE audit SET actor = 'nobody'",
    "DELETE FROM audit",
    "DELETE FROM audit WHERE entry_id = 1",
    "INSERT OR REPLACE INTO audit SELECT entry_id, at, 'nobody', role, action, target, arguments, '', '' FROM audit",
]


async def test_what_is_never_changed_is_guarded_by_the_database_itself(
    database_file: Path, library: SkillLibrary, teach: Any
) -> None:
    stored = await teach(library)
    await library.approve("glue", 1, bytes.fromhex(stored.model_digest), "erik")
    await library.audit(AuditEntry(actor="erik", action="Approve"))
    await library.add_job(JobReport(job_id="j1", kind="Execution"))
    await library.save_trace("j1", JobTrace(np.zeros(2), np.zeros((2, 1)), np.zeros((2, 1)), ("x_m",)))
    for statement in FORBIDDEN:
        with plain(database_file) as connection, pytest.raises(sqlite3.IntegrityError, match="never"):
            connection.execute(statement)
    assert (await library.description("glue")).model_digest == stored.model_digest
    assert [entry.actor for entry in await library.audit_trail()] == ["erik"]


def test_every_column_of_a_version_but_its_state_is_guarded() -> None:
    folder = Path(migrations.__file__).parent / "versions"
    text = "".join((folder / name).read_text() for name in ("0002_never_changed.py", "0005_contributors.py"))
    for column in tables.versions.columns:
        assert (f'"{column.name}"' in text) == (column.name != "state"), column.name


async def test_a_reader_is_not_stopped_by_a_writer(database_file: Path, library: SkillLibrary, teach: Any) -> None:
    await teach(library)
    with closing(sqlite3.connect(database_file, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        other.execute("UPDATE skills SET created_by = 'x'")
        assert (await library.description("glue")).version == 1
        other.execute("ROLLBACK")


async def test_a_full_disk_is_said_in_words_and_nothing_is_half_stored(
    database_file: Path, library: SkillLibrary, teach: Any, make_demonstration: Any
) -> None:
    await teach(library)

    def no_more_room(connection: sql.Connection) -> None:
        pages = connection.exec_driver_sql("PRAGMA page_count").scalar()
        connection.exec_driver_sql(f"PRAGMA max_page_count = {pages}")

    for _ in range(8):
        await library._database.write(no_more_room)
    big = [make_demonstration(f"b{number}", samples=5000) for number in range(8)]
    with pytest.raises(LibraryError, match="free space on its disk"):
        await teach(library, recordings=big)
    assert [one.version for one in await library.versions("glue")] == [1]
    with plain(database_file) as connection:
        assert connection.execute("SELECT count(*) FROM recordings").fetchone() == (2,)


def test_the_revisions_are_those_that_alembic_knows() -> None:
    folder = Path(migrations.__file__).parent
    scripts = ScriptDirectory(str(folder))
    assert {script.revision for script in scripts.walk_revisions()} == known_revisions()
    assert scripts.get_current_head() == max(known_revisions())
