"""The methods of SkillLibrary."""

import asyncio
import json
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from asyncua import ua

from library.description import JobState, SkillDescription, VersionState
from library.errors import InvalidValue, NotFound
from library.store import SkillLibrary
from library.values import check_name, check_text
from models.demonstration import Edits
from models.motion import Trajectory
from models.report import Verdict, VerdictKind, samples_along_path
from opcua_skill.configuration.atomic_skills import required_atomic_skills
from opcua_skill.configuration.settings import Settings
from opcua_skill.jobs import JobEngine, LearningRequest, PlanRefused, motion_parameters
from opcua_skill.jobs.worker_tasks import DocumentRefused
from opcua_skill.security.access import caller
from opcua_skill.server.features.telling import Telling
from opcua_skill.stack.services.calls import Refused
from opcua_skill.wire.from_client import (
    ReceivedDemonstrations,
    flat,
    learning_options,
    received_demonstrations,
    recipe,
    wire_aligned,
    wire_demonstration,
    wire_recipe,
    wire_report,
    wire_summary,
)
from opcua_skill.wire.refusals import Code, out_of_range, refusing

VERDICT_CODES = {"": Code.Good, "invalid": Code.BadOutOfRange, "odd": Code.BadNoMatch, "excluded": Code.BadNoData}
RELEARN_SECONDS = 60.0


