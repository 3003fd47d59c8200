"""A URDF as it is written, without trust: links, joints and shapes as rows, and what is odd in them."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from sim.arm_model import Floats
from sim.description.findings import ArmFinding, error, note, warning
from sim.planning.kinematics import FEWEST_AXES, KINDS, MOST_AXES

XACRO = "http://www.ros.org/wiki/xacro"
UNIT = 1e-3
UNBOUNDED = (-math.inf, math.inf)
# A turn of more than four full ones, or a part longer than twenty metres, is another unit.
MOST_TURN, MOST_LENGTH = 8.0 * math.pi, 20.0
OF_JOINTS = frozenset({"JointType", "Mimic", "NoAxis", "ZeroLimits", "LimitsSwapped", "InDegrees", "InMillimetres"})
ShapeKind = Literal["mesh", "box", "cylinder", "sphere", "unknown"]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One geometry of a link: ``offset`` (3,) m and ``rotation`` (3, 3) in the link's frame.

    ``size`` is what the tag says: x y z of a box, radius and length of a cylinder, radius of a sphere, scale of a mesh.
    """

    link: str
    use: Literal["visual", "collision"]
    kind: ShapeKind
    offset: Floats
    rotation: Floats
    size: tuple[float, ...]
    file: str = ""


@dataclass(frozen=True, slots=True)
class JointRow:
    """One joint as written; ``None`` where nothing, or nothing readable, is."""

    name: str
    kind: str
    parent: str
    child: str
    axis: tuple[float, ...] | None
    xyz: tuple[float, ...] | None
    rpy: tuple[float, ...] | None
    lower: float | None
    upper: float | None
    velocity: float | None
    limited: bool
    mimics: str
    soft: bool = False

    @property
    def moves(self) -> bool:
        """Whether it is not fixed."""
        return self.kind != "fixed"


@dataclass(frozen=True, slots=True, eq=False)
class LinkRow:
    """One link as written; ``mass`` None: no inertia."""

    name: str
    mass: float | None
    shapes: tuple[Shape, ...]

    @property
    def hull(self) -> tuple[Shape, ...]:
        """The shapes that say how large it is: for collisions where there are such, else as it is seen."""
        found = tuple(shape for shape in self.shapes if shape.use == "collision")
        return found or self.shapes


@dataclass(frozen=True, slots=True, eq=False)
class Description:
    """A URDF's rows, in the order of the file."""

    name: str
    links: tuple[LinkRow, ...]
    joints: tuple[JointRow, ...]

    @property
    def tips(self) -> tuple[str, ...]:
        """Links that nothing hangs on, in the order of the file."""
        parents = {joint.parent for joint in self.joints}
        return tuple(link.name for link in self.links if link.name not in parents)

    def chain(self, tip: str) -> tuple[JointRow, ...]:
        """Return the joints from the root to ``tip``; ends where a loop closes."""
        by_child = {joint.child: joint for joint in self.joints}
        found: list[JointRow] = []
        while tip in by_child and by_child[tip] not in found:
            found.append(by_child[tip])
            tip = found[-1].parent
        return tuple(reversed(found))

    def longest(self) -> str:
        """Return the tip with most moving joints before it, the deepest of those."""
        return max(self.tips, key=lambda tip: (sum(one.moves for one in self.chain(tip)), len(self.chain(tip))))


def read(text: str, where: str) -> tuple[Description | None, list[ArmFinding]]:
    """Return the rows of a URDF and what is odd in its writing; None where it is no URDF that can be read."""
    way_out = f"write it out first, where ROS is: `xacro {where}.xacro > {where}`"
    xacro = error("Xacro", where, f"{where} holds xacro, which is a program, not a description: {way_out}")
    try:
        root = ElementTree.fromstring(text.encode())
    except (ElementTree.ParseError, ValueError, LookupError) as wrong:
        if "<xacro:" in text:
            return None, [xacro]
        return None, [error("NotUrdf", where, f"{where} is no XML: {wrong}; export the arm again")]
    # What xacro has written out may still name its namespace.
    if any(tag.tag.startswith(f"{{{XACRO}}}") for tag in root.iter()) or any(
        mark in value for tag in root.iter() for value in tag.attrib.values() for mark in ("${", "$(")
    ):
        return None, [xacro]
    if root.tag != "robot":
        return None, [
            error("NotUrdf", where, f"{where} begins with <{root.tag}>, a URDF with <robot>: export the arm as URDF")
        ]
    links = tuple(_link(tag) for tag in root.findall("link"))
    joints = tuple(_joint(tag) for tag in root.findall("joint"))
    found = Description(root.get("name", ""), links, joints)
    return found, list(_oddities(found, where))


