"""The skill library: everything that is remembered, behind one object. Each method is one transaction."""

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar

import sqlalchemy as sql

from library.database import Database
from library.description import (
    AuditEntry,
    JobReport,
    JobState,
    Parameter,
    Recipe,
    SkillDescription,
    SkillSummary,
    StationRecord,
    VersionState,
)
from library.errors import ServedElsewhere
from library.names import normal
from library.postgresql.roles import weakness
from library.queries import audit as audit_rows
from library.queries import deployments as deployment_rows
from library.queries import jobs as job_rows
from library.queries import learned as learned_rows
from library.queries import leases as lease_rows
from library.queries import orders as order_rows
from library.queries import recipes as recipe_rows
from library.queries import recordings as recording_rows
from library.queries import search
from library.queries import stations as station_rows
from library.queries import users as user_rows
from library.queries import versions as version_rows
from library.queries.encoding import unpack_aligned, unpack_recording
from library.queries.leases import Lease, Server
from library.queries.news import News, announce
from library.queries.news import read as read_news
from library.records import JobOrder, JobTrace, User
from library.values import check_name, check_text
from models.demonstration import Demonstration, Edits
from models.options import LearningOptions
from models.report import AlignedDemonstration, LearnedMotion

Changed = TypeVar("Changed")


