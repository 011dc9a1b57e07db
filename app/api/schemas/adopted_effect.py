"""The ranges in which an adopted effect was learnt, over HTTP."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from app.api.schemas.base import Number, Schema, UtcTime

RangeAnswer = Annotated[list[Number], Field(min_length=2, max_length=2)]
"""Smallest and largest value."""


class ValidAnswer(Schema):
    """Where an effect was learnt: beyond it, it is held at the edge."""

    from_: UtcTime = Field(
        alias="from", description="Time of the first observation that it rests on, UTC"
    )
    to: UtcTime = Field(description="Time of the last one, UTC")
    temperatures_c: dict[str, RangeAnswer] = Field(
        description="Temperatures of the sensors that it is made of [°C]",
        examples=[{"z-column": [21.4, 29.8]}],
    )
    state: dict[str, RangeAnswer] = Field(
        description="Values of the states that drive it at once",
        examples=[{"spindle_rpm": [0.0, 12000.0]}],
    )
    positions_mm: dict[str, RangeAnswer] = Field(
        description="Positions on the axis of each of its components [mm]",
        examples=[{"EZZ": [2.5, 497.5]}],
    )
    made_of: dict[str, RangeAnswer] = Field(
        description="What it makes of several signals or of the past, such as how far a sensor was "
        "behind; the unit ends each name",
        examples=[{"z-column 41 min late minus z-column [K]": [-1.9, 2.3]}],
    )
    use_until: UtcTime | None = Field(
        description="Until when an effect that grows with time may be used, UTC: from then on what "
        "it may have grown by since `to` is more than one observation scatters; null for others"
    )
