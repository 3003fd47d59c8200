"""What keeps a PostgreSQL server from being used, in one sentence with what to do; by SQLSTATE, not by wording."""

from sqlalchemy.exc import DBAPIError

from library.errors import LibraryUnusable, Trouble

PREPARE = "have the owner of its tables run: opcua-skill library prepare"
_REMEDIES: dict[str, tuple[Trouble, str]] = {
    "28": (Trouble.FORBIDDEN, "correct user and password in the address of the database"),
    "3D": (Trouble.FORBIDDEN, "correct its name in the address of the database, or have it made: createdb"),
    "42501": (Trouble.FORBIDDEN, PREPARE),
    "25006": (Trouble.FORBIDDEN, "it can only be read, as a standby can: name the primary in the address"),
    "53100": (Trouble.FULL, "free space on the disk of the database server, then try again"),
    "53300": (Trouble.UNREACHABLE, "allow more connections on the database server (max_connections)"),
    "55P03": (Trouble.LOCKED, "another program holds it for long: close that program, then try again"),
    "40": (Trouble.LOCKED, "another program changes the same: try again"),
    "08": (Trouble.UNREACHABLE, "start the database server, or correct its address; the server goes on trying"),
    "57P": (Trouble.UNREACHABLE, "wait until the database server has started; the server goes on trying"),
    "XX": (Trouble.DAMAGED, "look into the log of the database server, and restore it from a backup"),
}
_UNREACHABLE = _REMEDIES["08"]
_OTHER = (Trouble.OTHER, "see the log for the statement")


def state_of(error: BaseException) -> str:
    """Return the SQLSTATE of an error of the driver; "" where the server said nothing."""
    found = getattr(error.orig if isinstance(error, DBAPIError) else error, "sqlstate", None)
    return str(found or "")


def lost(error: BaseException) -> bool:
    """Return whether the connection is gone, so that another one may do better."""
    if isinstance(error, DBAPIError):
        return error.connection_invalidated or state_of(error).startswith(("08", "57P0"))
    return isinstance(error, ConnectionError)


def unusable(where: str, error: BaseException) -> LibraryUnusable:
    """Return what a caller is told."""
    state = state_of(error)
    if state:
        trouble, remedy = next((found for key, found in _REMEDIES.items() if state.startswith(key)), _OTHER)
    else:
        reachable = isinstance(error, DBAPIError) and not error.connection_invalidated
        trouble, remedy = _OTHER if reachable else _UNREACHABLE
    reason = str(error.orig or error) if isinstance(error, DBAPIError) else str(error)
    # The driver puts the name of its class before what the server said, which is no word for people.
    said = reason.rpartition(">: ")[2].splitlines() or ["it did not answer in time"]
    return LibraryUnusable(where, said[0], remedy, trouble)
