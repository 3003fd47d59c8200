"""The methods of an arm's queue: hold it, and let the next job begin."""

from dataclasses import dataclass
from typing import Any

from library.description import Cause
from library.values import check_text
from opcua_skill.arm_lock import ArmLock
from opcua_skill.jobs import Station
from opcua_skill.methods.refusals import refusing
from opcua_skill.security.access import caller


@dataclass(frozen=True)
class QueueMethods:
    """Handlers of one arm's queue."""

    station: Station
    lock: ArmLock

    @refusing(blame="Comment")
    async def release_queue(self, comment: str) -> tuple[Any, ...]:
        """Let the next job begin; refused while the arm does not stand ready at home, at rest."""
        check_text(comment, "comment", 2000)
        self.lock.check(caller().session_id)
        await self.station.queue.release(caller().name, self.station.check_ready_for_release)
        return (self.station.queue.status.state,)

    @refusing(blame="Comment")
    async def hold_queue(self, comment: str) -> tuple[Any, ...]:
        """Let no further job begin until the queue is released; what runs goes on."""
        check_text(comment, "comment", 2000)
        self.station.queue.hold(Cause.REQUESTED, caller().name)
        await self.station.queue.written()
        return (self.station.queue.status.state,)
