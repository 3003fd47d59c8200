"""The way to where every run starts: asked for by a person, stopped by anybody; jobs wait meanwhile."""

import asyncio
import logging
from collections.abc import Callable

from library.description import Cause
from opcua_skill.jobs.motion.completion import is_lost
from opcua_skill.jobs.motion.steering import ARM_SIDE, SERVER_SIDE, STOP_AGAIN
from sim.arm import Arm, ArmError, Stopped
from sim.plan import MotionPlan

_log = logging.getLogger(__name__)


class WayHome:
    """The way home of one lane's arm. ``hold`` holds the lane's queue, ``over`` is called when the arm is at rest."""

    def __init__(
        self, name: str, arm_of: Callable[[], Arm], hold: Callable[[Cause, str], None], over: Callable[[], None]
    ) -> None:
        self._name = name
        self._arm_of = arm_of
        self._hold = hold
        self._over = over
        self.task: asyncio.Task[None] | None = None

    @property
    def under_way(self) -> bool:
        """Whether the arm is on its way, or about to be."""
        return self.task is not None

    def begin(self, plan: MotionPlan) -> None:
        """Begin; nothing else moves the arm."""
        self.task = asyncio.create_task(self._go(plan), name=f"{self._name} goes home")

    async def stop(self, because: str) -> None:
        """Bring the arm to rest, asking again until it is: a way that begins in this moment must not get away."""
        while self.task is not None:
            try:
                await self._arm_of().stop(because)
            except (ArmError, OSError) as fault:
                _log.error("stopping the way home of %s: %s", self._name, fault)
            if self.task is not None:
                await asyncio.wait({self.task}, timeout=STOP_AGAIN)

    async def _go(self, plan: MotionPlan) -> None:
        arm = self._arm_of()
        try:
            await arm.run(plan, lambda _: None)
            _log.info("lane %s: the arm is home", self._name)
        except Stopped as stopped:
            self._hold(Cause.UNASKED_STOP, ARM_SIDE)
            _log.warning("lane %s: the arm did not come home: %s", self._name, stopped)
        except ArmError as fault:
            protective = arm.state().protective_stop
            self._hold(
                Cause.ARM_LOST if is_lost(arm) else Cause.PROTECTIVE_STOP if protective else Cause.FAILED, ARM_SIDE
            )
            _log.warning("lane %s: the arm did not come home: %s", self._name, fault.text)
        except Exception:
            self._hold(Cause.FAILED, SERVER_SIDE)
            _log.exception("lane %s: the arm did not come home", self._name)
        finally:
            self.task = None
            self._over()
