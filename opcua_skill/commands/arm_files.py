"""`arms …`: a robot of one's own, looked at, described and measured before any server knows it."""

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from opcua_skill.commands.options.client import Json
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import note, print_json, say, screen, table

if TYPE_CHECKING:
    from sim.arm_model import Floats
    from sim.description.findings import ArmFinding

app = typer.Typer(no_args_is_help=True, help="Arms of one's own: check their files, describe one, measure a tool.")
Name = Annotated[str, typer.Option("--name", metavar="NAME", help="name of the tool, for the limits file")]


@app.command()
def check(
    place: Annotated[Path, typer.Argument(metavar="FOLDER", help="folder with URDF and limits file, or one of them")],
    as_json: Json = False,
) -> None:
    """Say everything that is missing or odd in an arm's files; status 1 if it cannot be used as it is."""
    from sim.description.checking import check_place

    if not place.exists() and not place.with_name(f"{place.name}.urdf").exists():
        raise Fault(f"there is no {place}")
    found = check_place(place)
    rows = [(name, one) for name, several in found.items() for one in several]
    usable = not any(one.weight == "error" for _, one in rows)
    if as_json:
        findings = [{"arm": name, **_told(one)} for name, one in rows]
        print_json({"usable": usable, "arms": list(found), "findings": findings})
    else:
        if rows:
            cells = [(name, one.weight, one.code, one.text) for name, one in rows]
            screen.print(table("", ("arm", "weight", "code", "what, and the way out"), cells))
        say(_verdict(list(found), [one for _, one in rows]))
    if not usable:
        raise typer.Exit(1)


def _told(one: "ArmFinding") -> dict[str, str]:
    return {"code": one.code, "weight": one.weight, "where": one.where, "text": one.text}


def _verdict(names: list[str], rows: "list[ArmFinding]") -> str:
    counts = {weight: sum(one.weight == weight for one in rows) for weight in ("error", "warning", "note")}
    listed = ", ".join(names)
    if counts["error"]:
        return f"{listed}: cannot be used yet, {counts['error']} errors, {counts['warning']} warnings"
    return f"{listed}: can be used, {counts['warning']} warnings, {counts['note']} notes"


@app.command()
def describe(
    description: Annotated[Path, typer.Argument(metavar="URDF", exists=True, dir_okay=False, help="the arm's URDF")],
    tip: Annotated[str, typer.Option(metavar="LINK", help="link the tool's tip is in; else the longest chain's")] = "",
    needle: Annotated[
        float, typer.Option(min=0.0, max=2.0, help="length in m of a tool that the URDF does not have")
    ] = 0.0,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="file to write, else beside the URDF")
    ] = None,
    again: Annotated[bool, typer.Option("--again", help="write over a limits file that is there")] = False,
    as_json: Json = False,
) -> None:
    """Write a first limits file for a URDF: hull, home, tool, workspace and limits proposed, all to be confirmed."""
    from sim.description.checking import read_text
    from sim.description.proposal import NotDescribable, propose, written

    target = output or description.with_suffix(".toml")
    if target.exists() and not again:
        raise Fault(f"{target} is there: give --again to write over it, or -o FILE")
    text, found = read_text(description)
    if text is None:
        raise Fault(found[0].text)
    try:
        proposal = propose(text, description.stem, description.parent, tip=tip, needle=needle)
    except NotDescribable as refused:
        if as_json:
            findings = [_told(one) for one in refused.findings]
            print_json({"file": None, "findings": findings})
            raise typer.Exit(1) from None
        raise Fault(str(refused)) from None
    target.write_text(written(proposal), encoding="utf-8")
    model = proposal.model
    if as_json:
        fits = [
            {"link": fit.capsule.link, "radius": fit.capsule.radius, "sticks_out": fit.excess} for fit in proposal.fits
        ]
        touching = [list(pair) for pair in proposal.touching]
        print_json({"file": target, "home": model.home, "tip": model.tool.tip, "hull": fits, "touching": touching})
        return
    cells = [(one.capsule.link, f"{1e3 * one.capsule.radius:.1f}", f"{1e3 * one.excess:.1f}") for one in proposal.fits]
    if cells:
        screen.print(table("", ("link", ">radius, mm", ">sticks out, mm"), cells))
    else:
        note("the URDF has no shapes: [hull] is empty, write capsules by hand")
    say(f"wrote {target}: look at every value, take its name out of to_confirm, then `opcua-skill arms check`")


