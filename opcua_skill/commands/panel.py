"""`panel`: the operator panel, in a browser."""

import logging
from pathlib import Path
from typing import Annotated

import typer

from opcua_skill.commands.options.client import DEFAULT_SERVER, Server
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import note, say


def panel(
    server: Server = DEFAULT_SERVER,
    port: Annotated[
        int, typer.Option(envvar="OPCUA_SKILL_PANEL_PORT", min=1, max=65535, help="port of the page")
    ] = 8080,
    host: Annotated[
        str, typer.Option(help="address to listen on; another than this machine's own needs TLS")
    ] = "127.0.0.1",
    certificate: Annotated[
        Path | None, typer.Option(exists=True, dir_okay=False, metavar="FILE", help="TLS certificate of the page (PEM)")
    ] = None,
    key: Annotated[
        Path | None, typer.Option(exists=True, dir_okay=False, metavar="FILE", help="its private key (PEM)")
    ] = None,
) -> None:
    """Open the operator panel in a browser: everybody signs in there with user and password of the server."""
    try:
        from opcua_skill.panel.app import Address, run
    except ImportError as missing:
        raise Fault(f"the panel is not installed ({missing}): pip install 'opcua-skill[panel]'") from None
    try:
        address = Address(host, port, certificate, key)
    except ValueError as error:
        raise Fault(str(error)) from None
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # a lost connection is told on the page, in a sentence
    logging.getLogger("nicegui").setLevel(logging.ERROR)

    def ready(url: str) -> None:
        say(f"panel on {url}")
        note(f"for the server at {server}; Ctrl-C ends it")

    try:
        run(server, address, on_ready=ready)
    except SystemExit as ended:
        if ended.code:
            raise Fault(
                f"the panel cannot listen on port {port} of {host}: is another one running? try --port"
            ) from None
