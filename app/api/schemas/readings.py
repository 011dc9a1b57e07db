"""Readings over HTTP."""

from __future__ import annotations

import json
from typing import Annotated, Any, Final, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag

from app.api.schemas.base import (
    MachineState,
    Schema,
    StatedTemperatures,
    Temperatures,
    UtcTime,
    way_of,
)
from app.api.schemas.in_pieces import InPieces
from app.services.readings import StoreOutcome
from app.storage.readings import WithdrawnReading
from app.thermal.reading import Reading

_ReadingTime = Annotated[
    UtcTime,
    Field(
        description="When, with a zone, from the year 1900 on; what lies in the future is not used "
        "before its time, and refused if it is more than a day ahead",
        examples=["2026-03-01T06:00:00Z"],
    ),
]


class ReadingSchema(Schema):
    """Live temperatures and the machine's state at one time."""

    time: _ReadingTime
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


class StatedReading(Schema):
    """A reading as it is sent: of a sensor that has no value it says so, or nothing."""

    time: _ReadingTime
    temperatures_c: StatedTemperatures = Field(
        description="Temperatures by sensor [°C]; null for a sensor that has no value: it is named "
        "in the status at once, until it has one again. A sensor that is left out is missed when "
        "its next reading should have come",
        min_length=1,
    )
    state: MachineState

    @property
    def without(self) -> frozenset[str]:
        """Sensors of which it says that they have no value."""
        return frozenset(name for name, value in self.temperatures_c.items() if value is None)

    def to_reading(self) -> Reading:
        """Make the reading of those that have a value."""
        known = {name: value for name, value in self.temperatures_c.items() if value is not None}
        return Reading(self.time, known, self.state)


def _one_or_more(body: object) -> str:
    return way_of("more") if isinstance(body, list) else way_of("one")


def _no_wrapped_list(body: Any) -> Any:
    """Tell who sends `{"readings": [...]}` of the list; else each field would be complained of."""
    if isinstance(body, dict) and len(body) == 1:
        ((name, entries),) = body.items()
        if isinstance(entries, list):
            raise ValueError(
                "one reading, an object with time and temperatures_c, or a list of them without "
                f"the name {json.dumps(name[:80])} around it, such as [{{…}}, {{…}}]"
            )
    return body


MOST_READINGS: Final = 10_000
"""In one list."""

Readings = Annotated[list[StatedReading], InPieces(MOST_READINGS)]
"""One to 10,000 readings."""

OneOrMoreReadings = Annotated[
    Annotated[StatedReading, Tag(way_of("one"))] | Annotated[Readings, Tag(way_of("more"))],
    Discriminator(_one_or_more),
    BeforeValidator(_no_wrapped_list),
]
"""A reading, or a list of them."""


class StoredReadings(Schema):
    """What became of the readings."""

    stored: int = Field(description="Readings that are new")
    duplicates: int = Field(description="Readings that were there already, with the same content")
    ahead: int = Field(
        0,
        description="How many of them lie in the future and are not used before their time; left "
        "out where none does",
    )
    warnings: list[str] = Field(
        [], description="What is to be said of them, in sentences; left out where nothing is"
    )

    @classmethod
    def of(cls, outcome: StoreOutcome) -> Self:
        """Say what became of them."""
        return cls(
            stored=outcome.stored,
            duplicates=outcome.duplicates,
            ahead=outcome.ahead,
            warnings=list(outcome.warnings),
        )

    def as_json(self) -> bytes:
        """Write it without what is left out."""
        return self.model_dump_json(exclude_defaults=True).encode()


class WithdrawnReadingAnswer(ReadingSchema):
    """A reading that was withdrawn: it counts nowhere."""

    withdrawn_at: UtcTime = Field(description="When it was withdrawn, UTC")

    @classmethod
    def of_withdrawn(cls, withdrawn: WithdrawnReading) -> Self:
        """Show a reading that was withdrawn."""
        shown = ReadingSchema.of(withdrawn.reading)
        return cls(**dict(shown), withdrawn_at=withdrawn.withdrawn_at)


class WithdrawnReadings(Schema):
    """How many readings were taken out of use."""

    withdrawn: int = Field(description="Readings that count nowhere from now on", examples=[1])
