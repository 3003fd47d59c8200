"""Everything that is missing or odd in the files of an arm, told at once: what is loaded afterwards is loaded whole."""

import math
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sim import robots
from sim.arm_model import ArmModel
from sim.description import urdf
from sim.description.capsules import beyond
from sim.description.findings import ArmFinding, error, note, warning
from sim.description.reach import grid, reachable
from sim.description.shapes import Carried, carried
from sim.planning.clearance import Cell, check_clearance, needle
from sim.planning.kinematics import kinematics

# What a source says that says nothing.
EMPTY_WORDS = frozenset({"", "x", "?", "-", "todo", "tbd", "unknown", "none", "source", "to be confirmed"})
HELD = 1e-4
THICK = 0.01
LONG_LINK = 0.05
WIDER = 1e-3
FAST_TURN, FAST_SLIDE = 60.0, 20.0
PLATE = (0.065, 0.09)
GRID = (3, 3, 3)


def check_place(place: Path) -> dict[str, list[ArmFinding]]:
    """Return what was found of every arm in a folder, or of one given by a file or common stem; by the arm's name."""
    if place.suffix.lower() in {".urdf", ".toml", ".xacro"} and not place.is_dir():
        place = place.with_suffix("")
    if not place.is_dir():
        return {place.name: check_arm(place)}
    found = sorted({file.with_suffix("") for kind in ("*.urdf", "*.toml") for file in place.glob(kind)})
    complete = robots.stems(place)
    if complete:
        found = complete
    if not found:
        return {place.name: [_no_files(place)]}
    result = {stem.name: check_arm(stem) for stem in found}
    if len(complete) > 1:
        listed = ", ".join(stem.name for stem in complete)
        text = f"the folder holds more than one arm ({listed}): name a file's path without ending in the configuration"
        for rows in result.values():
            rows.append(note("SeveralArms", str(place), text))
    return result


def _no_files(place: Path) -> ArmFinding:
    programs = sorted(place.glob("*.xacro")) if place.is_dir() else []
    if programs:
        name = programs[0].name
        plain = name.removesuffix(".xacro").removesuffix(".urdf")
        text = f"{name} is a program, not a description: write it out where ROS is, `xacro {name} > {plain}.urdf`"
        return error("Xacro", str(place), text)
    text = f"there is no URDF in {place}: lay the arm's there, then `opcua-skill arms describe` writes its limits file"
    return error("FilesMissing", str(place), text)


def check_arm(stem: Path) -> list[ArmFinding]:
    """Return everything found in the URDF and the limits file with the path ``stem`` and their endings."""
    found: list[ArmFinding] = []
    texts: dict[str, str] = {}
    for kind in ("urdf", "toml"):
        file = stem.with_name(f"{stem.name}.{kind}")
        if not file.is_file():
            found.append(_missing(file))
        else:
            text, told = read_text(file)
            found += told
            if text is not None:
                texts[kind] = text
    description = None
    if "urdf" in texts:
        description, told = urdf.read(texts["urdf"], f"{stem.name}.urdf")
        found += told
    values: dict[str, Any] = {}
    if "toml" in texts:
        try:
            values = tomllib.loads(texts["toml"])
        except tomllib.TOMLDecodeError as wrong:
            text = f"{stem.name}.toml is no TOML: {wrong}; mend that line"
            found.append(error("Unreadable", f"{stem.name}.toml", text))
    if description is None:
        return found
    tip = _tip(values) or (description.longest() if description.tips else "")
    if tip in {link.name for link in description.links}:
        found = [*urdf.of_chain(found, description, tip), *urdf.chain_findings(description, tip)]
    shapes, told = carried(description, tip, stem.parent)
    found += told
    if values:
        found += _figures(description, tip, values)
    if not values or any(one.weight == "error" for one in found if one.code not in {"NoHull", "MeshMissing"}):
        return found
    try:
        model = robots.read_files(stem)
    except ValueError as wrong:
        return [*found, error("NotLoadable", stem.name, str(wrong))]
    return [*found, *_of_model(model, description, shapes)]


