"""The steps from an empty database, or an older one, to the tables of today; run in-process at opening."""

from pathlib import Path

import sqlalchemy as sql
from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

from library.errors import LibraryUnusable


def migrate(connection: sql.Connection, where: str, to: str = "head") -> None:
    """Bring the database up to revision ``to`` in the transaction that is open on ``connection``."""
    config = Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(Path(__file__).parent).replace("%", "%%"))
    known = {script.revision for script in ScriptDirectory.from_config(config).walk_revisions()}
    found = MigrationContext.configure(connection).get_current_revision()
    if found is None and sql.inspect(connection).get_table_names():
        raise LibraryUnusable(where, "it is the database of another program", "name a file of its own")
    if found is not None and found not in known:
        raise LibraryUnusable(
            where, f"a newer version of this program wrote it (revision {found})", "install that version or a later one"
        )
    command.upgrade(config, to)
