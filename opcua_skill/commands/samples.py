"""`samples`: files of demonstrations to begin with, drawn by simulated people."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from opcua_skill.commands.options.client import Json
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import counted, print_json, say


class Shape(StrEnum):
    """What the simulated people draw on a plate of 65 x 90 mm."""

    ZIGZAG = "zigzag"
    RASTER = "raster"


def samples(
    shape: Annotated[Shape, typer.Argument(metavar="SHAPE", help="zigzag or raster, on a plate of 65 × 90 mm")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="folder for the files, one a person")],
    people: Annotated[int, typer.Option(min=2, max=200, help="how many people draw it")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="another number is another group of people")] = 0,
    as_json: Json = False,
) -> None:
    """Write sample demonstrations of simulated people as CSV files, to try out teaching; files are not replaced."""
    from library.readers.plain_csv import write
    from models.synthetic import ZIGZAG, raster, simulated_people

    corners = ZIGZAG if shape is Shape.ZIGZAG else raster(4)
    drawn, _ = simulated_people(people, seed, corners=corners)
    files = [folder / f"{shape}-{one.demonstration_id}.csv" for one in drawn]
    if there := [file for file in files if file.exists()]:
        raise Fault(f"{there[0]} is there already: name another folder (argument DIR)")
    folder.mkdir(parents=True, exist_ok=True)
    for file, one in zip(files, drawn, strict=True):
        write(file, one)
    if as_json:
        print_json({"files": files})
    else:
        say(f"wrote {counted(len(files), 'file')}: {files[0]} to {files[-1]}")
