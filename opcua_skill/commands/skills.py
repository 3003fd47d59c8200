"""`learn` and `skills …`: from files to a version, and through its life."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from opcua_skill.client import Learned, LearningOptions, Refused, Skill, SkillClient
from opcua_skill.commands.options.client import (
    DEFAULT_SERVER,
    Comment,
    Json,
    On,
    Output,
    Server,
    User,
    Version,
    with_client,
)
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.fields import made_of
from opcua_skill.commands.terminal.output import counted, note, notes, print_json, say, show_table, table, when
from opcua_skill.commands.terminal.quality import facts
from opcua_skill.commands.terminal.reading import (
    Marker,
    OnePlane,
    Placing,
    Topic,
    ToPlate,
    Unit,
    UpAxis,
    choices_of,
    read_files,
)

app = typer.Typer(no_args_is_help=True, help="Skills of the library: look, approve, deploy, exchange.")
SkillName = Annotated[str, typer.Argument(metavar="SKILL", help="name of the skill")]
SemanticType = Annotated[str, typer.Option("--type", help="semantic type, e.g. Gluing; a known skill keeps its own")]
Option = Annotated[list[str] | None, typer.Option("--option", metavar="K=V", help="learning option, repeatable")]
FORMATS = {".json": "json", ".aml": "aml", ".aas": "aas"}


def learning_options(given: list[str]) -> LearningOptions:
    """Return options from ``key=value`` words; wrong ones are a usage error that names the key."""
    for word in given:
        if "=" not in word:
            raise typer.BadParameter(f"{word!r} is not KEY=VALUE", param_hint="--option")
    pairs = {key: value for key, _, value in (word.partition("=") for word in given)}
    try:
        return made_of(LearningOptions, pairs)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--option") from None


def learn(
    skill: SkillName,
    files: Annotated[list[Path], typer.Argument(exists=True, help="files of demonstrations, or folders of ROS 2 bags")],
    semantic_type: SemanticType = "",
    option: Option = None,
    marker: Marker = "",
    unit: Unit = "",
    up_axis: UpAxis = "",
    topic: Topic = "",
    plane: OnePlane = False,
    to_plate: ToPlate = False,
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Send files of human demonstrations to the server, which learns a skill version from them."""
    options = learning_options(option or [])
    choices = choices_of(marker, unit, up_axis, topic)
    demonstrations = read_files(files, choices, Placing(plane=plane, fit_to_plate=to_plate))

    async def work(client: SkillClient) -> tuple[Learned, Skill]:
        kind = semantic_type or await known_type(client, skill)
        learned = await client.learn(skill, demonstrations, semantic_type=kind, options=options)
        return learned, await made_of_it(client, skill, learned)

    learned, made = with_client(server, user, work)
    if as_json:
        results = dict(zip((one.demonstration_id for one in demonstrations), learned.results, strict=False))
        print_json({**summary(made), "job_id": learned.job_id, "results": results, "report": made.report})
        return
    say_learned(made)


async def made_of_it(client: SkillClient, skill: str, learned: Learned) -> Skill:
    """Return the version that was learned, once it is; shows how far the job has come."""
    version = learned.version
    if learned.state != "Completed":
        with Progress(TextColumn("learning"), BarColumn(), TimeElapsedColumn(), console=notes) as bar:
            task = bar.add_task("", total=1.0)
            report = await client.follow(
                learned.job_id, on_progress=lambda job: bar.update(task, completed=job.progress)
            )
        if report.state != "Completed":
            raise Fault(f"learning {skill} ended {report.state}: {report.message or report.failure}")
        version = report.skill_version
    return await client.skill(skill, version)


def say_learned(made: Skill) -> None:
    """Tell what became of each demonstration, and what was made of them."""
    show_table(verdict_table(made))
    show_table(table("quality", ("what", "value"), facts(made.report)))
    digest = made.model_digest.hex()[:16]
    say(
        f"{made.name} version {made.version} is {made.state}: {counted(len(made.means), 'component')}, digest {digest}…"
    )


async def known_type(client: SkillClient, skill: str) -> str:
    """Return the semantic type the skill has already, empty for a new one."""
    try:
        return (await client.skill(skill)).semantic_type
    except Refused as refusal:
        if refusal.status != "BadNotFound":
            raise
        return ""


def verdict_table(skill: Skill) -> Any:
    """Return what became of each demonstration, worst first."""
    verdicts = skill.document.get("verdicts") or skill.report.get("verdicts") or ()
    rows = [
        (
            verdict.get("demonstrationId", verdict.get("demonstration_id", "")),
            verdict.get("kind", ""),
            verdict.get("reason", ""),
        )
        for verdict in verdicts
    ]
    return table("demonstrations", ("demonstration", "verdict", "why"), sorted(rows, key=lambda row: row[1]))


def summary(skill: Skill) -> dict[str, Any]:
    """Return a version without its arrays."""
    keys = ("name", "version", "semantic_type", "state", "model_digest", "required_atomic_skills")
    return {key: getattr(skill, key) for key in keys}


