"""What is never changed: refused by the database itself, whichever program asks."""

import sqlalchemy as sql
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

NEVER_CHANGED = {
    "recordings": ("digest",),
    "version_recordings": ("skill_name", "version", "position"),
    "aligned": ("skill_name", "version", "position"),
    "decisions": ("decision_id",),
    "traces": ("job_id",),
    "audit": ("entry_id",),
}
MODEL_COLUMNS = (
    "skill_name",
    "version",
    "semantic_type",
    "model_digest",
    "required_atomic_skills",
    "dimension",
    "frame",
    "clock",
    "duration",
    "time_step",
    "covariance_rule",
    "means",
    "covariances",
    "dispense",
    "parameters",
    "provenance",
    "report",
    "verdicts",
    "created_at",
    "created_by",
)


def upgrade() -> None:
    """Refuse UPDATE and DELETE on what is never changed, and of a version all but its state."""
    for table, key in NEVER_CHANGED.items():
        _refuse(table, "UPDATE", f"a row of {table} is never changed")
        _refuse(table, "DELETE", f"a row of {table} is never deleted")
        _refuse_replacing(table, key)
        _refuse_emptying(table)
    _refuse("versions", f"UPDATE OF {', '.join(MODEL_COLUMNS)}", "a version is never changed, learn a new one")
    _refuse("versions", "DELETE", "a version is never deleted, retire it")
    _refuse_replacing("versions", ("skill_name", "version"))
    _refuse_emptying("versions")


def _refuse(table: str, action: str, reason: str) -> None:
    trigger = f"{table}_no_{action.split()[0].lower()}"
    if op.get_context().dialect.name == "sqlite":
        op.execute(
            sql.DDL(f"CREATE TRIGGER {trigger} BEFORE {action} ON {table} BEGIN SELECT RAISE(ABORT, '{reason}'); END")
        )
        return
    op.execute(
        sql.DDL(
            f"CREATE FUNCTION {trigger}() RETURNS trigger LANGUAGE plpgsql AS "
            f"$$ BEGIN RAISE EXCEPTION '{reason}'; END $$"
        )
    )
    op.execute(sql.DDL(f"CREATE TRIGGER {trigger} BEFORE {action} ON {table} EXECUTE FUNCTION {trigger}()"))


def _refuse_replacing(table: str, key: tuple[str, ...]) -> None:
    """Close SQLite's side door: INSERT OR REPLACE deletes the old row without its trigger being asked."""
    if op.get_context().dialect.name != "sqlite":
        return
    same = " AND ".join(f"{column} = NEW.{column}" for column in key)
    op.execute(
        sql.DDL(
            f"CREATE TRIGGER {table}_no_replace BEFORE INSERT ON {table} "
            f"WHEN EXISTS (SELECT 1 FROM {table} WHERE {same}) "
            f"BEGIN SELECT RAISE(ABORT, 'a row of {table} is never replaced'); END"
        )
    )


def _refuse_emptying(table: str) -> None:
    """Close PostgreSQL's side door: TRUNCATE deletes all rows without their trigger being asked."""
    if op.get_context().dialect.name == "postgresql":
        _refuse(table, "TRUNCATE", f"a row of {table} is never deleted")