def _oddities(read: Description, where: str) -> Iterator[ArmFinding]:
    yield from _tree(read, where)
    for joint in read.joints:
        yield from _joint_oddities(joint)
    for link in read.links:
        for shape in link.shapes:
            if "://" in shape.file and not shape.file.startswith("file://"):
                yield error(
                    "PackagePath",
                    link.name,
                    f"link {link.name!r} takes its mesh from {shape.file!r}, which only ROS can find: "
                    "lay the meshes beside the URDF and write their path from there",
                )
            if shape.kind == "unknown" or not _finite(shape.size):
                yield error(
                    "NumberUnreadable",
                    link.name,
                    f"link {link.name!r} has a {shape.use} shape that is no mesh, box, cylinder or sphere with its "
                    "sizes: write one of these",
                )


def _tree(read: Description, where: str) -> Iterator[ArmFinding]:
    """Yield what keeps links and joints from being one tree."""
    names = [link.name for link in read.links]
    for kind, listed in (("link", names), ("joint", [joint.name for joint in read.joints])):
        for name, times in Counter(listed).items():
            if times > 1:
                yield error("DuplicateName", name, f"{times} {kind}s are named {name!r}: give each a name of its own")
    known = set(names)
    for joint in read.joints:
        for link in (joint.parent, joint.child):
            if link not in known:
                yield error(
                    "UnknownLink", joint.name, f"joint {joint.name!r} joins link {link!r}, which is not there: add it"
                )
    for child, times in Counter(joint.child for joint in read.joints).items():
        if times > 1:
            text = (
                f"link {child!r} hangs on {times} joints: a chain has one joint before each link, take the others out"
            )
            yield error("SeveralParents", child, text)
    children = {joint.child for joint in read.joints}
    roots = [name for name in dict.fromkeys(names) if name not in children]
    if len(roots) > 1:
        listed = ", ".join(roots)
        yield error("SeveralRoots", where, f"{where} has {len(roots)} bases ({listed}): join them, or take one out")
    round_about = [joint.name for joint in read.joints if read.chain(joint.child)[0].parent in children]
    if round_about:
        text = f"joints {', '.join(round_about)} go round in a circle: a chain has to begin at a base, take one out"
        yield error("Loop", round_about[0], text)
    if not names:
        yield error("NotUrdf", where, f"{where} has no links: export the arm as URDF")


def _joint_oddities(joint: JointRow) -> Iterator[ArmFinding]:
    name = joint.name
    if joint.kind not in KINDS:
        text = f"joint {name!r} is of type {joint.kind!r}: write it as single {', '.join(KINDS[:-1])} joints, or fixed"
        yield error("JointType", name, text)
    if joint.mimics:
        text = (
            f"joint {name!r} copies {joint.mimics!r} (mimic): every joint has to move on its own; "
            "where it belongs to a gripper, make it fixed"
        )
        yield error("Mimic", name, text)
    if joint.xyz is None or joint.rpy is None:
        text = f"the origin of joint {name!r} is not three numbers and three numbers: write xyz in m and rpy in rad"
        yield error("NumberUnreadable", name, text)
    elif max(map(abs, joint.xyz)) > MOST_LENGTH:
        text = f"joint {name!r} begins {max(map(abs, joint.xyz)):g} m from the one before: this looks like mm, write m"
        yield error("InMillimetres", name, text)
    elif max(map(abs, joint.rpy)) > 2.0 * math.pi + UNIT:
        text = f"joint {name!r} is turned by {max(map(abs, joint.rpy)):g} rad: this looks like degrees, write radians"
        yield error("InDegrees", name, text)
    if joint.moves and joint.kind in KINDS:
        yield from _axis_and_limits(joint)