def read_text(file: Path) -> tuple[str | None, list[ArmFinding]]:
    """Return a file's text without a byte order mark, and what is odd about its letters."""
    try:
        content = file.read_bytes()
    except OSError as wrong:
        return None, [error("Unreadable", file.name, f"{file.name} cannot be read: {wrong.strerror}")]
    found: list[ArmFinding] = []
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return None, [error("Encoding", file.name, f"{file.name} is written in UTF-16: save it as UTF-8")]
    if content.startswith(b"\xef\xbb\xbf"):
        text = f"{file.name} begins with a byte order mark: it is read, other programs may stumble; save it without"
        found.append(note("ByteOrderMark", file.name, text))
    try:
        return content.decode("utf-8-sig"), found
    except UnicodeDecodeError as wrong:
        line = content[: wrong.start].count(b"\n") + 1
        text = f"{file.name} is not UTF-8 (line {line}): save it as UTF-8"
        return None, [*found, error("Encoding", file.name, text)]


def _missing(file: Path) -> ArmFinding:
    if file.suffix == ".toml":
        written = file.with_suffix(".urdf").name
        text = f"there is no {file.name}: `opcua-skill arms describe {written}` writes a first one"
        return error("FilesMissing", file.name, text)
    return _no_files(file.parent) if not file.exists() else error("Unreadable", file.name, f"{file.name} is no file")


def _tip(values: dict[str, Any]) -> str:
    tool = values.get("tool")
    return str(tool.get("tip", "")) if isinstance(tool, dict) else ""


def _figures(description: urdf.Description, tip: str, values: dict[str, Any]) -> Iterator[ArmFinding]:
    """Yield what is odd in the numbers of the limits file by themselves, and beside the URDF's."""
    moving = [joint for joint in description.chain(tip) if joint.moves]
    limits = _table(values, "limits")
    for name, row in [*((row, limits.get(row)) for row in robots.ROWS), ("path", values.get("path"))]:
        if not isinstance(row, dict):
            text = f"the limits file has no {name} limits: give it a table with the numbers and their source"
            yield error("NoLimits", name, text)
        elif str(row.get("source", "")).strip().lower() in EMPTY_WORDS:
            text = f"the {name} limits name no source: say where the numbers are from, or that they were chosen"
            yield (warning if str(row.get("source", "")).strip() else error)("NoSource", name, text)
    if not (isinstance(values.get("hull"), dict) and values["hull"].get("capsules")):
        text = (
            "there is no [hull]: nothing would keep the arm from touching itself, the table or the part; "
            "`opcua-skill arms describe` fits capsules to its meshes"
        )
        yield error("NoHull", "hull", text)
    position = _table(limits, "position")
    lower, upper = _row(position.get("lower")), _row(position.get("upper"))
    velocity = _table(limits, "velocity")
    speeds = _row(velocity.get("values"))
    home = _row(values.get("home"))
    for k, joint in enumerate(moving):
        if k < len(home) and k < len(lower) and k < len(upper) and not lower[k] <= home[k] <= upper[k]:
            text = f"joint {joint.name!r} is at {home[k]:g} at home, outside of {lower[k]:g} to {upper[k]:g}: move home"
            yield error("HomeOutside", joint.name, text)
        if k < len(lower) and k < len(upper):
            yield from _range(joint, lower[k], upper[k])
        if k < len(speeds):
            yield from _speed(joint, speeds[k])
    for name in ("acceleration", "jerk"):
        row = _table(limits, name)
        for number, value in enumerate(_row(row.get("values")), start=1):
            if not value > 0.0:
                where = f"limits.{name}"
                yield error("ZeroLimits", where, f"the {name} of joint {number} is {value:g}: it has to be more than 0")


