"""Drawings whose place, size and turn do not matter: laid upon each other before anything else, at their average
pose.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from models.alignment.dtw import warp
from models.alignment.registration import some_of
from models.demonstration import Floats
from models.phase import at
from models.preprocessing.filtering import CleanMotion

CANDIDATES = 24
ROUNDS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """A map p -> scale * turn p + shift. ``turn`` has shape (d, d), ``shift`` (d,) in m."""

    scale: float
    turn: Floats
    shift: Floats

    def of(self, points: Floats) -> Floats:
        """Return the map of points (n, d)."""
        return self.scale * (points[:, None, :] * self.turn[None]).sum(axis=2) + self.shift


def similarity(points: Floats, target: Floats) -> Similarity:
    """Return the map that brings points (n, d) nearest to target points (n, d). Umeyama 1991, no mirroring."""
    middle, other = points.mean(axis=0), target.mean(axis=0)
    here, there = points - middle, target - other
    left, strengths, right = np.linalg.svd(there.T @ here)
    signs = np.ones(len(strengths))
    signs[-1] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    turn = (left * signs) @ right
    scale = float((strengths * signs).sum() / max(float((here * here).sum()), 1e-300))
    return Similarity(scale, turn, other - scale * turn @ middle)


def laid_upon(motions: Floats, target: Floats) -> Floats:
    """Return motions (u, n, d), each moved, turned and scaled as ``similarity`` says onto the target (n, d), by what is
    known of it; NaN stays NaN.
    """
    known = np.isfinite(motions[:, :, :1])
    count = known.sum(axis=1, keepdims=True)
    middle = np.where(known, motions, 0.0).sum(axis=1, keepdims=True) / count
    other = np.where(known, target, 0.0).sum(axis=1, keepdims=True) / count
    here = np.where(known, motions - middle, 0.0)
    there = np.where(known, target - other, 0.0)
    left, strengths, right = np.linalg.svd(there.transpose(0, 2, 1) @ here)
    signs = np.ones_like(strengths)
    signs[:, -1] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    turns = (left * signs[:, None, :]) @ right
    scales = (strengths * signs).sum(axis=1) / np.maximum((here * here).sum(axis=(1, 2)), 1e-300)
    laid = scales[:, None, None] * (here @ turns.transpose(0, 2, 1)) + other
    return np.where(known, laid, np.nan)


def laid_freely(motions: list[CleanMotion], curves: Floats) -> list[CleanMotion]:
    """Return the motions moved, turned and scaled onto each other; ``curves`` (u, n, d) are they at even steps of
    their way.
    """
    reference = curves[_central(curves)]
    maps = [similarity(curve, reference) for curve in curves]
    index = np.arange(curves.shape[1], dtype=np.float64)
    for _ in range(ROUNDS):
        moved = np.stack([one.of(curve) for one, curve in zip(maps, curves, strict=True)])
        positions = warp(reference, moved).positions
        maps = [similarity(at(where, index, curve), reference) for where, curve in zip(positions, curves, strict=True)]
    back = _average_pose(maps, curves, reference)
    return [_moved(motion, one, back) for motion, one in zip(motions, maps, strict=True)]


def _central(curves: Floats) -> int:
    """Return which curve the others come nearest to when they are laid upon it."""
    chosen = some_of(curves, CANDIDATES)
    rest: list[float] = []
    for candidate in chosen:
        target = curves[candidate]
        size = np.sqrt(((target - target.mean(axis=0)) ** 2).sum(axis=1).mean())
        away = [np.sqrt(((similarity(curve, target).of(curve) - target) ** 2).sum(axis=1).mean()) for curve in curves]
        rest.append(float(np.median(away) / size))
    return int(chosen[int(np.argmin(rest))])


def _average_pose(maps: list[Similarity], curves: Floats, reference: Floats) -> Similarity:
    """Return the map from the reference's pose to the average one: mean middle, geometric mean size, mean turn."""
    scale = float(np.exp(-np.mean([np.log(max(one.scale, 1e-12)) for one in maps])))
    left, _, right = np.linalg.svd(np.mean([one.turn.T for one in maps], axis=0))
    signs = np.ones(curves.shape[2])
    signs[-1] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    turn = (left * signs) @ right
    return Similarity(scale, turn, curves.mean(axis=(0, 1)) - scale * turn @ reference.mean(axis=0))


def _moved(motion: CleanMotion, there: Similarity, back: Similarity) -> CleanMotion:
    turned = motion.orientations
    if turned is not None:
        whole = np.eye(3)
        size = len(back.turn)
        whole[:size, :size] = back.turn @ there.turn
        turned = np.asarray((Rotation.from_matrix(whole) * Rotation.from_quat(turned)).as_quat())
    return replace(motion, points=back.of(there.of(motion.points)), orientations=turned)
