"""what analyses confirmed, beside their results

Revision ID: 5e1d7b30f9a4
Revises: 1e94b7c05ad8
Create Date: 2026-11-27 22:40:17.204611
"""

import json

import sqlalchemy as sa
from alembic import op

revision = "5e1d7b30f9a4"
down_revision = "1e94b7c05ad8"
branch_labels = None
depends_on = None

ANALYSES = sa.table(
    "analysis",
    sa.column("id", sa.Integer),
    sa.column("result", sa.Text),
    sa.column("confirmed", sa.JSON(none_as_null=True)),
)


def upgrade() -> None:
    op.add_column("analysis", sa.Column("confirmed", sa.JSON(none_as_null=True), nullable=True))
    connection = op.get_bind()
    done = sa.select(ANALYSES.c.id).where(ANALYSES.c.result.is_not(None))
    for number in connection.scalars(done).all():
        own = ANALYSES.c.id == number
        result = json.loads(connection.scalar(sa.select(ANALYSES.c.result).where(own)))
        confirmed = [
            effect["explanation"]
            for effect in result.get("effects", [])
            if effect.get("status") == "confirmed" and effect.get("helps", True)
        ]
        connection.execute(sa.update(ANALYSES).where(own).values(confirmed=confirmed))


def downgrade() -> None:
    op.drop_column("analysis", "confirmed")
