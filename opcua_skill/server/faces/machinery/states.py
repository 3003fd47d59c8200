"""The state and the operation mode of OPC 40001-1 that follow from an arm, its queue and its job."""

from library.description import JobReport
from sim.arm import ArmMode, ArmState

MOVING = frozenset({ArmMode.RUNNING, ArmMode.STOPPING})


def item_state(arm: ArmState) -> str:
    """Return the state of MachineryItemState_StateMachineType."""
    if not arm.known or arm.mode is ArmMode.CLOSED:
        return "NotAvailable"
    if arm.protective_stop or arm.mode in {ArmMode.FAULT, ArmMode.PROTECTIVE_STOP}:
        return "OutOfService"
    return "Executing" if arm.mode in MOVING else "NotExecuting"


def operation_mode(arm: ArmState, running: JobReport | None, *, held: bool) -> str:
    """Return the state of MachineryOperationModeStateMachineType.

    A held queue waits for people to see to the cell, and a run in test mode is theirs too: both are Setup. Maintenance
    is for people to say, not for the server to guess.
    """
    if item_state(arm) in {"NotAvailable", "OutOfService"}:
        return "None"
    if running is not None:
        return "Setup" if running.mode == "test" else "Processing"
    return "Setup" if held else "Processing"
