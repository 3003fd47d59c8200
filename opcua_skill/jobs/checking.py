"""Checking a run without queueing it: its version, the modes it may run in, its plan or what forbids it."""

import asyncio
from dataclasses import dataclass

from library.description import Recipe
from opcua_skill.jobs.errors import LacksAtomicSkill, NotExecutable, QueueFull
from opcua_skill.jobs.execution import MODES, ExecutionJobs
from opcua_skill.jobs.planning import Planning
from opcua_skill.jobs.run_card import RunCard
from opcua_skill.jobs.station import Station
from opcua_skill.jobs.worker_tasks import PlanRefused

MOST_WAITING = 8


@dataclass(frozen=True, slots=True)
class RunCheck:
    """What a check found. ``modes`` says for every mode why a run would be refused in it; empty: it would not be."""

    version: int
    planned: RunCard | PlanRefused
    modes: dict[str, str]


class RunChecks:
    """Checks runs one after another, so that whoever only looks never stands in front of many who want to run."""

    def __init__(self, execution: ExecutionJobs, planning: Planning) -> None:
        self._execution = execution
        self._planning = planning
        self._turn = asyncio.Lock()
        self._waiting = 0

    async def check(self, station: Station, recipe: Recipe, version: int) -> RunCheck:
        """Plan a recipe for a station's arm; ``version`` 0 is the one that a simulation would run.

        Raises QueueFull, and the library's NotFound and Damaged.
        """
        if self._waiting >= MOST_WAITING:
            raise QueueFull(f"as many checks as may wait do, {self._waiting}: try again when one has ended")
        wanted = recipe.model_copy(update={"skill_version": version}) if version else recipe
        self._waiting += 1
        try:
            async with self._turn:
                description = await self._execution.version_for(station, recipe.skill_name, wanted, "simulation")
                planned = await self._planning.card(station, description, recipe)
        finally:
            self._waiting -= 1
        return RunCheck(description.version, planned, await self._modes(station, wanted))

    async def _modes(self, station: Station, recipe: Recipe) -> dict[str, str]:
        told = {}
        for mode in MODES:
            try:
                description = await self._execution.version_for(station, recipe.skill_name, recipe, mode)
                self._execution.check_equipment(station, description)
                told[mode] = ""
            except (NotExecutable, LacksAtomicSkill) as refused:
                told[mode] = str(refused)
        return told
