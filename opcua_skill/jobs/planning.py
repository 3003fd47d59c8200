"""Plans, paths and trace files, each made in a worker process: the server's own never computes them."""

from library.description import Recipe, SkillDescription
from models.motion import Trajectory
from opcua_skill.configuration.settings import Settings
from opcua_skill.jobs.motion.run import QueuedMotion
from opcua_skill.jobs.motion_parameters import motion_order
from opcua_skill.jobs.process_pool import Workers
from opcua_skill.jobs.run_card import RunCard, run_card
from opcua_skill.jobs.station import Station
from opcua_skill.jobs.worker_tasks import (
    DocumentRefused,
    PlanRefused,
    plan_record,
    plan_skill,
    plan_way_home,
    read_document,
    ready,
    trajectory_as_learned,
    trajectory_of_plan,
    write_trace,
)
from sim.arm import Trace
from sim.plan import MotionPlan

PLANNING_SECONDS = 60.0
READING_SECONDS = 20.0


class Planning:
    """What is computed about motions of one server. Every method raises WorkerDied or WorkerTimeout by name."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._workers = Workers(1, "planning")
        self._reading = Workers(1, "reading")  # what is only looked at does not keep runs from being planned

    def sweep(self) -> None:
        """Remove what a server that was killed while it wrote a trace has left: it takes room and nobody sees it."""
        for left in (self._settings.data / "traces").glob(".*.part"):
            left.unlink(missing_ok=True)

    async def warm_up(self) -> None:
        """Let the workers import what the first plan needs."""
        await self._workers.warm_up(ready)
        await self._reading.warm_up(ready)

    def close(self) -> None:
        """End every worker, whatever it does."""
        self._workers.close()
        self._reading.close()

    async def plan(
        self,
        station: Station,
        description: SkillDescription,
        recipe: Recipe,
        speed_fraction: float = 1.0,
        *,
        only_looked_at: bool = False,
    ) -> MotionPlan | PlanRefused:
        """Plan and check a run on a station's arm."""
        workers = self._reading if only_looked_at else self._workers
        return await workers.run(
            f"planning {description.name}",
            plan_skill,
            description.motion(),
            motion_order(recipe, speed_fraction),
            station.model,
            description.model_digest,
            recipe.recipe_id,
            station.cell,
            seconds=PLANNING_SECONDS,
        )

    async def card(self, station: Station, description: SkillDescription, recipe: Recipe) -> RunCard | PlanRefused:
        """Plan a run on a station's arm and return what an operator has to see of it."""
        return await self._workers.run(
            f"checking {description.name}",
            run_card,
            description.motion(),
            motion_order(recipe, 1.0),
            station.model,
            description.model_digest,
            recipe.recipe_id,
            station.cell,
            seconds=PLANNING_SECONDS,
        )

    async def plan_home(self, station: Station) -> MotionPlan | PlanRefused:
        """Plan the way from where an arm stands to where every run starts."""
        joints = tuple(station.arm.state().joints)
        what = f"planning the way home on {station.name}"
        return await self._workers.run(
            what, plan_way_home, station.model, joints, station.cell, seconds=PLANNING_SECONDS
        )

    async def trajectory(self, description: SkillDescription, time_step: float) -> Trajectory:
        """Return the path with the people's own timing, at ``time_step`` s (0: the learned one)."""
        what = f"reproducing {description.name}"
        return await self._reading.run(
            what, trajectory_as_learned, description.motion(), time_step, seconds=PLANNING_SECONDS
        )

    async def recipe_trajectory(
        self, station: Station, description: SkillDescription, recipe: Recipe
    ) -> Trajectory | PlanRefused:
        """Return the path in the part's frame with a recipe's timing, as a station's arm would run it."""
        planned = await self.plan(station, description, recipe, only_looked_at=True)
        if isinstance(planned, PlanRefused):
            return planned
        motion = description.motion()
        what = f"reproducing {description.name}"
        return await self._reading.run(what, trajectory_of_plan, motion, planned, seconds=PLANNING_SECONDS)

    async def read_document(self, content: str, longest: float) -> SkillDescription | DocumentRefused:
        """Return the version in a document, or why it cannot be read or run."""
        return await self._reading.run("reading a document", read_document, content, longest, seconds=READING_SECONDS)

    async def keep_trace(self, order: QueuedMotion, trace: Trace) -> None:
        """Write the whole trace of a run into files, joints, valve and override too, and the plan that was run."""
        formats = self._settings.trace_files
        if formats:
            folder = self._settings.data / "traces"
            what = f"writing the trace of {order.job_id}"
            plan = plan_record(order.plan)
            await self._workers.run(
                what, write_trace, trace, folder, order.job_id, formats, plan, seconds=PLANNING_SECONDS
            )
