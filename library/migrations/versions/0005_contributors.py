"""Four eyes over a version's whole ancestry: who contributed to it, and how many have to approve it."""

import json

import sqlalchemy as sql
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

REASON = "a version is never changed, learn a new one"


def upgrade() -> None:
    """Add the columns, fill them along what each version is based on, and have the database guard them."""
    op.add_column("versions", sql.Column("contributors", sql.Text, nullable=False, server_default="[]"))
    op.add_column("versions", sql.Column("approvals_needed", sql.Integer, nullable=False, server_default="1"))
    _fill()
    if op.get_context().dialect.name == "sqlite":
        when = "BEFORE UPDATE OF contributors, approvals_needed ON versions"
        op.execute(
            sql.DDL(f"CREATE TRIGGER versions_no_update_of_people {when} BEGIN SELECT RAISE(ABORT, '{REASON}'); END")
        )
        return
    op.execute(
        sql.DDL(
            "CREATE TRIGGER versions_no_update_of_people BEFORE UPDATE OF contributors, approvals_needed ON versions"
            " EXECUTE FUNCTION versions_no_update()"
        )
    )


def _fill() -> None:
    connection = op.get_bind()
    names = ("skill_name", "created_by", "provenance", "contributors")
    texts = (sql.column(name, sql.String) for name in names)
    versions = sql.table("versions", *texts, sql.column("version", sql.Integer))
    known: dict[tuple[str, int], list[str]] = {}
    rows = sql.select(versions).order_by(versions.c.skill_name, versions.c.version)
    for row in connection.execute(rows).all():
        told = json.loads(row.provenance)
        before = known.get((row.skill_name, told.get("based_on") or 0), [])
        people = sorted({*before, row.created_by, told.get("taught_by", ""), told.get("imported_by", "")} - {""})
        known[row.skill_name, row.version] = people
        same = (versions.c.skill_name == row.skill_name) & (versions.c.version == row.version)
        connection.execute(versions.update().where(same).values(contributors=json.dumps(people)))
