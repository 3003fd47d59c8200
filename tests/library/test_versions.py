"""Skill versions: stored whole, returned bit for bit, moved through their life, never changed."""

import asyncio
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from library.description import JobReport, JobState, Parameter, SkillDescription, VersionState
from library.errors import DigestDiffers, InUse, InvalidValue, NotAllowedInState, NotFound, OwnVersion
from library.recipe import Recipe
from library.store import SkillLibrary
from models.demonstration import Edits
from models.motion import Motion
from models.options import LearningOptions


def digest_of(description: SkillDescription) -> bytes:
    return bytes.fromhex(description.model_digest)


async def test_a_new_skill_is_stored_whole(library: SkillLibrary, teach: Any, make_demonstration: Any) -> None:
    edits = Edits(excluded=frozenset({"d9"}), struck={"d1": frozenset({3, 1})})
    options = LearningOptions(components=7, clock="path")
    stored = await teach(library, edits=edits, options=options, frame="plate")
    assert stored == await library.description("glue")
    assert (stored.version, stored.state, stored.frame) == (1, VersionState.LEARNED, "plate")
    assert stored.provenance.taught_by == "tina"
    assert [one.demonstration_id for one in stored.provenance.recordings] == ["d1", "d2"]
    assert [one.kind for one in stored.verdicts] == ["used", "used"]
    assert stored.report["path_error"] == {"rms": 0.0004, "max": 0.0011}
    assert stored.report["smoothness"] is None
    assert await library.edits("glue") == edits
    assert await library.options("glue") == options
    assert await library.default_recipe_id("glue") == "glue-default"
    assert [one.recipe_id for one in await library.recipes("glue")] == ["glue-default"]


async def test_recordings_come_back_untouched(library: SkillLibrary, teach: Any, make_demonstration: Any) -> None:
    given_recordings = [make_demonstration("d1"), make_demonstration("d2", dimension=2, samples=55)]
    await teach(library, recordings=given_recordings)
    for before, after in zip(given_recordings, await library.recordings("glue", 1), strict=True):
        assert before.points.tobytes() == after.points.tobytes()
        assert before.times.tobytes() == after.times.tobytes()
        assert np.array_equal(before.triggers, after.triggers)
        assert (before.demonstration_id, before.operator, before.source) == (
            "d" + after.demonstration_id[1:],
            "anna",
            "tracker 7",
        )
        assert before.recorded_at == after.recorded_at
    aligned = await library.aligned("glue", 1)
    assert [one.demonstration_id for one in aligned] == ["d1", "d2"]


async def test_orientations_come_back_too(library: SkillLibrary, teach: Any, make_demonstration: Any) -> None:
    from dataclasses import replace

    turned = [
        replace(make_demonstration(name), orientations=np.tile([0.0, 0.0, 0.6, 0.8], (40, 1))) for name in ("d1", "d2")
    ]
    await teach(library, recordings=turned)
    found = await library.recordings("glue")
    assert found[0].orientations is not None
    assert found[0].orientations.tobytes() == turned[0].orientations.tobytes()


async def test_versions_count_up_and_recordings_are_stored_once(
    library: SkillLibrary, teach: Any, make_motion: Any, database_file: Path
) -> None:
    import sqlite3

    for number in (1, 2, 3):
        stored = await teach(library, motion=make_motion(number), based_on=number - 1 or None)
        assert stored.version == number
    assert [one.version for one in await library.versions("glue")] == [3, 2, 1]
    assert (await library.description("glue", 2)).provenance.based_on == 1
    with sqlite3.connect(database_file) as plain:
        assert plain.execute("SELECT count(*) FROM recordings").fetchone() == (2,)
        assert plain.execute("SELECT count(*) FROM version_recordings").fetchone() == (6,)
    plain.close()


async def test_the_motion_out_of_the_library_is_the_learned_one_bit_for_bit(
    library: SkillLibrary, teach: Any, make_motion: Any
) -> None:
    motion: Motion = make_motion(5)
    await teach(library, motion=motion)
    stored = (await library.description("glue")).motion()
    assert stored.means.tobytes() == motion.means.tobytes()
    assert stored.covariances.tobytes() == motion.covariances.tobytes()
    assert (stored.duration, stored.time_step, stored.dispense) == (motion.duration, motion.time_step, motion.dispense)
    assert (stored.clock, stored.covariance_rule, stored.dimension) == ("path", "within", 2)


