"""numbers of events, by which streams go on after a break

Revision ID: c83f5e0a7d19
Revises: b7e40d19c25a
Create Date: 2026-11-23 13:40:12.118040
"""

import sqlalchemy as sa
from alembic import op

revision = "c83f5e0a7d19"
down_revision = "b7e40d19c25a"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("event", sa.Column("number", sa.BigInteger(), nullable=True))
    op.execute("UPDATE event SET number = id")
    op.create_index("ix_event_number", "event", ["number"], unique=True)


def downgrade() -> None:
    op.drop_index("ix_event_number", "event")
    op.drop_column("event", "number")
