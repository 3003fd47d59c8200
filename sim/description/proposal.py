"""A first limits file for an arm of which there is a URDF only: everything proposed, everything to be confirmed."""

import math
from dataclasses import dataclass, replace
from itertools import combinations, product
from pathlib import Path

import numpy as np

from sim.arm_model import ArmModel, Bools, Capsule, Floats, Limits, PathLimits, Tool
from sim.description import urdf
from sim.description.capsules import Fit, fit
from sim.description.findings import ArmFinding, DescriptionError, error
from sim.description.reach import grid, reachable, reaching, seeds
from sim.description.shapes import carried
from sim.planning.clearance import Cell, between_links, least_distances
from sim.planning.kinematics import Kinematics

DOWN = np.diag([1.0, -1.0, -1.0])
FULL = 2.0 * math.pi
# Nothing of this is published in a URDF: chosen low. Full speed in so many seconds, full acceleration in so many.
TO_SPEED, TO_PUSH = 0.5, 0.2
SLOW_TURN, SLOW_SLIDE = 1.0, 0.25
NEEDLE = 2.5e-3
ABOVE = 0.12
ROOM = 0.02
FAR = 0.3
DRAWN = 3000
TO_CONFIRM = ("home", "limits", "path", "tool", "cell", "hull")


class NotDescribable(DescriptionError):
    """A URDF from which no limits file can be proposed: ``findings`` say why, each with its way out."""

    def __init__(self, findings: list[ArmFinding]) -> None:
        super().__init__("; ".join(one.text for one in findings))
        self.findings = tuple(findings)


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """An arm as proposed, how well each capsule fits, and the pairs of links left out because they always touch."""

    model: ArmModel
    tool_offset: tuple[float, float, float]
    tool_turn: tuple[float, float, float]
    sources: dict[str, str]
    fits: tuple[Fit, ...]
    touching: tuple[tuple[str, str], ...]


def propose(text: str, name: str, beside: Path, *, tip: str = "", needle: float = 0.0) -> Proposal:
    """Return what a first limits file should say of the arm in a URDF's text.

    ``tip`` is the link whose frame the tool ends in; empty: the end of the longest chain. ``needle`` is the length in m
    of a tool that the URDF does not have, along z of that frame. Raises ``NotDescribable``.
    """
    description, found = urdf.read(text, f"{name}.urdf")
    if description is None:
        raise NotDescribable(found)
    chosen = tip or (description.longest() if description.tips else "")
    if chosen not in {link.name for link in description.links}:
        raise NotDescribable([*found, error("UnknownLink", chosen, f"there is no link {chosen!r} in {name}.urdf")])
    shapes, told = carried(description, chosen, beside)
    found = [*urdf.of_chain(found, description, chosen), *urdf.chain_findings(description, chosen), *told]
    errors = [one for one in found if one.weight == "error"]
    if errors:
        raise NotDescribable(errors)
    moving = [joint for joint in description.chain(chosen) if joint.moves]
    limits, sources = _limits(moving)
    middle = tuple(0.5 * (low + high) for low, high in zip(limits.lower, limits.upper, strict=True))
    chain = Kinematics(text, chosen, middle, limits.lower, limits.upper)
    turn = _turn(chain)
    fits = tuple(fit(one.link, one.points) for one in shapes)
    base = ArmModel(
        name=name, manufacturer="to be confirmed", model=description.name or name, urdf=text, limits=limits,
        path_limits=PathLimits(0.25, 1.0, 20.0, "chosen low: to be confirmed"), home=middle,
        tool=Tool(chosen, "nozzle", 0.5, needle), workspace_low=(0.0, 0.0, 0.0), workspace_high=(1.0, 1.0, 1.0),
        part_frame=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), capsules=tuple(one.capsule for one in fits), apart=(),
        atomic_skills=("MoveTo", "FollowPath", "Dispense"), digest="",
    )  # fmt: skip
    offset = (0.0, 0.0, -needle if turn else needle)
    tool_turn = (math.pi, 0.0, 0.0) if turn else (0.0, 0.0, 0.0)
    if needle > 0.0:
        base = replace(base, capsules=(*base.capsules, Capsule(chosen, (0.0, 0.0, 0.0), offset, NEEDLE)))
    base = _turned(base, offset, tool_turn)
    apart, touching = _pairs(base, description, chosen)
    placed = _placed(replace(base, apart=apart))
    sealed = replace(placed, urdf=text, tool=replace(placed.tool, tip=chosen))
    return Proposal(sealed, offset, tool_turn, sources, fits, touching)


