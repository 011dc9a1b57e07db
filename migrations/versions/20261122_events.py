"""the event log

Revision ID: 9c41e7d25ab8
Revises: 5d1f0c7e9b32
Create Date: 2026-11-22 23:16:21.402871
"""

import sqlalchemy as sa
from alembic import op

revision = "9c41e7d25ab8"
down_revision = "5d1f0c7e9b32"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "event",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("time", sa.DateTime(timezone=True), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("subject", sa.String(length=64), nullable=False),
        sa.Column("machine_id", sa.String(length=64), nullable=True),
        sa.Column("who", sa.String(length=128), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("details", sa.JSON(), nullable=False),
        sa.Column("until", sa.DateTime(timezone=True), nullable=True),
        sa.Column("count", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_event")),
    )
    op.create_index(op.f("ix_event_machine_id"), "event", ["machine_id", "id"])
    op.create_index(op.f("ix_event_time"), "event", ["time"])


def downgrade() -> None:
    op.drop_table("event")
