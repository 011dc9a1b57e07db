"""What every shape shares: no unknown fields, no NaN, times with a zone, units in names."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
)


class Schema(BaseModel):
    """A shape that refuses fields it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _only_text(value: Any) -> Any:
    if isinstance(value, str | datetime):
        return value
    raise ValueError("a time as ISO 8601 text, such as 2026-03-01T06:00:00Z")


def _to_utc(value: datetime) -> datetime:
    return value.astimezone(UTC)


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number: no text, no booleans, no NaN."""

Numbers = Annotated[list[Number], Field(min_length=1, max_length=100_000)]
"""One or more finite numbers."""

UtcTime = Annotated[AwareDatetime, BeforeValidator(_only_text), AfterValidator(_to_utc)]
"""A time with a zone, kept as UTC."""

Name = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=200)
]
"""A name of 1 to 200 characters."""

Temperatures = Annotated[dict[str, Number], Field(examples=[{"x-middle": 24.1, "z-column": 27.3}])]
"""Sensor name to temperature [°C]."""

MachineState = Annotated[
    dict[str, Number],
    Field(
        default_factory=dict,
        description="Any numbers that the shop knows of the machine's state",
        examples=[{"spindle_rpm": 8000}],
    ),
]
"""The machine's state."""
