"""A learned motion becomes a version: recordings, model, aligned demonstrations, recipe and job, all or nothing."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import sqlalchemy as sql

from library.description import (
    DescribedVerdict,
    Parameter,
    Provenance,
    RecordingReference,
    SkillDescription,
)
from library.errors import DigestDiffers, InvalidValue
from library.lifecycle import JobState, VersionState
from library.queries import contributors, jobs, recipes, recordings, versions
from library.queries.encoding import PackedRecording, finite, pack_aligned, pack_recording
from library.recipe import Recipe
from library.values import check_name, now
from models.demonstration import Demonstration, Edits
from models.options import LearningOptions
from models.report import LearnedMotion


@dataclass(frozen=True, slots=True)
class PreparedVersion:
    """A version ready to be stored, all but its number: ``description.version`` is given in the transaction."""

    description: SkillDescription
    recordings: tuple[PackedRecording, ...]
    aligned: tuple[dict[str, Any], ...]
    brought_by: tuple[str, ...] = ()


def prepare(
    *,
    name: str,
    semantic_type: str,
    required_atomic_skills: Sequence[str],
    demonstrations: Sequence[Demonstration],
    edits: Edits,
    options: LearningOptions,
    learned: LearnedMotion,
    actor: str,
    based_on: int | None,
    parameters: Sequence[Parameter],
    frame: str,
    brought_by: Sequence[str] = (),
) -> PreparedVersion:
    """Return what is to be stored of a learned motion. No database here: packing megabytes belongs in a thread."""
    name = check_name(name, "name")
    ids = [demonstration.demonstration_id for demonstration in demonstrations]
    twice = next((one for one in ids if ids.count(one) > 1), None)
    if twice is not None:
        raise InvalidValue("demonstration_id", twice, "each demonstration has an id of its own")
    packed = tuple(pack_recording(demonstration) for demonstration in demonstrations)
    motion = learned.motion
    description = SkillDescription(
        name=name,
        version=1,
        semantic_type=semantic_type,
        state=VersionState.LEARNED,
        model_digest="0" * 64,
        required_atomic_skills=tuple(required_atomic_skills),
        dimension=motion.dimension,
        frame=frame,
        clock=motion.clock,
        duration=motion.duration,
        time_step=motion.time_step,
        covariance_rule=motion.covariance_rule,
        means=motion.means.tolist(),
        covariances=motion.covariances.tolist(),
        dispense=motion.dispense,
        parameters=tuple(parameters),
        provenance=Provenance(
            taught_by=actor,
            taught_at=now(),
            recordings=tuple(_reference(*pair) for pair in zip(demonstrations, packed, strict=True)),
            excluded=tuple(sorted(edits.excluded)),
            struck={key: tuple(sorted(indices)) for key, indices in sorted(edits.struck.items())},
            options=asdict(options),
            based_on=based_on,
        ),
        report=finite(learned.report.as_dict()),
        verdicts=tuple(DescribedVerdict(**finite(asdict(verdict))) for verdict in learned.verdicts),
    )
    description = description.model_copy(update={"model_digest": description.computed_digest()})
    return PreparedVersion(
        description, packed, tuple(pack_aligned(aligned) for aligned in learned.aligned), tuple(brought_by)
    )


def add(
    connection: sql.Connection, prepared: PreparedVersion, actor: str, job_id: str | None, default_recipe: Recipe | None
) -> SkillDescription:
    """Store the version under its skill's next number; a new skill gets its default recipe, the job is Completed."""
    name = prepared.description.name
    based_on = prepared.description.provenance.based_on
    if based_on is not None:
        versions.number(connection, name, based_on)
    digests = [one.digest for one in prepared.recordings]
    people = contributors.of_learned(connection, prepared.description, actor, prepared.brought_by, digests)
    described = prepared.description.model_copy(update={"contributors": people})
    version = _add_numbered(connection, described, actor, default_recipe)
    recordings.keep(connection, prepared.recordings, name, version)
    versions.insert_aligned(connection, prepared.aligned, name, version)
    if job_id is not None:
        jobs.move(connection, job_id, JobState.COMPLETED, {"skill_version": version})
    return versions.read(connection, name, version)


def add_imported(
    connection: sql.Connection, description: SkillDescription, actor: str, default_recipe: Recipe | None
) -> SkillDescription:
    """Store a version from another library as a new, unapproved one; its recordings stayed where they were made."""
    if description.computed_digest() != description.model_digest:
        raise DigestDiffers(description.name, description.version)
    provenance = description.provenance.model_copy(
        update={"imported_by": actor, "imported_at": now(), "based_on": None}
    )
    people, needed = contributors.of_imported(connection, description, actor)
    fresh: dict[str, Any] = {"state": VersionState.LEARNED, "decisions": (), "workstations": ()}
    fresh |= {"provenance": provenance, "contributors": people, "approvals_needed": needed}
    version = _add_numbered(connection, description.model_copy(update=fresh), actor, default_recipe)
    return versions.read(connection, description.name, version)


def edits_of(description: SkillDescription) -> Edits:
    """Return the edits a version was learned with."""
    provenance = description.provenance
    struck = {key: frozenset(indices) for key, indices in provenance.struck.items()}
    return replace(Edits(), excluded=frozenset(provenance.excluded), struck=struck)


def options_of(description: SkillDescription) -> LearningOptions:
    """Return the options a version was learned with."""
    options: dict[str, Any] = dict(description.provenance.options)
    try:
        return LearningOptions(**options)
    except TypeError as error:
        raise InvalidValue("options", options, "they are not options this program knows") from error


def _add_numbered(
    connection: sql.Connection, description: SkillDescription, actor: str, default_recipe: Recipe | None
) -> int:
    name = description.name
    latest = versions.newest(connection, name)
    numbered = description.model_copy(update={"version": latest + 1})
    if latest:
        versions.insert(connection, numbered)
        return latest + 1
    recipe_id = recipes.free_id(connection, name)
    versions.add_skill(connection, name, actor, recipe_id)
    versions.insert(connection, numbered)
    recipe = default_recipe or Recipe(recipe_id=recipe_id, skill_name=name)
    own = recipe.model_copy(update={"recipe_id": recipe_id, "skill_name": name, "skill_version": 0})
    recipes.put(connection, own, actor)
    return 1


def _reference(demonstration: Demonstration, packed: PackedRecording) -> RecordingReference:
    return RecordingReference(
        demonstration_id=demonstration.demonstration_id,
        operator=demonstration.operator,
        source=demonstration.source,
        recorded_at=demonstration.recorded_at,
        digest=packed.digest,
    )
