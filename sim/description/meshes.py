"""The points that span a link's shape: vertices of STL, OBJ and COLLADA files, corners of boxes, rims of cylinders."""

import math
import struct
from pathlib import Path
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import numpy as np

from sim.arm_model import Floats
from sim.description.findings import DescriptionError
from sim.description.urdf import Shape

RIM = 48
HUGE, MOST = 20_000_000, 400_000_000
FORMATS = (".stl", ".obj", ".dae")


class MeshRefused(DescriptionError):
    """A mesh that cannot be read: one sentence with the way out."""


def mesh_file(shape: Shape, folders: tuple[Path, ...]) -> Path | None:
    """Return the file of a mesh: as written, or below the first of ``folders`` that has it."""
    written = Path(unquote(urlsplit(shape.file).path)) if shape.file.startswith("file://") else Path(shape.file)
    for place in (written,) if written.is_absolute() else tuple(folder / written for folder in folders):
        if place.is_file():
            return place
    return None


def points_of(shape: Shape, folders: tuple[Path, ...]) -> Floats:
    """Return points (n, 3) in the link's frame, m, whose convex hull holds the whole shape.

    Raises ``MeshRefused`` for a mesh that is missing or cannot be read.
    """
    if shape.kind == "mesh":
        file = mesh_file(shape, folders)
        if file is None:
            raise MeshRefused(f"the mesh {shape.file!r} of link {shape.link!r} is not there: lay it beside the URDF")
        local = vertices(file) * np.array(shape.size)
    elif shape.kind == "box":
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        local = 0.5 * signs * np.array(shape.size)
    elif shape.kind == "cylinder":
        radius, length = shape.size
        local = np.concatenate([_rim(radius, 0.5 * length), _rim(radius, -0.5 * length)])
    elif shape.kind == "sphere":
        (radius,) = shape.size
        heights = np.linspace(-1.0, 1.0, 13)
        # Rings of a polyhedron around the ball: a little larger, so that its hull holds the ball.
        spare = radius / math.cos(math.pi / 12) ** 2
        local = np.concatenate([_rim(spare * math.sqrt(1 - h**2), spare * h) for h in heights])
    else:
        raise MeshRefused(f"a shape of link {shape.link!r} is not one that can be read")
    return local @ shape.rotation.T + shape.offset


def _rim(radius: float, height: float) -> Floats:
    angles = np.linspace(0.0, 2.0 * math.pi, RIM, endpoint=False)
    around = radius / math.cos(math.pi / RIM)
    return np.column_stack([around * np.cos(angles), around * np.sin(angles), np.full(RIM, height)])


def vertices(file: Path) -> Floats:
    """Return the vertices (n, 3) of a mesh file in its own unit. Raises ``MeshRefused``."""
    kind = file.suffix.lower()
    if kind not in FORMATS:
        raise MeshRefused(f"{file.name} is a {kind or 'nameless'} file: save the mesh as one of {', '.join(FORMATS)}")
    try:
        if file.stat().st_size > MOST:
            raise MeshRefused(
                f"{file.name} is larger than {MOST // 1_000_000} MB: save a simplified mesh for collisions"
            )
        content = file.read_bytes()
        found = {".stl": _stl, ".obj": _obj, ".dae": _dae}[kind](content)
    except MeshRefused:
        raise
    except (OSError, ValueError, IndexError, struct.error, ElementTree.ParseError) as wrong:
        raise MeshRefused(
            f"{file.name} cannot be read as {kind[1:].upper()}: {wrong}; export the mesh again"
        ) from wrong
    if not len(found) or not np.isfinite(found).all():
        raise MeshRefused(f"{file.name} has no vertices, or some that are no numbers: export the mesh again")
    return found


def _stl(content: bytes) -> Floats:
    if len(content) >= 84:
        (count,) = struct.unpack_from("<I", content, 80)
        # A binary file may begin with "solid" as well: its length tells.
        if len(content) == 84 + 50 * count:
            layout = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
            return np.frombuffer(content, layout, count, 84)["corners"].reshape(-1, 3).astype(np.float64)
    if not content.lstrip().startswith(b"solid"):
        raise MeshRefused("the STL file is cut off, or no STL file: export the mesh again")
    rows = [
        line.split()[1:4] for line in content.decode("utf-8", "replace").splitlines() if line.split()[:1] == ["vertex"]
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _obj(content: bytes) -> Floats:
    rows = [line.split()[1:4] for line in content.decode("utf-8", "replace").splitlines() if line.split()[:1] == ["v"]]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _dae(content: bytes) -> Floats:
    """Read the positions of a COLLADA file, placed by its scene, in metres, z upwards."""
    root = ElementTree.fromstring(content)
    space = root.tag.partition("}")[0] + "}" if root.tag.startswith("{") else ""
    unit = root.find(f"{space}asset/{space}unit")
    metre = float(unit.get("meter", "1")) if unit is not None else 1.0
    up = root.findtext(f"{space}asset/{space}up_axis", "Y_UP").strip()
    meshes = {geometry.get("id", ""): _positions(geometry, space) for geometry in root.iter(f"{space}geometry")}
    placed: list[Floats] = []

    def walk(node: ElementTree.Element, above: Floats) -> None:
        here = above @ _placing(node, space)
        for instance in node.findall(f"{space}instance_geometry"):
            points = meshes.get(instance.get("url", "").lstrip("#"))
            if points is not None and len(points):
                placed.append(points @ here[:3, :3].T + here[:3, 3])
        for child in node.findall(f"{space}node"):
            walk(child, here)

    for scene in root.iter(f"{space}visual_scene"):
        for node in scene.findall(f"{space}node"):
            walk(node, np.eye(4))
    if not placed:
        placed = [points for points in meshes.values() if len(points)]
    if not placed:
        return np.empty((0, 3))
    turn = {"Y_UP": [[1, 0, 0], [0, 0, -1], [0, 1, 0]], "X_UP": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}.get(up)
    points = np.concatenate(placed) * metre
    return points @ np.array(turn, dtype=np.float64).T if turn else points


def _positions(geometry: ElementTree.Element, space: str) -> Floats:
    """Return the points (n, 3) that a geometry names as positions."""
    named = {
        entry.get("source", "").lstrip("#")
        for entry in geometry.iter(f"{space}input")
        if entry.get("semantic") == "POSITION"
    }
    rows = [
        np.array((source.findtext(f"{space}float_array") or "").split(), dtype=np.float64).reshape(-1, 3)
        for source in geometry.iter(f"{space}source")
        if source.get("id") in named
    ]
    return np.concatenate(rows) if rows else np.empty((0, 3))


def _placing(node: ElementTree.Element, space: str) -> Floats:
    """Return the placing (4, 4) of a node below the one above it: its transformations in their order."""
    found = np.eye(4)
    for tag in node:
        kind = tag.tag.removeprefix(space)
        if kind not in {"matrix", "translate", "rotate", "scale"}:
            continue
        values = np.array((tag.text or "").split(), dtype=np.float64)
        step = np.eye(4)
        if kind == "matrix":
            step = values.reshape(4, 4)
        elif kind == "translate":
            step[:3, 3] = values
        elif kind == "scale":
            step[:3, :3] = np.diag(values)
        else:
            axis, angle = values[:3] / np.linalg.norm(values[:3]), math.radians(values[3])
            cross = np.cross(np.eye(3), axis)
            step[:3, :3] = np.eye(3) - math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
        found = found @ step
    return found