finite_floats = st.floats(allow_nan=False, allow_infinity=False)


@given(
    means=st.lists(st.tuples(*[finite_floats] * 4), min_size=1, max_size=3),
    duration=st.floats(min_value=1e-300, max_value=1e300, exclude_min=True),
    variances=st.tuples(*[st.floats(min_value=1e-300, max_value=1e150)] * 4),
)
@settings(deadline=None, max_examples=25)
def test_any_number_survives_the_database_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory,
    teach: Any,
    means: list[tuple[float, ...]],
    duration: float,
    variances: tuple[float, ...],
) -> None:
    motion = Motion(
        means=np.array(means),
        covariances=np.array([np.diag(variances)] * len(means)),
        clock="path",
        dimension=2,
        duration=duration,
        dispense=((0.0, 5e-324), (0.1, 0.30000000000000004)),
        time_step=duration,
        covariance_rule="paper",
    )

    async def there_and_back() -> SkillDescription:
        async with await SkillLibrary.open(tmp_path_factory.mktemp("bits") / "library.sqlite") as library:
            await teach(library, motion=motion)
            return await library.description("glue")

    stored = asyncio.run(there_and_back())
    assert stored.motion().means.tobytes() == motion.means.tobytes()
    assert stored.motion().covariances.tobytes() == motion.covariances.tobytes()
    assert struct.pack("<d", stored.duration) == struct.pack("<d", duration)
    again = SkillDescription.from_json(stored.to_json())
    assert again.motion().means.tobytes() == motion.means.tobytes()
    assert again == stored
    assert again.computed_digest() == stored.model_digest


async def test_learning_job_and_version_are_stored_together(library: SkillLibrary, teach: Any) -> None:
    await library.add_job(JobReport(job_id="l1", kind="Learning", skill_name="glue"))
    await library.move_job("l1", JobState.RUNNING)
    await teach(library, job_id="l1")
    job = await library.job("l1")
    assert (job.state, job.skill_version, job.progress) == (JobState.COMPLETED, 1, 1.0)
    assert job.end_time is not None


async def test_nothing_is_stored_when_the_job_was_stopped_meanwhile(library: SkillLibrary, teach: Any) -> None:
    await library.add_job(JobReport(job_id="l1", kind="Learning"))
    await library.move_job("l1", JobState.ABORTED)
    with pytest.raises(NotAllowedInState):
        await teach(library, job_id="l1")
    with pytest.raises(NotFound):
        await library.description("glue")
    assert await library.recipes() == []
    assert (await library.find())[0] == []


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"name": "a/b"}, "name"),
        ({"name": ""}, "name"),
        ({"name": "x" * 129}, "name"),
        ({"name": "tab\there"}, "name"),
        ({"semantic_type": "x\x00"}, "semantic_type"),
        ({"frame": "\ud800"}, "frame"),
        ({"required_atomic_skills": ("",)}, "required_atomic_skills"),
        ({"actor": "\ud8ff"}, "taught_by"),
    ],
)
async def test_text_that_a_client_could_not_get_back_is_refused_and_nothing_stored(
    library: SkillLibrary, teach: Any, changes: dict[str, Any], field: str
) -> None:
    with pytest.raises(InvalidValue) as refusal:
        await teach(library, **changes)
    assert refusal.value.field.startswith(field)
    assert (await library.find())[0] == []


async def test_two_demonstrations_with_one_id_are_refused(
    library: SkillLibrary, teach: Any, make_demonstration: Any
) -> None:
    with pytest.raises(InvalidValue, match="an id of its own"):
        await teach(library, recordings=[make_demonstration("d1"), make_demonstration("d1")])


async def test_a_version_based_on_one_that_does_not_exist_is_refused(library: SkillLibrary, teach: Any) -> None:
    await teach(library)
    with pytest.raises(NotFound, match="glue 4"):
        await teach(library, based_on=4)
    assert [one.version for one in await library.versions("glue")] == [1]


async def test_four_eyes_keep_the_teacher_from_approving(library: SkillLibrary, teach: Any) -> None:
    stored = await teach(library, actor="tina")
    with pytest.raises(OwnVersion, match="tina taught glue version 1"):
        await library.approve("glue", 1, digest_of(stored), "tina", "looks good")
    assert (await library.description("glue")).state is VersionState.LEARNED
    assert await library.approve("glue", 1, digest_of(stored), "erik", "looks good") is VersionState.APPROVED
    approval = (await library.description("glue")).approval
    assert approval is not None
    assert (approval.actor, approval.comment) == ("erik", "looks good")


