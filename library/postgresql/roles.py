"""Two roles: one owns the tables, another works with them and can neither drop nor disarm what guards them."""

import sqlalchemy as sql

from library.errors import LibraryUnusable
from library.postgresql.faults import PREPARE
from library.tables import VERSION_TABLE, metadata

ONLY_ADDED = ("recordings", "version_recordings", "aligned", "decisions", "traces", "audit")
"""Tables whose rows the working role may add and read, no more; of a version it may change the state alone."""


def may_migrate(connection: sql.Connection, tables: set[str]) -> bool:
    """Return whether the role that asks may make the tables, or change those that are there."""
    if not tables:
        return bool(connection.scalar(sql.text("SELECT has_schema_privilege(current_schema(), 'CREATE')")))
    return bool(connection.scalar(_OWNS))


_OWNS = sql.text(
    "SELECT bool_or(pg_has_role(current_user, relowner, 'USAGE')) FROM pg_class"
    " WHERE relnamespace = current_schema()::regnamespace AND relname = ANY(:tables)"
).bindparams(sql.bindparam("tables", sorted(metadata.tables), sql.ARRAY(sql.Text)))


def weakness(connection: sql.Connection) -> str:
    """Return what weakens the guards under the role that asks, in words; "" where they hold."""
    if connection.dialect.name != "postgresql" or not connection.scalar(_OWNS):
        return ""
    role = connection.scalar(sql.text("SELECT current_user::text"))
    return f"the database role {role} owns the library's tables and can drop what guards them"


def grant(connection: sql.Connection, role: str) -> None:
    """Give ``role`` what a server needs and no more, whatever it had; raises LibraryUnusable for one that cannot be."""
    database = str(connection.scalar(sql.text("SELECT current_database()::text")))
    if connection.scalar(sql.text("SELECT rolname FROM pg_roles WHERE rolname = :role"), {"role": role}) is None:
        remedy = f"make it first: CREATE ROLE {role} LOGIN PASSWORD '…'"
        raise LibraryUnusable(database, f"there is no role {role}", remedy)
    if connection.scalar(_TOO_MIGHTY, {"role": role}):
        remedy = "name one that is no superuser and no member of the owner"
        raise LibraryUnusable(database, f"the role {role} can drop what guards the tables", remedy)
    quote = connection.dialect.identifier_preparer.quote
    schema = quote(str(connection.scalar(sql.text("SELECT current_schema()::text"))))
    to, here = quote(role), quote(database)
    for statement in (
        f"GRANT CONNECT ON DATABASE {here} TO {to}",
        f"REVOKE CREATE ON SCHEMA {schema} FROM PUBLIC, {to}",
        f"GRANT USAGE ON SCHEMA {schema} TO {to}",
        *(f"GRANT USAGE, UPDATE ON SEQUENCE {schema}.{quote(name)} TO {to}" for name in connection.scalars(_SEQUENCES)),
        *(one for table in (*metadata.tables, VERSION_TABLE) for one in _rights(f"{schema}.{quote(table)}", table, to)),
    ):
        connection.exec_driver_sql(statement)


_TOO_MIGHTY = sql.text(
    "SELECT rolsuper OR pg_has_role(rolname, current_user, 'MEMBER') FROM pg_roles WHERE rolname = :role"
)


_SEQUENCES = sql.text(
    "SELECT sequence.relname FROM pg_class AS sequence JOIN pg_depend ON objid = sequence.oid AND deptype IN ('a', 'i')"
    " JOIN pg_class AS used ON used.oid = refobjid WHERE sequence.relkind = 'S'"
    " AND used.relnamespace = current_schema()::regnamespace AND used.relname = ANY(:tables)"
).bindparams(sql.bindparam("tables", sorted(metadata.tables), sql.ARRAY(sql.Text)))


def _rights(where: str, table: str, to: str) -> tuple[str, ...]:
    """Return what gives a role its rights on a table, after what it had has been taken."""
    rights = {VERSION_TABLE: "SELECT", "versions": "SELECT, INSERT, UPDATE (state)"}
    rights |= dict.fromkeys(ONLY_ADDED, "SELECT, INSERT")
    given = rights.get(table, "SELECT, INSERT, UPDATE, DELETE")
    return f"REVOKE ALL ON {where} FROM PUBLIC, {to}", f"GRANT {given} ON {where} TO {to}"


def refuse_migrating(where: str, revision: str) -> LibraryUnusable:
    """Return what a role is told that may not bring the tables up to date."""
    reason = f"its tables are those of an older version (revision {revision})" if revision else "it has no tables yet"
    return LibraryUnusable(where, reason, PREPARE)