@dataclass(frozen=True)
class LibraryMethods:
    """Handlers of the library's methods. Every one checks, asks the library or the job engine, and answers."""

    library: SkillLibrary
    jobs: JobEngine
    settings: Settings
    events: Telling

    @refusing(blame="SkillName", fields={"semantic_type": "SemanticType", "DemonstrationId": "Demonstrations"})
    async def learn_from_demonstration(
        self, skill_name: str, semantic_type: str, demonstrations: list[Any], options: Any
    ) -> tuple[Any, ...]:
        """Learn a new version of a skill."""
        received = received_demonstrations(demonstrations, self.settings.limits)
        return await self.learn_received(skill_name, semantic_type, received, options)

    async def learn_received(
        self,
        skill_name: str,
        semantic_type: str,
        received: ReceivedDemonstrations,
        options: Any,
        brought_by: tuple[str, ...] = (),
    ) -> tuple[Any, ...]:
        """Learn from demonstrations that came in by any door; the answer is that of LearnFromDemonstration.

        ``brought_by`` are those who recorded them, where that is not the caller.
        """
        skill_name = check_name(skill_name, "skill_name")
        check_text(semantic_type, "semantic_type", 256)
        if not semantic_type:
            raise InvalidValue("semantic_type", semantic_type, "say what kind of skill this is, such as Gluing")
        chosen = learning_options(options)
        outcome = await self.jobs.learn(
            LearningRequest(
                skill_name=skill_name,
                semantic_type=semantic_type,
                required_atomic_skills=required_atomic_skills(semantic_type, received.usable),
                recordings=received.usable,
                edits=Edits(),
                options=chosen,
                actor=caller().name,
                brought_by=brought_by,
            ),
            answer_within=self.settings.learning.answer_within,
        )
        verdicts = outcome.learned.verdicts if outcome.learned else ()
        report = _learning_words(received, verdicts, outcome.description, outcome.report.state.value)
        return (
            outcome.report.job_id,
            outcome.report.state.value,
            outcome.report.skill_version,
            _demonstration_results(received, verdicts),
            report,
        )

    @refusing(blame="Limit", fields={"state": "State"})
    async def find_skills(
        self, semantic_type: str, state: str, workstation: str, name_prefix: str, after: str, limit: int
    ) -> tuple[Any, ...]:
        """Return one page of skills, and where the next page begins."""
        most = self.settings.limits.max_page
        if state and state not in {one.value for one in VersionState}:
            raise out_of_range("State", f"there is no state {state!r}: {', '.join(one.value for one in VersionState)}")
        found, following = await self.library.find(
            semantic_type=semantic_type,
            state=state,
            workstation=workstation,
            name_prefix=name_prefix,
            after=after,
            limit=min(limit or most, most),
        )
        return ([wire_summary(one) for one in found], following)

    @refusing(blame="SkillName")
    async def get_skill(self, skill_name: str, version: int) -> tuple[Any, ...]:
        """Return the semantic description with the model."""
        return ((await self.library.description(skill_name, version)).to_json(),)

    @refusing(blame="SkillName")
    async def get_demonstrations(self, skill_name: str, version: int) -> tuple[Any, ...]:
        """Return the recordings as they came in, and as they were aligned."""
        raw = await self.library.recordings(skill_name, version)
        aligned = await self.library.aligned(skill_name, version)
        return ([wire_demonstration(one) for one in raw], [wire_aligned(one) for one in aligned])

    @refusing(blame="TimeStep")
    async def get_trajectory(self, skill_name: str, version: int, recipe_id: str, time_step: float) -> tuple[Any, ...]:
        """Return the path in the part's frame: as learned, or with a recipe's timing, at any time step."""
        if not (np.isfinite(time_step) and (time_step == 0.0 or 0.0005 <= time_step <= 1.0)):
            raise out_of_range("TimeStep", f"TimeStep is {time_step:g} s: it has to be 0, or 0.0005 to 1")
        description = await self.library.description(skill_name, version)
        self._check_samples(description.duration, time_step or description.time_step)
        if not recipe_id:
            path = await self.jobs.trajectory(description, time_step)
        else:
            chosen = await self.library.recipe(recipe_id)
            if chosen.skill_name != skill_name:
                raise NotFound("recipe", f"{recipe_id} of {skill_name}")
            if time_step:
                chosen = chosen.model_copy(update={"time_step": time_step})
            self._check_samples(chosen.duration or description.duration, chosen.time_step)
            planned = await self.jobs.recipe_trajectory(description, chosen)
            if isinstance(planned, PlanRefused):
                raise out_of_range("RecipeId", planned.findings[0].text)
            path = planned
        return _wire_trajectory(path)

    def _check_samples(self, duration: float, time_step: float) -> None:
        """Refuse a path of too many samples before any of them is made."""
        most, samples = self.settings.limits.max_trajectory_samples, duration / time_step + 1.0
        if samples > most:
            reason = (
                f"a path of {duration:g} s has {samples:.0f} samples at steps of {time_step:g} s, {most} are allowed: "
                f"take steps of at least {duration / (most - 1):.3g} s"
            )
            raise out_of_range("TimeStep", reason)

    @refusing(blame="Indices")
    async def remove_points(
        self, skill_name: str, version: int, demonstration_id: str, indices: list[int], comment: str
    ) -> tuple[Any, ...]:
        """Learn a new version without some samples of a recording, or of all recordings along a stretch of the path."""
        check_text(comment, "comment", 2000)
        if not indices:
            raise out_of_range("Indices", "no samples were named: give at least one index")
        description = await self.library.description(skill_name, version)
        recordings = await self.library.recordings(skill_name, description.version)
        edits = await self.library.edits(skill_name, description.version)
        if demonstration_id:
            recording = next((one for one in recordings if one.demonstration_id == demonstration_id), None)
            if recording is None:
                raise NotFound("demonstration", demonstration_id)
            _check_indices(indices, len(recording.times), f"recording {demonstration_id}")
            edits = edits.with_struck(demonstration_id, frozenset(indices))
        else:
            motion, aligned = description.motion(), await self.library.aligned(skill_name, description.version)
            steps = max(1, math.ceil(motion.duration / motion.time_step - 1e-9))
            _check_indices(indices, steps + 1, "the learned path")
            found = await asyncio.to_thread(samples_along_path, motion, aligned, indices)
            for name, samples in found.items():
                edits = edits.with_struck(name, samples)
        outcome = await self.jobs.learn(
            LearningRequest(
                skill_name=skill_name,
                semantic_type=description.semantic_type,
                required_atomic_skills=description.required_atomic_skills,
                recordings=recordings,
                edits=edits,
                options=await self.library.options(skill_name, description.version),
                actor=caller().name,
                comment=comment,
                based_on=description.version,
            ),
            answer_within=RELEARN_SECONDS,
        )
        if outcome.description is None:
            raise Refused(Code.BadTimeout, f"learning goes on as job {outcome.report.job_id}")
        return (outcome.description.version,)

    @refusing(blame="ModelDigest", fields={"comment": "Comment"})
    async def approve(self, skill_name: str, version: int, digest: bytes, comment: str) -> tuple[Any, ...]:
        """Approve a version, named by the digest of the model that was looked at."""
        check_text(comment, "comment", 2000)
        actor, four_eyes = caller().name, self.settings.four_eyes
        state = await self.library.approve(
            skill_name, version, bytes(digest), actor, comment, four_eyes=four_eyes, with_reason=True
        )
        await self._version_changed(skill_name, version, comment)
        return (state.value,)

    @refusing(blame="ModelDigest", fields={"comment": "Comment"})
    async def reject(self, skill_name: str, version: int, digest: bytes, comment: str) -> tuple[Any, ...]:
        """Reject a version."""
        check_text(comment, "comment", 2000)
        state = await self.library.reject(skill_name, version, bytes(digest), caller().name, comment)
        await self._version_changed(skill_name, version, comment)
        return (state.value,)

    @refusing(blame="Comment")
    async def retire(self, skill_name: str, version: int, comment: str) -> tuple[Any, ...]:
        """Take a version out of use."""
        check_text(comment, "comment", 2000)
        state = await self.library.retire(skill_name, version, caller().name, comment)
        await self._version_changed(skill_name, version, comment)
        return (state.value,)

    async def _version_changed(self, skill_name: str, version: int, comment: str) -> None:
        await self.events.version_changed(await self.library.description(skill_name, version), caller().name, comment)

    @refusing(blame="Workstation")
    async def deploy(self, skill_name: str, version: int, workstation: str) -> tuple[Any, ...]:
        """Make a version the one that a workstation runs."""
        station = self._station(workstation)
        description = await self.library.description(skill_name, version)
        missing = set(description.required_atomic_skills) - station.atomic_skills
        if missing:
            raise Refused(Code.BadNotSupported, f"{workstation} lacks the atomic skill {', '.join(sorted(missing))}")
        await self.library.deploy(skill_name, description.version, workstation, caller().name)
        await self.events.deployment_changed(description, workstation, True, caller().name)
        return ("Deployed",)

    @refusing(blame="Workstation")
    async def withdraw(self, skill_name: str, version: int, workstation: str) -> tuple[Any, ...]:
        """Take a version off a workstation."""
        self._station(workstation)
        description = await self.library.description(skill_name, version)
        await self.library.withdraw(skill_name, description.version, workstation, caller().name)
        await self.events.deployment_changed(description, workstation, False, caller().name)
        return (description.state.value,)

    def _station(self, name: str) -> Any:
        station = self.jobs.stations.get(name)
        if station is None:
            raise NotFound("workstation", name)
        return station

    @refusing(blame="Format")
    async def export_skill(self, skill_name: str, version: int, format_name: str) -> tuple[Any, ...]:
        """Return a version as a document."""
        _check_format(format_name)
        return ((await self.library.description(skill_name, version)).to_json(),)

    @refusing(blame="Content")
    async def import_skill(self, content: str, format_name: str) -> tuple[Any, ...]:
        """Store a version from a document; it starts as Learned and has to be approved here."""
        _check_format(format_name)
        most = self.settings.limits.max_content
        if len(content) > most:
            raise Refused(Code.BadRequestTooLarge, f"the document has {len(content)} characters, {most} are allowed")
        read = await self.jobs.read_document(content, self.settings.limits.max_duration)
        if isinstance(read, DocumentRefused):
            raise out_of_range("Content", read.reason)
        description = read
        start = self.jobs.default_recipe(description.name)
        stored = await self.library.import_version(description, caller().name, start)
        await self.events.version_changed(stored, caller().name, "imported")
        return (stored.name, stored.version)

    @refusing(blame="Recipe", within="Recipe")
    async def put_recipe(self, given: Any) -> tuple[Any, ...]:
        """Store a recipe, new or changed."""
        checked = recipe(given)
        motion_parameters(checked)
        await self.library.put_recipe(checked, caller().name)
        return ()

    @refusing(blame="RecipeId")
    async def get_recipe(self, recipe_id: str) -> tuple[Any, ...]:
        """Return a recipe."""
        return (wire_recipe(await self.library.recipe(recipe_id)),)

    @refusing(blame="SkillName")
    async def list_recipes(self, skill_name: str) -> tuple[Any, ...]:
        """Return the recipes of a skill, or of all where none is named."""
        if skill_name:
            await self.library.description(skill_name)
        return ([wire_recipe(one) for one in await self.library.recipes(skill_name)],)

    @refusing(blame="RecipeId")
    async def delete_recipe(self, recipe_id: str) -> tuple[Any, ...]:
        """Forget a recipe."""
        await self.library.delete_recipe(recipe_id, caller().name)
        return ()

    @refusing(blame="JobId")
    async def get_job(self, job_id: str) -> tuple[Any, ...]:
        """Return the report of a learning job."""
        report = await self.library.job(job_id)
        if report.kind != "Learning":
            raise NotFound("job", job_id)
        progress = self.jobs.learning_progress(job_id)
        if progress is not None and report.state is JobState.RUNNING:
            report = report.model_copy(update={"progress": progress})
        return (wire_report(report),)


