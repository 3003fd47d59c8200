"""Plain ints and strings as OPC UA values: asyncua takes them, but its type hints ask for its own classes."""

from typing import Any, cast

from asyncua import ua

SERVER = cast(Any, ua.NodeId)(2253)


def node_id(identifier: int | str | bytes, namespace: int = 0) -> ua.NodeId:
    """Return a NodeId whose kind follows from the identifier: a number, a string, or an opaque one."""
    return cast(Any, ua.NodeId)(identifier, namespace)


def status(code: int = 0) -> ua.StatusCode:
    """Return a StatusCode."""
    return cast(Any, ua.StatusCode)(int(code))


def status_name(code: int) -> str:
    """Return a status code in words, such as BadUserAccessDenied."""
    return status(code).name
