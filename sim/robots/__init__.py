"""Arms: those that come with the project, and anybody's own from a folder.

Each is a description (URDF) and a limits file (TOML) in which every row names its source. What a workstation changes,
its workspace, home or tool tip, becomes part of the model and of its digest.
"""

import hashlib
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from sim.arm_model import ArmModel, Capsule, Limits, PathLimits, SpareTool, Tool
from sim.planning.kinematics import kinematics

NAMES = ("panda", "xarm6", "iiwa14")
ROWS = ("position", "velocity", "acceleration", "jerk")
TIP_LINK = "configured_tip"
NOWHERE = (0.0, 0.0, 0.0)
# What is put between the tip of the description and a configured one: as thick as a dispensing needle.
NEEDLE = 2.5e-3


@dataclass(frozen=True, slots=True)
class Changes:
    """What a workstation has otherwise than its arm's files say; what is empty stays.

    ``tip`` and ``tip_turn`` are where the tool's tip is in the tip frame of the description: m, and roll, pitch, yaw
    in rad. ``tool`` names one of the tools in the arm's limits file. ``collisions_checked`` False says in as many words
    that nothing keeps the arm from touching things.
    """

    workspace_low: tuple[float, float, float] | None = None
    workspace_high: tuple[float, float, float] | None = None
    home: tuple[float, ...] | None = None
    tip: tuple[float, float, float] | None = None
    tip_turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tool: str = ""
    collisions_checked: bool = True


def names() -> tuple[str, ...]:
    """Return the names of the arms that come with the project, the default first."""
    return NAMES


@lru_cache(maxsize=8)
def load(name: str = "panda") -> ArmModel:
    """Return the model of an arm: one of the known names, or the folder or common stem of its URDF and limits file.

    Raises ``ValueError`` naming what is wrong.
    """
    if name in NAMES:
        folder = files("sim.robots")
        urdf, table = ((folder / f"{name}.{kind}").read_text("utf-8") for kind in ("urdf", "toml"))
        return read_model(name, urdf, table)
    stem = _stem(Path(name))
    if stem is None:
        raise ValueError(
            f"there is no arm {name!r}: known are {', '.join(NAMES)}, or a folder with a URDF and a limits file"
        )
    return read_files(stem)


def read_files(stem: Path) -> ArmModel:
    """Return the model of an arm from the files with the path ``stem`` and their endings, as they are now.

    Raises ``ValueError`` naming what is wrong.
    """
    try:
        # What editors of Windows put before the first letter (a byte order mark) is no part of the text.
        urdf, table = (stem.with_name(f"{stem.name}.{kind}").read_text("utf-8-sig") for kind in ("urdf", "toml"))
    except (OSError, UnicodeDecodeError) as unreadable:
        raise ValueError(f"the files of arm {str(stem)!r} cannot be read: {unreadable}") from unreadable
    model = read_model(stem.name, urdf, table)
    return replace(model, urdf=_with_meshes_found(model.urdf, stem.parent))


def _with_meshes_found(urdf: str, folder: Path) -> str:
    """Return a description whose meshes that lie beside it are named by their whole path."""
    root = ElementTree.fromstring(urdf)
    found = {mesh.get("filename", "") for mesh in root.iter("mesh")}
    beside = {name: (folder / name).resolve() for name in found if name and (folder / name).is_file()}
    if not beside:
        return urdf
    for mesh in root.iter("mesh"):
        if place := beside.get(mesh.get("filename", "")):
            mesh.set("filename", str(place))
    return ElementTree.tostring(root, encoding="unicode")


def _stem(place: Path) -> Path | None:
    """Return the path without ending of a URDF and a limits file of one name, in a folder or given as such."""
    if place.suffix in {".urdf", ".toml"}:
        place = place.with_suffix("")
    if place.with_name(f"{place.name}.urdf").is_file() and place.with_name(f"{place.name}.toml").is_file():
        return place
    found = stems(place)
    if len(found) > 1:
        named = ", ".join(str(one) for one in found)
        raise ValueError(f"folder {str(place)!r} holds more than one arm: name one of {named}")
    return found[0] if found else None


def stems(folder: Path) -> list[Path]:
    """Return the paths without ending of every URDF in a folder that has a limits file of the same name."""
    return [one.with_suffix("") for one in sorted(folder.glob("*.urdf")) if one.with_suffix(".toml").is_file()]


