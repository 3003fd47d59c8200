"""What a run would do, before it is stored, approved or started."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.demonstration import Bools, Floats
from opcua_skill.client.session import Session
from opcua_skill.wire import to_server
from opcua_skill.wire.values import Mode, Recipe


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing found: a fatal one forbids the run, any other is worth knowing.

    ``place`` is where along the path, 0 to 1, and ``time`` in s since its start, both None where it is about no
    place; ``size`` says by how much, in ``unit``, None where there is no number to it; ``asked`` and ``limit`` are what
    was wanted and what is possible.
    """

    code: str
    place: float | None
    time: float | None
    size: float | None
    unit: str
    text: str
    fatal: bool
    asked: float | None = None
    limit: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RunCheck:
    """What `CheckRun` answered. ``refused`` says for every mode why it would be refused, empty where it would not.

    The path as it would be run, in the part's frame, thinned; empty if it cannot: ``times`` (n,) s, ``points`` (n, 3)
    m, ``speeds`` (n,) m/s, ``dispense`` (n,), ``covariances`` (n, 3, 3) m². ``facts`` are the report's other keys.
    """

    version: int
    can_run: bool
    findings: tuple[Finding, ...]
    refused: Mapping[Mode, str]
    times: Floats
    points: Floats
    speeds: Floats
    dispense: Bools
    covariances: Floats
    facts: Mapping[str, Any]


async def ask_check(session: Session, place: str, recipe: Recipe, version: int) -> RunCheck:
    """Return what a workstation says of a run."""
    number, can_run, text, times, points, speeds, dispense, covariances = await session.call(
        place,
        "CheckRun",
        Recipe=to_server.structure(to_server.recipe_out(session.structure, recipe)),
        SkillVersion=to_server.uint32(version),
    )
    told = dict(to_server.document(text))
    found, refused = told.pop("findings", ()), told.pop("modes", {})
    count = len(times or ())
    return RunCheck(
        version=int(number),
        can_run=bool(can_run),
        findings=tuple(
            Finding(
                one["code"],
                one["phase"],
                one["time"],
                one["size"],
                one["unit"],
                one["text"],
                one["fatal"],
                one.get("asked"),
                one.get("limit"),
            )
            for one in found
        ),
        refused=refused,
        times=np.asarray(times or [], dtype=np.float64),
        points=np.asarray(points or [], dtype=np.float64).reshape(count, 3),
        speeds=np.asarray(speeds or [], dtype=np.float64),
        dispense=np.asarray(dispense or [], dtype=bool),
        covariances=np.asarray(covariances or [], dtype=np.float64).reshape(count, 3, 3),
        facts=told,
    )
