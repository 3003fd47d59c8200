"""Options that server-side commands share, and the settings they lead to."""

import tomllib
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from opcua_skill.commands.faults import Fault
from opcua_skill.settings import Settings

Config = Annotated[
    Path | None, typer.Option("--config", exists=True, dir_okay=False, metavar="FILE", help="settings in TOML")
]
Data = Annotated[Path | None, typer.Option("--data", file_okay=False, metavar="DIR", help="data folder of the server")]


def load_settings(config: Path | None, **overrides: Any) -> Settings:
    """Return the settings; a fault names the key, the file and what is wrong with its value."""
    try:
        return Settings.load(config, **overrides)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "settings"
        raise Fault(f"{config or 'settings'}: {key}: {first['msg']}") from None
    except tomllib.TOMLDecodeError as error:
        raise Fault(f"{config} is not TOML: {error}") from None