def _axis_and_limits(joint: JointRow) -> Iterator[ArmFinding]:
    name = joint.name
    size = math.hypot(*joint.axis) if joint.axis else 0.0
    if joint.axis is None or not size > 0.0:
        yield error("NoAxis", name, f"the axis of joint {name!r} has no direction: write three numbers, one not 0")
    elif abs(size - 1.0) > UNIT:
        text = f"the axis of joint {name!r} is {size:g} long: it is read as a direction, write it with length 1"
        yield warning("AxisNotUnit", name, text)
    if joint.kind == "continuous":
        return
    if not joint.limited or joint.lower is None or joint.upper is None:
        text = f"joint {name!r} has no readable limits in the URDF: the limits file has to say them, with their source"
        yield warning("NoLimits", name, text)
        return
    if joint.lower > joint.upper:
        text = f"joint {name!r} has its lower limit {joint.lower:g} above its upper one {joint.upper:g}: swap them"
        yield error("LimitsSwapped", name, text)
    if joint.lower == joint.upper:
        text = f"joint {name!r} may go from {joint.lower:g} to {joint.upper:g}, so nowhere: write its range, or fixed"
        yield error("ZeroLimits", name, text)
    reach = max(abs(joint.lower), abs(joint.upper))
    if joint.kind == "revolute" and reach > MOST_TURN:
        yield error("InDegrees", name, f"joint {name!r} turns to {reach:g} rad: this looks like degrees, write radians")
    if joint.kind == "prismatic" and reach > MOST_LENGTH:
        yield error("InMillimetres", name, f"joint {name!r} slides to {reach:g} m: this looks like mm, write m")
    if joint.velocity is not None and joint.velocity <= 0.0:
        text = f"joint {name!r} has velocity 0 in the URDF: its velocity has to come from the controller's manual"
        yield warning("ZeroLimits", name, text)


def of_chain(found: list[ArmFinding], description: Description, tip: str) -> list[ArmFinding]:
    """Return findings with those of joints beside the chain to ``tip`` as warnings: these stay where they are."""
    names = {joint.name for joint in description.joints} - {joint.name for joint in description.chain(tip)}
    return [
        replace(one, weight="warning")
        if one.weight == "error" and one.where in names and one.code in OF_JOINTS
        else one
        for one in found
    ]


def chain_findings(read: Description, tip: str) -> list[ArmFinding]:
    """Return what is to be said of the chain that ends at ``tip``."""
    chain = read.chain(tip)
    moving = sum(joint.moves for joint in chain)
    found: list[ArmFinding] = []
    if not FEWEST_AXES <= moving <= MOST_AXES:
        text = f"the chain to {tip!r} has {moving} moving joints: arms of {FEWEST_AXES} to {MOST_AXES} plan, fix others"
        found.append(error("AxisCount", tip, text))
    elif moving < 6:
        text = (
            f"the chain to {tip!r} has {moving} axes: the nozzle is held as near to what was shown as they allow, and "
            "every plan says where it leans"
        )
        found.append(note("FewAxes", tip, text))
    elsewhere = {joint.name for joint in read.joints if joint.moves} - {joint.name for joint in chain}
    if elsewhere:
        listed = ", ".join(sorted(elsewhere))
        text = (
            f"{len(elsewhere)} moving joints are not between the base and {tip!r} ({listed}): they stay where they are "
            "and what hangs on them has no hull; make them fixed, or name another tip"
        )
        found.append(warning("SeveralChains", tip, text))
    below = {joint.child for joint in chain} | {chain[0].parent if chain else tip}
    for link in read.links:
        if link.name in below and link.mass is None and link.shapes:
            text = (
                f"link {link.name!r} has no inertia: PyBullet moves it as 1 kg, drivers that do not simulate need none"
            )
            found.append(note("NoInertia", link.name, text))
    return found


