"""`backup` and `restore`: everything a server remembers, copied beside it, and put back."""

import asyncio
from pathlib import Path
from typing import Annotated

import typer

from opcua_skill.commands.options.client import Json
from opcua_skill.commands.options.server import Config, Data, data_options, load_settings
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import counted, note, print_json, say

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="folder of the backup")]


def backup(folder: Folder, data: Data = None, config: Config = None, as_json: Json = False) -> None:
    """Copy library, certificates and traces into a new folder, also while the server runs, and check the copy."""
    from opcua_skill.backup.backups import BackupFault, make_backup

    settings = load_settings(config, data=data)
    try:
        made = make_backup(settings, folder)
    except BackupFault as fault:
        raise Fault(str(fault)) from None
    size = sum(one.size for one in made.files)
    if as_json:
        print_json({"folder": folder.absolute(), "files": len(made.files), "bytes": size, "made_at": made.made_at})
    else:
        read = f"{counted(len(made.files), 'file')}, {size / 1e6:.1f} MB, all read back"
        say(f"{folder} holds a backup of {settings.data}: {read}")


def restore(folder: Folder, data: Data = None, config: Config = None, as_json: Json = False) -> None:
    """Put a backup into a data folder that holds nothing yet; it is checked first, and no server may run there."""
    from opcua_skill.backup import restoring
    from opcua_skill.backup.backups import BackupFault
    from opcua_skill.configuration.data_lock import ServedAlready

    settings = load_settings(config, data=data)
    try:
        manifest = asyncio.run(restoring.restore(settings, folder))
    except (BackupFault, ServedAlready) as fault:
        raise Fault(str(fault)) from None
    if as_json:
        print_json({"data": settings.data.absolute(), "files": len(manifest.files), "made_at": manifest.made_at})
        return
    say(f"{settings.data} is as it was on {manifest.made_at.astimezone():%Y-%m-%d %H:%M:%S}")
    note(f"serve it: opcua-skill serve {data_options(settings, config)}")
