"""what processes tell of their connections

Revision ID: b7e40d19c25a
Revises: 6d2b9f40c1e7
Create Date: 2026-11-23 13:46:12.402917
"""

import sqlalchemy as sa
from alembic import op

revision = "b7e40d19c25a"
down_revision = "6d2b9f40c1e7"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "connection_report",
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("told_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("content", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("owner", name=op.f("pk_connection_report")),
    )


def downgrade() -> None:
    op.drop_table("connection_report")
