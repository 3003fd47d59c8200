"""Jobs: every state they pass through reaches the database first; what a run measured is kept as blobs."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import sqlalchemy as sql

from library.errors import AlreadyExists, Damaged, InvalidValue, NotFound
from library.lifecycle import FINAL_JOB_STATES, JobState, check_job_move
from library.queries import recipes, stations
from library.queries.encoding import pack, stored, to_text, unpack
from library.recipe import Recipe
from library.records import Cause, Failure, JobReport, JobTrace
from library.tables import jobs, traces
from library.values import now

MAX_LIMIT = 1000
_MAY_CHANGE = frozenset(
    {
        "progress",
        "skill_version",
        "start_time",
        "end_time",
        "failure",
        "message",
        "path_error",
        "tracking_error",
        "samples",
        "cause",
        "path_phase",
        "place",
        "held_queue",
        "paused_from",
        "paused_until",
    }
)


def add(connection: sql.Connection, report: JobReport, recipe: Recipe | None = None, server: str = "") -> None:
    """Store a new job, with its recipe as it is now: what is changed later does not change what this job ran."""
    if connection.scalar(sql.select(jobs.c.number).where(jobs.c.job_id == report.job_id)) is not None:
        raise AlreadyExists("job", report.job_id)
    if recipe is None and report.recipe_id:
        recipe = recipes.read(connection, report.recipe_id)
    connection.execute(
        jobs.insert().values(
            job_id=report.job_id,
            state=report.state.value,
            workstation=report.workstation,
            skill_name=report.skill_name,
            recipe_id=report.recipe_id,
            progress=report.progress,
            report=report.to_json(),
            recipe="" if recipe is None else recipe.to_json(),
            server=server,
        )
    )


def read(connection: sql.Connection, job_id: str) -> JobReport:
    """Return a job as it is now."""
    row = connection.execute(sql.select(jobs).where(jobs.c.job_id == job_id)).one_or_none()
    if row is None:
        raise NotFound("job", job_id)
    return _report(row)


def read_recipe(connection: sql.Connection, job_id: str) -> Recipe | None:
    """Return the recipe of a job as it was when the job was added; None if it has none."""
    read(connection, job_id)
    content = connection.scalar(sql.select(jobs.c.recipe).where(jobs.c.job_id == job_id))
    with stored(f"the recipe of job {job_id}"):
        return Recipe.from_json(content) if content else None


def move(connection: sql.Connection, job_id: str, to: JobState, changes: dict[str, Any]) -> JobReport:
    """Move a job to state ``to``, change the fields named and return what it is now. Times set themselves."""
    unknown = sorted(set(changes) - _MAY_CHANGE)
    if unknown:
        raise InvalidValue("field", unknown[0], f"of a job only {', '.join(sorted(_MAY_CHANGE))} may change")
    before = read(connection, job_id)
    check_job_move(f"job {job_id}", before.state, to)
    automatic: dict[str, Any] = {"state": to}
    if to is JobState.RUNNING and before.start_time is None:
        automatic["start_time"] = now()
    if to in FINAL_JOB_STATES:
        automatic["end_time"] = now()
    if to is JobState.COMPLETED:
        automatic["progress"] = 1.0
    after = _in_order(JobReport(**{**before.model_dump(), **automatic, **changes}))
    connection.execute(
        jobs.update()
        .where(jobs.c.job_id == job_id)
        .values(state=to.value, progress=after.progress, report=after.to_json())
    )
    return after


def _in_order(report: JobReport) -> JobReport:
    """Return the report with an end that is not before its start, whatever was done to the clock meanwhile."""
    if report.start_time is None or report.end_time is None or report.end_time >= report.start_time:
        return report
    return report.model_copy(update={"end_time": report.start_time})


def set_progress(connection: sql.Connection, job_id: str, progress: float) -> None:
    """Note how far a job has come, 0 to 1. One that has ended keeps its last: news may arrive late."""
    if not 0.0 <= progress <= 1.0:
        raise InvalidValue("progress", progress, "it lies in 0 to 1")
    changed = connection.execute(
        jobs.update().where(jobs.c.job_id == job_id, jobs.c.state.not_in(FINAL_JOB_STATES)).values(progress=progress)
    )
    if not changed.rowcount:
        read(connection, job_id)


def newest(connection: sql.Connection, state: str, workstation: str, limit: int) -> list[JobReport]:
    """Return the newest jobs, the newest first; "" fits any state or workstation.

    One that cannot be read comes as what its row still says. Where none of them all can be, Damaged is raised.
    """
    if state and state not in set(JobState):
        raise InvalidValue("state", state, f"it is one of {', '.join(JobState)}, or empty for any")
    if not 0 <= limit <= MAX_LIMIT:
        raise InvalidValue("limit", limit, f"it is at most {MAX_LIMIT}; 0 stands for 100")
    query = sql.select(jobs).order_by(jobs.c.number.desc())
    if state:
        query = query.where(jobs.c.state == state)
    if workstation:
        query = query.where(jobs.c.workstation == workstation)
    found = [_report_or_damage(row) for row in connection.execute(query.limit(limit or 100))]
    if found and not any(readable for _, readable in found):
        everywhere = [_report_or_damage(row) for row in connection.execute(query.limit(MAX_LIMIT))]
        if not any(readable for _, readable in everywhere):
            raise Damaged("the list of jobs", found[0][0].message)
    return [report for report, _ in found]


def interrupt_unfinished(
    connection: sql.Connection, server: str = "", workstations: Sequence[str] = ()
) -> list[JobReport]:
    """Fail every job that has not ended, because nobody works on it any more; return them, the oldest first.

    With ``server`` only its own, and those of the ``workstations`` that are its now: others go on working on theirs.

    In the same transaction the queues of the arms they were for are held: a person has to look before anything moves.
    One that cannot be read any more is failed too, and holds the queue of its workstation: it may have moved the arm.
    """
    query = sql.select(jobs).where(jobs.c.state.not_in(FINAL_JOB_STATES)).order_by(jobs.c.number)
    if server:
        query = query.where(jobs.c.server.in_((server, "")) | jobs.c.workstation.in_(workstations))
    found: list[JobReport] = []
    to_look_at: set[str] = set()
    for row in connection.execute(query).all():
        try:
            report = _report(row)
        except Damaged:
            connection.execute(jobs.update().where(jobs.c.number == row.number).values(state=JobState.FAILED.value))
            to_look_at.add(row.workstation)
            continue
        found.append(report)
        if moves_an_arm(report):
            to_look_at.add(report.workstation)
    for workstation in to_look_at - {""}:
        stations.hold(connection, workstation, Cause.UNFINISHED_AT_START, "server")
    return [
        move(
            connection,
            report.job_id,
            JobState.FAILED,
            {
                "failure": Failure.INTERRUPTED,
                "cause": Cause.UNFINISHED_AT_START,
                "held_queue": moves_an_arm(report),
                "message": f"the server stopped while the job was {report.state.value}: start it again if wanted",
            },
        )
        for report in found
    ]


def moves_an_arm(report: JobReport) -> bool:
    """Return whether a job is one that moves an arm, not a simulation beside it and not learning."""
    return report.kind == "Execution" and report.mode != "simulation" and bool(report.workstation)


def pack_trace(job_id: str, trace: JobTrace) -> dict[str, Any]:
    """Return a trace as a row, or raise InvalidValue if its parts do not fit together."""
    shape = (len(trace.times), len(trace.columns))
    for name, array in (("commanded", trace.commanded), ("measured", trace.measured)):
        if array.shape != shape:
            raise InvalidValue(name, array.shape, f"its shape is {shape}: times by columns")
    return {
        "job_id": job_id,
        "columns": to_text(trace.columns),
        "times": pack(np.asarray(trace.times, dtype=np.float64)),
        "commanded": pack(np.asarray(trace.commanded, dtype=np.float64)),
        "measured": pack(np.asarray(trace.measured, dtype=np.float64)),
    }


def unpack_trace(row: Any) -> JobTrace:
    """Return the trace of a row."""
    with stored(f"the trace of job {row.job_id}"):
        return JobTrace(
            times=unpack(row.times, np.float64),
            commanded=unpack(row.commanded, np.float64),
            measured=unpack(row.measured, np.float64),
            columns=tuple(json.loads(row.columns)),
        )


def save_trace(connection: sql.Connection, job_id: str, row: dict[str, Any]) -> None:
    """Store what a job commanded and measured; once."""
    read(connection, job_id)
    if connection.scalar(sql.select(traces.c.job_id).where(traces.c.job_id == job_id)) is not None:
        raise AlreadyExists("trace", job_id, "a job has one")
    connection.execute(traces.insert().values(row))


def trace_row(connection: sql.Connection, job_id: str) -> sql.Row[Any]:
    """Return the row of a job's trace."""
    read(connection, job_id)
    row = connection.execute(sql.select(traces).where(traces.c.job_id == job_id)).one_or_none()
    if row is None:
        raise NotFound("trace", job_id)
    return row


def _report_or_damage(row: Any) -> tuple[JobReport, bool]:
    """Return a job, or for one that cannot be read what its row still says; and whether it can."""
    try:
        return _report(row), True
    except Damaged as damage:
        told = JobReport(
            job_id=row.job_id,
            kind="Execution" if row.workstation else "Learning",
            workstation=row.workstation,
            skill_name=row.skill_name,
            recipe_id=row.recipe_id,
            state=JobState(row.state) if row.state in set(JobState) else JobState.FAILED,
            failure=Failure.INTERNAL,
            message=str(damage),
        )
        return told, False


def _report(row: Any) -> JobReport:
    with stored(f"job {row.job_id}"):
        report = JobReport.from_json(row.report)
        return report.model_copy(update={"state": JobState(row.state), "progress": row.progress})
