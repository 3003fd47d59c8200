"""Which server has which workstation, and which server a job is of: where several share a library."""

import sqlalchemy as sql
from alembic import op

from library.tables import Moment, name

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the table; the jobs that are there are of a server that had the library alone."""
    op.create_table(
        "leases",
        sql.Column("workstation", name(), primary_key=True),
        sql.Column("server", sql.Text, nullable=False),
        sql.Column("endpoint", sql.Text, nullable=False),
        sql.Column("until", Moment, nullable=False),
    )
    op.add_column("jobs", sql.Column("server", sql.Text, nullable=False, server_default=""))
