"""An arm made worse on purpose, so that watching over tolerances can be tried. Its traces are labelled so."""

import math
from dataclasses import dataclass

import numpy as np

from sim.arm_model import Floats

CAUGHT_UP = 1e-6


@dataclass(frozen=True, slots=True)
class Imperfection:
    """How much worse: ``lag`` in s of a first-order delay, ``backlash`` in rad, ``noise`` of the encoders in rad."""

    lag: float = 0.0
    backlash: float = 0.0
    noise: float = 0.0
    seed: int = 0

    def begin(self, joints: Floats, dt: float) -> "Faults":
        """Return the faults of one run that begins at joints (dof,); the same seed gives the same run."""
        return Faults(self, joints, dt)

    def label(self) -> str:
        """Return what a trace's source says of it."""
        return f"made imperfect on purpose ({self.described()})"

    def described(self) -> str:
        """Return the numbers as words for a trace."""
        return (
            f"lag {self.lag * 1e3:.3g} ms, backlash {math.degrees(self.backlash):.3g} degrees, "
            f"noise {math.degrees(self.noise):.3g} degrees"
        )


class Faults:
    """The faults of one run."""

    def __init__(self, size: Imperfection, joints: Floats, dt: float) -> None:
        self._size = size
        self._share = 1.0 - math.exp(-dt / size.lag) if size.lag > 0.0 else 1.0
        self._lagged = joints.copy()
        self._played = joints.copy()
        self._still = True
        self._random = np.random.default_rng(size.seed)

    @property
    def settled(self) -> bool:
        """Whether the joints have caught up with what was commanded last."""
        return self._still

    def command(self, start: Floats, end: Floats) -> tuple[Floats, Floats]:
        """Return what the joints really follow in a tick from ``start`` to ``end``."""
        before = self._played
        self._lagged = self._lagged + self._share * (end - self._lagged)
        half = 0.5 * self._size.backlash
        self._played = np.clip(before, self._lagged - half, self._lagged + half)
        self._still = bool(np.abs(end - self._lagged).max() < CAUGHT_UP)
        return before, self._played

    def measure(self, joints: Floats) -> Floats:
        """Return what the encoders say."""
        return joints + self._random.normal(0.0, self._size.noise, len(joints)) if self._size.noise else joints
