"""`demo`: the options of the main job."""

import asyncio
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from opcua_skill.commands.options.client import Json
from opcua_skill.commands.terminal.errors import Fault


class People(StrEnum):
    """Whose demonstrations."""

    LASA = "lasa"
    SIMULATED = "simulated"


def demo(
    people: Annotated[
        People | None, typer.Option(help="real LASA demonstrations (if that package is installed) or simulated people")
    ] = None,
    demonstrations: Annotated[
        list[Path] | None, typer.Option(exists=True, dir_okay=False, metavar="FILES", help="own recordings, repeatable")
    ] = None,
    arm: Annotated[str, typer.Option(metavar="NAME", help="the arm")] = "panda",
    out: Annotated[Path, typer.Option(file_okay=False, metavar="DIR", help="where pictures go")] = Path("demo-output"),
    keep_serving: Annotated[bool, typer.Option("--keep-serving", help="leave the server up until Ctrl-C")] = False,
    as_json: Json = False,
) -> None:
    """The main job, end to end: people show, an engineer approves, the arm runs it, all through OPC UA."""
    from opcua_skill.demo import Wishes, main_job

    wishes = Wishes(
        people=people.value if people else "",
        files=tuple(demonstrations or ()),
        arm=arm,
        out=out,
        keep_serving=keep_serving,
        as_json=as_json,
    )
    try:
        asyncio.run(main_job(wishes))
    except asyncio.CancelledError:
        raise Fault("the demo was stopped before its end") from None
