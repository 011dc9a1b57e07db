"""What is stated of a key that is to be made."""

from __future__ import annotations

from pydantic import Field

from app.access.keys import Role
from app.stated import Name, Schema


class KeyRequest(Schema):
    """A key that is to be made."""

    name: str = Field(
        description="Whose it is: 1 to 64 letters, digits, dots, hyphens and underscores",
        examples=["line-3"],
    )
    role: Role = Field(
        description="`sensor` sends readings, `viewer` reads and computes, `metrologist` does "
        "both and changes models, `admin` makes machines and keys too"
    )
    machines: list[Name] | None = Field(
        default=None,
        max_length=10_000,
        description="Ids of the machines that it is for, one or more; null for all, also those "
        "that are made later. An admin is for all",
        examples=[["mcfv5050"]],
    )
