"""Job orders of a manufacturing system: what was ordered, byte for byte, and which job it became."""

import sqlalchemy as sql
from alembic import op

from library.tables import Moment, Serial, name

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the table; until now nobody could order anything."""
    op.create_table(
        "job_orders",
        sql.Column("number", Serial, primary_key=True),
        sql.Column("workstation", name(), nullable=False),
        sql.Column("order_id", name(), nullable=False),
        sql.Column("content", sql.LargeBinary, nullable=False),
        sql.Column("job_id", name(), nullable=False),
        sql.Column("ended", sql.String(16), nullable=False),
        sql.Column("actor", sql.Text, nullable=False),
        sql.Column("received_at", Moment, nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_index("uq_job_orders_workstation_order_id", "job_orders", ["workstation", "order_id"], unique=True)
    op.create_index("ix_job_orders_by_job", "job_orders", ["job_id"])
