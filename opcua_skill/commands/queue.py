"""`queue …`: whether a workstation's next job may begin."""

import typer

from opcua_skill.client import QueueStatus, SkillClient
from opcua_skill.commands.options.client import DEFAULT_SERVER, Comment, Json, On, Server, User, with_client
from opcua_skill.commands.terminal.output import print_json, say, show_table, table, when

app = typer.Typer(no_args_is_help=True, help="The queue of a workstation: look, release, hold.")


@app.command()
def show(on: On, server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False) -> None:
    """Show whether the next job may begin, and if not, why."""
    found: QueueStatus = with_client(server, user, lambda client: client.workstation(on).queue())
    if as_json:
        print_json(found)
        return
    rows = [
        ("state", found.state),
        ("because", found.because),
        ("by", found.by),
        ("since", when(found.since)),
        ("waiting", found.waiting),
    ]
    show_table(table(f"queue of {on}", ("what", "value"), rows))


def _decide(on: str, server: str, user: str, comment: str, as_json: bool, *, release: bool) -> None:
    async def work(client: SkillClient) -> str:
        workstation = client.workstation(on)
        return await (workstation.release_queue(comment) if release else workstation.hold_queue(comment))

    state = with_client(server, user, work)
    if as_json:
        print_json({"workstation": on, "state": state})
    else:
        say(f"the queue of {on} is {state}")


@app.command()
def release(
    on: On, comment: Comment = "", server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False
) -> None:
    """Let the next job begin, after you have looked; the arm has to stand ready at home."""
    _decide(on, server, user, comment, as_json, release=True)


@app.command()
def hold(
    on: On, comment: Comment = "", server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False
) -> None:
    """Let no further job begin until the queue is released; what runs goes on."""
    _decide(on, server, user, comment, as_json, release=False)
