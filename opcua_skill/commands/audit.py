"""`audit`: who asked for what and what came of it, read from the data folder. Nothing can change it."""

from typing import Annotated

import typer

from opcua_skill.commands.options.client import Json
from opcua_skill.commands.options.server import Config, Data, load_settings, with_library
from opcua_skill.commands.terminal.output import print_json, show_table, table, when


def audit(
    limit: Annotated[int, typer.Option(min=1, max=10_000, help="how many entries, the newest first")] = 50,
    before: Annotated[int, typer.Option(min=0, help="only entries older than this number; 0: from the newest")] = 0,
    data: Data = None,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Show the audit trail of a server, the newest entries first."""
    found = with_library(load_settings(config, data=data), lambda library: library.audit_trail(limit, before))
    if as_json:
        print_json(found)
        return
    rows = [
        (entry.entry_id, when(entry.at), entry.actor or "–", entry.role, entry.action, entry.status, entry.reason)
        for entry in found
    ]
    show_table(table("", (">number", "when", "who", "role", "action", "status", "reason"), rows))
