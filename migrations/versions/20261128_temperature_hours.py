"""hours of readings, in bins of a minute

Revision ID: c19e6a07f4d2
Revises: 7a30c5e19b84
Create Date: 2026-11-28 06:02:41.556120
"""

import sqlalchemy as sa
from alembic import op

revision = "c19e6a07f4d2"
down_revision = "7a30c5e19b84"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "temperature_hour",
        sa.Column("machine_id", sa.String(length=64), nullable=False),
        sa.Column("hour", sa.DateTime(timezone=True), nullable=False),
        sa.Column("is_stale", sa.Boolean(), nullable=False),
        sa.Column("minutes", sa.JSON(), nullable=False),
        sa.Column("whole", sa.LargeBinary(), nullable=False),
        sa.Column("bins", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["machine_id"],
            ["machine.id"],
            name=op.f("fk_temperature_hour_machine"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("machine_id", "hour", name=op.f("pk_temperature_hour")),
    )
    op.create_table(
        "temperature_hours_done",
        sa.Column("id", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("number", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_temperature_hours_done")),
    )


def downgrade() -> None:
    op.drop_table("temperature_hours_done")
    op.drop_table("temperature_hour")
