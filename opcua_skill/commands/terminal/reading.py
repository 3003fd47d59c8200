"""Reading files of demonstrations for a command: what a file leaves open is an option or, at a terminal, a question."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from models.demonstration import Demonstration
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import note

if TYPE_CHECKING:
    from library.errors import ChoiceNeeded
    from library.readers import Choices, Reader

OPTIONS = {"marker": "--marker", "unit": "--unit", "up_axis": "--up-axis", "topic": "--topic"}
QUESTIONS = {
    "marker": "which marker or rigid body is the tool?",
    "unit": "what is the unit of its positions?",
    "up_axis": "which of its axes points up?",
    "topic": "which topic is the tool?",
}
UP_AXES = ("", "x", "y", "z")
UNITS = ("", "m", "cm", "mm")
LISTED = 40

Marker = Annotated[str, typer.Option("--marker", metavar="NAME", help="marker or rigid body to follow")]
Unit = Annotated[str, typer.Option("--unit", help="m, cm or mm, for files that name no unit")]
UpAxis = Annotated[str, typer.Option("--up-axis", help="x, y or z: which axis of the file points up")]
Topic = Annotated[str, typer.Option("--topic", help="topic of a ROS bag to follow")]
OnePlane = Annotated[bool, typer.Option("--plane", help="lay 3-D demonstrations into the plane they were drawn in")]
ToPlate = Annotated[
    bool, typer.Option("--fit-to-plate", help="scale and move drawings, all alike, onto the plate of 65 x 90 mm")
]


@dataclass(frozen=True, slots=True)
class Placing:
    """What to do with demonstrations once they are read."""

    plane: bool = False
    fit_to_plate: bool = False


def choices_of(marker: str, unit: str, up_axis: str, topic: str) -> "Choices":
    """Return the choices that were given as options."""
    from library.readers import Choices

    for value, known, option in ((up_axis, UP_AXES, "--up-axis"), (unit, UNITS, "--unit")):
        if value not in known:
            raise typer.BadParameter(f"{value!r} is not one of {', '.join(known[1:])}", param_hint=option)
    return Choices(marker=marker, up_axis=up_axis, unit=unit, topic=topic)  # type: ignore[arg-type]


def read_files(files: Sequence[Path], choices: "Choices", placing: Placing) -> list[Demonstration]:
    """Return the demonstrations of files, without the samples that were not seen; tells what was not as it is."""
    from library.readers import Reader, gaps, named_apart, without_gaps

    found: list[Demonstration] = []
    with Reader() as reader:
        for file in files:
            read, choices = _read_one(reader, file, choices)
            found += read
    for one in found:
        missing = gaps(one)
        if missing.lost:
            note(f"{one.demonstration_id}: {missing.words()}")
    return named_apart(_placed([without_gaps(one) for one in found], placing))


def _read_one(reader: "Reader", file: Path, choices: "Choices") -> "tuple[list[Demonstration], Choices]":
    """Return what is in a file, and the choices as answered: they hold for the next file too."""
    from library.errors import ChoiceNeeded

    for _ in range(2 * len(OPTIONS)):
        try:
            return reader.read(file, choices), choices
        except ChoiceNeeded as question:
            choices = replace(choices, **{question.choice: _answer(question)})
    raise Fault(f"{file} asks for the same choice again and again: give all of {', '.join(OPTIONS.values())}")


def _answer(question: "ChoiceNeeded") -> str:
    """Return what the person at the terminal chooses; without one, say which option to give."""
    option = OPTIONS[question.choice]
    shown = ", ".join(question.options[:LISTED])
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise Fault(f"{question.path}: {question.problem}; give {option}, one of {shown}")
    typer.echo(f"{question.path}: {question.problem}", err=True)
    for number, name in enumerate(question.options, 1):
        typer.echo(f"  {number}  {name}", err=True)
    while True:
        given = typer.prompt(QUESTIONS[question.choice], err=True).strip()
        if given in question.options:
            return given
        if given.isdecimal() and 1 <= int(given) <= len(question.options):
            return question.options[int(given) - 1]
        typer.echo(f"choose a name, or a number from 1 to {len(question.options)}", err=True)


def _placed(found: list[Demonstration], placing: Placing) -> list[Demonstration]:
    from library.readers import common_plane, fit_to_plate, onto_plane

    if placing.plane:
        flat = [one.demonstration_id for one in found if one.dimension == 2]
        if flat:
            raise Fault(f"--plane is for demonstrations in space: {flat[0]} is in the plane already")
        plane = common_plane(found)
        note(plane.words())
        found = onto_plane(found, plane)
    if placing.fit_to_plate:
        solid = [one.demonstration_id for one in found if one.dimension == 3]
        if solid:
            raise Fault(f"--fit-to-plate is for drawings in the plane: {solid[0]} is in space, add --plane")
        found = fit_to_plate(found)
    return found
