"""The steps from an empty database, or an older one, to the tables of today; run in-process at opening."""

from pathlib import Path

import sqlalchemy as sql

from library.errors import LibraryUnusable
from library.postgresql.roles import may_migrate, refuse_migrating
from library.tables import VERSION_TABLE, metadata


def migrate(connection: sql.Connection, where: str, to: str = "head", *, must_exist: bool = False) -> None:
    """Bring the database up to revision ``to`` in the transaction that is open on ``connection``.

    Alembic is imported only where there is something to do: it takes longer than opening the library.
    """
    known = known_revisions()
    tables = set(sql.inspect(connection).get_table_names())
    check_ours(tables, where)
    if must_exist and not tables:
        raise LibraryUnusable(where, "it has no tables yet", "check its name, or start a server on it first")
    asked = sql.text(f"SELECT version_num FROM {VERSION_TABLE}")
    found = [str(revision) for revision in connection.scalars(asked)] if tables else []
    if unknown := [revision for revision in found if revision not in known]:
        raise LibraryUnusable(
            where,
            f"a newer version of this program wrote it (revision {unknown[0]})",
            "install that version or a later one",
        )
    if to != "head" or found != [max(known)]:
        if connection.dialect.name == "postgresql" and not may_migrate(connection, tables):
            raise refuse_migrating(where, "".join(found))
        _upgrade(connection, to)
    if to == "head":
        _check_tables(connection, where)


def known_revisions() -> set[str]:
    """Return the names of all revisions that this version of the program knows: their files begin with them."""
    return {file.name.partition("_")[0] for file in (Path(__file__).parent / "versions").glob("[0-9]*_*.py")}


def _upgrade(connection: sql.Connection, to: str) -> None:
    from alembic import command
    from alembic.config import Config

    config = Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(Path(__file__).parent).replace("%", "%%"))
    command.upgrade(config, to)


def check_ours(tables: set[str], where: str) -> None:
    """Raise LibraryUnusable if there are tables and they are another program's."""
    if tables and not (VERSION_TABLE in tables and tables & {"skills", "versions"}):
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
