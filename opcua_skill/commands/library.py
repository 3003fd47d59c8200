"""`library`: the database of a server made ready, and carried from one engine to the other."""

import asyncio
from typing import Annotated

import typer

from opcua_skill.commands.options.client import Json
from opcua_skill.commands.terminal.output import counted, note, print_json, say

app = typer.Typer(no_args_is_help=True, help="The library's database: prepared for servers, and copied to another.")
Role = Annotated[str, typer.Option("--role", metavar="ROLE", help="database role that servers sign in with")]


@app.callback()
def library() -> None:
    """The library's database: prepared for servers, and copied to another."""


@app.command()
def prepare(
    url: Annotated[str, typer.Argument(metavar="URL", help="postgresql+asyncpg://OWNER@HOST/NAME, as its owner")],
    role: Role,
) -> None:
    """Make the tables of a library on PostgreSQL, or bring them up to date, for servers that sign in as ROLE.

    Run as the role that is to own the tables. ROLE is given what a server needs and no more: it cannot change what is
    never changed, nor drop what guards it. Passwords are taken from PGPASSWORD or ~/.pgpass where URL has none.
    """
    from library.database import address
    from library.preparing import prepare as make_ready

    asyncio.run(make_ready(url, role))
    named = address(url)
    say(f"{named.render_as_string()} is ready for servers that sign in as {role}")
    served = named.set(username=role, password=None).render_as_string()
    note(f'in their configuration: database = "{served}", with the password of {role}')


@app.command()
def copy(
    source: Annotated[str, typer.Argument(metavar="SOURCE", help="a library: its file or postgresql+asyncpg://…")],
    target: Annotated[str, typer.Argument(metavar="TARGET", help="a new or empty one: file or postgresql+asyncpg://…")],
    as_json: Json = False,
) -> None:
    """Carry a whole library into another database, of either engine, and read it back.

    All of it comes from one moment, and all of it is there in the end or nothing. Stop the server of SOURCE first:
    what it stores later stays behind. Certificates and traces in the data folder are not in the library.
    """
    from library.copying import copy_library

    copied = asyncio.run(copy_library(source, target))
    if as_json:
        print_json({"rows": copied.rows, "sha256": copied.digest})
        return
    rows = sum(copied.rows.values())
    say(f"{counted(rows, 'row')} carried and read back as the same, SHA-256 {copied.digest}")
