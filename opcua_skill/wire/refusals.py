"""From what went wrong to the exact status code: one table, used by every method."""

from collections.abc import Awaitable, Callable
from functools import wraps
from typing import Any

from asyncua.ua.status_codes import StatusCodes

from library.errors import (
    AlreadyExists,
    DigestDiffers,
    InUse,
    InvalidValue,
    LibraryUnusable,
    NotAllowedInState,
    NotFound,
    OwnVersion,
    ServedElsewhere,
    Trouble,
)
from library.turns import waiting_at_most
from models.errors import LearningError
from opcua_skill.jobs import ArmNotReady, LacksAtomicSkill, LearningFailed, MotionNotPossible, NotExecutable, QueueFull
from opcua_skill.security.arm_lock import LockedByAnother
from opcua_skill.stack.services.calls import Refused
from sim.arm import CommandRefused

Code = StatusCodes

CODES: dict[type[Exception], int] = {
    NotFound: Code.BadNotFound,
    NotAllowedInState: Code.BadInvalidState,
    DigestDiffers: Code.BadInvalidState,
    InUse: Code.BadInvalidState,
    AlreadyExists: Code.BadInvalidState,
    ServedElsewhere: Code.BadInvalidState,
    OwnVersion: Code.BadUserAccessDenied,
    NotExecutable: Code.BadNotExecutable,
    ArmNotReady: Code.BadInvalidState,
    LacksAtomicSkill: Code.BadNotSupported,
    QueueFull: Code.BadResourceUnavailable,
    LockedByAnother: Code.BadLocked,
    MotionNotPossible: Code.BadOutOfRange,
    CommandRefused: Code.BadInvalidState,
}
UNUSABLE: dict[Trouble, tuple[int, str]] = {
    Trouble.LOCKED: (
        Code.BadTimeout,
        "another program holds the library's database locked: nothing was stored, try again when it has let go",
    ),
    Trouble.UNREACHABLE: (
        Code.BadResourceUnavailable,
        "the library's database server cannot be reached: nothing was stored, try again when it is there again",
    ),
    Trouble.OUTCOME_UNKNOWN: (
        Code.BadCommunicationError,
        "the library's database server went away while it was stored, maybe it is: look before trying again",
    ),
    Trouble.FULL: (
        Code.BadResourceUnavailable,
        "the library's disk is full: nothing was stored, free space on it and try again",
    ),
}
LIBRARY_SECONDS = 3.0
NAMED = {
    "skill": "SkillName",
    "version": "Version",
    "recipe": "RecipeId",
    "job": "JobId",
    "trace": "JobId",
    "workstation": "Workstation",
    "demonstration": "DemonstrationId",
    "recording": "RecordingId",
}
BLAMED = {"demonstrations": "Demonstrations", "options": "Options", "edits": "Indices", "model": "Content"}


def _at_fault(error: Exception, within: str) -> dict[str, int]:
    """Return which argument an error points at, with its code."""
    if isinstance(error, NotFound):
        return {within or NAMED.get(error.kind, ""): int(StatusCodes.BadNotFound)}
    if isinstance(error, DigestDiffers):
        return {"ModelDigest": int(StatusCodes.BadOutOfRange)}
    if isinstance(error, MotionNotPossible):
        return {"RecipeId": int(StatusCodes.BadOutOfRange)}
    return {}


def out_of_range(argument: str, reason: str) -> Refused:
    """Return the refusal of one argument's value."""
    return Refused(Code.BadInvalidArgument, reason, arguments={argument: Code.BadOutOfRange})


def refusing(
    *, blame: str = "", fields: dict[str, str] | None = None, within: str = ""
) -> Callable[[Callable[..., Awaitable[Any]]], Callable[..., Awaitable[Any]]]:
    """Translate what a method's work raises.

    ``blame`` is the argument at fault for a bad value, ``fields`` maps more of them; ``within`` is the structure that
    holds everything a method is given.
    """

    def decorate(method: Callable[..., Awaitable[Any]]) -> Callable[..., Awaitable[Any]]:
        @wraps(method)
        async def translated(*arguments: Any) -> Any:
            try:
                with waiting_at_most(LIBRARY_SECONDS):
                    return await method(*arguments)
            except LibraryUnusable as error:
                if error.trouble not in UNUSABLE:
                    raise
                code, reason = UNUSABLE[error.trouble]
                raise Refused(code, reason) from error
            except tuple(CODES) as error:
                raise Refused(CODES[type(error)], str(error), arguments=_at_fault(error, within)) from error
            except InvalidValue as error:
                raise out_of_range((fields or {}).get(error.field, blame), str(error)) from error
            except LearningFailed as error:
                raise out_of_range(BLAMED.get(error.argument, blame), str(error)) from error
            except LearningError as error:
                raise out_of_range(BLAMED.get(error.argument, blame), str(error)) from error

        return translated

    return decorate
