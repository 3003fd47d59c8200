"""What is particular to PostgreSQL: who may do what, what is said when it cannot be used, and writers that meet."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest
import sqlalchemy as sql
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext

from library import tables
from library.errors import LibraryError, LibraryUnusable, NotAllowedInState, ServedElsewhere, Trouble
from library.postgresql.transactions import WRITERS_LOCK
from library.preparing import prepare
from library.queries import audit as audit_rows
from library.queries.leases import Server
from library.queries.news import News
from library.records import AuditEntry, JobReport, JobTrace
from library.store import SkillLibrary
from library.turns import waiting_at_most
from tests.library.test_database import FORBIDDEN as FORBIDDEN_IN_SQLITE
from tests.postgres import OWNER, SECRET, SERVER, SUPERUSER, Cluster

FORBIDDEN = [
    *(statement.replace("x''", "''::bytea") for statement in FORBIDDEN_IN_SQLITE if "REPLACE" not in statement),
    "TRUNCATE audit",
    "TRUNCATE recordings CASCADE",
    "INSERT INTO versions SELECT * FROM versions ON CONFLICT (skill_name, version) DO UPDATE SET means = ''",
]
DISARMING = [
    "DROP TABLE audit CASCADE",
    "DROP TRIGGER audit_no_delete ON audit",
    "ALTER TABLE audit DISABLE TRIGGER ALL",
    "DROP FUNCTION audit_no_delete() CASCADE",
    "CREATE OR REPLACE FUNCTION audit_no_delete() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN RETURN NULL; END $$",
    "SET session_replication_role = replica",
    "UPDATE alembic_version SET version_num = '0001'",
    f"SET ROLE {OWNER}",
]


@pytest.fixture
async def database(cluster: Cluster) -> str:
    """A database of this test's own, prepared."""
    return await cluster.new_database()


@pytest.fixture
async def shared(cluster: Cluster, database: str) -> AsyncIterator[SkillLibrary]:
    """A library in it, open under the role of a server."""
    async with await SkillLibrary.open(cluster.url(database)) as opened:
        yield opened


async def fill(library: SkillLibrary, teach: Any) -> None:
    """Store a row wherever rows are never changed."""
    import numpy as np

    stored = await teach(library)
    await library.approve("glue", 1, bytes.fromhex(stored.model_digest), "erik")
    await library.audit(AuditEntry(actor="erik", action="Approve"))
    await library.add_job(JobReport(job_id="j1", kind="Execution"))
    await library.save_trace("j1", JobTrace(np.zeros(2), np.zeros((2, 1)), np.zeros((2, 1)), ("x_m",)))


async def test_a_server_s_role_cannot_change_what_is_never_changed_nor_disarm_what_guards_it(
    cluster: Cluster, database: str, shared: SkillLibrary, teach: Any
) -> None:
    import asyncpg

    await fill(shared, teach)
    for statement in FORBIDDEN + DISARMING:
        with pytest.raises(asyncpg.PostgresError, match=r"denied|must be|never"):
            await cluster.execute(database, statement, role=SERVER)
    assert [entry.actor for entry in await shared.audit_trail()] == ["erik"]
    assert await shared.weakness() == ""


async def test_the_triggers_hold_against_the_owner_too(
    cluster: Cluster, database: str, shared: SkillLibrary, teach: Any
) -> None:
    import asyncpg

    await fill(shared, teach)
    for statement in FORBIDDEN:
        with pytest.raises(asyncpg.PostgresError, match="never"):
            await cluster.execute(database, statement, role=OWNER)


async def test_a_role_that_owns_the_tables_is_told_of(cluster: Cluster, database: str) -> None:
    for role in (OWNER, SUPERUSER):
        async with await SkillLibrary.open(cluster.url(database, role)) as library:
            assert await library.weakness() == (
                f"the database role {role} owns the library's tables and can drop what guards them"
            )


async def test_the_migrations_end_at_the_tables_the_code_knows(shared: SkillLibrary) -> None:
    def differences(connection: sql.Connection) -> list[Any]:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        return compare_metadata(context, tables.metadata)

    assert await shared._database.read(differences) == []


