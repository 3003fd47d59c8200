"""What an arm is to who plans for it: its limits, its hull, its tools, and the words for rows of numbers.

Lengths are in metres, angles in radians, times in seconds; a pose is seven numbers x y z qx qy qz qw in the arm's base
frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Pose = tuple[float, float, float, float, float, float, float]
Stage = Literal["travel", "approach", "dispense", "retract"]


@dataclass(frozen=True, slots=True)
class Limits:
    """What the joints may do, one number a joint.

    Rad, rad/s, rad/s², rad/s³; m instead of rad where a joint slides. ``sources`` names where each row is from.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    jerk: tuple[float, ...]
    sources: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class PathLimits:
    """What the nozzle may do along a path: m/s, m/s², m/s³. ``speed`` bounds every straight and learned path."""

    speed: float
    acceleration: float
    jerk: float
    source: str


@dataclass(frozen=True, slots=True)
class Capsule:
    """A hull around part of a link.

    All points within ``radius`` of the segment ``start``-``end``, in the link's frame, m.
    """

    link: str
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


@dataclass(frozen=True, slots=True)
class Tool:
    """The dispensing nozzle: its frame in the URDF (z out of the tip), and what it can do."""

    tip: str
    name: str
    mass: float
    length: float


@dataclass(frozen=True, slots=True)
class SpareTool:
    """Another tool for the same arm: its tip is at ``offset`` and ``turn`` in the frame of link ``tip``.

    m, and roll, pitch, yaw in rad. ``capsules`` hold it, in that frame. ``residual`` in m is what was left when the tip
    was measured; NaN: it was not.
    """

    name: str
    tip: str
    offset: tuple[float, float, float]
    turn: tuple[float, float, float]
    mass: float
    length: float
    capsules: tuple[Capsule, ...]
    residual: float


@dataclass(frozen=True, slots=True)
class ArmModel:
    """One kind of arm with its nozzle: everything a plan needs to know of it.

    ``urdf`` is the text of the description, ``home`` the joints at which every plan starts and ends. The nozzle tip
    may be anywhere in the box ``workspace_low``..``workspace_high`` (base frame). ``part_frame`` is where the
    demonstration cell has its plate. ``capsules`` cover every link; ``apart`` names the pairs of links that could
    touch and must not.
    """

    name: str
    manufacturer: str
    model: str
    urdf: str
    limits: Limits
    path_limits: PathLimits
    home: tuple[float, ...]
    tool: Tool
    workspace_low: tuple[float, float, float]
    workspace_high: tuple[float, float, float]
    part_frame: Pose
    capsules: tuple[Capsule, ...] = field(repr=False)
    apart: tuple[tuple[str, str], ...] = field(repr=False)
    atomic_skills: tuple[str, ...]
    digest: str
    collisions_checked: bool = True
    """False only where the configuration says in as many words that nothing is checked: then a hull may be missing."""
    tools: tuple[SpareTool, ...] = ()
    """What else the arm can carry; a workstation names one of them."""
    unconfirmed: tuple[str, ...] = ()
    """What of its files was proposed and nobody has looked at yet."""

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.home)