def _range(joint: urdf.JointRow, low: float, high: float) -> Iterator[ArmFinding]:
    name = joint.name
    if not low < high:
        text = f"joint {name!r} may go from {low:g} to {high:g} in the limits file: write its range"
        yield error("ZeroLimits", name, text)
    reach = max(abs(low), abs(high))
    if joint.kind != "prismatic" and reach > urdf.MOST_TURN:
        text = f"joint {name!r} turns to {reach:g} rad in the limits file: this looks like degrees, write radians"
        yield error("InDegrees", name, text)
    if joint.kind == "prismatic" and reach > urdf.MOST_LENGTH:
        text = f"joint {name!r} slides to {reach:g} m in the limits file: this looks like mm, write m"
        yield error("InMillimetres", name, text)
    if joint.kind == "continuous" or joint.lower is None or joint.upper is None:
        return
    if low < joint.lower - WIDER or high > joint.upper + WIDER:
        text = (
            f"joint {name!r} may go from {low:g} to {high:g} by the limits file and from {joint.lower:g} to "
            f"{joint.upper:g} by the URDF: make sure which the controller keeps"
        )
        yield warning("LimitsWider", name, text)


def _speed(joint: urdf.JointRow, speed: float) -> Iterator[ArmFinding]:
    name = joint.name
    if not speed > 0.0:
        yield error("ZeroLimits", name, f"the velocity of joint {name!r} is {speed:g}: it has to be more than 0")
    elif joint.kind == "prismatic" and speed > FAST_SLIDE:
        yield error("InMillimetres", name, f"joint {name!r} slides with {speed:g} m/s: this looks like mm/s, write m/s")
    elif joint.kind != "prismatic" and speed > FAST_TURN:
        text = f"joint {name!r} turns with {speed:g} rad/s: this looks like degrees, write rad/s"
        yield error("InDegrees", name, text)
    elif joint.velocity and speed > joint.velocity * (1.0 + WIDER):
        text = f"joint {name!r} may do {speed:g} by the limits file and {joint.velocity:g} by the URDF: make sure which"
        yield warning("LimitsWider", name, text)


def _table(values: dict[str, Any], name: str) -> dict[str, Any]:
    found = values.get(name)
    return found if isinstance(found, dict) else {}


def _row(values: Any) -> list[float]:
    if not isinstance(values, list):
        return []
    return [float(one) if isinstance(one, int | float) else math.nan for one in values]


def _of_model(model: ArmModel, description: urdf.Description, shapes: list[Carried]) -> Iterator[ArmFinding]:
    """Yield what is wrong with an arm that can be read: its hull, home and workspace held against each other."""
    if model.unconfirmed:
        text = (
            f"nobody has confirmed {', '.join(model.unconfirmed)} yet, and a server refuses the arm: look at each and "
            "take its name out of to_confirm"
        )
        yield error("Unconfirmed", "to_confirm", text)
    yield from _hull(model, description, shapes)
    yield from _home(model)
    yield from _workspace(model)
    for tool in model.tools:
        try:
            robots.changed(model, robots.Changes(tool=tool.name))
        except ValueError as wrong:
            yield error("NotLoadable", tool.name, str(wrong))


