"""Options that server-side commands share, the settings they lead to, and the library that these lead to."""

import asyncio
import shlex
import tomllib
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from pydantic import ValidationError

from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.configuration.settings import Settings

if TYPE_CHECKING:
    from library.store import SkillLibrary

Result = TypeVar("Result")
Config = Annotated[
    Path | None, typer.Option("--config", exists=True, dir_okay=False, metavar="FILE", help="settings in TOML")
]
Data = Annotated[Path | None, typer.Option("--data", file_okay=False, metavar="DIR", help="data folder of the server")]


def data_options(settings: Settings, config: Path | None) -> str:
    """Return the options that lead a verb to the same data, to be run as they stand in any folder."""
    named = f" --config {shlex.quote(str(config.absolute()))}" if config is not None else ""
    return f"--data {shlex.quote(str(settings.data.absolute()))}{named}"


def load_settings(config: Path | None, **overrides: Any) -> Settings:
    """Return the settings; a fault names the key, the file and what is wrong with its value."""
    try:
        return Settings.load(config, **overrides)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "settings"
        raise Fault(f"{config or 'settings'}: {key}: {first['msg'].removeprefix('Value error, ')}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise Fault(f"{config} is not TOML: {error}") from None


def with_library(
    settings: Settings, work: "Callable[[SkillLibrary], Awaitable[Result]]", *, may_make: bool = False
) -> Result:
    """Open the library of a data folder, do the work, close it; where there is none, only who adds to it makes one.

    Its imports are slow: only these commands pay.
    """
    from library.store import SkillLibrary

    async def opened() -> Result:
        library = await SkillLibrary.open(settings.database_address, must_exist=not may_make)
        try:
            return await work(library)
        finally:
            await library.close()

    return asyncio.run(opened())
