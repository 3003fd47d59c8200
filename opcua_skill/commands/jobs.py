"""`run` and `jobs …`: motions on a workstation, and what became of them."""

import csv
from collections.abc import Awaitable, Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from opcua_skill.client import JobReport, JobTrace, Refused, SkillClient, Workstation
from opcua_skill.commands.options.client import (
    DEFAULT_SERVER,
    Comment,
    Json,
    On,
    Output,
    Server,
    User,
    with_client,
)
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import counted, millimetres, notes, print_json, say, show_table, table, when

app = typer.Typer(no_args_is_help=True, help="Jobs: look, pause, resume, abort, read the trace.")
JobId = Annotated[str, typer.Argument(metavar="ID", help="id of the job")]


class RunMode(StrEnum):
    """Where a run takes place: beside the arm, on it slowly, or on it."""

    SIMULATION = "simulation"
    TEST = "test"
    PRODUCTION = "production"


def run(
    skill: Annotated[str, typer.Argument(metavar="SKILL", help="name of the skill")],
    on: On,
    recipe: Annotated[str, typer.Option("--recipe", metavar="ID", help="recipe; else the skill's default")] = "",
    mode: Annotated[RunMode, typer.Option(help="simulation moves nothing, test moves slowly")] = RunMode.SIMULATION,
    follow: Annotated[bool, typer.Option("--follow", help="wait for the end and show progress")] = False,
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Queue a run of a skill on a workstation."""

    async def work(client: SkillClient) -> JobReport:
        workstation = client.workstation(on)
        started = await workstation.execute(skill, recipe_id=recipe, mode=mode.value)
        if not follow:
            return await workstation.job(started.job_id)
        with Progress(TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=notes) as bar:
            task = bar.add_task(started.state, total=1.0)
            return await client.follow(
                started.job_id,
                on=on,
                limit=24 * 3600.0,
                on_progress=lambda job: bar.update(task, completed=job.progress, description=job.state),
            )

    report = with_client(server, user, work)
    tell(report, as_json)
    if report.state in {"Failed", "Aborted"}:
        raise Fault(f"job {report.job_id} ended {report.state}: {report.message or report.failure.value}")


def tell(report: JobReport, as_json: bool) -> None:
    """Print a job report."""
    if as_json:
        print_json(report)
        return
    rows = [
        ("state", f"{report.state}, {report.progress:.0%}"),
        ("skill", f"{report.skill_name} version {report.skill_version}"),
        ("recipe", report.recipe_id),
        ("mode", report.mode),
        ("start", when(report.start_time)),
        ("end", when(report.end_time)),
        ("failure", report.failure.value),
        ("message", report.message),
        ("time steps", report.samples),
        ("path error, mm (RMS, max)", " ".join(millimetres(value) for value in report.path_error)),
        ("tracking error, mm (RMS, max)", " ".join(millimetres(value) for value in report.tracking_error)),
    ]
    show_table(table(f"{report.kind} job {report.job_id}", ("what", "value"), rows))


@app.command("list")
def list_jobs(
    on: On,
    state: Annotated[str, typer.Option(help="only in this state")] = "",
    limit: Annotated[int, typer.Option(min=1, help="at most so many, newest first")] = 100,
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """List the jobs of a workstation, newest first."""
    found = with_client(server, user, lambda client: client.workstation(on).jobs(state, limit))
    if as_json:
        print_json(found)
        return
    rows = [
        (
            one.job_id,
            one.kind,
            one.state,
            f"{one.skill_name}@{one.skill_version}",
            one.recipe_id,
            one.mode,
            when(one.start_time),
        )
        for one in found
    ]
    show_table(table("", ("=job", "kind", "state", "skill", "recipe", "mode", "start"), rows))


async def find_place(client: SkillClient, job_id: str) -> tuple[Workstation | None, JobReport]:
    """Return where a job belongs: the library (None) or one of the workstations."""
    try:
        return None, await client.job(job_id)
    except Refused as refusal:
        if refusal.status != "BadNotFound":
            raise
    for name in await client.workstations():
        try:
            return client.workstation(name), await client.workstation(name).job(job_id)
        except Refused as refusal:
            if refusal.status != "BadNotFound":
                raise
    raise Fault(f"there is no job {job_id} (argument ID)")


@app.command()
def show(job_id: JobId, server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False) -> None:
    """Show a job's report, of learning or of motion."""

    async def work(client: SkillClient) -> JobReport:
        return (await find_place(client, job_id))[1]

    tell(with_client(server, user, work), as_json)


def _steer(job_id: str, server: str, user: str, as_json: bool, act: Callable[[Workstation], Awaitable[str]]) -> None:
    async def work(client: SkillClient) -> str:
        workstation, report = await find_place(client, job_id)
        if workstation is None:
            raise Fault(f"job {job_id} is a {report.kind.lower()} job: only motions can be paused, resumed or aborted")
        return await act(workstation)

    state = with_client(server, user, work)
    if as_json:
        print_json({"job_id": job_id, "state": state})
    else:
        say(f"job {job_id} is {state}")


@app.command()
def pause(
    job_id: JobId, comment: Comment = "", server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False
) -> None:
    """Pause a motion."""
    _steer(job_id, server, user, as_json, lambda workstation: workstation.pause(job_id, comment))


@app.command()
def resume(
    job_id: JobId, comment: Comment = "", server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False
) -> None:
    """Resume a paused motion."""
    _steer(job_id, server, user, as_json, lambda workstation: workstation.resume(job_id, comment))


@app.command()
def abort(
    job_id: JobId, comment: Comment = "", server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False
) -> None:
    """Abort a job: the arm stops, and the job ends once it is at rest. Not an emergency stop."""
    _steer(job_id, server, user, as_json, lambda workstation: workstation.abort(job_id, comment))


@app.command()
def trace(
    job_id: JobId, output: Output, server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False
) -> None:
    """Write what was commanded and measured at the nozzle to a CSV file, in s and mm."""

    async def work(client: SkillClient) -> JobTrace:
        workstation, report = await find_place(client, job_id)
        if workstation is None:
            raise Fault(f"job {job_id} is a {report.kind.lower()} job: it moved nothing")
        return await workstation.trace(job_id)

    found = with_client(server, user, work)
    write_trace(output, found)
    if as_json:
        print_json({"file": output, "samples": len(found.times)})
    else:
        say(f"wrote {output}: {counted(len(found.times), 'sample')}")


def write_trace(file: Path, found: JobTrace) -> None:
    """Write a trace as CSV, one row a sample."""
    axes = "xyz"[: found.commanded.shape[1]]
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["t_s", *(f"commanded_{axis}_mm" for axis in axes), *(f"measured_{axis}_mm" for axis in axes)])
        for at, commanded, measured in zip(found.times, found.commanded, found.measured, strict=True):
            writer.writerow([f"{at:.6f}", *(f"{value * 1000:.6f}" for value in (*commanded, *measured))])
