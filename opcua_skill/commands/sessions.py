"""`sessions …`: who is signed in at a running server, and ending somebody's session; for administrators."""

from typing import Annotated

import typer

from opcua_skill.client import OpenSession, SkillClient
from opcua_skill.commands.options.client import DEFAULT_SERVER, Json, Server, User, with_client
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import print_json, say, show_table, table, when

SHORT = 8
app = typer.Typer(no_args_is_help=True, help="Sessions of a running server: who is signed in, and ending one.")


@app.command("list")
def list_sessions(server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False) -> None:
    """List who is signed in, the oldest session first."""
    found = with_client(server, user, lambda client: client.sessions())
    if as_json:
        print_json(found)
        return
    rows = [
        (
            one.session_id[:SHORT],
            one.user or "–",
            one.role,
            one.client,
            one.address,
            when(one.since),
            round(one.idle),
        )
        for one in found
    ]
    show_table(table("", ("=session", "=user", "role", "client", "from", "since", ">idle s"), rows))


@app.command()
def end(
    session: Annotated[str, typer.Argument(metavar="SESSION", help="(the start of) its id")] = "",
    of: Annotated[str, typer.Option("--of", metavar="NAME", help="all sessions of a user instead")] = "",
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """End a session, or all of a user; the user may sign in again unless removed."""
    if bool(session) == bool(of):
        raise typer.BadParameter("give either SESSION or --of NAME", param_hint="SESSION / --of")

    async def work(client: SkillClient) -> list[OpenSession]:
        if session:
            return [await client.end_session(session)]
        named = [one for one in await client.sessions() if one.user == of]
        if not named:
            raise Fault(f"{of} is not signed in")
        return [await client.end_session(one.session_id) for one in named]

    ended = with_client(server, user, work)
    if as_json:
        print_json([one.session_id for one in ended])
        return
    for one in ended:
        say(f"session {one.session_id[:SHORT]} of {one.user or 'nobody'} is ended")
