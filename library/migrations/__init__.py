"""The steps from an empty database, or an older one, to the tables of today; run in-process at opening."""

from pathlib import Path

import sqlalchemy as sql
from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

from library.errors import LibraryUnusable
from library.tables import metadata


def migrate(connection: sql.Connection, where: str, to: str = "head") -> None:
    """Bring the database up to revision ``to`` in the transaction that is open on ``connection``."""
    config = _config(connection)
    known = known_revisions()
    found = MigrationContext.configure(connection).get_current_revision()
    check_ours(set(sql.inspect(connection).get_table_names()), where)
    if found is not None and found not in known:
        raise LibraryUnusable(
            where, f"a newer version of this program wrote it (revision {found})", "install that version or a later one"
        )
    command.upgrade(config, to)
    if to == "head":
        _check_tables(connection, where)


def known_revisions() -> set[str]:
    """Return the names of all revisions that this version of the program knows."""
    return {script.revision for script in ScriptDirectory.from_config(_config(None)).walk_revisions()}


def _config(connection: sql.Connection | None) -> Config:
    config = Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(Path(__file__).parent).replace("%", "%%"))
    return config


def check_ours(tables: set[str], where: str) -> None:
    """Raise LibraryUnusable if there are tables and they are another program's."""
    if tables and not ("alembic_version" in tables and tables & {"skills", "versions"}):
        raise LibraryUnusable(where, "it is the database of another program", "name a file of its own")


def _check_tables(connection: sql.Connection, where: str) -> None:
    """Raise LibraryUnusable unless every table is there with all its columns: another program may have been at it."""
    there = sql.inspect(connection)
    tables = set(there.get_table_names())
    for name, table in metadata.tables.items():
        if name not in tables:
            raise LibraryUnusable(where, f"its table {name} is missing", "restore it from a backup")
        columns = {column["name"] for column in there.get_columns(name)}
        if missing := [column.name for column in table.columns if column.name not in columns]:
            reason = f"its table {name} lacks {', '.join(missing)}"
            raise LibraryUnusable(where, reason, "restore it from a backup")
