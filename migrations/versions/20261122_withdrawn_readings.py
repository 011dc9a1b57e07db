"""readings that were withdrawn

Revision ID: 8e51b7c3d0f4
Revises: c2e9a4d07b15
Create Date: 2026-11-22 04:50:12.604418
"""

import sqlalchemy as sa
from alembic import op

revision = "8e51b7c3d0f4"
down_revision = "c2e9a4d07b15"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column(
        "machine", sa.Column("withdrawals", sa.Integer(), server_default="0", nullable=False)
    )
    op.create_table(
        "withdrawn_reading",
        sa.Column(
            "id",
            sa.BigInteger().with_variant(sa.Integer(), "sqlite"),
            autoincrement=False,
            nullable=False,
        ),
        sa.Column("machine_id", sa.String(length=64), nullable=False),
        sa.Column("time", sa.DateTime(timezone=True), nullable=False),
        sa.Column("temperatures_c", sa.JSON(), nullable=False),
        sa.Column("state", sa.JSON(), nullable=False),
        sa.Column("withdrawn_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["machine_id"],
            ["machine.id"],
            name=op.f("fk_withdrawn_reading_machine"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_withdrawn_reading")),
    )


def downgrade() -> None:
    op.drop_table("withdrawn_reading")
    op.drop_column("machine", "withdrawals")