def read_model(name: str, urdf: str, table: str) -> ArmModel:
    """Return an arm's model from the text of its URDF and of its limits file. The digest covers both.

    Raises ``ValueError`` with one sentence that says what of them is missing, wrong or not understood.
    """
    try:
        values: dict[str, Any] = tomllib.loads(table)
        model = _model(name, urdf, table, values)
        _check(model, values)
    except ElementTree.ParseError as wrong:
        raise ValueError(f"the description of {name} is no XML: {wrong}") from wrong
    except KeyError as missing:
        raise ValueError(f"the limits file of {name} has no {missing.args[0]!r}") from missing
    except (TypeError, AttributeError, IndexError, tomllib.TOMLDecodeError) as wrong:
        raise ValueError(f"the limits file of {name} cannot be read: {wrong}") from wrong
    main = values["tool"]
    if "offset" not in main and "turn" not in main:
        return model
    turned = _with_tip(model, main.get("offset", NOWHERE), main.get("turn", NOWHERE))
    return replace(turned, tool=replace(turned.tool, length=model.tool.length))


def _model(name: str, urdf: str, table: str, values: dict[str, Any]) -> ArmModel:
    limits = values["limits"]
    path, tool, cell, hull = values["path"], values["tool"], values["cell"], values.get("hull", {})
    return ArmModel(
        name=name,
        manufacturer=values["manufacturer"],
        model=values["model"],
        urdf=urdf,
        limits=Limits(
            lower=tuple(limits["position"]["lower"]),
            upper=tuple(limits["position"]["upper"]),
            velocity=tuple(limits["velocity"]["values"]),
            acceleration=tuple(limits["acceleration"]["values"]),
            jerk=tuple(limits["jerk"]["values"]),
            sources=tuple((row, limits[row]["source"]) for row in ROWS),
        ),
        path_limits=PathLimits(path["speed"], path["acceleration"], path["jerk"], path["source"]),
        home=tuple(values["home"]),
        tool=Tool(tool["tip"], tool["name"], tool["mass"], tool["length"]),
        workspace_low=tuple(cell["workspace_low"]),
        workspace_high=tuple(cell["workspace_high"]),
        part_frame=tuple(cell["part_frame"]),
        capsules=tuple(
            Capsule(row["link"], tuple(row["start"]), tuple(row["end"]), row["radius"])
            for row in hull.get("capsules", [])
        ),
        apart=tuple((pair[0], pair[1]) for pair in hull.get("apart", [])),
        atomic_skills=tuple(values["atomic_skills"]),
        tools=tuple(_spare(row, tool["tip"]) for row in values.get("tools", [])),
        unconfirmed=tuple(values.get("to_confirm", [])),
        digest=hashlib.sha256(f"{urdf}\0{table}".encode()).hexdigest(),
    )


def _spare(row: dict[str, Any], tip: str) -> SpareTool:
    """Return one of the further tools of an arm from its row in the limits file."""
    tip = row.get("tip", tip)
    return SpareTool(
        name=row["name"],
        tip=tip,
        offset=_three(row.get("offset", NOWHERE), "offset", row["name"]),
        turn=_three(row.get("turn", NOWHERE), "turn", row["name"]),
        mass=float(row["mass"]),
        length=float(row["length"]),
        capsules=tuple(
            Capsule(tip, tuple(one["start"]), tuple(one["end"]), one["radius"]) for one in row.get("capsules", [])
        ),
        residual=float(row.get("residual", math.nan)),
    )


def _three(values: Sequence[float], what: str, tool: str) -> tuple[float, float, float]:
    if len(values) != 3 or not all(math.isfinite(value) for value in values):
        raise ValueError(f"the {what} of tool {tool!r} is {list(values)}: it has to be three finite numbers")
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def _check(model: ArmModel, values: dict[str, Any]) -> None:
    """Raise ``ValueError`` for the first thing in an arm's files that does not fit the rest of them."""
    name, limits = model.name, model.limits
    chain = kinematics(model)
    for row, numbers in (
        ("lower positions", limits.lower),
        ("upper positions", limits.upper),
        ("velocities", limits.velocity),
        ("accelerations", limits.acceleration),
        ("jerks", limits.jerk),
        ("home", model.home),
    ):
        if len(numbers) != chain.dof:
            raise ValueError(f"{name} has {chain.dof} moving joints and {len(numbers)} {row} in its limits file")
        if not all(math.isfinite(one) for one in numbers):
            raise ValueError(f"the {row} of {name} are {list(numbers)}: they have to be finite numbers")
    for row, numbers in (
        ("velocities", limits.velocity),
        ("accelerations", limits.acceleration),
        ("jerks", limits.jerk),
        ("path limits", (model.path_limits.speed, model.path_limits.acceleration, model.path_limits.jerk)),
    ):
        if min(numbers) <= 0.0:
            raise ValueError(f"the {row} of {name} are {list(numbers)}: they have to be more than 0")
    for row, source in (*limits.sources, ("path", values["path"]["source"])):
        if not str(source).strip():
            raise ValueError(f"the {row} limits of {name} name no source: say where the numbers are from")
    for joint, (low, high, at) in enumerate(zip(limits.lower, limits.upper, model.home, strict=True), start=1):
        if not low <= at <= high:
            raise ValueError(f"joint {joint} of {name} is at {at:g} at home, outside of its range {low:g} to {high:g}")
    known = {"base"} | {link for joint in chain.joints for link in (joint.parent, joint.child)}
    for link in [capsule.link for capsule in model.capsules] + [link for pair in model.apart for link in pair]:
        if link not in known:
            raise ValueError(f"the hull of {name} names link {link!r}, which is not between its base and its tip")
    _check_box(model)