async def test_an_older_library_is_brought_up_to_date_by_its_owner_alone(cluster: Cluster) -> None:
    name = "an_older_one"
    await cluster.execute("postgres", f"CREATE DATABASE {name} OWNER {OWNER}")
    with pytest.raises(LibraryUnusable, match=r"it has no tables yet: .*opcua-skill library prepare"):
        await SkillLibrary.open(cluster.url(name))
    await prepare(cluster.url(name, OWNER), SERVER)
    await prepare(cluster.url(name, OWNER), SERVER)
    async with await SkillLibrary.open(cluster.url(name)) as library:
        await library.audit(AuditEntry(actor="erik", action="Approve"))
    set_to = "UPDATE alembic_version SET version_num = "
    await cluster.execute(
        name, "DROP TABLE stations, job_orders, leases", "ALTER TABLE jobs DROP server", set_to + "'0003'"
    )
    await cluster.execute(name, "DROP TRIGGER versions_no_update_of_people ON versions")
    await cluster.execute(name, "ALTER TABLE versions DROP contributors, DROP approvals_needed")
    with pytest.raises(LibraryUnusable, match=r"an older version \(revision 0003\): have the owner .* prepare"):
        await SkillLibrary.open(cluster.url(name))
    await prepare(cluster.url(name, OWNER), SERVER)
    async with await SkillLibrary.open(cluster.url(name)) as library:
        assert (await library.station("cell-1")).workstation == "cell-1"
        assert len(await library.audit_trail()) == 1
    await cluster.execute(name, set_to + "'9999'")
    with pytest.raises(LibraryUnusable, match=r"a newer version of this program wrote it \(revision 9999\)"):
        await SkillLibrary.open(cluster.url(name))


async def test_only_a_role_that_cannot_drop_the_guards_is_prepared_for(cluster: Cluster, database: str) -> None:
    owner = cluster.url(database, OWNER)
    for role, why in (("nobody", "there is no role nobody"), (SUPERUSER, "can drop"), (OWNER, "can drop")):
        with pytest.raises(LibraryUnusable, match=why):
            await prepare(owner, role)
    with pytest.raises(LibraryUnusable, match="needs no preparing"):
        await prepare("sqlite:///x.db", SERVER)


async def test_what_is_wrong_with_an_address_is_one_clear_sentence(cluster: Cluster, database: str) -> None:
    nowhere = f"postgresql+asyncpg://{SERVER}:{SECRET}@127.0.0.1:1/{database}"
    for url, why, trouble in (
        (cluster.url(database, secret="wrong"), "password authentication failed.*correct user and pass", "FORBIDDEN"),
        (cluster.url("none_such"), '"none_such" does not exist: correct its name', "FORBIDDEN"),
        (nowhere, "start the database server, or correct its address", "UNREACHABLE"),
        (nowhere.replace("+asyncpg", ""), "start the database server", "UNREACHABLE"),
        ("postgresql+psycopg://x/y", "is none of sqlite, postgresql", "OTHER"),
    ):
        with pytest.raises(LibraryUnusable, match=why) as caught:
            await SkillLibrary.open(url)
        assert caught.value.trouble is Trouble[trouble]
        assert SECRET not in str(caught.value) and "\n" not in str(caught.value)


async def test_the_database_of_another_program_is_left_alone(cluster: Cluster) -> None:
    await cluster.execute("postgres", f"CREATE DATABASE other OWNER {OWNER}")
    await cluster.execute("other", "CREATE TABLE bookmarks (url TEXT)", role=OWNER)
    with pytest.raises(LibraryUnusable, match="another program"):
        await prepare(cluster.url("other", OWNER), SERVER)


async def test_two_who_approve_at_once_are_one_winner_and_one_exact_refusal(
    cluster: Cluster, database: str, shared: SkillLibrary, teach: Any
) -> None:
    async with await SkillLibrary.open(cluster.url(database)) as other:
        for turn in range(5):
            stored = await teach(shared, f"skill {turn}")
            digest = bytes.fromhex(stored.model_digest)
            answers = await asyncio.gather(
                shared.approve(f"skill {turn}", 1, digest, "erik"),
                other.reject(f"skill {turn}", 1, digest, "elsa", "not this one"),
                return_exceptions=True,
            )
            refused = [answer for answer in answers if isinstance(answer, BaseException)]
            assert len(refused) == 1 and isinstance(refused[0], NotAllowedInState)
            assert len((await other.description(f"skill {turn}")).decisions) == 1
        versions = await asyncio.gather(*(teach(one, "same") for one in (shared, other, shared, other)))
        assert sorted(one.version for one in versions) == [1, 2, 3, 4]


