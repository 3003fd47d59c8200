"""`Machines/<Workstation>/Queue`: whether the arm's next job may begin, and the methods that decide it."""

from dataclasses import dataclass
from typing import Any

from asyncua import ua

from library.description import Cause
from library.values import check_text
from opcua_skill.jobs import Station
from opcua_skill.jobs.motion.release import QueueStatus
from opcua_skill.security.access import caller
from opcua_skill.security.arm_lock import ArmLock
from opcua_skill.server.address_space import Tree, count, text
from opcua_skill.server.features.library_nodes import COMMENT, OPERATORS, STATE, method
from opcua_skill.stack.services.calls import add_method
from opcua_skill.wire.from_client import NO_TIME
from opcua_skill.wire.refusals import refusing

MEANINGS = {
    "State": "Released or Held: while it is held no further job begins",
    "HeldBecause": "why it is held; empty: it is released",
    "HeldBy": "who held or released it last: a user, arm or server",
    "HeldSince": "when that was",
    "Waiting": "jobs that wait",
}


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


async def add_queue(tree: Tree, workstation: str, methods: QueueMethods) -> None:
    """Add the queue to a workstation."""
    path = f"Machines/{workstation}/Queue"
    queue_type = tree.type_id("QueueType")
    queue = tree.object(
        path, tree.id(f"Machines/{workstation}"), type_definition=queue_type, description="the jobs that wait"
    )
    blank = queue_values(QueueStatus(since=NO_TIME))
    declared = tree.type_id("QueueType/State") in tree.server.iserver.aspace
    for name, value in queue_values(methods.station.queue.status).items():
        tree.variable(f"{path}/{name}", queue, value, description=MEANINGS[name])
        if not declared:
            place = {"node_id": tree.type_id(f"QueueType/{name}"), "name": tree.name(name)}
            member = tree.variable(
                f"QueueType/{name}",
                queue_type,
                blank[name],
                description=MEANINGS[name],
                **place,
            )
            tree.make_mandatory(member)
    for spec in (
        method("ReleaseQueue", methods.release_queue, OPERATORS, (COMMENT,), (STATE,)),
        method("HoldQueue", methods.hold_queue, OPERATORS, (COMMENT,), (STATE,), urgent=True),
    ):
        tree.declare_method("QueueType", spec)
        await add_method(tree.server, queue, spec, tree.id(f"{path}/{spec.name}"), tree.name(spec.name))


def queue_values(status: QueueStatus) -> dict[str, ua.Variant]:
    """Return what the nodes show, and what an event about the queue says."""
    return {
        "State": text(status.state),
        "HeldBecause": text(status.because.value),
        "HeldBy": text(status.by),
        "HeldSince": ua.Variant(status.since, ua.VariantType.DateTime),
        "Waiting": count(status.waiting),
    }