async def test_without_four_eyes_the_teacher_may_approve(library: SkillLibrary, teach: Any) -> None:
    stored = await teach(library, actor="tina")
    assert await library.approve("glue", 1, digest_of(stored), "tina", four_eyes=False) is VersionState.APPROVED


async def test_an_approval_names_the_digest_of_what_is_stored(library: SkillLibrary, teach: Any) -> None:
    stored = await teach(library)
    for wrong in (b"", bytes(32), digest_of(stored)[:-1], digest_of(stored) + b"\0"):
        with pytest.raises(DigestDiffers):
            await library.approve("glue", 1, wrong, "erik")
        with pytest.raises(DigestDiffers):
            await library.reject("glue", 1, wrong, "erik")
    assert (await library.description("glue")).decisions == ()


async def test_a_decision_is_taken_once(library: SkillLibrary, teach: Any) -> None:
    stored = await teach(library)
    await library.reject("glue", 1, digest_of(stored), "erik", "kinks")
    with pytest.raises(NotAllowedInState, match="glue version 1 is Rejected"):
        await library.approve("glue", 1, digest_of(stored), "erik")
    assert [made.state for made in (await library.description("glue")).decisions] == [VersionState.REJECTED]


async def test_only_an_approved_version_is_deployed(library: SkillLibrary, teach: Any) -> None:
    await teach(library)
    with pytest.raises(NotAllowedInState, match="only one that is Approved can be deployed"):
        await library.deploy("glue", 1, "ws1", "erik")
    assert await library.deployed("glue", "ws1") is None


async def approved(library: SkillLibrary, teach: Any, make_motion: Any, count: int) -> None:
    for seed in range(count):
        stored = await teach(library, motion=make_motion(seed))
        await library.approve("glue", stored.version, digest_of(stored), "erik")


async def test_deploying_another_version_replaces_the_one_there(
    library: SkillLibrary, teach: Any, make_motion: Any
) -> None:
    await approved(library, teach, make_motion, 2)
    await library.deploy("glue", 1, "ws1", "erik")
    await library.deploy("glue", 1, "ws2", "erik")
    await library.deploy("glue", 2, "ws1", "erik")
    assert (await library.deployed("glue", "ws1"), await library.deployed("glue", "ws2")) == (2, 1)
    assert [one.version for one in await library.deployments("ws1")] == [2]
    assert (await library.description("glue", 1)).workstations == ("ws2",)


async def test_a_deployed_version_is_not_retired_before_it_is_withdrawn(
    library: SkillLibrary, teach: Any, make_motion: Any
) -> None:
    await approved(library, teach, make_motion, 1)
    await library.deploy("glue", 1, "ws1", "erik")
    with pytest.raises(InUse, match="deployed on ws1"):
        await library.retire("glue", 1, "erik", "worn out")
    await library.withdraw("glue", 1, "ws1", "erik")
    assert await library.deployments("ws1") == []
    assert await library.retire("glue", 1, "erik", "worn out") is VersionState.RETIRED
    with pytest.raises(NotAllowedInState):
        await library.deploy("glue", 1, "ws1", "erik")


async def test_what_is_not_deployed_cannot_be_withdrawn(library: SkillLibrary, teach: Any, make_motion: Any) -> None:
    await approved(library, teach, make_motion, 2)
    with pytest.raises(NotAllowedInState, match="not deployed on ws1"):
        await library.withdraw("glue", 0, "ws1", "erik")
    await library.deploy("glue", 2, "ws1", "erik")
    with pytest.raises(NotAllowedInState, match="glue version 1 is not deployed on ws1"):
        await library.withdraw("glue", 1, "ws1", "erik")
    assert await library.deployed("glue", "ws1") == 2


@pytest.mark.parametrize(
    "ask",
    [
        lambda library: library.description("nothing"),
        lambda library: library.description("glue", 2),
        lambda library: library.recordings("nothing"),
        lambda library: library.aligned("glue", 9),
        lambda library: library.edits("nothing"),
        lambda library: library.approve("nothing", 1, bytes(32), "erik"),
        lambda library: library.retire("glue", 2, "erik"),
        lambda library: library.deploy("nothing", 1, "ws1", "erik"),
        lambda library: library.withdraw("nothing", 1, "ws1", "erik"),
        lambda library: library.default_recipe_id("nothing"),
        lambda library: library.description("glue", -1),
    ],
)
async def test_what_does_not_exist_is_not_found(library: SkillLibrary, teach: Any, ask: Any) -> None:
    await teach(library)
    with pytest.raises(NotFound):
        await ask(library)


