"""keys and the browsers in which they were stated

Revision ID: 5d1f0c7e9b32
Revises: f30d6b81a7c2
Create Date: 2026-11-22 23:05:40.118273
"""

import sqlalchemy as sa
from alembic import op

revision = "5d1f0c7e9b32"
down_revision = "f30d6b81a7c2"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "access_key",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("name", sa.String(length=64), nullable=False),
        sa.Column("role", sa.String(length=16), nullable=False),
        sa.Column("machines", sa.JSON(), nullable=True),
        sa.Column("digest", sa.String(length=64), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("last_used_at", sa.DateTime(timezone=True), nullable=True),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_access_key")),
        sa.UniqueConstraint("digest", name=op.f("uq_access_key_digest")),
        sa.UniqueConstraint("name", name=op.f("uq_access_key_name")),
    )
    op.create_table(
        "browser_session",
        sa.Column("digest", sa.String(length=64), nullable=False),
        sa.Column("key_id", sa.Integer(), nullable=False),
        sa.Column("expires_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["key_id"],
            ["access_key.id"],
            name=op.f("fk_browser_session_access_key"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("digest", name=op.f("pk_browser_session")),
    )
    op.create_index(op.f("ix_browser_session_key_id"), "browser_session", ["key_id"])


def downgrade() -> None:
    op.drop_table("browser_session")
    op.drop_table("access_key")
