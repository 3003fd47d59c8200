"""The numbers of a recipe as people see them: millimetres, degrees, per cent; their ranges and defaults."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from scipy.spatial.transform import Rotation

from opcua_skill.client import ClientError, Recipe, Refused

TURN_RANGE = 360.0
SHOWN_UNITS = {"m": ("mm", 1000.0), "m/s": ("mm/s", 1000.0), "rad": ("°", 57.29577951308232)}
CHOICES: Mapping[str, tuple[str, ...]] = {
    "Corners": ("slow", "refuse"),
    "TubePolicy": ("flag", "stop"),
    "NozzleTurn": ("shown", "free"),
}
LABELS: Mapping[str, str] = {
    "BlendRadius": "Rounding of corners",
    "Corners": "Corners too sharp",
    "ChordTolerance": "Straight lines cut at most",
    "TubeSigmas": "Width of the watched tube",
    "TubePolicy": "Outside the tube",
    "NozzleTurn": "Turn of the nozzle",
    "PartX": "Part begins at x",
    "PartY": "Part begins at y",
    "PartLength": "Part long along x",
    "PartWidth": "Part wide along y",
}


@dataclass(frozen=True, slots=True)
class Field:
    """A number as people see it: ``scale`` turns the stored SI value into the shown one, ``default`` is stored."""

    name: str
    label: str
    unit: str
    low: float | None
    high: float | None
    scale: float = 1.0
    step: float = 1.0
    hint: str = ""
    default: float = 0.0

    def shown(self, stored: float) -> float:
        """Return a stored value as shown."""
        return round(stored * self.scale, 6)

    @property
    def range(self) -> str:
        """The allowed range with its unit; empty when there is none."""
        if self.low is None or self.high is None:
            return ""
        return f"{self.low:g} … {self.high:g}\u00a0{self.unit}".rstrip()

    def fault(self, value: Any) -> str:
        """Return the range if a shown value lies outside it, or is no number; empty if it is fine."""
        if not isinstance(value, int | float):
            return self.range or self.unit or "0"
        low, high = (
            (-float("inf") if self.low is None else self.low),
            (float("inf") if self.high is None else self.high),
        )
        return "" if low <= value <= high else self.range


def _of(name: str, label: str, unit: str, low: float, high: float, scale: float, step: float, hint: str = "") -> Field:
    default = getattr(Recipe("", ""), name)
    return Field(name, label, unit, low, high, scale, step, hint, default)


TIMING_FIELDS = (
    _of("time_step", "Time step", "ms", 1.0, 20.0, 1000.0, 1.0),
    _of("duration", "Duration", "s", 0.0, 3600.0, 1.0, 0.5, "0: as taught"),
    _of("speed", "Nozzle speed", "mm/s", 0.0, 1000.0, 1000.0, 5.0, "for constant speed"),
    _of("speed_override", "Speed override", "%", 1.0, 100.0, 100.0, 5.0),
)
NOZZLE_FIELDS = (
    _of("standoff", "Nozzle above the part", "mm", 0.0, 500.0, 1000.0, 0.5),
    _of("approach_height", "Approach from above", "mm", 0.0, 500.0, 1000.0, 5.0),
    _of("retract_height", "Retract upwards", "mm", 0.0, 500.0, 1000.0, 5.0),
    _of("dispense_lead", "Valve opens earlier by", "ms", -1000.0, 1000.0, 1000.0, 10.0),
    _of("max_deviation", "Largest deviation", "mm", 0.0, 1000.0, 1000.0, 0.1, "0: not checked"),
)
FIELDS = (*TIMING_FIELDS, *NOZZLE_FIELDS)
PLACE_FIELDS = tuple(Field(axis, "Part in the arm's base", "mm", -5000.0, 5000.0, 1000.0) for axis in ("x", "y", "z"))
TURN_FIELDS = tuple(
    Field(f"turn_{axis}", "Turned about", "°", -TURN_RANGE, TURN_RANGE, 1.0) for axis in ("x", "y", "z")
)


def turned(frame: tuple[float, ...]) -> tuple[float, float, float]:
    """Return a frame's rotation in degrees about the base's fixed axes: first x, then y, then z."""
    angles = Rotation.from_quat(frame[3:7]).as_euler("xyz", degrees=True)
    x, y, z = (round(float(angle), 4) + 0.0 for angle in angles)
    return x, y, z


def quaternion(degrees: Iterable[float]) -> tuple[float, ...]:
    """Return the quaternion x y z w of rotations in degrees about the base's fixed axes: first x, then y, then z."""
    return tuple(float(part) for part in Rotation.from_euler("xyz", list(degrees), degrees=True).as_quat())


def parameter_fields(parameters: Iterable[Mapping[str, Any]]) -> list[Field]:
    """Return the numbers a skill declares as parameters, with their units and ranges as people see them."""
    found = []
    for one in parameters:
        if isinstance(one.get("default"), str):
            continue
        unit, scale = SHOWN_UNITS.get(one.get("unit") or "", (one.get("unit") or "", 1.0))
        low, high = (None if one.get(end) is None else scale * float(one[end]) for end in ("minimum", "maximum"))
        name, default = one["name"], float(one.get("default") or 0.0)
        step = 10.0 ** max(-3, min(0, round(_magnitude(default * scale or (high or 1.0) / 100.0))))
        label = LABELS.get(name, one.get("description") or name)
        found.append(Field(name, label, unit, low, high, scale, step, "", default))
    return found


def _magnitude(value: float) -> float:
    magnitude = 0
    while abs(value) < 1.0 and magnitude > -6 and value:
        value, magnitude = value * 10.0, magnitude - 1
    return magnitude


def choice_fields(parameters: Iterable[Mapping[str, Any]]) -> list[tuple[str, str, str, tuple[str, ...]]]:
    """Return the words a skill declares as parameters: name, label, default, and what may be chosen."""
    words = [one for one in parameters if isinstance(one.get("default"), str) and one["name"] in CHOICES]
    return [(one["name"], LABELS[one["name"]], one["default"], CHOICES[one["name"]]) for one in words]


def field_at_fault(error: ClientError) -> str:
    """Return the name of the field that a refusal is about; empty when it is about none, or about several."""
    if not isinstance(error, Refused):
        return ""
    found = re.match(r"(?:parameters\.)?(\w+) (?:is|has|of) ", error.reason)
    return found.group(1) if found else ""
