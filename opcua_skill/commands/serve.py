"""`serve`: the process a plant leaves running."""

import asyncio
import contextlib
import gc
import logging
import os
import signal
import sys
from typing import Annotated

import typer

from library.private_files import KeyIsOpen
from opcua_skill.commands.options.server import Config, Data, data_options, load_settings
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import note, say
from opcua_skill.configuration.settings import Settings
from opcua_skill.security import CertificateUnusable

log = logging.getLogger(__name__)


def serve(
    config: Config = None,
    data: Data = None,
    endpoint: Annotated[
        str | None, typer.Option(metavar="URL", help="address to listen on; port 0 takes a free one")
    ] = None,
    until_stdin_closes: Annotated[bool, typer.Option("--until-stdin-closes", hidden=True)] = False,
) -> None:
    """Run the server; Ctrl-C stops it cleanly."""
    # What a start makes lives as long as the server. Looking through it for garbage would take a second of the start,
    # and later 0.4 s at a time in which nobody is served.
    gc.disable()
    from opcua_skill.configuration.data_lock import ServedAlready
    from opcua_skill.server.first_look import DataUnusable

    settings = load_settings(config, data=data, endpoint=endpoint)
    os.umask(0o077)  # what a server writes is for its own user, also what its workers write
    logging.getLogger().setLevel(settings.log_level.upper())
    for name in ("asyncua", "sqlalchemy", "alembic"):
        logging.getLogger(name).setLevel(logging.WARNING)
    import opcua_skill.server.app  # noqa: F401 - first, so that the workers have it all too
    from opcua_skill.jobs import process_pool

    process_pool.prepare(process_pool.PREPARED)
    try:
        asyncio.run(keep_serving(settings, until_stdin_closes, data_options(settings, config)))
    except (ServedAlready, DataUnusable, CertificateUnusable, KeyIsOpen) as error:
        raise Fault(str(error)) from None
    except OSError as error:
        raise Fault(f"cannot serve at {settings.endpoint}: {error}") from None


async def keep_serving(settings: Settings, until_stdin_closes: bool, where: str) -> None:
    """Serve until somebody asks to stop: Ctrl-C, SIGTERM, or the process that holds our stdin ending in any way.

    ``where`` are the options that lead other verbs to the same data.
    """
    from opcua_skill.commands.arms import Arms
    from opcua_skill.server.app import SkillServerApp

    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(name, stop.set)
    if until_stdin_closes:
        watch_stdin(loop, stop)
    async with SkillServerApp(settings, Arms(settings)) as app:
        gc.freeze()
        gc.enable()
        say(f"listening on {app.endpoint}")
        stations = ", ".join(f"{station.name} ({station.arm}, {station.driver})" for station in settings.workstations)
        note(f"workstations: {stations}; data in {settings.data}")
        if not await app.library.users():
            note(f"nobody can sign in yet: opcua-skill users add admin --role admin {where}")
        await stop.wait()
        note("stopping")
    with contextlib.suppress(BrokenPipeError):
        say("stopped")


def watch_stdin(loop: asyncio.AbstractEventLoop, stop: asyncio.Event) -> None:
    """Set ``stop`` once stdin has ended: whoever started us is gone, even if killed."""

    def read() -> None:
        if not sys.stdin.buffer.raw.read(4096):  # pyright: ignore[reportAttributeAccessIssue]
            loop.remove_reader(sys.stdin.fileno())
            stop.set()

    loop.add_reader(sys.stdin.fileno(), read)
