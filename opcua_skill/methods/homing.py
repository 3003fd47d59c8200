"""Going to the start: after a stop on the path the arm goes home slowly, if a person asks for it and not otherwise."""

from dataclasses import dataclass
from typing import Any

from library.errors import NotAllowedInState
from library.values import check_text
from opcua_skill.arm_lock import ArmLock
from opcua_skill.computations import PlanRefused
from opcua_skill.jobs import JobEngine, Station
from opcua_skill.methods.refusals import Code, refusing
from opcua_skill.stack.access import caller
from opcua_skill.stack.calls import Refused
from sim.arm import ArmMode


@dataclass(frozen=True)
class HomingMethods:
    """The handler of one arm's GoHome. A stop of any kind stops this motion too: it stops the arm."""

    jobs: JobEngine
    station: Station
    lock: ArmLock

    @refusing(blame="Comment")
    async def go_home(self, comment: str) -> tuple[Any, ...]:
        """Move the arm slowly to where every run starts; answers once the way is checked and the motion begins."""
        check_text(comment, "comment", 2000)
        self.lock.check(caller().session_id)
        self._check_idle()
        planned = await self.jobs.plan_home(self.station)
        if isinstance(planned, PlanRefused):
            raise Refused(Code.BadOutOfRange, planned.findings[0].text)
        self._check_idle()
        self.station.lane.go_home(planned)
        return ()

    def _check_idle(self) -> None:
        self.station.lane.check_at_rest(f"the arm of {self.station.name}")
        mode = self.station.arm.state().mode
        if mode is not ArmMode.IDLE:
            raise NotAllowedInState(f"the arm of {self.station.name}", mode.value, "it has to be idle")
