"""Options that client commands share, and the client they ask for."""

import asyncio
import os
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from opcua_skill.client import SkillClient
from opcua_skill.commands.terminal.errors import Fault

Result = TypeVar("Result")

Server = Annotated[
    str, typer.Option("--server", envvar="OPCUA_SKILL_SERVER", metavar="URL", help="address of the server")
]
User = Annotated[
    str, typer.Option("--user", envvar="OPCUA_SKILL_USER", help="who signs in; the password: OPCUA_SKILL_PASSWORD")
]
Json = Annotated[bool, typer.Option("--json", help="print the result as one JSON document")]
On = Annotated[str, typer.Option("--on", metavar="WS", help="name of the workstation")]
Version = Annotated[int, typer.Option("--version", min=0, help="version of the skill; 0 is the newest")]
Output = Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="file to write")]
Comment = Annotated[str, typer.Option("--comment", help="why, in a few words: kept in the records")]
DEFAULT_SERVER = "opc.tcp://127.0.0.1:4840"


def password(user: str) -> str:
    """Return the password, from the environment or asked for. Never an argument: others can read those."""
    if (given := os.environ.get("OPCUA_SKILL_PASSWORD")) is not None:
        return given
    if sys.stdin.isatty():
        return typer.prompt(f"Password of {user}", hide_input=True, err=True)
    raise Fault("no password: set OPCUA_SKILL_PASSWORD")


def with_client(server: str, user: str, work: Callable[[SkillClient], Awaitable[Result]]) -> Result:
    """Sign in, do the work, sign out."""
    if not user:
        raise Fault("who are you? give --user NAME (or set OPCUA_SKILL_USER)")
    secret = password(user)

    async def signed_in() -> Result:
        async with SkillClient(server, user, secret) as client:
            return await work(client)

    return asyncio.run(signed_in())
