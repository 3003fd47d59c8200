"""A library is carried whole from one engine to the other and back, or not at all."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sql

from library import copying
from library.copying import copy_library
from library.database import Database
from library.errors import AlreadyExists, LibraryUnusable
from library.records import AuditEntry, JobReport, JobTrace
from library.store import SkillLibrary
from tests.postgres import Cluster


async def filled(where: str, teach: Any) -> None:
    """Make a library with a row in every table, and more than one batch in one of them."""
    async with await SkillLibrary.open(where) as library:
        stored = await teach(library)
        await teach(library, "ünïcode / 中".replace("/", "-"))
        await library.approve("glue", 1, bytes.fromhex(stored.model_digest), "erik", "gut — 很好")
        await library.deploy("glue", 1, "ws1", "erik")
        await library.add_job(JobReport(job_id="j1", kind="Execution"))
        await library.save_trace("j1", JobTrace(np.zeros(2), np.full((2, 1), 0.1), np.zeros((2, 1)), ("x_m",)))
        await library.change_station("ws1", speed_override=0.1)
        await library.add_user("erik", "engineer", "hash", b"\x00\xff")
        for number in range(2 * copying.ROWS + 1):
            await library.audit(AuditEntry(actor="erik", action="Approve", arguments={"n": number}))


async def test_a_library_goes_to_postgresql_and_back_bit_for_bit(
    cluster: Cluster, tmp_path: Path, teach: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(copying, "ROWS", 20)
    first, shared, back = str(tmp_path / "a.db"), cluster.url(await cluster.new_database()), str(tmp_path / "b.db")
    await filled(first, teach)
    there = await copy_library(first, shared)
    again = await copy_library(shared, back)
    assert there == again
    assert (there.rows["audit"], there.rows["versions"], there.rows["traces"]) == (41, 2, 1)
    with closing(sqlite3.connect(first)) as connection:
        connection.execute("ATTACH DATABASE ? AS other", (back,))
        for table in there.rows:
            assert connection.execute(f"SELECT * FROM {table} EXCEPT SELECT * FROM other.{table}").fetchall() == []
    async with await SkillLibrary.open(shared) as library, await SkillLibrary.open(first) as original:
        assert await library.description("glue") == await original.description("glue")
        for one in (library, original):
            assert await one.audit(AuditEntry(actor="erik", action="Next")) == 42, "counting goes on after the last"
            await one.add_job(JobReport(job_id="j2", kind="Execution"))


async def test_a_target_that_holds_something_is_refused_and_left_alone(
    cluster: Cluster, tmp_path: Path, teach: Any
) -> None:
    source, taken = str(tmp_path / "a.db"), cluster.url(await cluster.new_database())
    await filled(source, teach)
    async with await SkillLibrary.open(taken) as library:
        await library.audit(AuditEntry(actor="anna", action="Approve"))
    with pytest.raises(AlreadyExists, match="its audit are not empty, name a new or empty one"):
        await copy_library(source, taken)
    with pytest.raises(AlreadyExists, match="not empty"):
        await copy_library(source, source)
    async with await SkillLibrary.open(taken) as library:
        assert [entry.actor for entry in await library.audit_trail()] == ["anna"]


async def test_nothing_is_copied_from_where_no_library_is(cluster: Cluster, tmp_path: Path) -> None:
    with pytest.raises(LibraryUnusable, match="there is no such file"):
        await copy_library(str(tmp_path / "none.db"), str(tmp_path / "b.db"))
    await cluster.execute("postgres", "CREATE DATABASE without_tables")
    with pytest.raises(LibraryUnusable, match="it has no tables yet"):
        await copy_library(cluster.url("without_tables"), str(tmp_path / "b.db"))
    assert not (tmp_path / "b.db").exists()


@pytest.mark.parametrize("side", ["source", "target"])
async def test_a_copy_that_fails_on_one_side_ends_and_leaves_nothing(
    side: str, cluster: Cluster, tmp_path: Path, teach: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, target = str(tmp_path / "a.db"), cluster.url(await cluster.new_database())
    await filled(source, teach)
    monkeypatch.setattr(copying, "ROWS", 2)
    batches = copying._batches

    def failing(connection: sql.Connection, table: sql.Table) -> Any:
        for count, rows in enumerate(batches(connection, table)):
            if table.name == "audit" and count == 30 and (connection.dialect.name == "sqlite") is (side == "source"):
                raise sqlite3.OperationalError("the disk is gone")
            yield rows

    monkeypatch.setattr(copying, "_batches", failing)
    with pytest.raises(sqlite3.OperationalError, match="the disk is gone"):
        await copy_library(source, target)
    monkeypatch.setattr(copying, "_batches", batches)
    assert (await copy_library(source, target)).rows["audit"] == 2 * 100 + 1


async def test_a_database_that_gives_back_something_else_is_found_out(
    cluster: Cluster, tmp_path: Path, teach: Any
) -> None:
    source, name = str(tmp_path / "a.db"), await cluster.new_database()
    await filled(source, teach)
    function = (
        "CREATE FUNCTION shorten() RETURNS trigger LANGUAGE plpgsql AS "
        "$$ BEGIN NEW.speed_override := NEW.speed_override * 0.999; RETURN NEW; END $$"
    )
    trigger = "CREATE TRIGGER shorten BEFORE INSERT ON stations FOR EACH ROW EXECUTE FUNCTION shorten()"
    await cluster.execute(name, function, trigger)
    with pytest.raises(LibraryUnusable, match="it gave back other than was stored"):
        await copy_library(source, cluster.url(name))
    database = await Database.open(cluster.url(name))
    assert (
        await database.read(lambda connection: connection.exec_driver_sql("SELECT count(*) FROM audit").scalar()) == 0
    )
    await database.close()
