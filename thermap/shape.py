"""What the generated shapes share."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Shape(BaseModel):
    """Something that comes from the service; it cannot be changed.

    What a user makes has no unknown fields. Fields that a newer service adds are passed over by
    `thermap.call.reader_of`.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        # Names that are Python's own words, such as `from`, stand with an underscore too.
        validate_by_name=True,
        validate_by_alias=True,
        # Made ready when it is first used: an import is not to wait for a hundred shapes.
        defer_build=True,
    )
