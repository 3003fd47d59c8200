"""The verbs of `opcua-skill`. Exit status 0 done, 1 refused or failed with one sentence on stderr, 2 wrong usage."""

import importlib
import logging
import sys
from dataclasses import dataclass
from importlib.metadata import version as installed_version
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from models.errors import SkillError


@dataclass(frozen=True, slots=True)
class Verb:
    """Where a verb is: ``name`` in ``module``, a function or a Typer of further verbs; ``help`` is its first line."""

    module: str
    name: str
    help: str


VERBS = {
    "demo": Verb(
        "demo",
        "demo",
        "The main job, end to end: people show, an engineer approves, the arm runs it, all through OPC UA.",
    ),
    "serve": Verb("serve", "serve", "Run the server; Ctrl-C stops it cleanly."),
    "panel": Verb(
        "panel",
        "panel",
        "Open the operator panel in a browser: everybody signs in there with user and password of the server.",
    ),
    "samples": Verb(
        "samples",
        "samples",
        "Write sample demonstrations of simulated people as CSV files, to try out teaching; files are not replaced.",
    ),
    "learn": Verb(
        "skills", "learn", "Send files of human demonstrations to the server, which learns a skill version from them."
    ),
    "record": Verb(
        "record",
        "record",
        "Record demonstrations on a workstation: from a tracker, or by replaying files.",
    ),
    "skills": Verb("skills", "app", "Skills of the library: look, approve, deploy, exchange."),
    "recipes": Verb("recipes", "app", "Recipes: time step, speed, frame and heights of a run."),
    "arms": Verb("arm_files", "app", "Arms of one's own: check their files, describe one, measure a tool."),
    "run": Verb("jobs", "run", "Queue a run of a skill on a workstation."),
    "jobs": Verb("jobs", "app", "Jobs: look, pause, resume, abort, read the trace."),
    "queue": Verb("queue", "app", "The queue of a workstation: look, release, hold."),
    "users": Verb("users", "app", "Users and their roles, on the data folder of a server."),
    "certificates": Verb("certificates", "app", "Certificates, on the data folder of a server."),
    "sessions": Verb("sessions", "app", "Sessions of a running server: who is signed in, and ending one."),
    "library": Verb("library", "app", "The library's database: prepared for servers, and copied to another."),
    "audit": Verb("audit", "audit", "Show the audit trail of a server, the newest entries first."),
    "backup": Verb(
        "backup",
        "backup",
        "Copy library, certificates and traces into a new folder, also while the server runs, and check the copy.",
    ),
    "restore": Verb(
        "backup",
        "restore",
        "Put a backup into a data folder that holds nothing yet; it is checked first, and no server may run there.",
    ),
    "bench": Verb(
        "bench", "bench", "Run the benchmarks. Ratios of one run mean something; absolute times depend on the machine."
    ),
}


class Verbs(TyperGroup):
    """The verbs by name: a verb's module is imported when it is asked for, so that no verb waits for the others."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in the order of the help page."""
        return list(VERBS)

    def get_command(self, ctx: Any, cmd_name: str) -> TyperCommand | None:
        """Return what the help page shows of a verb."""
        verb = VERBS.get(cmd_name)
        return TyperCommand(cmd_name, help=verb.help) if verb else None

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the verb asked for, imported now."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, command and imported(name or "", VERBS[name or ""]), rest


def imported(name: str, verb: Verb) -> Any:
    """Return a verb as a command that can be run."""
    found = getattr(importlib.import_module(f"opcua_skill.commands.{verb.module}"), verb.name)
    if not isinstance(found, typer.Typer):
        alone = typer.Typer()
        alone.command(name)(found)
        found = alone
    command = typer.main.get_command(found)
    command.name = name
    return command


app = typer.Typer(
    cls=Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Show a robot a task by hand a few times; every workstation that can do it, does it.",
)


def tell_version(wanted: bool) -> None:
    """Print the version and leave."""
    if wanted:
        typer.echo(f"opcua-skill {installed_version('opcua-skill')}")
        raise typer.Exit


@app.callback()
def options(
    verbose: Annotated[int, typer.Option("-v", "--verbose", count=True, help="log more: -v, -vv")] = 0,
    version: Annotated[
        bool, typer.Option("--version", callback=tell_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    """Set up logging: stderr, nothing of the libraries below unless asked for."""
    levels = (logging.WARNING, logging.INFO, logging.DEBUG)
    logging.basicConfig(
        level=levels[min(verbose, 2)], format="%(asctime)s %(levelname)s %(name)s: %(message)s", stream=sys.stderr
    )
    if not verbose:
        for name in ("asyncua", "sqlalchemy", "alembic", "matplotlib"):
            logging.getLogger(name).setLevel(logging.CRITICAL)


def status_of(arguments: list[str]) -> int:
    """Run one command and return its exit status; what a person did wrong is one sentence, never a traceback."""
    try:
        app(args=arguments, prog_name="opcua-skill")
    except SystemExit as left:
        return left.code if left.code in {0, 1, 2} else 1
    except (SkillError, OSError) as error:
        typer.echo(f"error: {' '.join(str(error).split())}", err=True)
    return 1
