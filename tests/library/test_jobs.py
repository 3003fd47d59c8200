"""Jobs and traces: every move in the database first, ends that stay ends."""

from itertools import product
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sql

from library.description import JobReport, JobState
from library.errors import AlreadyExists, Damaged, InUse, InvalidValue, NotAllowedInState, NotFound
from library.lifecycle import FINAL_JOB_STATES, NEXT_JOB_STATES
from library.recipe import Recipe
from library.records import Failure, JobTrace
from library.store import SkillLibrary

WAYS = {
    JobState.QUEUED: (),
    JobState.RUNNING: (JobState.RUNNING,),
    JobState.PAUSED: (JobState.RUNNING, JobState.PAUSED),
    JobState.STOPPING: (JobState.RUNNING, JobState.STOPPING),
    JobState.COMPLETED: (JobState.RUNNING, JobState.COMPLETED),
    JobState.FAILED: (JobState.FAILED,),
    JobState.ABORTED: (JobState.ABORTED,),
}


async def job_in(library: SkillLibrary, state: JobState, job_id: str, **fields: Any) -> None:
    await library.add_job(JobReport(job_id=job_id, kind="Execution", workstation="ws1", **fields))
    for step in WAYS[state]:
        await library.move_job(job_id, step)


async def test_the_library_moves_jobs_exactly_along_the_table(library: SkillLibrary) -> None:
    for number, (now, to) in enumerate(product(JobState, JobState)):
        job_id = f"j{number}"
        await job_in(library, now, job_id)
        if to in NEXT_JOB_STATES[now]:
            assert (await library.move_job(job_id, to)).state is to
            assert (await library.job(job_id)).state is to
            continue
        before = await library.job(job_id)
        with pytest.raises(NotAllowedInState):
            await library.move_job(job_id, to, message="should not be there")
        assert await library.job(job_id) == before


async def test_a_job_that_cannot_be_read_does_not_keep_the_others_from_coming(library: SkillLibrary) -> None:
    for name in ("j1", "j2", "j3"):
        await job_in(library, JobState.COMPLETED, name)
    spoil = sql.text("UPDATE jobs SET report = '[]', state = 'Wrong' WHERE job_id = 'j2'")
    await library._database.write(lambda connection: connection.execute(spoil).close())
    found = await library.jobs(workstation="ws1")
    assert [(one.job_id, one.state, one.failure) for one in found] == [
        ("j3", JobState.COMPLETED, Failure.NONE),
        ("j2", JobState.FAILED, Failure.INTERNAL),
        ("j1", JobState.COMPLETED, Failure.NONE),
    ]
    assert "job j2" in found[1].message
    assert [one.job_id for one in await library.jobs(workstation="ws1", limit=1)] == ["j3"]
    with pytest.raises(Damaged, match="job j2"):
        await library.job("j2")
    every = sql.text("UPDATE jobs SET report = '[]'")
    await library._database.write(lambda connection: connection.execute(every).close())
    with pytest.raises(Damaged, match="list of jobs"):
        await library.jobs(workstation="ws1", limit=1)


async def test_a_job_keeps_what_it_is_told_on_the_way(library: SkillLibrary) -> None:
    await job_in(library, JobState.RUNNING, "j1", skill_name="glue", skill_version=2, actor="otto", mode="test")
    started = (await library.job("j1")).start_time
    done = await library.move_job(
        "j1",
        JobState.COMPLETED,
        path_error=(0.0001, 0.0002),
        tracking_error=(0.00001, 0.00005),
        samples=1234,
        message="done",
    )
    assert done == await library.job("j1")
    assert (done.path_error, done.tracking_error, done.samples) == ((0.0001, 0.0002), (0.00001, 0.00005), 1234)
    assert (done.actor, done.mode, done.skill_version, done.progress) == ("otto", "test", 2, 1.0)
    assert started is not None
    assert done.end_time is not None
    assert done.end_time >= started == done.start_time


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "Learning"},
        {"skill_name": "other"},
        {"state": JobState.ABORTED},
        {"samples": -1},
        {"progress": 2.0},
        {"path_error": (float("nan"), 0.0)},
        {"failure": "Bored"},
    ],
)
async def test_a_job_takes_no_nonsense(library: SkillLibrary, fields: dict[str, Any]) -> None:
    await job_in(library, JobState.QUEUED, "j1")
    with pytest.raises(InvalidValue):
        await library.move_job("j1", JobState.RUNNING, **fields)
    assert (await library.job("j1")).state is JobState.QUEUED


