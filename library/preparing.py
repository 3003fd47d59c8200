"""A database made ready by the role that owns it, for another role to serve."""

from library.database import Database, address
from library.errors import LibraryUnusable
from library.postgresql.roles import grant


async def prepare(url: str, role: str) -> None:
    """Make the tables behind ``url``, or bring them up to date, and give ``role`` what a server needs and no more.

    Raises LibraryUnusable; nothing is given then.
    """
    named = address(url)
    where = named.render_as_string()
    if named.get_backend_name() != "postgresql":
        raise LibraryUnusable(where, "it has no roles", "a file needs no preparing: a server makes it when it starts")
    database = await Database.open(url)
    try:
        await database.write(lambda connection: grant(connection, role))
    finally:
        await database.close()
