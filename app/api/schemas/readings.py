"""Readings over HTTP."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Discriminator, Field, Tag

from app.api.schemas.base import MachineState, Schema, Temperatures, UtcTime, way_of
from app.thermal.reading import Reading


class ReadingSchema(Schema):
    """Live temperatures and the machine's state at one time."""

    time: UtcTime = Field(
        description="When, with a zone; not in the future", examples=["2026-03-01T06:00:00Z"]
    )
    temperatures_c: Temperatures = Field(
        description="Temperatures by sensor [°C]; leave a failed sensor out", min_length=1
    )
    state: MachineState

    def to_reading(self) -> Reading:
        """Make the reading."""
        return Reading(self.time, self.temperatures_c, self.state)

    @classmethod
    def of(cls, reading: Reading) -> Self:
        """Show a reading."""
        return cls(
            time=reading.time,
            temperatures_c=dict(reading.temperatures_c),
            state=dict(reading.state),
        )


def _one_or_more(body: object) -> str:
    return way_of("more") if isinstance(body, list) else way_of("one")


Readings = Annotated[list[ReadingSchema], Field(min_length=1, max_length=10_000)]
"""One to 10,000 readings."""

OneOrMoreReadings = Annotated[
    Annotated[ReadingSchema, Tag(way_of("one"))] | Annotated[Readings, Tag(way_of("more"))],
    Discriminator(_one_or_more),
]
"""A reading, or a list of them."""


class StoredReadings(Schema):
    """What became of the readings."""

    stored: int = Field(description="Readings that are new")
    duplicates: int = Field(description="Readings that were there already, with the same content")