async def test_a_job_id_is_used_once(library: SkillLibrary) -> None:
    await job_in(library, JobState.QUEUED, "j1")
    with pytest.raises(AlreadyExists):
        await job_in(library, JobState.QUEUED, "j1")


async def test_progress_that_comes_after_the_end_changes_nothing(library: SkillLibrary) -> None:
    await job_in(library, JobState.RUNNING, "j1")
    await library.set_progress("j1", 0.25)
    assert (await library.job("j1")).progress == 0.25
    await library.move_job("j1", JobState.FAILED, failure=Failure.TIMEOUT)
    assert (await library.job("j1")).progress == 0.25
    await library.set_progress("j1", 0.5)
    assert (await library.job("j1")).progress == 0.25
    with pytest.raises(NotFound):
        await library.set_progress("j2", 0.5)
    with pytest.raises(InvalidValue):
        await library.set_progress("j1", 1.5)


async def test_at_start_every_unfinished_job_is_interrupted_and_no_other(library: SkillLibrary) -> None:
    for state in JobState:
        await job_in(library, state, f"j-{state.value}")
    ended = {state: await library.job(f"j-{state.value}") for state in FINAL_JOB_STATES}
    interrupted = await library.interrupt_unfinished()
    assert {one.job_id for one in interrupted} == {f"j-{s.value}" for s in set(JobState) - FINAL_JOB_STATES}
    for one in interrupted:
        assert (one.state, one.failure) == (JobState.FAILED, Failure.INTERRUPTED)
        assert await library.job(one.job_id) == one
    for state, before in ended.items():
        assert await library.job(f"j-{state.value}") == before
    assert await library.interrupt_unfinished() == []


async def test_jobs_are_listed_newest_first_by_state_and_workstation(library: SkillLibrary) -> None:
    for number in range(5):
        await job_in(library, JobState.RUNNING if number % 2 else JobState.QUEUED, f"j{number}")
    await library.add_job(JobReport(job_id="learn", kind="Learning"))
    assert [one.job_id for one in await library.jobs()] == ["learn", "j4", "j3", "j2", "j1", "j0"]
    assert [one.job_id for one in await library.jobs("Running")] == ["j3", "j1"]
    assert [one.job_id for one in await library.jobs(workstation="ws1", limit=2)] == ["j4", "j3"]
    for wrong in ({"state": "Sleeping"}, {"limit": -1}, {"limit": 1001}):
        with pytest.raises(InvalidValue):
            await library.jobs(**wrong)


async def test_a_job_keeps_the_recipe_it_was_given(library: SkillLibrary, teach: Any) -> None:
    await teach(library)
    recipe = Recipe(recipe_id="r1", skill_name="glue", time_step=0.004)
    await library.put_recipe(recipe, "erik")
    await job_in(library, JobState.QUEUED, "j1", skill_name="glue", recipe_id="r1")
    await library.put_recipe(recipe.model_copy(update={"time_step": 0.02}), "erik")
    assert await library.job_recipe("j1") == recipe
    assert (await library.recipe("r1")).time_step == 0.02
    with pytest.raises(InUse, match="by job j1"):
        await library.delete_recipe("r1", "erik")
    await library.move_job("j1", JobState.ABORTED)
    await library.delete_recipe("r1", "erik")
    assert await library.job_recipe("j1") == recipe
    with pytest.raises(NotFound):
        await job_in(library, JobState.QUEUED, "j2", recipe_id="r1")


async def test_a_trace_comes_back_bit_for_bit_and_is_stored_once(library: SkillLibrary) -> None:
    await job_in(library, JobState.RUNNING, "j1")
    generator = np.random.default_rng(1)
    trace = JobTrace(
        times=np.arange(50) * 0.004,
        commanded=generator.normal(size=(50, 3)),
        measured=np.where(generator.random((50, 3)) < 0.1, np.nan, generator.normal(size=(50, 3))),
        columns=("x_m", "y_m", "z_m"),
    )
    await library.save_trace("j1", trace)
    found = await library.trace("j1")
    for part in ("times", "commanded", "measured"):
        assert getattr(found, part).tobytes() == getattr(trace, part).tobytes()
    assert found.columns == trace.columns
    with pytest.raises(AlreadyExists):
        await library.save_trace("j1", trace)
    await job_in(library, JobState.RUNNING, "j2")
    with pytest.raises(NotFound, match="trace 'j2'"):
        await library.trace("j2")
    with pytest.raises(NotFound, match="job 'j3'"):
        await library.save_trace("j3", trace)
    with pytest.raises(InvalidValue, match="times by columns"):
        await library.save_trace("j2", JobTrace(trace.times, trace.commanded[:-1], trace.measured, trace.columns))
