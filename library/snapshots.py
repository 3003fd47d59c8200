"""A copy of a SQLite library as it is at one moment, made beside those who write; and whether such a copy is whole."""

import contextlib
import sqlite3
import time
from pathlib import Path

from library.errors import LibraryUnusable, Trouble
from library.migrations import check_ours, known_revisions

PATIENCE = 30.0
"""s for which a copy waits for a program that holds the library for itself."""
RESTORE = "restore it from another backup"


def copy_library(source: Path, target: Path) -> None:
    """Write what ``source`` holds now into the new file ``target``; raises LibraryUnusable or OSError.

    Nobody who reads or writes the library waits for it.
    """
    until = time.monotonic() + PATIENCE

    def progress(status: int, _left: int, _pages: int) -> None:
        if status in {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED} and time.monotonic() > until:
            remedy = "another program holds it for long: close that program, then try again"
            raise LibraryUnusable(str(source), "database is locked", remedy, Trouble.LOCKED)

    try:
        # Not read-only: where nobody else has the library open, SQLite's side files go when we close it.
        with contextlib.closing(sqlite3.connect(f"{source.as_uri()}?mode=rw", uri=True, timeout=PATIENCE)) as ours:
            check_ours(_tables(ours), str(source))
            with contextlib.closing(sqlite3.connect(target)) as theirs:
                ours.backup(theirs, progress=progress)
    except sqlite3.Error as error:
        remedy = "free space where the copy goes, or restore the library from a backup if it is damaged"
        raise LibraryUnusable(str(source), str(error), remedy) from error


def check_copy(file: Path) -> str:
    """Return the revision of the tables of a library that nobody has open; raises LibraryUnusable unless it is whole.

    Not a byte is changed, and nothing is written beside it.
    """
    where = str(file)
    try:
        with contextlib.closing(
            sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
        ) as connection:
            check_ours(_tables(connection), where)
            ((found,),) = connection.execute("PRAGMA integrity_check(1)").fetchall()
            if found != "ok":
                raise LibraryUnusable(where, f"it is damaged ({found})", RESTORE, Trouble.DAMAGED)
            if connection.execute("PRAGMA foreign_key_check").fetchone():
                reason = "rows refer to others that are missing"
                raise LibraryUnusable(where, reason, RESTORE, Trouble.DAMAGED)
            revisions = [revision for (revision,) in connection.execute("SELECT version_num FROM alembic_version")]
    except sqlite3.Error as error:
        raise LibraryUnusable(where, str(error), RESTORE, Trouble.DAMAGED) from error
    if len(revisions) != 1 or revisions[0] not in known_revisions():
        named = ", ".join(map(str, revisions)) or "none"
        reason = f"a newer version of this program wrote it (revision {named})"
        raise LibraryUnusable(where, reason, "install that version or a later one")
    return revisions[0]


def _tables(connection: sqlite3.Connection) -> set[str]:
    return {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")} or {"none"}
