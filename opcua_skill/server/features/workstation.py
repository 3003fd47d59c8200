"""The methods of a workstation: running skills, and the arm's stop, reset and lock."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from library.description import JobReport, JobState
from library.errors import NotFound
from library.lifecycle import FINAL_JOB_STATES
from library.names import normal
from library.store import SkillLibrary
from library.values import check_text
from opcua_skill.configuration.settings import Settings
from opcua_skill.jobs import JobEngine, Station
from opcua_skill.jobs.motion.completion import TRACE_COLUMNS
from opcua_skill.jobs.motion.motion_queue import MotionQueue
from opcua_skill.security.access import Role, caller
from opcua_skill.security.arm_lock import ArmLock
from opcua_skill.server.features.telling import Telling
from opcua_skill.stack.services.calls import Refused
from opcua_skill.wire.from_client import flat, wire_report
from opcua_skill.wire.refusals import Code, out_of_range, refusing

MODES = ("simulation", "test", "production")
MODE_ROLES = {"simulation": Role.OPERATOR, "test": Role.ENGINEER, "production": Role.OPERATOR}


@dataclass(frozen=True)
class WorkstationMethods:
    """Handlers of one workstation's methods."""

    library: SkillLibrary
    jobs: JobEngine
    station: Station
    lock: ArmLock
    settings: Settings
    events: Telling
    lock_changed: Callable[[], Any]

    @refusing(blame="RecipeId")
    async def execute_skill(self, skill_name: str, recipe_id: str, mode: int) -> tuple[Any, ...]:
        """Check a run completely and queue it; nothing has moved when this answers."""
        if not 0 <= mode < len(MODES):
            raise out_of_range("Mode", f"there is no mode {mode}: 0 is simulation, 1 test, 2 production")
        word, who = MODES[mode], caller()
        if who.role not in MODE_ROLES[word].and_above:
            raise Refused(Code.BadUserAccessDenied, f"the role {who.role} may not run in {word} mode")
        if word != "simulation":
            self.lock.check(who.session_id)
        await self.library.description(skill_name)
        chosen = await self.library.recipe(recipe_id or await self.library.default_recipe_id(skill_name))
        if chosen.skill_name != normal(skill_name):
            raise NotFound("recipe", f"{recipe_id} of {skill_name}")
        report = await self.jobs.execute(self.station.name, chosen.skill_name, chosen, word, who.name)  # type: ignore[arg-type]
        return (report.job_id, report.state.value)

    async def _lane_of(self, job_id: str) -> MotionQueue:
        """Return the lane that holds a job of this workstation, whatever the database says; else where it belonged."""
        for lane in (self.station.lane, self.station.simulation):
            if lane.holds(job_id):
                return lane
        report = await self.library.job(job_id)
        if report.workstation != self.station.name:
            raise NotFound("job", f"{job_id} of {self.station.name}")
        return self.station.simulation if report.mode == "simulation" else self.station.lane

    @refusing(blame="JobId", fields={"comment": "Comment"})
    async def pause_job(self, job_id: str, comment: str) -> tuple[Any, ...]:
        """Stop on the path; the job can be resumed."""
        check_text(comment, "comment", 2000)
        state = await (await self._lane_of(job_id)).pause(job_id, comment or f"{caller().name} paused the job")
        return (state.value,)

    @refusing(blame="JobId", fields={"comment": "Comment"})
    async def resume_job(self, job_id: str, comment: str) -> tuple[Any, ...]:
        """Go on where the arm paused."""
        check_text(comment, "comment", 2000)
        lane = await self._lane_of(job_id)
        if lane is self.station.lane:
            self.lock.check(caller().session_id)
        return ((await lane.resume(job_id)).value,)

    @refusing(blame="JobId", fields={"comment": "Comment"})
    async def abort_job(self, job_id: str, comment: str) -> tuple[Any, ...]:
        """Take a job out of the queue or stop its motion; it is Stopping until the arm is at rest."""
        check_text(comment, "comment", 2000)
        lane = await self._lane_of(job_id)
        state = await lane.abort(job_id, comment or f"{caller().name} aborted the job", by=caller().name)
        return (state.value,)

    @refusing(blame="JobId")
    async def get_job(self, job_id: str) -> tuple[Any, ...]:
        """Return the report of a job."""
        return (wire_report(self._as_now(await self.library.job(job_id))),)

    def _as_now(self, report: JobReport) -> JobReport:
        """Return a report with how far the run is by now, or with what keeps the job waiting."""
        moves_the_arm = report.mode != "simulation"
        lane = self.station.lane if moves_the_arm else self.station.simulation
        state = lane.state_of(report.job_id)
        if state is not None and report.state in FINAL_JOB_STATES:  # somebody else wrote that: the arm's word counts
            report = report.model_copy(update={"state": state})
        progress = lane.progress_of(report.job_id)
        if progress is not None and report.state in {JobState.RUNNING, JobState.PAUSED, JobState.STOPPING}:
            phase, place = lane.place_of(report.job_id)
            return report.model_copy(update={"progress": progress, "path_phase": phase, "place": place})
        if report.state is JobState.QUEUED and moves_the_arm:
            return report.model_copy(update={"held_queue": self.station.queue.held})
        return report

    @refusing(blame="State")
    async def list_jobs(self, state: str, limit: int) -> tuple[Any, ...]:
        """Return the newest jobs of this workstation."""
        if state and state not in {one.value for one in JobState}:
            raise out_of_range("State", f"there is no state {state!r}: {', '.join(one.value for one in JobState)}")
        most = self.settings.limits.max_page
        found = await self.library.jobs(state=state, limit=min(limit or most, most), workstation=self.station.name)
        return ([wire_report(self._as_now(one)) for one in found],)

    @refusing(blame="JobId")
    async def get_trace(self, job_id: str) -> tuple[Any, ...]:
        """Return commanded and measured nozzle tip of a run: x y z in m in the arm's base, row-major."""
        return await self._trace(job_id, slice(0, len(TRACE_COLUMNS)))

    @refusing(blame="JobId")
    async def get_joint_trace(self, job_id: str) -> tuple[Any, ...]:
        """Return commanded and measured joints of a run in rad, row-major; none for a run of an older version."""
        return await self._trace(job_id, slice(len(TRACE_COLUMNS), None))

    async def _trace(self, job_id: str, columns: slice) -> tuple[Any, ...]:
        trace = await self.library.trace(job_id)
        commanded, measured = trace.commanded[:, columns], trace.measured[:, columns]
        return (flat(trace.times), flat(commanded), flat(measured))

    @refusing(blame="Comment")
    async def protective_stop(self, comment: str) -> tuple[Any, ...]:
        """Stop the arm as fast as its limits allow; it refuses to move until it is reset."""
        check_text(comment, "comment", 2000)
        because = comment or f"{caller().name} pressed the protective stop"
        try:
            await self.station.lane.protective_stop(because, caller().name)
        finally:
            await self.events.protective_stop(self.station.name, because, caller().name)
        return ()

    @refusing(blame="Comment")
    async def reset(self, comment: str) -> tuple[Any, ...]:
        """Acknowledge a protective stop or a fault, so that the arm may move again."""
        check_text(comment, "comment", 2000)
        self.lock.check(caller().session_id)
        await self.station.reset()
        return ()

    async def init_lock(self, context: str) -> tuple[Any, ...]:
        """Take the arm for oneself (OPC 10000-100): 0, or -1 when somebody has it."""
        who = caller()
        status = self.lock.take(who.session_id, who.name, check_text(context, "Context", 256) or who.peer)
        await self.lock_changed()
        return (status,)

    async def renew_lock(self) -> tuple[Any, ...]:
        """Keep the arm: 0, or -1 when one does not have it."""
        status = self.lock.renew(caller().session_id)
        await self.lock_changed()
        return (status,)

    async def exit_lock(self) -> tuple[Any, ...]:
        """Give the arm back: 0, or -1 when one does not have it."""
        status = self.lock.give_back(caller().session_id)
        await self.lock_changed()
        return (status,)

    async def break_lock(self) -> tuple[Any, ...]:
        """Take the lock away from whoever has it: 0, or -1 when nobody has."""
        status = self.lock.break_lock()
        await self.lock_changed()
        return (status,)
