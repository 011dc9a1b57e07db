"""Pictures over HTTP."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field

from app.api.schemas.base import Integer, Number
from app.api.schemas.error_field import VolumeRequest


class PictureRequest(VolumeRequest):
    """At which temperatures the work volume is drawn, and how."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
                "tool_offset_mm": [0, 0, 160],
                "missing_components": "zero",
            }
        }
    )

    exaggeration: Annotated[Number, Field(gt=0, le=1e9)] | None = Field(
        None,
        description="How many times larger than they are errors are drawn; chosen if left out "
        "(without a unit)",
        examples=[2000],
    )
    arrows_per_axis: Annotated[Integer, Field(ge=2, le=12)] = Field(
        5, description="Number of error vectors along each axis"
    )
