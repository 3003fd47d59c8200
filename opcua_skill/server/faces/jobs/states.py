"""In which state of OPC 10031-4 an order is, and what a method's ReturnStatus says."""

from enum import IntEnum

from library.description import Cause, JobReport, JobState
from library.records import JobOrder


class OrderState(IntEnum):
    """A top-level state, with its StateNumber."""

    NOT_ALLOWED_TO_START = 1
    ALLOWED_TO_START = 2
    RUNNING = 3
    INTERRUPTED = 4
    ENDED = 5
    ABORTED = 6


STATE_NAMES = {
    OrderState.NOT_ALLOWED_TO_START: "NotAllowedToStart",
    OrderState.ALLOWED_TO_START: "AllowedToStart",
    OrderState.RUNNING: "Running",
    OrderState.INTERRUPTED: "Interrupted",
    OrderState.ENDED: "Ended",
    OrderState.ABORTED: "Aborted",
}
SUBSTATES: dict[OrderState, dict[str, int]] = {
    OrderState.NOT_ALLOWED_TO_START: {"Waiting": 1, "Ready": 2, "Loaded": 3},
    OrderState.ALLOWED_TO_START: {"Waiting": 1, "Ready": 2, "Loaded": 3},
    OrderState.INTERRUPTED: {"Held": 1, "Suspended": 2},
    OrderState.ENDED: {"Completed": 1, "Closed": 2},
}
NOT_BEGUN = frozenset({OrderState.NOT_ALLOWED_TO_START, OrderState.ALLOWED_TO_START})
OVER = frozenset({OrderState.ENDED, OrderState.ABORTED})


def state_of(order: JobOrder | None, report: JobReport | None, *, held: bool) -> tuple[OrderState, str]:
    """Return state and substate (empty: there is none) of an order that became a job, or of either alone.

    ``held``: the queue of the arm is held, so that what may start waits.
    """
    if order is not None and order.ended == "Aborted":
        return OrderState.ABORTED, ""
    if report is None:
        return OrderState.NOT_ALLOWED_TO_START, "Ready"
    match report.state:
        case JobState.QUEUED:
            return OrderState.ALLOWED_TO_START, "Waiting" if held and report.mode != "simulation" else "Loaded"
        case JobState.RUNNING | JobState.STOPPING:
            return OrderState.RUNNING, ""
        case JobState.PAUSED:
            return OrderState.INTERRUPTED, "Held" if report.cause is Cause.UNASKED_PAUSE else "Suspended"
        case JobState.COMPLETED:
            return OrderState.ENDED, "Completed"
        case _:
            stopped = order is not None and order.ended == "Stopped"
            return (OrderState.ENDED, "Completed") if stopped else (OrderState.ABORTED, "")


class Bit(IntEnum):
    """A bit of ReturnStatus: 0 to 32 are the standard's, those above are ours."""

    NO_ERROR = 0
    UNKNOWN_ORDER = 1
    INVALID_STATUS = 3
    UNABLE = 4
    INVALID_REQUEST = 32
    NOT_RELEASED = 33
    LOCKED = 34
    MOTION_NOT_POSSIBLE = 35
    OTHER_CONTENT = 36
    UNKNOWN_WORK_MASTER = 37
    STARTS_LATER = 38
    NO_ROOM = 39
    ARM_NOT_READY = 40


class OrderRefused(Exception):
    """An order is not taken, or what was asked of it is not done: the bits that say why, and a sentence for the log."""

    def __init__(self, reason: str, *bits: Bit) -> None:
        super().__init__(reason)
        self.bits = bits


def return_status(*bits: Bit) -> int:
    """Return the bits as one number."""
    return sum(1 << bit for bit in bits)
