"""Going to the start: after a stop on the path the arm goes home slowly, on request, before anything else can run."""

import asyncio
import logging
from dataclasses import dataclass, field
from typing import Any

from library.errors import NotAllowedInState
from library.values import check_text
from opcua_skill.arm_lock import ArmLock
from opcua_skill.computations import PlanRefused
from opcua_skill.jobs import JobEngine, Station
from opcua_skill.methods.refusals import Code, refusing
from opcua_skill.stack.access import caller
from opcua_skill.stack.calls import Refused
from sim.arm import ArmError, ArmMode
from sim.plan import MotionPlan

_log = logging.getLogger(__name__)


@dataclass
class HomingMethods:
    """The handler of one arm's GoHome. A stop of any kind stops this motion too: it stops the arm."""

    jobs: JobEngine
    station: Station
    lock: ArmLock
    _way: "asyncio.Task[None] | None" = field(default=None)

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
        self._way = asyncio.create_task(self._go(planned), name=f"{self.station.name} goes home")
        return ()

    def _check_idle(self) -> None:
        mode = self.station.arm.state().mode
        under_way = self._way is not None and not self._way.done()
        if mode is not ArmMode.IDLE or under_way or self.station.lane.waiting:
            state = "with jobs waiting" if self.station.lane.waiting else mode.value
            raise NotAllowedInState(f"the arm of {self.station.name}", state, "it has to be idle")

    async def _go(self, plan: MotionPlan) -> None:
        try:
            await self.station.arm.run(plan, lambda _: None)
            _log.info("the arm of %s is home", self.station.name)
        except ArmError as stopped:
            _log.warning("the arm of %s did not come home: %s", self.station.name, stopped.text)
        except Exception:
            _log.exception("the arm of %s did not come home", self.station.name)