def _turned(model: ArmModel, offset: tuple[float, float, float], turn: tuple[float, float, float]) -> ArmModel:
    """Return an arm whose tip is placed by one fixed joint more, where it is."""
    if not any(offset) and not any(turn):
        return model
    place, angles = (" ".join(repr(one) for one in row) for row in (offset, turn))
    joint = (
        f'<link name="proposed_tip"/><joint name="to_proposed_tip" type="fixed"><parent link="{model.tool.tip}"/>'
        f'<child link="proposed_tip"/><origin xyz="{place}" rpy="{angles}"/></joint>'
    )
    end = model.urdf.rindex("</robot>")
    text = f"{model.urdf[:end]}{joint}{model.urdf[end:]}"
    return replace(model, urdf=text, tool=replace(model.tool, tip="proposed_tip"))


def _limits(moving: list[urdf.JointRow]) -> tuple[Limits, dict[str, str]]:
    """Return joint limits from what a URDF says, the rest chosen low, and where each row is from."""
    lower, upper, speeds, chosen = [], [], [], []
    for joint in moving:
        low, high = (-FULL, FULL) if joint.kind == "continuous" else (joint.lower, joint.upper)
        if low is None or high is None:
            low, high = (-0.5, 0.5) if joint.kind == "prismatic" else (-math.pi, math.pi)
            chosen.append(joint.name)
        lower.append(low)
        upper.append(high)
        slow = SLOW_SLIDE if joint.kind == "prismatic" else SLOW_TURN
        speeds.append(joint.velocity if joint.velocity else slow)
    soft = [joint.name for joint in moving if joint.soft]
    kept = f", {', '.join(soft)} by safety_controller" if soft else ""
    invented = f", {', '.join(chosen)} chosen" if chosen else ""
    without = [joint.name for joint in moving if not joint.velocity]
    slower = f", {', '.join(without)} chosen low" if without else ""
    sources = {
        "position": f"limit elements of the URDF{kept}{invented}: to be confirmed with the controller's manual",
        "velocity": f"limit elements of the URDF{slower}: to be confirmed with the controller's manual",
        "acceleration": f"chosen low, full speed in {TO_SPEED:g} s: to be confirmed with the controller's manual",
        "jerk": f"chosen low, full acceleration in {TO_PUSH:g} s: to be confirmed with the controller's manual",
    }
    pushes = [speed / TO_SPEED for speed in speeds]
    jerks = tuple(push / TO_PUSH for push in pushes)
    limits = Limits(tuple(lower), tuple(upper), tuple(speeds), tuple(pushes), jerks, tuple(sources.items()))
    return limits, sources


def _turn(chain: Kinematics) -> bool:
    """Return whether the tip's z points into the tool: then it never points down, and its opposite does."""
    random = np.random.default_rng(5)
    drawn = random.uniform(chain.lower, chain.upper, (DRAWN, chain.dof))
    down = -chain.forward(drawn)[1][:, 2, 2]
    return bool(down.max() < 0.7 and down.min() < -0.7)


def _pairs(
    model: ArmModel, description: urdf.Description, tip: str
) -> tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]]:
    """Return the pairs of links to keep apart, and those left out because they touch almost everywhere."""
    group: dict[str, int] = {}
    number = 0
    chain = description.chain(tip)
    group[chain[0].parent] = 0
    for joint in chain:
        number += joint.moves
        group[joint.child] = number
    links = list(dict.fromkeys(capsule.link for capsule in model.capsules))
    random = np.random.default_rng(3)
    lower, upper = np.array(model.limits.lower), np.array(model.limits.upper)
    joints = random.uniform(lower, upper, (300, model.dof))
    apart: list[tuple[str, str]] = []
    touching: list[tuple[str, str]] = []
    for first, second in combinations(links, 2):
        if abs(group[first] - group[second]) < 2:
            continue
        gaps = between_links(model, joints, first, second)
        if (gaps < 0.0).mean() > 0.6:
            touching.append((first, second))
        elif gaps.min() < FAR:
            apart.append((first, second))
    return tuple(apart), tuple(touching)


