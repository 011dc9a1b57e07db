"""several set-ups in a verification

Revision ID: f30d6b81a7c2
Revises: e47a90b2c6d1
Create Date: 2026-11-22 12:38:07.114820
"""

import sqlalchemy as sa
from alembic import op

revision = "f30d6b81a7c2"
down_revision = "e47a90b2c6d1"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column(
        "verification", sa.Column("setup_names", sa.JSON(), server_default="[]", nullable=False)
    )
    op.add_column("verification", sa.Column("setup", sa.LargeBinary(), nullable=True))


def downgrade() -> None:
    op.drop_column("verification", "setup")
    op.drop_column("verification", "setup_names")