def _hull(model: ArmModel, description: urdf.Description, shapes: list[Carried]) -> Iterator[ArmFinding]:
    if not model.capsules:
        return
    held = {capsule.link for capsule in model.capsules}
    for one in shapes:
        if one.link not in held:
            text = f"link {one.link!r} has a shape and no capsule: nothing would keep it from touching things, add one"
            yield error("HullIncomplete", one.link, text)
            continue
        own = [capsule for capsule in model.capsules if capsule.link == one.link]
        over = np.min([beyond(one.points, capsule) for capsule in own], axis=0)
        if over.max() > HELD:
            text = (
                f"link {one.link!r} sticks out of its capsules by {1e3 * over.max():.1f} mm: make them larger, "
                "`opcua-skill arms describe` fits them anew"
            )
            yield error("HullSticksOut", one.link, text)
    shaped = {one.link for one in shapes}
    chain = description.chain(kinematics(model).joints[-1].child) or description.chain(model.tool.tip)
    for before, after in pairwise(chain):
        far = math.hypot(*(after.xyz or (0.0,)))
        known = held | shaped | ({before.child} if not before.moves and before.parent in held else set())
        if before.child not in known and far > LONG_LINK:
            text = (
                f"link {before.child!r} has neither shape nor capsule, and the next joint is {1e3 * far:.0f} mm on: "
                "give it a capsule"
            )
            yield warning("HullIncomplete", before.child, text)
    at_tip = needle(model)
    if at_tip is not None and at_tip.radius > THICK:
        text = (
            f"the capsule at the tip is {2e3 * at_tip.radius:.0f} mm thick and may come near the part, as a needle has "
            "to: give the needle a capsule of its own that ends at the tip"
        )
        yield warning("NeedleThick", at_tip.link, text)
    if at_tip is None:
        text = "no capsule ends at the tip: the needle is not kept from anything, give it one"
        yield warning("NeedleThick", model.tool.tip, text)


def _home(model: ArmModel) -> Iterator[ArmFinding]:
    chain = kinematics(model)
    place, turn = chain.seed_position, chain.seed_rotation
    none = np.array([math.nan])
    for finding in check_clearance(model, np.array([model.home]), none, none, (Cell().table(),), off_path="at home")[0]:
        yield error("HomeInCollision", "home", f"{finding.text}; or give the arm another home")
    low, high = np.array(model.workspace_low), np.array(model.workspace_high)
    if ((place < low) | (place > high)).any():
        x, y, z = 1e3 * place
        text = (
            f"at home the nozzle is at x {x:.0f} y {y:.0f} z {z:.0f} mm, outside of the workspace: "
            "make the workspace larger, or give the arm another home"
        )
        yield warning("HomeOutsideWorkspace", "home", text)
    lean = math.degrees(math.acos(float(np.clip(-turn[2, 2], -1.0, 1.0))))
    if lean > 90.0:
        text = (
            f"at home the nozzle points {lean - 90.0:.0f} degrees upwards: z has to point out of the tip, "
            "turn the tool's frame ([tool] turn = [3.14159265, 0, 0])"
        )
        yield warning("NozzleUp", "home", text)


def _workspace(model: ArmModel) -> Iterator[ArmFinding]:
    """Yield how much of the workspace, and of a plate at the part's place, is reached with the nozzle as at home."""
    chain = kinematics(model)
    low, high = np.array(model.workspace_low), np.array(model.workspace_high)
    if max(np.abs(low).max(), np.abs(high).max()) > urdf.MOST_LENGTH:
        text = f"the workspace reaches {max(np.abs(low).max(), np.abs(high).max()):g} m: this looks like mm, write m"
        yield error("InMillimetres", "cell", text)
        return
    share = float(reachable(chain, grid(low, high, GRID), chain.seed_rotation).mean())
    if share == 0.0:
        text = "no place of the workspace is reached with the nozzle as it is held at home: move the workspace or home"
        yield error("WorkspaceUnreachable", "cell", text)
    elif share < 1.0:
        text = (
            f"{100 * share:.0f} % of the workspace is reached with the nozzle as at home: plans elsewhere are refused"
        )
        yield note("WorkspacePartly", "cell", text)
    corners = np.array([[0.0, 0.0, 0.0], [PLATE[0], 0.0, 0.0], [0.0, PLATE[1], 0.0], [*PLATE, 0.0]])
    corners = Rotation.from_quat(model.part_frame[3:]).apply(corners) + np.array(model.part_frame[:3])
    if not reachable(chain, corners, chain.seed_rotation).all():
        text = "a plate of 65 x 90 mm at part_frame is not reached with the nozzle as at home: move part_frame"
        yield warning("PartUnreachable", "cell", text)