def _placed(model: ArmModel) -> ArmModel:
    """Return an arm with home, part and workspace proposed: nozzle down, away from every end, clear of everything."""
    lower, upper = model.limits.lower, model.limits.upper
    chain = Kinematics(model.urdf, model.tool.tip, model.home, lower, upper)
    random = np.random.default_rng(2)
    drawn = chain.forward(random.uniform(chain.lower, chain.upper, (DRAWN, chain.dof)))[0]
    low, high = np.percentile(drawn, 2.0, axis=0), np.percentile(drawn, 98.0, axis=0)
    low[2] = max(low[2], ROOM)
    if high[2] <= low[2] + ROOM:
        text = "the arm nowhere reaches above the plane it stands on: its base has to be at the table, z up"
        raise NotDescribable([error("WorkspaceUnreachable", model.name, text)])
    home, height = _home(model, chain, low, high)
    chain = Kinematics(model.urdf, model.tool.tip, home, lower, upper)
    place = chain.seed_position
    box_low, box_high = _box(chain, low, high, place, height)
    x, y, z = (round(float(value), 3) for value in place)
    frame = (x, y, round(max(ROOM, z - height), 3), 0.0, 0.0, 0.0, 1.0)
    return replace(model, home=home, workspace_low=box_low, workspace_high=box_high, part_frame=frame)


def _home(model: ArmModel, chain: Kinematics, low: Floats, high: Floats) -> tuple[tuple[float, ...], float]:
    """Return the joints found best for home, and how far below them a part can be worked on, m."""
    places = grid(low, high, (6, 5, 5))
    joints, good = reaching(chain, places, DOWN, seeds(chain, 5))
    joints, places = joints[good], np.repeat(places, good.sum(axis=1), axis=0)
    height = min(ABOVE, 0.4 * float(high[2] - low[2]))
    below = chain.refine(places - [0.0, 0.0, height], DOWN, joints)
    both = below.reached & ((below.joints >= chain.lower) & (below.joints <= chain.upper)).all(axis=1)
    joints = joints[both]
    if not len(joints):
        shorter = ", or a shorter --needle" if model.tool.length else ""
        text = (
            f"no place was found that the nozzle reaches pointing down: name another --tip{shorter}, or turn its frame"
        )
        raise NotDescribable([error("WorkspaceUnreachable", model.name, text)])
    ranges = np.where(chain.slides, chain.upper - chain.lower, np.minimum(chain.upper - chain.lower, FULL))
    spare = np.minimum(np.minimum(joints - chain.lower, chain.upper - joints) / ranges, 0.25).min(axis=1)
    nozzle, held = chain.forward(joints)
    agile = np.linalg.svd(chain.jacobian(joints), compute_uv=False)[:, -1]
    centre = 0.5 * (low + high)
    off_middle = np.linalg.norm((nozzle - centre) / (high - low), axis=1)
    front = (0.5 + 0.5 * nozzle[:, 0] / np.maximum(np.linalg.norm(nozzle[:, :2], axis=1), 1e-6)) ** 4
    score = np.minimum(agile / max(float(np.percentile(agile, 90)), 1e-9), 1.0) * (0.05 + spare) * front
    score *= (1.0 - 0.5 * np.minimum(off_middle, 1.0)) * (0.2 - np.minimum(held[:, 2, 2], 0.1))
    order = np.argsort(-score)[:200]
    probe = replace(model, home=tuple(float(one) for one in joints[order[0]]))
    gaps = least_distances(probe, joints[order], (Cell().table(),))
    free = order[gaps > ROOM]
    best = free[0] if len(free) else order[int(gaps.argmax())]
    rounded = np.clip(np.round(joints[best], 4), chain.lower, chain.upper)
    return tuple(float(one) for one in rounded), height