def _link(tag: ElementTree.Element) -> LinkRow:
    name = tag.get("name", "")
    mass = tag.find("inertial/mass")
    shapes = [_shape(name, use, part) for use in ("collision", "visual") for part in tag.findall(use)]
    return LinkRow(name, _number(mass.get("value")) if mass is not None else None, tuple(shapes))


def _shape(link: str, use: Literal["visual", "collision"], tag: ElementTree.Element) -> Shape:
    origin = tag.find("origin")
    xyz = _numbers(origin.get("xyz") if origin is not None else None, "0 0 0") or (math.nan,) * 3
    rpy = _numbers(origin.get("rpy") if origin is not None else None, "0 0 0") or (math.nan,) * 3
    turn = Rotation.from_euler("xyz", rpy).as_matrix() if _finite(rpy) else np.full((3, 3), np.nan)
    geometry = tag.find("geometry")
    kind: ShapeKind = "unknown"
    size: tuple[float, ...] = xyz if not _finite(xyz) else rpy
    file = ""
    for part in geometry if geometry is not None else ():
        if part.tag == "mesh":
            kind, file, size = "mesh", part.get("filename", ""), _numbers(part.get("scale"), "1 1 1") or (math.nan,)
        elif part.tag == "box":
            kind, size = "box", _numbers(part.get("size"), "") or (math.nan,)
        elif part.tag == "cylinder":
            kind, size = "cylinder", (_number(part.get("radius")), _number(part.get("length")))
        elif part.tag == "sphere":
            kind, size = "sphere", (_number(part.get("radius")),)
    if not (_finite(xyz) and _finite(rpy)):
        kind = "unknown"
    return Shape(link, use, kind, np.array(xyz), turn, size, file)


def _joint(tag: ElementTree.Element) -> JointRow:
    def of(path: str, name: str, otherwise: str = "") -> str:
        part = tag.find(path)
        return otherwise if part is None else part.get(name, otherwise)

    limit = tag.find("limit")
    lower, upper, velocity = (
        None if limit is None or limit.get(name) is None else _number(limit.get(name))
        for name in ("lower", "upper", "velocity")
    )
    lower, upper, velocity = (
        None if value is None or not math.isfinite(value) else value for value in (lower, upper, velocity)
    )
    soft = _soft_limits(tag)
    if lower is not None and upper is not None:
        lower, upper = max(lower, soft[0]), min(upper, soft[1])
    return JointRow(
        name=tag.get("name", ""),
        kind=tag.get("type", ""),
        parent=of("parent", "link"),
        child=of("child", "link"),
        axis=_numbers(of("axis", "xyz", "1 0 0"), ""),
        xyz=_numbers(of("origin", "xyz", "0 0 0"), ""),
        rpy=_numbers(of("origin", "rpy", "0 0 0"), ""),
        lower=lower,
        upper=upper,
        velocity=velocity,
        limited=limit is not None,
        mimics=of("mimic", "joint") if tag.find("mimic") is not None else "",
        soft=soft != UNBOUNDED,
    )


def _soft_limits(tag: ElementTree.Element) -> tuple[float, float]:
    """Return between what a joint's safety controller keeps it, where it says both ends and they leave a range."""
    kept = tag.find("safety_controller")
    if kept is None:
        return UNBOUNDED
    lower, upper = (_number(kept.get(f"soft_{end}_limit")) for end in ("lower", "upper"))
    return (lower, upper) if lower < upper else UNBOUNDED


def _numbers(text: str | None, otherwise: str) -> tuple[float, ...] | None:
    """Return three finite numbers, None where they are not."""
    values = tuple(_number(word) for word in (text if text is not None else otherwise).split())
    return values if len(values) == 3 and _finite(values) else None


def _number(text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError:
        return math.nan


def _finite(values: tuple[float, ...]) -> bool:
    return bool(values) and all(math.isfinite(value) for value in values)
