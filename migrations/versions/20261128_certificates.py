"""what a certificate names: the machine's serial number, the instrument, the operator

Revision ID: 2f8d61b4c7e0
Revises: c19e6a07f4d2
Create Date: 2026-11-28 09:58:20.304117
"""

import sqlalchemy as sa
from alembic import op

revision = "2f8d61b4c7e0"
down_revision = "c19e6a07f4d2"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("machine", sa.Column("serial_number", sa.Text(), nullable=True))
    op.add_column("verification", sa.Column("instrument", sa.Text(), nullable=True))
    op.add_column("verification", sa.Column("operator", sa.Text(), nullable=True))


def downgrade() -> None:
    op.drop_column("verification", "operator")
    op.drop_column("verification", "instrument")
    op.drop_column("machine", "serial_number")
