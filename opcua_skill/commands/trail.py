"""What the command line changes in a data folder, written into the audit trail of its library."""

import getpass
import os
from typing import TYPE_CHECKING

from library.errors import LibraryError
from opcua_skill.commands.options.server import with_library
from opcua_skill.commands.terminal.output import note
from opcua_skill.configuration.settings import Settings

if TYPE_CHECKING:
    from library.records import AuditEntry

ACTOR = "command line"


def entry(action: str, target: str, **arguments: object) -> "AuditEntry":
    """Return the entry of something that is done: by the command line, and by which login of this machine."""
    from library.records import AuditEntry

    return AuditEntry(ACTOR, "", action, target, {"Login": login(), **arguments}, status="Good")


def login() -> str:
    """Return the name of who runs this process, its number where it has no name."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())


def record(settings: Settings, done: "AuditEntry") -> None:
    """Write an entry about what is no part of the library; say so where that cannot be done."""
    try:
        with_library(settings, lambda library: library.audit(done))
    except LibraryError as error:
        note(f"done, but not written into the audit trail: {error}")