class SkillLibrary:
    """Skills with their versions, recordings, approvals and deployments; recipes; jobs; the audit trail; users.

    A method that changes something returns after the change has reached the disk, or raises a LibraryError and has
    changed nothing, now or later; one that is cancelled has changed nothing unless its commit was under way. Version 0
    stands for the newest one.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._me: Server | None = None
        self._mine: tuple[str, ...] = ()

    @classmethod
    async def open(cls, url_or_path: str | Path, *, must_exist: bool = False) -> Self:
        """Return the library in a file, or behind a database URL, brought up to date; made unless it must exist."""
        return cls(await Database.open(url_or_path, must_exist=must_exist))

    async def close(self) -> None:
        """Finish what is under way and let go of the database."""
        await self._database.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def check_writable(self) -> None:
        """Raise LibraryUnusable if nothing could be stored now."""
        await self._database.check_writable()

    async def weakness(self) -> str:
        """Return what weakens the guards of what is never changed, in words; "" where they hold."""
        return await self._database.read(weakness)

    # Several servers

    @property
    def shared(self) -> bool:
        """Whether other servers may work with the library at the same time."""
        return self._database.shared

    async def serve_as(self, me: Server, workstations: Sequence[str], seconds: float) -> None:
        """Be a server of a shared library from now on, and have ``workstations`` for ``seconds`` s.

        Raises ServedElsewhere, and has none of them, if another server has one.
        """

        def all_of_them(connection: sql.Connection) -> None:
            others = lease_rows.renew(connection, me, workstations, seconds)
            if others:
                raise ServedElsewhere(others[0].workstation, others[0].endpoint)
            announce(connection, me, News("leases"))

        await self._database.write(all_of_them)
        self._me, self._mine = me, tuple(workstations)

    async def renew_leases(self, seconds: float) -> list[Lease]:
        """Have this server's workstations for further ``seconds`` s; return those that another server has by now."""
        me = self._me
        assert me is not None
        return await self._database.write(lambda connection: lease_rows.renew(connection, me, self._mine, seconds))

    async def give_back_leases(self) -> None:
        """Let other servers have this one's workstations at once."""
        me = self._me
        if me is None:
            return

        def every(connection: sql.Connection) -> None:
            lease_rows.give_back(connection, me)
            announce(connection, me, News("leases"))

        await self._database.write(every)

    async def leases(self) -> list[Lease]:
        """Return which server has which workstation, in the order of the workstations."""
        return await self._database.read(lease_rows.everyone)

    async def check_lease(self, workstation: str) -> None:
        """Raise ServedElsewhere if a workstation has become another server's."""
        if self._me is not None:
            await self._database.read(lambda connection: lease_rows.check(connection, self._me, workstation))

    def listen(self, heard: Callable[[News | None], None]) -> None:
        """Have ``heard`` called with what other servers have changed; with None whenever something may be missed."""

        def told(payload: str) -> None:
            news = read_news(payload)
            if news is None or self._me is None or news.server != self._me.name:
                heard(news)

        self._database.listen(told)

    # Skills

    async def add_version(
        self,
        *,
        name: str,
        semantic_type: str,
        required_atomic_skills: Sequence[str],
        recordings: Sequence[Demonstration],
        edits: Edits,
        options: LearningOptions,
        learned: LearnedMotion,
        actor: str,
        job_id: str | None,
        based_on: int | None = None,
        parameters: Sequence[Parameter] = (),
        frame: str = "part",
        default_recipe: Recipe | None = None,
        brought_by: Sequence[str] = (),
    ) -> SkillDescription:
        """Store a learned motion as the next version of a skill and return its description.

        ``brought_by`` are people who recorded what it is learned from, beside who has it learned.
        In the same transaction go the recordings, the aligned demonstrations, for a new skill its default recipe
        (``default_recipe`` under an id of the library's choice), and the learning job's end.
        """
        prepared = await asyncio.to_thread(
            learned_rows.prepare,
            name=name,
            semantic_type=semantic_type,
            required_atomic_skills=required_atomic_skills,
            demonstrations=recordings,
            edits=edits,
            options=options,
            learned=learned,
            actor=actor,
            based_on=based_on,
            parameters=parameters,
            frame=frame,
            brought_by=brought_by,
        )
        return await self._database.write(
            lambda connection: self._announced(
                connection, learned_rows.add(connection, prepared, actor, job_id, default_recipe), actor
            )
        )

    async def import_version(
        self, description: SkillDescription, actor: str, default_recipe: Recipe | None = None
    ) -> SkillDescription:
        """Store a version from another library as the next version here, state Learned, without recordings."""
        return await self._database.write(
            lambda connection: self._announced(
                connection, learned_rows.add_imported(connection, description, actor, default_recipe), actor
            )
        )

    def _announced(self, connection: sql.Connection, stored: SkillDescription, actor: str) -> SkillDescription:
        announce(connection, self._me, News("version", stored.name, stored.version, actor=actor))
        return stored

    async def description(self, name: str, version: int = 0) -> SkillDescription:
        """Return the description of a version."""
        name = normal(name)
        return await self._database.read(lambda connection: version_rows.read(connection, name, version))

    async def versions(self, name: str) -> list[SkillSummary]:
        """Return a summary of each version of a skill, the newest first; none for an unknown skill."""
        name = normal(name)
        return await self._database.read(lambda connection: search.of_skill(connection, name))

    async def find(
        self,
        *,
        semantic_type: str = "",
        state: str = "",
        workstation: str = "",
        name_prefix: str = "",
        after: str = "",
        limit: int = 0,
    ) -> tuple[list[SkillSummary], str]:
        """Return skills in the order of their names, and the name to pass as ``after`` for the next page ("": the end).

        Of each skill comes the newest version that fits; with ``workstation`` it is the one deployed there.
        """
        name_prefix = normal(name_prefix)
        return await self._database.read(
            lambda connection: search.find(
                connection,
                semantic_type=semantic_type,
                state=state,
                workstation=workstation,
                name_prefix=name_prefix,
                after=after,
                limit=limit,
            )
        )

    async def recordings(self, name: str, version: int = 0) -> list[Demonstration]:
        """Return the recordings a version was learned from, untouched, in the order they were given."""
        name = normal(name)
        rows = await self._database.read(lambda connection: recording_rows.of_version(connection, name, version))
        return await asyncio.to_thread(lambda: [unpack_recording(row) for row in rows])

    async def aligned(self, name: str, version: int = 0) -> list[AlignedDemonstration]:
        """Return the demonstrations a version used, as they were aligned; an imported one has none."""
        name = normal(name)
        rows = await self._database.read(lambda connection: version_rows.aligned_of(connection, name, version))
        return await asyncio.to_thread(lambda: [unpack_aligned(row) for row in rows])

    async def edits(self, name: str, version: int = 0) -> Edits:
        """Return what an operator had taken out of the recordings of a version."""
        return learned_rows.edits_of(await self.description(name, version))

    async def options(self, name: str, version: int = 0) -> LearningOptions:
        """Return the options a version was learned with."""
        return learned_rows.options_of(await self.description(name, version))

    # The life of a version

    async def approve(
        self,
        name: str,
        version: int,
        digest: bytes,
        actor: str,
        comment: str = "",
        *,
        four_eyes: bool = True,
        with_reason: bool = False,
    ) -> VersionState:
        """Approve the version whose model has this SHA-256, and return its state now.

        With four eyes nobody may who contributed to it, and a version of unknown origin needs two who do.
        ``with_reason``: an empty comment is refused.
        """
        to = VersionState.APPROVED
        return await self._decide(name, version, to, actor, comment, digest, four_eyes, with_reason)

    async def reject(self, name: str, version: int, digest: bytes, actor: str, comment: str = "") -> VersionState:
        """Reject the version whose model has this SHA-256."""
        return await self._decide(name, version, VersionState.REJECTED, actor, comment, digest)

    async def retire(self, name: str, version: int, actor: str, comment: str = "") -> VersionState:
        """Take a version out of use for good; it must not be deployed anywhere."""
        return await self._decide(name, version, VersionState.RETIRED, actor, comment)

    async def _decide(
        self,
        name: str,
        version: int,
        to: VersionState,
        actor: str,
        comment: str,
        digest: bytes | None = None,
        four_eyes: bool = False,
        with_reason: bool = False,
    ) -> VersionState:
        check_text(comment, "comment")
        name = normal(name)

        def decided(connection: sql.Connection) -> VersionState:
            state = version_rows.decide(connection, name, version, to, actor, comment, digest, four_eyes, with_reason)
            announce(connection, self._me, News("version", name, version, actor=actor))
            return state

        return await self._database.write(decided)

    async def deploy(self, name: str, version: int, workstation: str, actor: str) -> VersionState:
        """Deploy an approved version on a workstation, where it replaces any other version of that skill."""
        name = normal(name)
        check_name(workstation, "workstation")

        def deployed(connection: sql.Connection) -> VersionState:
            lease_rows.check(connection, self._me, workstation)
            state = deployment_rows.deploy(connection, name, version, workstation, actor)
            announce(connection, self._me, News("deployed", name, version, workstation, actor))
            return state

        return await self._database.write(deployed)

    async def withdraw(self, name: str, version: int, workstation: str, actor: str) -> VersionState:
        """Take a version (0: whichever is there) off a workstation."""
        name = normal(name)
        check_text(actor, "actor")

        def withdrawn(connection: sql.Connection) -> VersionState:
            lease_rows.check(connection, self._me, workstation)
            state = deployment_rows.withdraw(connection, name, version, workstation)
            announce(connection, self._me, News("withdrawn", name, version, workstation, actor))
            return state

        return await self._database.write(withdrawn)

    async def deployments(self, workstation: str) -> list[SkillDescription]:
        """Return the versions deployed on a workstation, in the order of their names."""
        return await self._database.read(lambda connection: deployment_rows.on_workstation(connection, workstation))

    async def deployed(self, name: str, workstation: str) -> int | None:
        """Return which version of a skill is deployed on a workstation, if any."""
        name = normal(name)
        return await self._database.read(lambda connection: deployment_rows.deployed(connection, name, workstation))

    # Recipes

    async def put_recipe(self, recipe: Recipe, actor: str) -> None:
        """Store a recipe, or change the one with that id."""
        await self._database.write(lambda connection: recipe_rows.put(connection, recipe, actor))

    async def recipe(self, recipe_id: str) -> Recipe:
        """Return a recipe."""
        recipe_id = normal(recipe_id)
        return await self._database.read(lambda connection: recipe_rows.read(connection, recipe_id))

    async def recipes(self, skill_name: str = "") -> list[Recipe]:
        """Return the recipes of a skill, or of all skills, in the order of their ids."""
        skill_name = normal(skill_name)
        return await self._database.read(lambda connection: recipe_rows.of_skill(connection, skill_name))

    async def delete_recipe(self, recipe_id: str, actor: str) -> None:
        """Delete a recipe, unless it is a skill's default or a job still needs it."""
        recipe_id = normal(recipe_id)
        check_text(actor, "actor")
        await self._database.write(lambda connection: recipe_rows.delete(connection, recipe_id))

    async def default_recipe_id(self, skill_name: str) -> str:
        """Return the id of the recipe that was made with the skill."""
        skill_name = normal(skill_name)
        return await self._database.read(lambda connection: version_rows.default_recipe_id(connection, skill_name))

    # Jobs

    async def add_job(self, report: JobReport, recipe: Recipe | None = None) -> JobReport:
        """Store a new job together with the recipe it runs; without one, with its recipe as it is now."""

        def added(connection: sql.Connection) -> None:
            lease_rows.check(connection, self._me, report.workstation)
            job_rows.add(connection, report, recipe, self._me.name if self._me is not None else "")

        await self._database.write(added)
        return report

    async def move_job(self, job_id: str, to: JobState, **fields: Any) -> JobReport:
        """Move a job to another state, set fields of its report, and return what it is now.

        Start time, end time and the progress of a completed job set themselves, unless given.
        """
        return await self._database.write(lambda connection: job_rows.move(connection, job_id, to, fields))

    async def set_progress(self, job_id: str, progress: float) -> None:
        """Note how far a job has come, 0 to 1."""
        await self._database.write(lambda connection: job_rows.set_progress(connection, job_id, progress))

    async def job(self, job_id: str) -> JobReport:
        """Return a job."""
        return await self._database.read(lambda connection: job_rows.read(connection, job_id))

    async def job_recipe(self, job_id: str) -> Recipe | None:
        """Return the recipe of a job as it was when the job was added."""
        return await self._database.read(lambda connection: job_rows.read_recipe(connection, job_id))

    async def jobs(self, state: str = "", limit: int = 0, workstation: str = "") -> list[JobReport]:
        """Return the newest jobs, the newest first."""
        return await self._database.read(lambda connection: job_rows.newest(connection, state, workstation, limit))

    async def add_order(self, order: JobOrder, most: int) -> bool:
        """Store a job order; return False, and store nothing, where ``most`` of the workstation have not ended."""
        return await self._database.write(lambda connection: order_rows.add(connection, order, most))

    async def order(self, workstation: str, order_id: str) -> JobOrder:
        """Return a job order."""
        return await self._database.read(lambda connection: order_rows.read(connection, workstation, order_id))

    async def order_of_job(self, job_id: str) -> JobOrder | None:
        """Return the job order that became a job, if one did."""
        return await self._database.read(lambda connection: order_rows.of_job(connection, job_id))

    async def orders(self, workstation: str, limit: int) -> list[JobOrder]:
        """Return the job orders that have not ended and the newest ``limit`` of all, the newest first."""
        return await self._database.read(lambda connection: order_rows.newest(connection, workstation, limit))

    async def change_order(self, workstation: str, order_id: str, **fields: Any) -> JobOrder:
        """Change fields of a job order and return what it is now."""
        return await self._database.write(
            lambda connection: order_rows.change(connection, workstation, order_id, fields)
        )

    async def remove_order(self, workstation: str, order_id: str) -> None:
        """Forget a job order."""
        await self._database.write(lambda connection: order_rows.remove(connection, workstation, order_id))

    async def interrupt_unfinished(self) -> list[JobReport]:
        """Fail, as Interrupted, every job that has not ended: for a server that starts, when nobody works on them.

        Where others share the library these are its own jobs, and those of its workstations.
        """
        name = self._me.name if self._me is not None else ""
        return await self._database.write(
            lambda connection: job_rows.interrupt_unfinished(connection, name, self._mine)
        )

    async def station(self, workstation: str) -> StationRecord:
        """Return what is remembered of a workstation."""
        return await self._database.read(lambda connection: station_rows.read(connection, workstation))

    async def change_station(self, workstation: str, **fields: Any) -> StationRecord:
        """Change what is remembered of a workstation and return what it is now."""
        return await self._database.write(lambda connection: station_rows.change(connection, workstation, fields))

    async def save_trace(self, job_id: str, trace: JobTrace) -> None:
        """Store what a job commanded and measured; a job has one trace."""
        row = await asyncio.to_thread(job_rows.pack_trace, job_id, trace)
        await self._database.write(lambda connection: job_rows.save_trace(connection, job_id, row))

    async def trace(self, job_id: str) -> JobTrace:
        """Return what a job commanded and measured."""
        row = await self._database.read(lambda connection: job_rows.trace_row(connection, job_id))
        return await asyncio.to_thread(job_rows.unpack_trace, row)

    # Records and users

    async def audit(self, entry: AuditEntry) -> int:
        """Add an entry to the audit trail and return its id. Whatever stands in it, it can be written."""
        return await self._database.write(lambda connection: audit_rows.add(connection, entry))

    async def audit_trail(self, limit: int = 0, before: int = 0) -> list[AuditEntry]:
        """Return the newest entries, the newest first; ``before`` is the smallest id of the page before."""
        return await self._database.read(lambda connection: audit_rows.trail(connection, limit, before))

    async def add_user(
        self,
        name: str,
        role: str,
        password_hash: str = "",
        certificate: bytes = b"",
        actor: str = "",
        entry: AuditEntry | None = None,
    ) -> User:
        """Store somebody who may sign in, with the hash of a password, a certificate (DER), or both.

        Here and below ``entry`` goes into the audit trail with the change: both are there, or neither is.
        """
        name = check_name(name, "name")
        check_name(role, "role")
        return await self._told(
            entry, lambda connection: user_rows.add(connection, name, role, password_hash, certificate, actor)
        )

    async def add_users(self, added: Sequence[tuple[str, str, str]], actor: str, entries: Sequence[AuditEntry]) -> None:
        """Store all of ``added`` (name, role, hash of the password) with their entries, or none if one cannot be."""
        checked = [(check_name(name, "name"), check_name(role, "role"), secret) for name, role, secret in added]

        def every(connection: sql.Connection) -> None:
            for name, role, secret in checked:
                user_rows.add(connection, name, role, secret, b"", actor)
            for entry in entries:
                audit_rows.add(connection, entry)

        await self._database.write(every)

    async def users(self) -> list[User]:
        """Return all users in the order of their names."""
        return await self._database.read(user_rows.everyone)

    async def user(self, name: str) -> User:
        """Return a user."""
        return await self._database.read(lambda connection: user_rows.read(connection, name))

    async def set_password_hash(self, name: str, password_hash: str, entry: AuditEntry | None = None) -> None:
        """Give a user another password."""
        await self._told(entry, lambda connection: user_rows.set_password_hash(connection, name, password_hash))

    async def set_role(self, name: str, role: str, entry: AuditEntry | None = None) -> None:
        """Give a user another role."""
        check_name(role, "role")
        await self._told(entry, lambda connection: user_rows.set_role(connection, name, role))

    async def remove_user(self, name: str, entry: AuditEntry | None = None) -> None:
        """Remove a user; what the user did stays in the records."""
        await self._told(entry, lambda connection: user_rows.remove(connection, name))

    async def _told(self, entry: AuditEntry | None, change: Callable[[sql.Connection], Changed]) -> Changed:
        """Make a change and write its entry in one transaction."""

        def both(connection: sql.Connection) -> Changed:
            result = change(connection)
            if entry is not None:
                audit_rows.add(connection, entry)
            return result

        return await self._database.write(both)
