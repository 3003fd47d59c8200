"""`Machines/<Workstation>/CheckRun`: what a recipe would do on an arm, without a job and without being stored."""

import json
from dataclasses import dataclass
from typing import Any

from opcua_skill.jobs import JobEngine, Station, motion_parameters
from opcua_skill.jobs.run_card import found
from opcua_skill.jobs.worker_tasks import PlanRefused
from opcua_skill.server.address_space import Tree
from opcua_skill.server.features.library_nodes import OPERATORS, method
from opcua_skill.server.types import BOOLEAN, DOUBLE, STRING, UINT32
from opcua_skill.stack.services.calls import Argument, add_method
from opcua_skill.wire.from_client import recipe
from opcua_skill.wire.refusals import refusing


@dataclass(frozen=True)
class CheckingMethods:
    """The handler of one workstation's CheckRun."""

    jobs: JobEngine
    station: Station

    @refusing(blame="Recipe", within="Recipe")
    async def check_run(self, given: Any, version: int) -> tuple[Any, ...]:
        """Plan and check a run without queueing it: what would run, where it slows, or why it cannot."""
        wanted = recipe(given)
        motion_parameters(wanted)
        checked = await self.jobs.check(self.station.name, wanted, version)
        planned = checked.planned
        if isinstance(planned, PlanRefused):
            told = {"modes": checked.modes} | found(planned.findings)
            return (checked.version, False, json.dumps(told), [], [], [], [], [])
        return (
            checked.version,
            True,
            json.dumps({"modes": checked.modes} | planned.facts),
            planned.times.tolist(),
            planned.points.ravel().tolist(),
            planned.speeds.tolist(),
            planned.dispense.tolist(),
            planned.covariances.ravel().tolist(),
        )


async def add_checking(tree: Tree, workstation: str, methods: CheckingMethods) -> None:
    """Add the method to a workstation."""
    place = f"Machines/{workstation}"
    spec = method(
        "CheckRun",
        methods.check_run,
        OPERATORS,
        (
            Argument("Recipe", tree.type_id("RecipeDataType"), description="stored or not"),
            Argument("SkillVersion", UINT32, description="0: the one that a simulation would run"),
        ),
        (
            Argument("SkillVersion", UINT32, description="the version that was looked at"),
            Argument("CanRun", BOOLEAN, description="false: the findings say why not"),
            Argument("Report", STRING, description="JSON: findings, modes, plan digest, speeds, lengths, plate, valve"),
            Argument("Times", DOUBLE, 1, "s since the start of the path, thinned"),
            Argument("Positions", DOUBLE, 1, "nozzle tip x y z in m in the part's frame, row-major"),
            Argument("Speeds", DOUBLE, 1, "of the nozzle, m/s"),
            Argument("Dispense", BOOLEAN, 1, "valve open, lead included"),
            Argument("Covariances", DOUBLE, 1, "of the people, 3 x 3 a sample, m2, row-major"),
        ),
        changes=False,
        seconds=70.0,
    )
    tree.declare_method("WorkstationType", spec)
    await add_method(tree.server, tree.id(place), spec, tree.id(f"{place}/{spec.name}"), tree.name(spec.name))
