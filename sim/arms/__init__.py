"""The arms that come with the project: a description, and a limits file in which every row names its source."""

import hashlib
import tomllib
from functools import lru_cache
from importlib.resources import files
from typing import Any

from sim.arm import ArmModel, Capsule, Limits, PathLimits, Tool

NAMES = ("panda", "xarm6", "iiwa14")


def names() -> tuple[str, ...]:
    """Return the names of the arms, the default first."""
    return NAMES


@lru_cache(maxsize=8)
def load(name: str = "panda") -> ArmModel:
    """Return the model of an arm. Raises ``ValueError`` naming the known ones."""
    if name not in NAMES:
        raise ValueError(f"there is no arm {name!r}: known are {', '.join(NAMES)}")
    folder = files("sim.arms")
    return read_model(name, (folder / f"{name}.urdf").read_text("utf-8"), (folder / f"{name}.toml").read_text("utf-8"))


def read_model(name: str, urdf: str, table: str) -> ArmModel:
    """Return an arm's model from the text of its URDF and of its limits file. The digest covers both."""
    values: dict[str, Any] = tomllib.loads(table)
    limits = values["limits"]
    path, tool, cell, hull = values["path"], values["tool"], values["cell"], values.get("hull", {})
    return ArmModel(
        name=name,
        manufacturer=values["manufacturer"],
        model=values["model"],
        urdf=urdf,
        limits=Limits(
            lower=tuple(limits["position"]["lower"]),
            upper=tuple(limits["position"]["upper"]),
            velocity=tuple(limits["velocity"]["values"]),
            acceleration=tuple(limits["acceleration"]["values"]),
            jerk=tuple(limits["jerk"]["values"]),
            sources=tuple((row, limits[row]["source"]) for row in ("position", "velocity", "acceleration", "jerk")),
        ),
        path_limits=PathLimits(path["speed"], path["acceleration"], path["jerk"], path["source"]),
        home=tuple(values["home"]),
        tool=Tool(tool["tip"], tool["name"], tool["mass"], tool["length"]),
        workspace_low=tuple(cell["workspace_low"]),
        workspace_high=tuple(cell["workspace_high"]),
        part_frame=tuple(cell["part_frame"]),
        capsules=tuple(
            Capsule(row["link"], tuple(row["start"]), tuple(row["end"]), row["radius"])
            for row in hull.get("capsules", [])
        ),
        apart=tuple((pair[0], pair[1]) for pair in hull.get("apart", [])),
        atomic_skills=tuple(values["atomic_skills"]),
        digest=hashlib.sha256(f"{urdf}\0{table}".encode()).hexdigest(),
    )
