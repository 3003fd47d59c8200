"""What is remembered of a workstation: whether its queue is held, and its speed override."""

import sqlalchemy as sql
from alembic import op

from library.tables import Moment, Real, name

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the table; a workstation without a row is released and at full speed."""
    op.create_table(
        "stations",
        sql.Column("workstation", name(), primary_key=True),
        sql.Column("held_because", sql.String(32), nullable=False),
        sql.Column("held_by", sql.Text, nullable=False),
        sql.Column("held_since", Moment, nullable=False),
        sql.Column("speed_override", Real, nullable=False),
    )
