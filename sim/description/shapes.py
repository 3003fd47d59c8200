"""What every link of a chain carries: its own shapes, and those of what is fixed to it beside the chain."""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sim.arm_model import Floats
from sim.description.findings import ArmFinding, error, warning
from sim.description.meshes import HUGE, MeshRefused, mesh_file, points_of
from sim.description.urdf import Description, Shape


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """One shape of a link of the chain: points (n, 3) in that link's frame, m, whose hull holds it."""

    link: str
    shape: Shape
    points: Floats


def folders(beside: Path) -> tuple[Path, ...]:
    """Return where meshes are looked for: beside the description, then with those that come with PyBullet."""
    found = find_spec("pybullet_data")
    shipped = (Path(found.origin).parent,) if found and found.origin else ()
    return (beside, *shipped)


def carried(description: Description, tip: str, beside: Path) -> tuple[list[Carried], list[ArmFinding]]:
    """Return the shapes of the links from the base to ``tip``, and which of them cannot be read."""
    places = folders(beside)
    found: list[Carried] = []
    findings: list[ArmFinding] = []
    rows = {link.name: link for link in description.links}
    for name, (owner, rotation, offset) in _owners(description, tip).items():
        for shape in rows[name].hull if name in rows else ():
            if shape.kind == "unknown":
                continue
            findings += _of_size(shape, places)
            try:
                points = points_of(shape, places)
            except MeshRefused as refused:
                missing = shape.kind == "mesh" and mesh_file(shape, places) is None
                findings.append(error("MeshMissing" if missing else "MeshUnreadable", name, str(refused)))
                continue
            if np.abs(points).max() > 20.0:
                text = (
                    f"a shape of link {name!r} reaches {np.abs(points).max():g} m from its frame: this looks like mm, "
                    "give the mesh a scale of 0.001"
                )
                findings.append(error("InMillimetres", name, text))
                continue
            found.append(Carried(owner, shape, points @ rotation.T + offset))
    return found, findings


def _of_size(shape: Shape, places: tuple[Path, ...]) -> Iterator[ArmFinding]:
    file = mesh_file(shape, places) if shape.kind == "mesh" else None
    if file is not None and file.stat().st_size > HUGE:
        text = (
            f"the mesh {file.name} of link {shape.link!r} is {file.stat().st_size / 1e6:.0f} MB: simulation and "
            "pictures become slow, save a simplified one"
        )
        yield warning("MeshHuge", shape.link, text)


def _owners(description: Description, tip: str) -> dict[str, tuple[str, Floats, Floats]]:
    """Return for each link that moves as one of the chain which one that is, and its rotation and offset there."""
    chain = description.chain(tip)
    still: tuple[Floats, Floats] = (np.eye(3), np.zeros(3))
    names = [chain[0].parent, *(joint.child for joint in chain)] if chain else [tip]
    found: dict[str, tuple[str, Floats, Floats]] = {name: (name, *still) for name in names}
    for _ in description.joints:
        for joint in description.joints:
            if joint.moves or joint.child in found or joint.parent not in found or not (joint.xyz and joint.rpy):
                continue
            owner, rotation, offset = found[joint.parent]
            turn = Rotation.from_euler("xyz", joint.rpy).as_matrix()
            found[joint.child] = (owner, rotation @ turn, offset + rotation @ np.array(joint.xyz))
    return found