@app.command()
def tool(
    poses: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", exists=True, dir_okay=False, help="CSV or JSON: poses x y z qx qy qz qw of the flange, m"
        ),
    ],
    name: Name = "measured",
    joints_of: Annotated[
        str, typer.Option("--joints-of", metavar="ARM", help="the rows are joints of this arm, rad or m, instead")
    ] = "",
    worst: Annotated[float, typer.Option(min=0.0, help="residual in m from which the measurement is refused")] = 1e-3,
    as_json: Json = False,
) -> None:
    """Work out where a tool's tip is: it was held on one point while the flange was turned, in four poses or more."""
    import numpy as np

    from sim.description.tool_point import PosesRefused, tool_point

    positions, rotations = _flange(poses, joints_of)
    try:
        found = tool_point(positions, rotations)
    except PosesRefused as refused:
        raise Fault(f"{poses}: {refused}") from None
    largest = float(found.residuals.max())
    if largest > worst:
        row = int(found.residuals.argmax()) + 1
        raise Fault(
            f"{poses}: pose {row} misses the common point by {1e3 * largest:.2f} mm, {1e3 * worst:.2f} mm are allowed: "
            "measure it again, or leave it out"
        )
    offset = [round(float(value), 6) for value in found.offset]
    if as_json:
        print_json(
            {
                "offset": offset,
                "point": found.point,
                "residuals": found.residuals,
                "rms": found.rms,
                "standard_error": found.uncertainty,
            }
        )
        return
    errors = ", ".join(f"{1e3 * float(value):.3f}" for value in found.uncertainty)
    residual, length = round(found.rms, 7), round(float(np.linalg.norm(found.offset)), 6)
    say(
        f'[[tools]]\nname = "{name}"\noffset = {offset}\nturn = [0.0, 0.0, 0.0]\nmass = 0.5\nlength = {length}\n'
        f"residual = {residual}"
    )
    note(
        f"{len(positions)} poses, residual {1e3 * found.rms:.3f} mm (largest {1e3 * largest:.3f}), standard error of "
        f"the offset {errors} mm; the turn cannot be seen from poses, give it and the mass by hand"
    )


def _flange(file: Path, joints_of: str) -> "tuple[Floats, Floats]":
    """Return positions (n, 3) in m and rotations (n, 3, 3) of the flange from a file of poses or joints."""
    import numpy as np
    from scipy.spatial.transform import Rotation

    from sim.planning.kinematics import kinematics
    from sim.robots import load

    rows = _rows(file)
    if joints_of:
        try:
            model = load(joints_of)
        except ValueError as unknown:
            raise Fault(str(unknown)) from None
        if any(len(row) != model.dof for row in rows):
            raise Fault(f"{file}: every row has to be the {model.dof} joints of {model.name}")
        return kinematics(model).forward(np.array(rows).reshape(-1, model.dof))
    if any(len(row) != 7 for row in rows):
        raise Fault(f"{file}: every row has to be seven numbers, x y z in m and a quaternion x y z w")
    values = np.array(rows).reshape(-1, 7)
    sizes = np.linalg.norm(values[:, 3:], axis=1)
    for number, size in enumerate(sizes, start=1):
        if not abs(size - 1.0) < 0.01:
            raise Fault(f"{file}: the quaternion of pose {number} is {size:.3g} long, it has to be of length 1")
    return values[:, :3], Rotation.from_quat(values[:, 3:]).as_matrix()


def _rows(file: Path) -> list[list[float]]:
    """Return the rows of numbers in a file; a first row of words in a CSV file is its head."""
    try:
        text = file.read_text(encoding="utf-8-sig")
        given: list[Any] = json.loads(text) if file.suffix.lower() == ".json" else [*csv.reader(text.splitlines())]
        cells = [row for row in given if row]
        if cells and file.suffix.lower() != ".json" and not _is_number(cells[0][0]):
            cells = cells[1:]
        rows = [[float(cell) for cell in row] for row in cells]
    except (ValueError, TypeError) as wrong:
        raise Fault(f"{file} is no table of numbers: {wrong}") from None
    if not all(abs(value) < float("inf") for row in rows for value in row):
        raise Fault(f"{file} holds numbers that are not finite")
    return rows


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