async def test_a_workstation_is_one_server_s_until_its_lease_has_run_out(
    cluster: Cluster, database: str, shared: SkillLibrary, teach: Any
) -> None:
    one, two = Server("one", "opc.tcp://one"), Server("two", "opc.tcp://two")
    await teach(shared)
    await shared.serve_as(one, ("ws1",), 60.0)
    await shared.add_job(JobReport(job_id="run", kind="Execution", workstation="ws1"))
    await shared.add_job(JobReport(job_id="learn", kind="Learning"))
    async with await SkillLibrary.open(cluster.url(database)) as other:
        with pytest.raises(ServedElsewhere, match=r"ws1 is served by opc\.tcp://one"):
            await other.serve_as(two, ("ws2", "ws1"), 60.0)
        assert [lease.workstation for lease in await other.leases()] == ["ws1"], "all of them or none"
        await other.serve_as(two, ("ws2",), 60.0)
        assert await other.interrupt_unfinished() == [], "others work on theirs"
        await shared.renew_leases(0.0)
        await other.serve_as(two, ("ws2", "ws1"), 60.0)
        assert [report.job_id for report in await other.interrupt_unfinished()] == ["run"]
        [lost] = await shared.renew_leases(60.0)
        assert (lost.workstation, lost.endpoint) == ("ws1", "opc.tcp://two")
        for refused in (
            shared.add_job(JobReport(job_id="late", kind="Execution", workstation="ws1")),
            shared.deploy("glue", 1, "ws1", "erik"),
            shared.check_lease("ws1"),
        ):
            with pytest.raises(ServedElsewhere):
                await refused
        await other.give_back_leases()
        assert await shared.renew_leases(60.0) == []
    await shared.give_back_leases()
    assert await shared.leases() == []


async def test_what_is_not_committed_is_told_to_nobody(
    cluster: Cluster, database: str, shared: SkillLibrary, teach: Any
) -> None:
    heard: asyncio.Queue[News | None] = asyncio.Queue()
    async with await SkillLibrary.open(cluster.url(database)) as other:
        other.listen(heard.put_nowait)
        async with asyncio.timeout(60):
            assert await heard.get() is None, "a new connection: something may have been missed"
            stored = await teach(shared)
            with pytest.raises(LibraryError):
                await shared.deploy("glue", 1, "ws1", "erik")
            await shared.approve("glue", 1, bytes.fromhex(stored.model_digest), "erik")
            told = [await heard.get(), await heard.get()]
    assert told == [News("version", "glue", 1, actor="tina"), News("version", "glue", 1, actor="erik")]


async def test_a_caller_whose_turn_does_not_come_is_told_and_leaves_nothing(
    cluster: Cluster, database: str, shared: SkillLibrary
) -> None:
    import asyncpg

    other = await asyncpg.connect(user=SERVER, password=SECRET, host=str(cluster.folder), database=database)
    try:
        await other.execute(f"SELECT pg_advisory_lock({WRITERS_LOCK})")
        with waiting_at_most(0.1), pytest.raises(LibraryUnusable) as caught:
            await shared.audit(AuditEntry(actor="late", action="Approve"))
        assert caught.value.trouble is Trouble.LOCKED
        assert await shared.audit_trail() == []
    finally:
        await other.close()
    await shared.audit(AuditEntry(actor="erik", action="Approve"))
    assert [entry.actor for entry in await shared.audit_trail()] == ["erik"]


async def test_a_commit_whose_answer_is_lost_is_told_as_what_it_was(
    cluster: Cluster, database: str, shared: SkillLibrary
) -> None:
    """The process that serves the connection is killed by the commit itself: after it, or in place of it."""
    transactions = shared._database._transactions
    entry = AuditEntry(actor="erik", action="Approve")

    async def severed(work: Any, committed: bool) -> Any:
        async with transactions._engine.connect() as connection:
            transaction = await connection.begin()
            number = str(await connection.scalar(sql.text("SELECT pg_current_xact_id()::text")))
            await connection.run_sync(work)
            await (transaction.commit() if committed else transaction.rollback())
        return await transactions._was_committed(number, ConnectionResetError())

    def run(committed: bool) -> Any:
        work = severed(lambda connection: audit_rows.add(connection, entry), committed)
        return asyncio.wrap_future(asyncio.run_coroutine_threadsafe(work, transactions._loop))

    assert await run(True) is True
    assert await run(False) is False
    assert len(await shared.audit_trail()) == 1
    unknown = transactions._was_committed("99999999", ConnectionResetError())
    with pytest.raises(LibraryUnusable, match="maybe it is") as caught:
        await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(unknown, transactions._loop))
    assert caught.value.trouble is Trouble.OUTCOME_UNKNOWN


async def test_a_library_outlives_its_server_being_stopped_killed_and_started(teach: Any) -> None:
    from tests import postgres

    with postgres.cluster() as cluster:
        await postgres.prepare_template(cluster)
        url = cluster.url("template_library")
        async with await SkillLibrary.open(url) as library:
            await teach(library)
            for ending in ("fast", "immediate"):
                cluster.stop(ending)
                with pytest.raises(LibraryUnusable) as caught:
                    await library.audit(AuditEntry(actor="late", action="Approve"))
                assert caught.value.trouble is Trouble.UNREACHABLE, caught.value
                with pytest.raises(LibraryError):
                    await library.description("glue")
                cluster.start()
                await library.audit(AuditEntry(actor="erik", action=ending))
                assert (await library.description("glue")).version == 1
            assert [one.action for one in await library.audit_trail()] == ["immediate", "fast"]
