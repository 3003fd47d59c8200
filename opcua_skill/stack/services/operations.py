"""One operation of a request: what goes wrong in it costs its own result, never those of the others."""

import logging
import secrets
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from asyncua.common.utils import ServiceError
from asyncua.ua.status_codes import StatusCodes as Codes
from asyncua.ua.uaerrors import UaStatusCodeError

from opcua_skill.stack.address_space.values import status

log = logging.getLogger(__name__)
Result = TypeVar("Result")


def refused(kind: Callable[..., Result], code: int) -> Result:
    """Return the result of an operation that was not carried out."""
    return kind(StatusCode=status(code))


def fault_code(error: Exception, what: str) -> int:
    """Return the code an operation's exception is answered with; one that nobody foresaw is found in the log."""
    if isinstance(error, ServiceError | UaStatusCodeError):
        return int(error.code)
    log.error("fault %s in one operation of a %s", secrets.token_hex(4), what, exc_info=error)
    return Codes.BadInternalError


async def attempted(
    operation: Callable[[], Awaitable[Result]], otherwise: Callable[[int], Result], what: str
) -> Result:
    """Return what an operation comes to, or what its exception's code makes of it."""
    try:
        return await operation()
    except Exception as error:
        return otherwise(fault_code(error, what))


def attempted_at_once(operation: Callable[[], Any], otherwise: Callable[[int], Any], what: str) -> Any:
    """Return what an operation that need not wait comes to, or what its exception's code makes of it."""
    try:
        return operation()
    except Exception as error:
        return otherwise(fault_code(error, what))
