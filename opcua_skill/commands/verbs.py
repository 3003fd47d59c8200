"""The verbs of `opcua-skill`. Exit status 0 done, 1 refused or failed with one sentence on stderr, 2 wrong usage."""

import logging
import sys
from importlib.metadata import version as installed_version
from typing import Annotated

import typer

from models.errors import SkillError
from opcua_skill.client.errors import ClientError
from opcua_skill.commands import audit, bench, certificates, demo, jobs, panel, recipes, record, serve, skills, users
from opcua_skill.commands.faults import Fault

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Show a robot a task by hand a few times; every workstation that can do it, does it.",
)
app.command("demo")(demo.demo)
app.command("serve")(serve.serve)
app.command("panel")(panel.panel)
app.command("learn")(skills.learn)
app.command("record")(record.record)
app.add_typer(skills.app, name="skills")
app.add_typer(recipes.app, name="recipes")
app.command("run")(jobs.run)
app.add_typer(jobs.app, name="jobs")
app.add_typer(users.app, name="users")
app.add_typer(certificates.app, name="certificates")
app.command("audit")(audit.audit)
app.command("bench")(bench.bench)


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
    sentence = ""
    try:
        app(args=arguments, prog_name="opcua-skill")
    except SystemExit as left:
        return left.code if left.code in {0, 1, 2} else 1
    except (Fault, ClientError, SkillError, OSError) as error:
        sentence = str(error)
    except Exception as error:
        if not isinstance(error, _library_errors()):
            raise
        sentence = str(error)
    typer.echo(f"error: {' '.join(sentence.split())}", err=True)
    return 1


def _library_errors() -> tuple[type[Exception], ...]:
    from library.errors import LibraryError

    return (LibraryError,)
