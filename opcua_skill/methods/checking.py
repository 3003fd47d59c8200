"""Looking before anything moves: what a recipe would do on an arm, without a job and without being stored."""

import json
from dataclasses import dataclass
from typing import Any

from opcua_skill.computations import PlanRefused
from opcua_skill.jobs import JobEngine, Station, motion_parameters
from opcua_skill.jobs.run_card import found
from opcua_skill.methods.refusals import refusing
from opcua_skill.methods.values import recipe


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
