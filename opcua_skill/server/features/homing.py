"""`Arm/GoHome` and `StopMotion`: to the start, slowly and only if a person asks for it, and whatever moves stopped."""

from dataclasses import dataclass
from typing import Any

from library.errors import NotAllowedInState
from library.values import check_text
from opcua_skill.jobs import JobEngine, Station
from opcua_skill.jobs.worker_tasks import PlanRefused
from opcua_skill.security.access import caller
from opcua_skill.security.arm_lock import ArmLock
from opcua_skill.server.address_space import Tree
from opcua_skill.server.features.library_nodes import COMMENT, OPERATORS, method
from opcua_skill.stack.services.calls import Refused, add_method
from opcua_skill.wire.refusals import Code, refusing
from sim.arm import ArmMode


@dataclass(frozen=True)
class HomingMethods:
    """The handlers of one arm's GoHome and StopMotion. A stop of any kind stops the way home too, and one asked for."""

    jobs: JobEngine
    station: Station
    lock: ArmLock

    @refusing(blame="Comment")
    async def go_home(self, comment: str) -> tuple[Any, ...]:
        """Move the arm slowly to where every run starts; answers once the way is checked and the motion begins."""
        check_text(comment, "comment", 2000)
        self.lock.check(caller().session_id)
        self._check_idle()
        stops = self.station.lane.stops
        planned = await self.jobs.plan_home(self.station)
        if isinstance(planned, PlanRefused):
            raise Refused(Code.BadOutOfRange, planned.findings[0].text)
        self._check_idle()
        if self.station.lane.stops != stops:
            why = "look first, then ask again"
            raise NotAllowedInState(f"the arm of {self.station.name}", "stopped meanwhile", why)
        self.station.lane.go_home(planned)
        return ()

    @refusing(blame="Comment")
    async def stop_motion(self, comment: str) -> tuple[Any, ...]:
        """Bring whatever moves the arm to rest on its path, and hold the queue; a job is Aborted, cause Stopped."""
        check_text(comment, "comment", 2000)
        await self.station.lane.stop_motion(comment or f"{caller().name} stopped the motion", caller().name)
        return ()

    def _check_idle(self) -> None:
        self.station.lane.check_at_rest(f"the arm of {self.station.name}")
        mode = self.station.arm.state().mode
        if mode is not ArmMode.IDLE:
            raise NotAllowedInState(f"the arm of {self.station.name}", mode.value, "it has to be idle")


async def add_homing(tree: Tree, workstation: str, methods: HomingMethods) -> None:
    """Add the methods to the arm of a workstation."""
    arm = f"Machines/{workstation}/Arm"
    for spec in (
        method("GoHome", methods.go_home, OPERATORS, (COMMENT,), ()),
        method("StopMotion", methods.stop_motion, OPERATORS, (COMMENT,), (), urgent=True),
    ):
        tree.declare_method("ArmType", spec)
        await add_method(tree.server, tree.id(arm), spec, tree.id(f"{arm}/{spec.name}"), tree.name(spec.name))