def _box(
    chain: Kinematics, low: Floats, high: Floats, home: Floats, height: float
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return a box around home in which every place looked at is reached with the nozzle down."""
    counts = (11, 11, 7)
    steps = (high - low) / (np.array(counts) - 1)
    start = low + (home - low) % steps
    axes = [start[k] + steps[k] * np.arange(-1, counts[k] + 1) for k in range(3)]
    axes = [axis[(axis >= low[k] - 1e-9) & (axis <= high[k] + 1e-9)] for k, axis in enumerate(axes)]
    shape = tuple(len(axis) for axis in axes)
    good = reachable(chain, np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), DOWN).reshape(shape)
    first, last = _roomiest(good, axes, tuple(int(np.abs(axis - home[k]).argmin()) for k, axis in enumerate(axes)))
    box_low = np.array([axes[k][first[k]] for k in range(3)])
    box_high = np.array([axes[k][last[k]] for k in range(3)])
    # Home and what is worked on below it are in the box, whatever the grid met.
    box_low = np.minimum(box_low, home - [ROOM, ROOM, height])
    box_high = np.maximum(box_high, home + ROOM)
    box_low[2] = max(box_low[2], 0.005)
    low_corner = tuple(math.floor(1e3 * value) / 1e3 for value in box_low)
    high_corner = tuple(math.ceil(1e3 * value) / 1e3 for value in box_high)
    return low_corner, high_corner  # type: ignore[return-value]


def _roomiest(good: Bools, axes: list[Floats], around: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the first and last index of the box of most room around a place in which all of a grid is good."""
    bad = np.pad(np.cumsum(np.cumsum(np.cumsum(~good, axis=0), axis=1), axis=2), ((1, 0), (1, 0), (1, 0)))
    sides = [
        [(a, b) for a in range(here + 1) for b in range(here, len(axis))]
        for here, axis in zip(around, axes, strict=True)
    ]
    best, room = ((*around,), (*around,)), 0.0
    for corners in product(*sides):
        (x, over_x), (y, over_y), (z, over_z) = ((a, b + 1) for a, b in corners)
        here = math.prod(float(axis[b] - axis[a]) + 2.0 * ROOM for axis, (a, b) in zip(axes, corners, strict=True))
        if here <= room:
            continue
        upper = bad[over_x, over_y, over_z] - bad[x, over_y, over_z] - bad[over_x, y, over_z] + bad[x, y, over_z]
        lower = bad[over_x, over_y, z] - bad[x, over_y, z] - bad[over_x, y, z] + bad[x, y, z]
        if upper == lower:
            best, room = (tuple(a for a, _ in corners), tuple(b for _, b in corners)), here
    return best


def written(proposal: Proposal) -> str:
    """Return the text of the limits file."""
    model, limits = proposal.model, proposal.model.limits
    sources = proposal.sources
    lines = [
        "# Proposed from the URDF alone. Look at every value; take its name out of to_confirm once it is right:",
        "# a server refuses the arm until the list is empty.",
        f"to_confirm = {_texts(TO_CONFIRM)}",
        f"manufacturer = {_text(model.manufacturer)}",
        f"model = {_text(model.model)}",
        "# Where every plan starts and ends: nozzle down, clear of everything. To be confirmed.",
        f"home = {_numbers(model.home)}",
        f"atomic_skills = {_texts(model.atomic_skills)}",
        "",
        "[limits.position]",
        f"lower = {_numbers(limits.lower)}",
        f"upper = {_numbers(limits.upper)}",
        f"source = {_text(sources['position'])}",
    ]
    rows = (("velocity", limits.velocity), ("acceleration", limits.acceleration), ("jerk", limits.jerk))
    for name, values in rows:
        lines += ["", f"[limits.{name}]", f"values = {_numbers(values)}", f"source = {_text(sources[name])}"]
    path = model.path_limits
    lines += [
        "",
        "[path]",
        f"speed = {path.speed!r}",
        f"acceleration = {path.acceleration!r}",
        f"jerk = {path.jerk!r}",
        f"source = {_text(path.source)}",
        "",
        "# z has to point out of the tip. To be confirmed; `opcua-skill arms tool` measures it.",
        "[tool]",
        f"tip = {_text(model.tool.tip)}",
        f"name = {_text(model.tool.name)}",
        f"mass = {model.tool.mass!r}",
        f"length = {model.tool.length!r}",
    ]
    if any(proposal.tool_offset) or any(proposal.tool_turn):
        lines += [f"offset = {_numbers(proposal.tool_offset)}", f"turn = {_numbers(proposal.tool_turn)}"]
    lines += [
        "",
        "# The box in which the nozzle may be, and where the part lies. To be confirmed.",
        "[cell]",
        f"workspace_low = {_numbers(model.workspace_low)}",
        f"workspace_high = {_numbers(model.workspace_high)}",
        f"part_frame = {_numbers(model.part_frame)}",
        'source = "proposed: reached with the nozzle down"',
        "",
        "[hull]",
        "# Each holds every vertex of one shape; in the comment, how far it sticks out of that shape at most.",
        "capsules = [",
    ]
    for one in proposal.fits:
        capsule = one.capsule
        lines.append(
            f"    {{ link = {_text(capsule.link)}, start = {_numbers(capsule.start)}, end = {_numbers(capsule.end)}, "
            f"radius = {capsule.radius!r} }}, # {1e3 * one.excess:.1f} mm"
        )
    lines.append("]")
    for first, second in proposal.touching:
        lines.append(f"# {first} and {second} touch almost everywhere by their capsules: they are not kept apart.")
    lines += [f"apart = [{', '.join(_texts(pair) for pair in model.apart)}]", ""]
    return "\n".join(lines)


def _numbers(values: tuple[float, ...]) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _texts(values: tuple[str, ...]) -> str:
    return "[" + ", ".join(_text(value) for value in values) + "]"


def _text(value: str) -> str:
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(one if one.isprintable() else f"\\u{ord(one):04x}" for one in escaped) + '"'
