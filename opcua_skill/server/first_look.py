"""What a server looks at before it serves: is what it served last still there, and can everybody's role be read."""

import logging
from collections.abc import Sequence
from pathlib import Path

from library.names import doubles
from library.private_files import loose
from opcua_skill.configuration.data_lock import LOCK_FILE, Holder, database_file
from opcua_skill.configuration.settings import Settings
from opcua_skill.security import StoredUser
from opcua_skill.security.access import Role

log = logging.getLogger(__name__)


class DataUnusable(Exception):
    """What is in a data folder cannot be served as it is: one sentence, with what to do. Nothing was changed."""


def check_library_is_there(settings: Settings, last: Holder | None) -> None:
    """Raise DataUnusable if the library that was served here last is gone: an empty one would be put in its place."""
    file = database_file(settings)
    if last is None or file is None or last.database != str(file) or file.exists():
        return
    raise DataUnusable(
        f"the library {file} is missing, though it was served last on"
        f" {last.since.astimezone():%Y-%m-%d %H:%M:%S}: restore it from a backup, or delete"
        f" {settings.data / LOCK_FILE} to begin with an empty library"
    )


def check_users(users: Sequence[StoredUser]) -> None:
    """Raise DataUnusable for a user whose role is none of ours: another program has been at the table."""
    for user in users:
        if user.role not in tuple(Role):
            known = ", ".join(Role)
            raise DataUnusable(
                f"the user {user.name!r} has the role {user.role!r}, which is none of {known}: opcua-skill users role"
                f" {user.name} ROLE, or restore the library from a backup"
            )


def tell_doubles(users: Sequence[StoredUser]) -> None:
    """Say in the log which users differ in case or form of their names alone: made before names were compared so."""
    for group in doubles(user.name for user in users):
        names = ", ".join(repr(name) for name in group)
        log.warning("users %s differ in case or accents' form alone: each signs in as written, remove one", names)


def tell_loose(settings: Settings, *more: Path) -> None:
    """Say in the log which files and folders others than the server's user may look into."""
    for one in loose(settings.data, *more):
        log.warning("%s: chmod go-rwx it, unless that is meant", one)
