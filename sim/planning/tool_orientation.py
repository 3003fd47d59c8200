"""How the nozzle is held along a path: straight against the part, or as the people held it.

A skill may carry the tool's orientation: unit quaternions x y z w that turn the tool's own frame into the part's. The
tool's frame has its origin at the tip and its z axis up along the tool, from the tip towards the hand: the identity
is a tool held upright on the part, and what it dispenses leaves it along its -z. The nozzle of an arm has the same
origin, and its z axis out of the tip. So, with R the part in the base, Q what was learned and U the nozzle's rotation
in the base when it stands upright on the part (against the part's z axis, turned about it as at home),

    nozzle in the base = R Q R^T U

and a skill that carries no orientation has Q = 1. Where the nozzle may turn freely about its own axis, which a round
one may, only the axis is followed and the turn about it is the one nearest to home's. Before the path's first point and
beyond its last the nozzle goes on turning as it turns there, as it goes on straight: so turning begins where the speed
does, from rest.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from sim.arm_model import ArmModel, Floats
from sim.order import NozzleTurn
from sim.planning.kinematics import kinematics
from sim.planning.path import ToolPath

ALONG = 1e-6


class Holding:
    """The nozzle's rotation in the base frame along a path."""

    def __init__(self, path: ToolPath, arm: ArmModel, turn: NozzleTurn = "shown") -> None:
        self._path = path
        self._arm = arm
        self._free = turn == "free"
        self.upright = tool_rotation(arm, path.rotation)
        self.as_shown = path.motion.has_orientation
        self._turning = self._at_ends() if self.as_shown else (np.zeros(3), np.zeros(3))

    def at_lengths(self, lengths: Floats) -> Floats:
        """Return rotations (n, 3, 3) at arc lengths (n,) in m, or one (3, 3) for all where none was learned."""
        if not self.as_shown:
            return self.upright
        rotations = self.at_phases(self._path.phases_at(lengths))
        for outside, beyond, turning in (
            (lengths < 0.0, lengths, self._turning[0]),
            (lengths > self._path.length, lengths - self._path.length, self._turning[1]),
        ):
            if outside.any():
                on = Rotation.from_rotvec(beyond[outside][:, None] * turning).as_matrix()
                rotations[outside] = on @ rotations[outside]
        return rotations

    def at_phases(self, phases: Floats) -> Floats:
        """Return rotations (n, 3, 3) at phases (n,)."""
        if not self.as_shown:
            return np.broadcast_to(self.upright, (len(phases), 3, 3))
        part = self._path.rotation
        learned = Rotation.from_quat(self._path.motion.orientations_at(phases)).as_matrix()
        turned = np.einsum("ij,njk,lk->nil", part, learned, part)
        if not self._free:
            return np.einsum("nij,jk->nik", turned, self.upright)
        return _nearest_to(kinematics(self._arm).seed_rotation[:, 0], -turned @ part[:, 2])

    def _at_ends(self) -> tuple[Floats, Floats]:
        """Return by how much the nozzle turns along the path where it begins and ends: turn vectors (3,) in rad/m."""
        spacing = self._path.length / (len(self._path.lengths) - 1)
        places = np.array([0.0, spacing, self._path.length - spacing, self._path.length])
        turns = Rotation.from_matrix(self.at_phases(self._path.phases_at(places)))
        first, last = (turns[1] * turns[0].inv()), (turns[3] * turns[2].inv())
        return first.as_rotvec() / spacing, last.as_rotvec() / spacing

    def tilts(self, phases: Floats) -> Floats:
        """Return the angle (n,) in rad by which the nozzle's axis leaves the part's normal."""
        along = -(self.at_phases(phases)[:, :, 2] * self._path.rotation[:, 2]).sum(axis=1)
        return np.arccos(np.clip(along, -1.0, 1.0))


def tool_rotation(arm: ArmModel, part: Floats) -> Floats:
    """Return the rotation (3, 3) of a nozzle upright on a part with rotation (3, 3): turned about its axis as at home.

    So the wrist stays away from its limits whichever way the part is turned.
    """
    found = _nearest_to(kinematics(arm).seed_rotation[:, 0], -part[None, :, 2])
    return found[0]


def _nearest_to(x: Floats, axes: Floats) -> Floats:
    """Return rotations (n, 3, 3) with z axes (n, 3), whose x axes are as near to ``x`` as that allows."""
    across = x - axes * (axes * x).sum(axis=1, keepdims=True)
    size = np.sqrt((across**2).sum(axis=1, keepdims=True))
    across = np.where(size > ALONG, across, np.cross(np.array([0.0, 1.0, 0.0]), axes))
    across = across / np.sqrt((across**2).sum(axis=1, keepdims=True))
    found = np.empty((len(axes), 3, 3))
    found[:, :, 0], found[:, :, 1], found[:, :, 2] = across, np.cross(axes, across), axes
    return found


def quaternions(rotations: Floats) -> Floats:
    """Return rotations (n, 3, 3) as unit quaternions (n, 4), x y z w, each on the side of the one before it."""
    if len(rotations) == 0:
        return np.empty((0, 4))
    found = Rotation.from_matrix(rotations).as_quat()
    turned = (found[1:] * found[:-1]).sum(axis=1) < 0.0
    sides = np.where(np.concatenate([[False], np.cumsum(turned) % 2 == 1]), -1.0, 1.0)
    return found * sides[:, None]
