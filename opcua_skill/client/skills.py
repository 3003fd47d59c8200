"""`SkillClient`: the skill library and the workstations of one server, typed."""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from pathlib import Path as FilePath

import numpy as np
from asyncua import ua

from models.demonstration import Demonstration, Edits
from opcua_skill.client.errors import ClientError, Refused, TookTooLong
from opcua_skill.client.session import Event, Session
from opcua_skill.client.workstation import Workstation, ask_report
from opcua_skill.wire import to_server
from opcua_skill.wire.values import (
    AuditEntry,
    JobReport,
    Learned,
    LearningOptions,
    Limits,
    OpenSession,
    Path,
    Recipe,
    Recordings,
    Skill,
    SkillSummary,
)

LIBRARY = "SkillLibrary"
POLL = 0.5
SMALL_MESSAGE = 1_000_000
OnProgress = Callable[[JobReport], None]


class SkillClient:
    """A person or a program at a skill library: signs in, and asks only what INTERFACE offers.

    Every refusal is a `Refused` with the status, the argument and the server's reason.
    """

    def __init__(
        self,
        url: str,
        user: str,
        password: str,
        *,
        folder: FilePath | None = None,
        timeout: float = 30.0,
        secure: bool = True,
    ) -> None:
        """``folder`` keeps the client's certificate and the servers it knows; ``timeout`` in s is for one request."""
        self.session = Session(url, user, password, folder=folder, timeout=timeout, secure=secure)

    async def __aenter__(self) -> "SkillClient":
        await self.session.open()
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.session.close()

    def workstation(self, name: str) -> Workstation:
        """Return a workstation of this server; whether it exists shows at the first call."""
        return Workstation(self.session, name)

    async def workstations(self) -> list[str]:
        """Return the names of the server's workstations."""
        return await self.session.children("Machines")

    async def insecure(self) -> tuple[str, ...]:
        """Return in words what the server's configuration weakens; empty for a server as it comes."""
        (told,) = await self.session.read(f"{LIBRARY}/Insecure")
        return tuple(str(words) for words in told or ())

    async def four_eyes(self) -> bool:
        """Return whether somebody else than who taught a version has to approve it."""
        return bool((await self.session.read(f"{LIBRARY}/FourEyes"))[0])

    async def presets(self) -> tuple[str, ...]:
        """Return the ways to learn that the server has, for ``LearningOptions.preset``; the default first."""
        (names,) = await self.session.read(f"{LIBRARY}/Presets")
        return tuple(str(name) for name in names or ())

    async def limits(self) -> Limits:
        """Return what one call may bring."""
        names = ("MaxDemonstrations", "MaxPointsPerDemonstration", "MaxQueuedJobs", "MaxMessageSize")
        values = await self.session.read(*(f"{LIBRARY}/Limits/{name}" for name in names))
        return Limits(*(int(value) for value in values))

    async def learn(
        self,
        skill_name: str,
        demonstrations: Sequence[Demonstration],
        *,
        semantic_type: str = "",
        options: LearningOptions | None = None,
    ) -> Learned:
        """Send demonstrations. Comes back when the skill is stored, or after 1 s while the job still runs."""
        await self._check_size(demonstrations)
        job_id, state, version, results, report = await self.session.call(
            LIBRARY,
            "LearnFromDemonstration",
            SkillName=to_server.string(skill_name),
            SemanticType=to_server.string(semantic_type),
            Demonstrations=to_server.structure_array(
                [to_server.demonstration_out(self.session.structure, one) for one in demonstrations]
            ),
            Options=to_server.structure(to_server.options_out(self.session.structure, options or LearningOptions())),
        )
        return Learned(
            job_id, state, int(version), tuple(code.name for code in results or ()), to_server.document(report)
        )

    async def _check_size(self, demonstrations: Sequence[Demonstration]) -> None:
        """Refuse what no message of this server can hold: sent all the same, it would cost the connection."""
        size = sum(to_server.size_of(one) for one in demonstrations)
        if size < SMALL_MESSAGE:
            return
        limits = await self.limits()
        longest = max(len(one.times) for one in demonstrations)
        if longest > limits.max_points_per_demonstration:
            most = limits.max_points_per_demonstration
            reason = f"a demonstration has {longest} samples, {most} are allowed: record fewer a second"
        elif size > limits.max_message_size:
            reason = (
                f"these demonstrations make a message of {size / 1e6:.0f} MB, the server takes "
                f"{limits.max_message_size / 1e6:.0f} MB: send fewer of them, or record fewer samples a second"
            )
        else:
            return
        raise Refused("LearnFromDemonstration", "BadRequestTooLarge", "Demonstrations", reason)

    async def learn_to_the_end(
        self,
        skill_name: str,
        demonstrations: Sequence[Demonstration],
        *,
        semantic_type: str = "",
        options: LearningOptions | None = None,
        limit: float = 600.0,
        on_progress: OnProgress | None = None,
    ) -> JobReport:
        """Send demonstrations and return the report of the learning job when it has ended, however it ended."""
        learned = await self.learn(skill_name, demonstrations, semantic_type=semantic_type, options=options)
        return await self.follow(learned.job_id, limit=limit, on_progress=on_progress)

    async def find_skills(
        self, *, semantic_type: str = "", state: str = "", workstation: str = "", name_prefix: str = "", limit: int = 0
    ) -> list[SkillSummary]:
        """Return the newest version of every skill that matches, page by page; ``limit`` 0 means all."""
        found: list[SkillSummary] = []
        after = ""
        while True:
            skills, after = await self.session.call(
                LIBRARY,
                "FindSkills",
                SemanticType=to_server.string(semantic_type),
                State=to_server.string(state),
                Workstation=to_server.string(workstation),
                NamePrefix=to_server.string(name_prefix),
                After=to_server.string(after),
                Limit=to_server.uint32(limit - len(found) if limit else 0),
            )
            found += [to_server.summary_in(skill) for skill in skills or ()]
            if not after or (limit and len(found) >= limit):
                return found

    async def skill(self, skill_name: str, version: int = 0) -> Skill:
        """Return a version's semantic description; 0 is the newest."""
        [text] = await self.session.call(
            LIBRARY, "GetSkill", SkillName=to_server.string(skill_name), Version=to_server.uint32(version)
        )
        return Skill.from_document(to_server.document(text))

    async def recordings(self, skill_name: str, version: int = 0) -> Recordings:
        """Return the demonstrations a version was learned from, as sent and as aligned."""
        raw, aligned = await self.session.call(
            LIBRARY, "GetDemonstrations", SkillName=to_server.string(skill_name), Version=to_server.uint32(version)
        )
        return Recordings(
            tuple(to_server.demonstration_in(one) for one in raw or ()),
            tuple(to_server.demonstration_in(one) for one in aligned or ()),
        )

    async def path(self, skill_name: str, version: int = 0, *, recipe_id: str = "", time_step: float = 0.0) -> Path:
        """Return the path of a version, as learned or as a recipe wants it."""
        dimension, times, positions, covariances, dispense = await self.session.call(
            LIBRARY,
            "GetTrajectory",
            SkillName=to_server.string(skill_name),
            Version=to_server.uint32(version),
            RecipeId=to_server.string(recipe_id),
            TimeStep=to_server.double(time_step),
        )
        n, d = len(times), int(dimension)
        return Path(
            times=np.asarray(times, dtype=np.float64),
            points=np.asarray(positions, dtype=np.float64).reshape(n, d),
            covariances=np.asarray(covariances, dtype=np.float64).reshape(n, d, d),
            dispense=np.asarray(dispense, dtype=bool),
        )

    async def remove_points(
        self, skill_name: str, version: int, indices: Sequence[int], *, demonstration_id: str = "", comment: str = ""
    ) -> int:
        """Strike samples and learn again from what is left; return the new version.

        ``indices`` count samples of one recording, or of the learned path when ``demonstration_id`` is empty.
        """
        [new] = await self.session.call(
            LIBRARY,
            "RemovePoints",
            SkillName=to_server.string(skill_name),
            Version=to_server.uint32(version),
            DemonstrationId=to_server.string(demonstration_id),
            Indices=to_server.uint32_array(indices),
            Comment=to_server.string(comment),
        )
        return int(new)

    async def learn_again(
        self, skill_name: str, version: int, edits: Edits, *, comment: str = ""
    ) -> tuple[str, str, int]:
        """Learn a new version from a version's recordings with exactly these edits: also fewer than before.

        Returns job id, its state, and the new version, 0 while the job still runs.
        """
        made = self.session.structure("DemonstrationEditsDataType")
        entries = [
            made(DemonstrationId=name, Excluded=name in edits.excluded, Struck=sorted(edits.struck.get(name, ())))
            for name in sorted({*edits.excluded, *edits.struck})
        ]
        job_id, state, new = await self.session.call(
            LIBRARY,
            "LearnAgain",
            SkillName=to_server.string(skill_name),
            Version=to_server.uint32(version),
            Edits=to_server.structure_array(entries),
            Comment=to_server.string(comment),
        )
        return job_id, state, int(new)

    async def approve(
        self, skill_name: str, version: int, model_digest: bytes, comment: str = "by a program that gave no reason"
    ) -> str:
        """Approve exactly the model with this digest; return the version's state. An empty reason is refused."""
        return await self._judge("Approve", skill_name, version, model_digest, comment)

    async def reject(self, skill_name: str, version: int, model_digest: bytes, comment: str = "") -> str:
        """Reject exactly the model with this digest; return the version's state."""
        return await self._judge("Reject", skill_name, version, model_digest, comment)

    async def _judge(self, method: str, skill_name: str, version: int, model_digest: bytes, comment: str) -> str:
        [state] = await self.session.call(
            LIBRARY,
            method,
            SkillName=to_server.string(skill_name),
            Version=to_server.uint32(version),
            ModelDigest=to_server.byte_string(model_digest),
            Comment=to_server.string(comment),
        )
        return state

    async def deploy(self, skill_name: str, version: int, workstation: str) -> str:
        """Make an approved version what a workstation runs; return the version's state."""
        return await self._place("Deploy", skill_name, version, workstation)

    async def withdraw(self, skill_name: str, version: int, workstation: str) -> str:
        """Take a version off a workstation; return the version's state."""
        return await self._place("Withdraw", skill_name, version, workstation)

    async def _place(self, method: str, skill_name: str, version: int, workstation: str) -> str:
        [state] = await self.session.call(
            LIBRARY,
            method,
            SkillName=to_server.string(skill_name),
            Version=to_server.uint32(version),
            Workstation=to_server.string(workstation),
        )
        return state

    async def retire(self, skill_name: str, version: int, comment: str = "") -> str:
        """Retire a version for good; return its state."""
        [state] = await self.session.call(
            LIBRARY,
            "Retire",
            SkillName=to_server.string(skill_name),
            Version=to_server.uint32(version),
            Comment=to_server.string(comment),
        )
        return state

    async def export_skill(self, skill_name: str, version: int = 0, file_format: str = "json") -> str:
        """Return a version as text in an exchange format."""
        [content] = await self.session.call(
            LIBRARY,
            "ExportSkill",
            SkillName=to_server.string(skill_name),
            Version=to_server.uint32(version),
            Format=to_server.string(file_format),
        )
        return content

    async def import_skill(self, content: str, file_format: str = "json") -> tuple[str, int]:
        """Store a version from an exchange format; return its name and new version number, in state Learned."""
        name, version = await self.session.call(
            LIBRARY, "ImportSkill", Content=to_server.string(content), Format=to_server.string(file_format)
        )
        return name, int(version)

    async def put_recipe(self, recipe: Recipe) -> None:
        """Store a recipe, or replace the one of that id."""
        await self.session.call(
            LIBRARY, "PutRecipe", Recipe=to_server.structure(to_server.recipe_out(self.session.structure, recipe))
        )

    async def recipe(self, recipe_id: str) -> Recipe:
        """Return a recipe."""
        [value] = await self.session.call(LIBRARY, "GetRecipe", RecipeId=to_server.string(recipe_id))
        return to_server.recipe_in(value)

    async def recipes(self, skill_name: str = "") -> list[Recipe]:
        """Return the recipes of a skill, or all of them."""
        [values] = await self.session.call(LIBRARY, "ListRecipes", SkillName=to_server.string(skill_name))
        return [to_server.recipe_in(value) for value in values or ()]

    async def delete_recipe(self, recipe_id: str) -> None:
        """Delete a recipe."""
        await self.session.call(LIBRARY, "DeleteRecipe", RecipeId=to_server.string(recipe_id))

    async def job(self, job_id: str) -> JobReport:
        """Return the report of a learning job; for a motion ask its workstation."""
        return await ask_report(self.session, LIBRARY, job_id)

    async def audit_trail(self, before: int = 0, limit: int = 100) -> list[AuditEntry]:
        """Return the newest entries of the audit trail, or those before an entry, the newest first."""
        [values] = await self.session.call(
            LIBRARY, "GetAuditTrail", Before=to_server.uint64(before), Limit=to_server.uint32(limit)
        )
        return [to_server.audit_entry_in(value) for value in values or ()]

    async def sessions(self) -> list[OpenSession]:
        """Return who is signed in, the oldest session first."""
        return [one for one, _ in await self._sessions()]

    async def end_session(self, session_id: str) -> OpenSession:
        """End the session whose id begins so, and return what it was; raises ClientError unless there is one."""
        found = [pair for pair in await self._sessions() if session_id and pair[0].session_id.startswith(session_id)]
        if len(found) != 1:
            raise ClientError(f"{len(found)} sessions have an id that begins with {session_id!r}")
        one, node = found[0]
        await self.session.call(LIBRARY, "EndSession", SessionId=ua.Variant(node, ua.VariantType.NodeId))
        return one

    async def _sessions(self) -> list[tuple[OpenSession, ua.NodeId]]:
        told = await self.session.call(LIBRARY, "ListSessions")
        return [
            (OpenSession(to_server.identifier(node), user, role, program, address, to_server.moment(since), idle), node)
            for node, user, role, program, address, since, idle in zip(*(values or () for values in told), strict=True)
        ]

    @contextlib.asynccontextmanager
    async def events(self) -> AsyncIterator["asyncio.Queue[Event]"]:
        """Yield a queue of what the server tells while the block runs; the oldest gives way after 1000 unread ones.

        ::

            async with client.events() as told:
                started = await client.workstation("ws1").execute("zigzag")
                event = await told.get()
        """
        async with self.session.events() as queue:
            yield queue

    async def follow(
        self, job_id: str, *, on: str = "", limit: float = 600.0, on_progress: OnProgress | None = None
    ) -> JobReport:
        """Return a job's report once it has ended. ``on`` names the workstation of a motion; empty for learning.

        Woken by the job's events; asks every half second as well, should an event be lost. ``limit`` in s.
        """
        place = Workstation(self.session, on).path if on else LIBRARY
        async with self.session.events() as queue:
            return await until_ended(lambda: ask_report(self.session, place, job_id), queue, job_id, limit, on_progress)


async def until_ended(
    ask: Callable[[], Awaitable[JobReport]],
    queue: "asyncio.Queue[Event]",
    job_id: str,
    limit: float,
    on_progress: OnProgress | None,
) -> JobReport:
    """Ask again at every event about the job, and every ``POLL`` s, until it has ended or ``limit`` s have passed."""
    deadline = time.monotonic() + limit
    while True:
        report = await ask()
        if on_progress is not None:
            on_progress(report)
        if report.ended:
            return report
        if time.monotonic() > deadline:
            raise TookTooLong(f"job {job_id} is still {report.state} after {limit:g} s ({report.progress:.0%} done)")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(POLL):
                while (await queue.get()).job_id != job_id:
                    continue
