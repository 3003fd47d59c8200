"""What is asked of an arm: the part of a recipe that moves it."""

from dataclasses import dataclass
from typing import Literal

from sim.arm_model import Pose

Timing = Literal["demonstrated", "constant_speed", "time_optimal"]
NozzleTurn = Literal["shown", "free"]
Plate = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class MotionOrder:
    """How a skill is to be run: the part of a recipe that moves the arm. SI units.

    ``duration`` and ``speed`` scale the demonstrated timing (0: as learned); for ``constant_speed`` ``speed`` is the
    nozzle's. ``speed_override`` and ``speed_fraction`` (0.25 in test mode) slow the whole plan. ``frame`` is the part
    in the arm's base. ``dispense_lead`` opens and closes the valve that much earlier. ``max_deviation`` stops the run
    when the measured nozzle is farther than that from the commanded one (0: not watched); ``tube_sigmas`` watches the
    skill's own spread, ``tube_policy`` says whether leaving it is told or stops the run.

    ``chord_tolerance`` is the most by which straight lines between the samples may cut the path. Where constant speed
    is impossible in a corner, ``corners`` refuses the plan or slows down and tells where. ``blend_radius`` rounds
    corners. Where the skill carries the tool's orientation, ``nozzle_turn`` follows all of it (``shown``) or only the
    nozzle's axis (``free``), which leaves a round nozzle's turn about that axis to the arm. ``part_x`` to
    ``part_width`` say how large the part is and where in its frame it begins (0 long or wide: nobody said).
    """

    time_step: float = 0.008
    timing: Timing = "demonstrated"
    duration: float = 0.0
    speed: float = 0.0
    speed_override: float = 1.0
    frame: Pose = (0.42, 0.0, 0.10, 0.0, 0.0, 0.0, 1.0)
    standoff: float = 0.001
    approach_height: float = 0.05
    retract_height: float = 0.05
    dispense_lead: float = 0.0
    max_deviation: float = 0.0
    speed_fraction: float = 1.0
    blend_radius: float = 0.0
    corners: Literal["slow", "refuse"] = "slow"
    chord_tolerance: float = 5e-5
    tube_sigmas: float = 0.0
    tube_policy: Literal["flag", "stop"] = "flag"
    nozzle_turn: NozzleTurn = "shown"
    part_x: float = 0.0
    part_y: float = 0.0
    part_length: float = 0.0
    part_width: float = 0.0

    @property
    def plate(self) -> Plate | None:
        """The part as seen from above in its frame: x y of its corner, length and width, m; None: nobody said."""
        if self.part_length > 0.0 and self.part_width > 0.0:
            return (self.part_x, self.part_y, self.part_length, self.part_width)
        return None
