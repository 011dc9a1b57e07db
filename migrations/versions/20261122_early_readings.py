"""how long before its time a reading arrived

Revision ID: e47a90b2c6d1
Revises: 7b1d94c0e3a5
Create Date: 2026-11-22 08:45:21.330954
"""

import sqlalchemy as sa
from alembic import op

revision = "e47a90b2c6d1"
down_revision = "7b1d94c0e3a5"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("reading", sa.Column("early_s", sa.Double(), nullable=True))


def downgrade() -> None:
    op.drop_column("reading", "early_s")
