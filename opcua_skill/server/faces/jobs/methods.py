"""The methods of JobOrderControl and JobOrderResults: each asks the orders and answers with a ReturnStatus.

A refusal is a Good call with bits that say why (OPC 10031-4, Annex B.2): a client that sees a Bad one loses them.
"""

import logging
from collections.abc import Awaitable, Callable
from functools import wraps
from typing import Any

from pydantic import ValidationError

from library.errors import AlreadyExists, InvalidValue, NotAllowedInState, NotFound
from library.values import check_text
from opcua_skill.jobs import ArmNotReady, LacksAtomicSkill, MotionNotPossible, NotExecutable, QueueFull
from opcua_skill.security.arm_lock import LockedByAnother
from opcua_skill.server.faces.jobs.orders import JobOrders
from opcua_skill.server.faces.jobs.states import Bit, OrderRefused, return_status
from opcua_skill.server.faces.jobs.structures import Structures
from opcua_skill.wire.refusals import refusing
from sim.arm import CommandRefused

BITS: dict[type[Exception], tuple[Bit, ...]] = {
    NotFound: (Bit.UNABLE, Bit.UNKNOWN_WORK_MASTER),
    NotAllowedInState: (Bit.INVALID_STATUS,),
    CommandRefused: (Bit.INVALID_STATUS,),
    NotExecutable: (Bit.UNABLE, Bit.NOT_RELEASED),
    LacksAtomicSkill: (Bit.UNABLE, Bit.NOT_RELEASED),
    ArmNotReady: (Bit.UNABLE, Bit.ARM_NOT_READY),
    QueueFull: (Bit.UNABLE, Bit.NO_ROOM),
    LockedByAnother: (Bit.UNABLE, Bit.LOCKED),
    MotionNotPossible: (Bit.UNABLE, Bit.MOTION_NOT_POSSIBLE),
    AlreadyExists: (Bit.UNABLE, Bit.OTHER_CONTENT),
    InvalidValue: (Bit.INVALID_REQUEST,),
    ValidationError: (Bit.INVALID_REQUEST,),
}
SUCCESS = return_status(Bit.NO_ERROR)
LONGEST_COMMENT = 2000  # letters, as for the comments of our own methods

Handler = Callable[..., Awaitable[tuple[Any, ...]]]
_log = logging.getLogger(__name__)


def answering(method: Handler) -> Handler:
    """Translate what an order is refused for into bits."""

    @wraps(method)
    async def answered(*arguments: Any) -> tuple[Any, ...]:
        try:
            return await method(*arguments)
        except OrderRefused as refusal:
            bits, why = refusal.bits, refusal
        except tuple(BITS) as error:
            bits, why = next(bits for kind, bits in BITS.items() if isinstance(error, kind)), error
        _log.warning("%s refused with %s: %s", method.__name__, ", ".join(bit.name for bit in bits), why)
        return (return_status(*bits),)

    return refusing(blame="JobOrder")(answered)


class ControlMethods:
    """Handlers of JobOrderControl."""

    def __init__(self, orders: JobOrders) -> None:
        self._orders = orders

    @answering
    async def store(self, order: Any, comment: list[Any]) -> tuple[Any, ...]:
        """Take a job order; it is not started."""
        _words(comment)
        await self._orders.store(order)
        return (SUCCESS,)

    @answering
    async def store_and_start(self, order: Any, comment: list[Any]) -> tuple[Any, ...]:
        """Take a job order and start it; the same order is taken and started once."""
        _words(comment)
        await self._orders.store_and_start(order)
        return (SUCCESS,)

    @answering
    async def update(self, order: Any, comment: list[Any]) -> tuple[Any, ...]:
        """Replace a job order that has not begun to move."""
        _words(comment)
        await self._orders.update(order)
        return (SUCCESS,)

    @answering
    async def start(self, order_id: str, comment: list[Any]) -> tuple[Any, ...]:
        """Start a stored job order: it is checked completely and waits for the arm."""
        _words(comment)
        await self._orders.start(order_id)
        return (SUCCESS,)

    @answering
    async def revoke_start(self, order_id: str, comment: list[Any]) -> tuple[Any, ...]:
        """Take a job order that has not begun to move out of the queue; it stays stored."""
        _words(comment)
        await self._orders.revoke_start(order_id)
        return (SUCCESS,)

    @answering
    async def pause(self, order_id: str, comment: list[Any]) -> tuple[Any, ...]:
        """Stop on the path; the job order can be resumed."""
        await self._orders.pause(order_id, _words(comment))
        return (SUCCESS,)

    @answering
    async def resume(self, order_id: str, comment: list[Any]) -> tuple[Any, ...]:
        """Go on where the arm paused."""
        _words(comment)
        await self._orders.resume(order_id)
        return (SUCCESS,)

    @answering
    async def stop(self, order_id: str, comment: list[Any]) -> tuple[Any, ...]:
        """Bring a running job order to rest and end it; the queue is held."""
        await self._orders.stop(order_id, _words(comment))
        return (SUCCESS,)

    @answering
    async def abort(self, order_id: str, comment: list[Any]) -> tuple[Any, ...]:
        """Abort a job order that has not ended; if it runs the queue is held."""
        await self._orders.abort(order_id, _words(comment))
        return (SUCCESS,)

    @answering
    async def cancel(self, order_id: str, comment: list[Any]) -> tuple[Any, ...]:
        """Forget a job order that has not begun to move."""
        _words(comment)
        await self._orders.cancel(order_id)
        return (SUCCESS,)

    @answering
    async def clear(self, order_id: str, comment: list[Any]) -> tuple[Any, ...]:
        """Forget a job order that has ended."""
        _words(comment)
        await self._orders.clear(order_id)
        return (SUCCESS,)


class ResultMethods:
    """Handlers of JobOrderResults."""

    def __init__(self, orders: JobOrders, structures: Structures) -> None:
        self._orders = orders
        self._structures = structures

    @refusing(blame="JobOrderID")
    async def by_order_id(self, order_id: str) -> tuple[Any, ...]:
        """Return what has become of a job order."""
        try:
            found = await self._orders.find(order_id)
        except OrderRefused as refusal:
            return (self._structures.response(None, None, []), return_status(*refusal.bits))
        states = self._structures.states(*self._orders.state(found))
        return (self._structures.response(*found, states), SUCCESS)

    @refusing(blame="JobOrderState")
    async def by_state(self, states: list[Any]) -> tuple[Any, ...]:
        """Return what has become of the job orders in one of these states."""
        wanted = {int(state.StateNumber) for state in states if not (state.BrowsePath and state.BrowsePath.Elements)}
        answers = []
        for found in await self._orders.newest():
            state = self._orders.state(found)
            if state[0] in wanted:
                answers.append(self._structures.response(*found, self._structures.states(*state)))
        return (answers, SUCCESS)


def _words(comment: list[Any]) -> str:
    """Return the comments as one text."""
    return check_text("; ".join(one.Text or "" for one in comment if one is not None), "Comment", LONGEST_COMMENT)