async def test_an_imported_version_starts_unapproved_and_its_importer_cannot_approve(
    library: SkillLibrary, teach: Any, tmp_path: Path
) -> None:
    stored = await teach(library, actor="tina")
    await library.approve("glue", 1, digest_of(stored), "erik")
    await library.deploy("glue", 1, "ws1", "erik")
    text = (await library.description("glue")).to_json()
    async with await SkillLibrary.open(tmp_path / "other.sqlite") as other:
        imported = await other.import_version(SkillDescription.from_json(text), "ingo")
        assert (imported.state, imported.version, imported.workstations) == (VersionState.LEARNED, 1, ())
        assert imported.model_digest == stored.model_digest
        assert imported.motion().means.tobytes() == stored.motion().means.tobytes()
        assert (imported.provenance.taught_by, imported.provenance.imported_by) == ("tina", "ingo")
        assert imported.summary.created_by == "ingo"
        assert await other.recordings("glue") == []
        assert await other.default_recipe_id("glue") == "glue-default"
        for teacher in ("ingo", "tina"):
            with pytest.raises(OwnVersion):
                await other.approve("glue", 1, digest_of(imported), teacher)
        await other.approve("glue", 1, digest_of(imported), "erik")
        again = await other.import_version(SkillDescription.from_json(text), "ingo")
        assert (again.version, again.state) == (2, VersionState.LEARNED)


async def test_an_import_whose_content_was_changed_is_refused(
    library: SkillLibrary, teach: Any, tmp_path: Path
) -> None:
    stored = await teach(library)
    first = stored.means[0]
    moved = stored.model_copy(update={"means": ((math.nextafter(first[0], 9.0), *first[1:]), *stored.means[1:])})
    relabelled = stored.model_copy(update={"semantic_type": "urn:example:Welding"})
    for forged in (moved, relabelled):
        with pytest.raises(DigestDiffers):
            await library.import_version(forged, "ingo")
    assert [one.version for one in await library.versions("glue")] == [1]


async def test_the_default_recipe_of_the_workstation_is_taken_under_an_id_of_the_librarys_choice(
    library: SkillLibrary, teach: Any
) -> None:
    wanted = Recipe(recipe_id="x", skill_name="x", time_step=0.004, frame=(0.3, 0.1, 0.02, 0.0, 0.0, 0.0, 1.0))
    await teach(library, name="bond", default_recipe=wanted)
    default = await library.recipe(await library.default_recipe_id("bond"))
    assert (default.skill_name, default.time_step, default.frame[0]) == ("bond", 0.004, 0.3)
    await library.put_recipe(Recipe(recipe_id="weld-default", skill_name="bond"), "erik")
    await teach(library, name="weld")
    assert await library.default_recipe_id("weld") == "weld-default-2"


async def test_a_skills_parameters_are_kept_with_unit_and_range(library: SkillLibrary, teach: Any) -> None:
    nozzle = Parameter(name="nozzle", description="which nozzle", default="fine")
    stored = await teach(library, parameters=(nozzle,))
    assert stored.parameters == (nozzle,)
    with pytest.raises(InvalidValue, match=r"pressure is 9\.0: it lies in 0 to 6 bar"):
        Parameter(name="pressure", unit="bar", default=9.0, minimum=0.0, maximum=6.0)


async def test_a_cancelled_call_leaves_the_library_usable(library: SkillLibrary, teach: Any, make_motion: Any) -> None:
    for seed in range(12):
        call = asyncio.ensure_future(teach(library, motion=make_motion(seed)))
        for _ in range(seed):
            await asyncio.sleep(0)
        call.cancel()
        with pytest.raises(asyncio.CancelledError):
            await call
    stored = await teach(library)
    found = await library.versions("glue")
    assert [one.version for one in found] == list(range(stored.version, 0, -1))
    for one in found:
        description = await library.description("glue", one.version)
        assert description.computed_digest() == one.model_digest
        assert len(await library.recordings("glue", one.version)) == 2