@app.command("list")
def list_skills(
    semantic_type: Annotated[str, typer.Option("--type", help="only of this semantic type")] = "",
    state: Annotated[str, typer.Option(help="only in this state: Learned, Approved, Rejected, Retired")] = "",
    on: On = "",
    prefix: Annotated[str, typer.Option(help="only names that start so")] = "",
    limit: Annotated[int, typer.Option(min=0, help="at most so many; 0 is all")] = 0,
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """List skills, the newest version of each."""
    found = with_client(
        server,
        user,
        lambda client: client.find_skills(
            semantic_type=semantic_type, state=state, workstation=on, name_prefix=prefix, limit=limit
        ),
    )
    if as_json:
        print_json(found)
        return
    rows = [
        (
            one.name,
            one.version,
            one.state,
            one.semantic_type,
            ", ".join(one.workstations),
            when(one.created_at),
            one.created_by,
        )
        for one in found
    ]
    show_table(table("", ("=skill", ">version", "state", "type", "deployed on", "learned", "by"), rows))


@app.command()
def show(
    skill: SkillName, version: Version = 0, server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False
) -> None:
    """Show a version's semantic description and quality report."""
    found = with_client(server, user, lambda client: client.skill(skill, version))
    if as_json:
        print_json(found.document)
        return
    plain = [(key, value.hex() if isinstance(value, bytes) else value) for key, value in summary(found).items()]
    show_table(table(f"{found.name} version {found.version}", ("what", "value"), plain))
    show_table(table("quality", ("what", "value"), facts(found.report)))
    show_table(verdict_table(found))


def _judge(
    verb: str, skill: str, version: int, digest: str, comment: str, server: str, user: str, as_json: bool
) -> None:
    try:
        given = bytes.fromhex(digest)
    except ValueError:
        raise typer.BadParameter(f"{digest!r} is not a digest in hex", param_hint="--digest") from None

    async def work(client: SkillClient) -> tuple[Skill, str]:
        found = await client.skill(skill, version)
        judge = client.approve if verb == "approve" else client.reject
        return found, await judge(skill, found.version, given or found.model_digest, comment)

    found, state = with_client(server, user, work)
    _told(found, state, as_json)
    if verb == "approve" and state != "Approved":
        note("its origin is not known here: a second person has to approve it as well")


def _told(skill: Skill, state: str, as_json: bool) -> None:
    if as_json:
        print_json({**summary(skill), "state": state})
    else:
        say(f"{skill.name} version {skill.version} is {state} (digest {skill.model_digest.hex()[:16]}…)")


Digest = Annotated[str, typer.Option("--digest", metavar="HEX", help="the model you have looked at; else the newest")]


@app.command()
def approve(
    skill: SkillName,
    version: Version = 0,
    digest: Digest = "",
    comment: Comment = "at the command line, no reason given",
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Approve a version: from then on it may be deployed. Who taught it cannot."""
    _judge("approve", skill, version, digest, comment, server, user, as_json)


@app.command()
def reject(
    skill: SkillName,
    version: Version = 0,
    digest: Digest = "",
    comment: Comment = "",
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Reject a version for good."""
    _judge("reject", skill, version, digest, comment, server, user, as_json)


@app.command()
def deploy(
    skill: SkillName,
    on: On,
    version: Version = 0,
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Make an approved version what a workstation runs."""

    async def work(client: SkillClient) -> tuple[Skill, str]:
        found = await client.skill(skill, version)
        return found, await client.deploy(skill, found.version, on)

    found, state = with_client(server, user, work)
    if as_json:
        print_json({**summary(found), "state": state, "workstation": on})
    else:
        say(f"{found.name} version {found.version} is deployed on {on}")


@app.command()
def withdraw(
    skill: SkillName,
    on: On,
    version: Annotated[int, typer.Option("--version", min=0, help="0 is the deployed one")] = 0,
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Take a skill off a workstation."""

    async def work(client: SkillClient) -> int:
        number = version or (await client.workstation(on).model(skill)).version
        await client.withdraw(skill, number, on)
        return number

    number = with_client(server, user, work)
    if as_json:
        print_json({"name": skill, "version": number, "workstation": on})
    else:
        say(f"{skill} version {number} is no longer deployed on {on}")


@app.command()
def retire(
    skill: SkillName,
    version: Version = 0,
    comment: Comment = "",
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Retire a version for good."""

    async def work(client: SkillClient) -> tuple[Skill, str]:
        found = await client.skill(skill, version)
        return found, await client.retire(skill, found.version, comment)

    _told(*with_client(server, user, work), as_json)


@app.command()
def export(
    skill: SkillName,
    output: Output,
    version: Version = 0,
    file_format: Annotated[str, typer.Option("--format", help="json, aml or aas")] = "json",
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Write a version to a file that other libraries can import."""
    content = with_client(server, user, lambda client: client.export_skill(skill, version, file_format))
    output.write_text(content, encoding="utf-8")
    if as_json:
        print_json({"file": output, "characters": len(content)})
    else:
        say(f"wrote {output}")


@app.command("import")
def import_file(
    file: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="file made by export")],
    file_format: Annotated[str, typer.Option("--format", help="json, aml or aas; else from the file's name")] = "",
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Store a version from a file. It arrives as Learned: it has to be approved here."""
    known = file_format or FORMATS.get(file.suffix.lower(), "")
    if not known:
        raise typer.BadParameter(f"{file.name} does not tell its format by its name", param_hint="--format")
    content = file.read_text(encoding="utf-8")
    name, version = with_client(server, user, lambda client: client.import_skill(content, known))
    if as_json:
        print_json({"name": name, "version": version})
    else:
        say(f"{name} version {version} is Learned")


@app.command()
def plot(
    skill: SkillName,
    output: Output,
    version: Version = 0,
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Draw a version: demonstrations, components and regression, the path alone."""
    from opcua_skill.client.figures import learning_figure, view_of

    async def work(client: SkillClient) -> Any:
        return await view_of(client, skill, version)

    learning_figure([with_client(server, user, work)], output)
    if as_json:
        print_json({"file": output})
    else:
        say(f"wrote {output}")