def _check_box(model: ArmModel) -> None:
    if len(model.workspace_low) != 3 or len(model.workspace_high) != 3:
        raise ValueError(f"the workspace of {model.name} has to be two corners of three numbers each")
    if not all(low < high for low, high in zip(model.workspace_low, model.workspace_high, strict=True)):
        raise ValueError(
            f"the workspace of {model.name} is from {list(model.workspace_low)} to {list(model.workspace_high)} m: "
            "every upper number has to be more than the lower one"
        )


def changed(model: ArmModel, changes: Changes) -> ArmModel:
    """Return an arm as a workstation has it. Raises ``ValueError`` where the changes do not fit the arm."""
    if changes == Changes():
        return model
    low, high = changes.workspace_low or model.workspace_low, changes.workspace_high or model.workspace_high
    found = replace(
        model,
        workspace_low=low,
        workspace_high=high,
        home=changes.home or model.home,
        collisions_checked=changes.collisions_checked,
        digest=hashlib.sha256(f"{model.digest}\0{changes}".encode()).hexdigest(),
    )
    if len(found.home) != model.dof:
        raise ValueError(f"{model.name} has {model.dof} moving joints and {len(found.home)} at its configured home")
    for joint, (least, most, at) in enumerate(zip(model.limits.lower, model.limits.upper, found.home, strict=True), 1):
        if not least <= at <= most:
            raise ValueError(
                f"joint {joint} of {model.name} is at {at:g} at the configured home, outside of its range "
                f"{least:g} to {most:g}"
            )
    _check_box(found)
    if changes.tool:
        found = _with_tool(found, changes.tool)
    return found if changes.tip is None else _with_tip(found, changes.tip, changes.tip_turn)


def _with_tool(model: ArmModel, name: str) -> ArmModel:
    """Return an arm that carries another of its tools; what of the first one is beyond the new tip's link is off."""
    chosen = next((tool for tool in model.tools if tool.name == name), None)
    if chosen is None:
        known = ", ".join(tool.name for tool in model.tools) or "none"
        raise ValueError(f"{model.name} has no tool {name!r}: its limits file names {known}")
    behind = {chosen.tip}
    joints = kinematics(model).joints
    if chosen.tip in {joint.parent for joint in joints}:
        behind = {joint.parent for joint in joints[[joint.parent for joint in joints].index(chosen.tip) :]}
        if any(joint.axis is not None and joint.parent in behind for joint in joints):
            raise ValueError(f"tool {name!r} of {model.name} hangs on {chosen.tip!r}, before its last moving joint")
    bare = replace(model, tool=Tool(chosen.tip, chosen.name, chosen.mass, chosen.length))
    left = {joint.child for joint in joints} - {joint.child for joint in kinematics(bare).joints}
    hull = (*(one for one in model.capsules if one.link not in left), *chosen.capsules)
    apart = tuple(pair for pair in model.apart if left.isdisjoint(pair))
    carried = _with_tip(replace(bare, capsules=hull, apart=apart), chosen.offset, chosen.turn)
    return replace(carried, tool=replace(carried.tool, length=chosen.length))


def _with_tip(model: ArmModel, tip: Sequence[float], turn: Sequence[float]) -> ArmModel:
    """Return an arm whose tool ends elsewhere than its description says: one fixed joint more."""
    place, angles = (" ".join(repr(float(one)) for one in row) for row in (tip, turn))
    link = TIP_LINK if TIP_LINK not in model.urdf else f"{TIP_LINK}_{model.urdf.count(TIP_LINK)}"
    joint = (
        f'<link name="{link}"/><joint name="to_{link}" type="fixed"><parent link="{model.tool.tip}"/>'
        f'<child link="{link}"/><origin xyz="{place}" rpy="{angles}"/></joint>'
    )
    end = model.urdf.rindex("</robot>")
    reach = float(np.linalg.norm(tip))
    needle = Capsule(model.tool.tip, NOWHERE, _three(tip, "offset", model.tool.name), NEEDLE)
    hull = (*model.capsules, needle) if model.capsules and reach > 0.0 else model.capsules
    return replace(
        model,
        urdf=f"{model.urdf[:end]}{joint}{model.urdf[end:]}",
        tool=replace(model.tool, tip=link, length=model.tool.length + float(tip[2])),
        capsules=hull,
    )
