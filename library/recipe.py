"""A recipe: how one skill is to be run for one product. Stored, edited by engineers, named by jobs."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from library.errors import InvalidValue
from library.values import Name, RecipeId, Text, Value

Timing = Literal["demonstrated", "constant_speed", "time_optimal"]
Pose = Annotated[tuple[float, float, float, float, float, float, float], Field(min_length=7, max_length=7)]


class Recipe(Value):
    """The parameters of a run.

    ``skill_version`` 0 is the deployed one. ``time_step`` and ``duration`` are in s; ``duration`` 0 is as learned, and
    counts with ``demonstrated`` only. ``speed`` in m/s counts with ``constant_speed`` only. ``speed_override`` is a
    fraction.
    ``frame`` is the part in the arm's base: x y z in m, then the unit quaternion qx qy qz qw. ``standoff``,
    ``approach_height``, ``retract_height`` and ``max_deviation`` (0: not checked) are in m, ``dispense_lead`` in s
    (positive: the valve opens that much earlier). The ranges are those within which a motion can be planned at all.
    """

    recipe_id: RecipeId
    skill_name: Name
    skill_version: int = Field(default=0, ge=0, le=2**32 - 1)
    product: Text = ""
    time_step: float = Field(default=0.008, ge=0.001, le=0.02)
    timing: Timing = "demonstrated"
    duration: float = Field(default=0.0, ge=0.0, le=3600.0)
    speed: float = Field(default=0.0, ge=0.0, le=1.0)
    speed_override: float = Field(default=1.0, gt=0.0, le=1.0)
    frame: Pose = (0.45, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)
    standoff: float = Field(default=0.005, ge=0.0, le=0.5)
    approach_height: float = Field(default=0.05, ge=0.0, le=0.5)
    retract_height: float = Field(default=0.05, ge=0.0, le=0.5)
    dispense_lead: float = Field(default=0.0, ge=-1.0, le=1.0)
    max_deviation: float = Field(default=0.001, ge=0.0, le=1.0)
    parameters: dict[Name, float | Text] = Field(default_factory=dict, max_length=200)

    @model_validator(mode="after")
    def _parts_agree(self) -> "Recipe":
        if self.timing == "constant_speed" and self.speed == 0.0:
            raise InvalidValue("speed", self.speed, "timing constant_speed needs a speed above 0 and at most 1 m/s")
        if any(abs(x) > 10.0 for x in self.frame[:3]):
            raise InvalidValue("frame", self.frame, "x, y and z lie within 10 m of the arm's base")
        if abs(math.hypot(*self.frame[3:]) - 1.0) > 1e-6:
            raise InvalidValue("frame", self.frame, "qx qy qz qw is a unit quaternion (length 1 within 1e-6)")
        return self