def _check_format(name: str) -> None:
    if name not in ("json", ""):
        raise out_of_range("Format", f"format {name!r} is not offered: json is")


def _check_indices(indices: list[int], samples: int, what: str) -> None:
    if len(indices) > samples:
        raise out_of_range("Indices", f"{what} has samples 0 to {samples - 1}, {len(indices)} were named")
    if max(indices) >= samples:
        raise out_of_range("Indices", f"{what} has samples 0 to {samples - 1}, {max(indices)} was named")


def _demonstration_results(received: ReceivedDemonstrations, verdicts: tuple[Verdict, ...]) -> list[ua.StatusCode]:
    by_id = {verdict.demonstration_id: verdict for verdict in verdicts}
    codes = []
    for name, fault in zip(received.ids, received.faults, strict=True):
        verdict = by_id.get(name)
        if fault:
            codes.append(Code.BadOutOfRange)
        elif verdict is None or verdict.kind is VerdictKind.USED:
            codes.append(Code.Good)
        elif verdict.kind is VerdictKind.USED_IN_PART:
            codes.append(Code.UncertainSubNormal)
        else:
            codes.append(VERDICT_CODES[verdict.fault])
    return [ua.StatusCode(code) for code in codes]


def _learning_words(
    received: ReceivedDemonstrations, verdicts: tuple[Verdict, ...], description: SkillDescription | None, state: str
) -> str:
    """Return the report as JSON: state, what became of each demonstration, and the quality of the path."""
    by_id = {verdict.demonstration_id: verdict for verdict in verdicts}
    demonstrations = []
    for name, fault in zip(received.ids, received.faults, strict=True):
        verdict = by_id.get(name)
        entry: dict[str, Any] = {
            "demonstrationId": name,
            "verdict": "left out" if fault else "pending",
            "reason": fault,
        }
        if verdict is not None:
            entry.update(verdict=verdict.kind.value, reason=verdict.reason, code=verdict.code)
            entry.update(place=verdict.place, size=verdict.size)
        demonstrations.append(entry)
    quality = description.report if description else {}
    return json.dumps({"state": state, "demonstrations": demonstrations, "quality": quality}, allow_nan=False)


def _wire_trajectory(path: Trajectory) -> tuple[Any, ...]:
    return (
        path.points.shape[1],
        flat(path.times),
        flat(path.points),
        flat(path.covariances),
        flat(path.dispense),
    )
