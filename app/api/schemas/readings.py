"""Readings over HTTP."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from datetime import datetime
from typing import Annotated, Any, Final, NamedTuple

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    TypeAdapter,
    ValidationError,
    WrapValidator,
)
from pydantic_core import CoreSchema, SchemaValidator, core_schema

from app.field_errors import way_of
from app.in_pieces import InPieces
from app.stated import (
    MachineState,
    Schema,
    StatedTemperatures,
    Temperatures,
    UtcTime,
)
from app.thermal.reading import Reading

_ReadingTime = Annotated[
    UtcTime,
    Field(
        description="When, with a zone, from the year 1900 on; what lies in the future is not used "
        "before its time, and refused if it is more than a day ahead",
        examples=["2026-03-01T06:00:00Z"],
    ),
]


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
        present = {name: value for name, value in self.temperatures_c.items() if value is not None}
        return Reading(self.time, present, self.state)


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

_Explained = Annotated[
    Annotated[StatedReading, Tag(way_of("one"))] | Annotated[Readings, Tag(way_of("more"))],
    Discriminator(_one_or_more),
    BeforeValidator(_no_wrapped_list),
]


class SentReadings(NamedTuple):
    """Readings as they were sent: alone or in a list; and of each the sensors without a value."""

    readings: Sequence[Reading]
    without: Sequence[Collection[str]] = ()
    is_list: bool = True


_MOST_AT_ONCE: Final = 250
"""Readings that are checked in one call: half a millisecond."""

_PLAIN_TIME: Final = (
    r"^(19|2[0-9])[0-9]{2}-[0-9]{2}-[0-9]{2}T([01][0-9]|2[0-3]):[0-9]{2}:[0-9]{2}"
    r"(\.[0-9]{1,6})?(Z|\+00:00)$"
)
"""UTC, within the years that `UtcTime` allows: the standard library reads it as pydantic does."""


def _plain_reading() -> CoreSchema:
    """Say what `StatedReading` says of a reading with all its values, in UTC, and make it one.

    Nothing of it is called back in Python but for names of states: it takes a third of the time.
    """
    time = core_schema.no_info_after_validator_function(
        datetime.fromisoformat, core_schema.str_schema(strict=True, pattern=_PLAIN_TIME)
    )
    temperatures = TypeAdapter(Annotated[Temperatures, Field(min_length=1)]).core_schema
    on_time = core_schema.with_default_schema(core_schema.float_schema(), default=0.0)
    fields = [
        core_schema.dataclass_field("time", time),
        core_schema.dataclass_field("temperatures_c", temperatures),
        core_schema.dataclass_field("state", TypeAdapter(MachineState).core_schema),
        core_schema.dataclass_field("early_s", on_time, init=False),
    ]
    arguments = core_schema.dataclass_args_schema("Reading", fields, extra_behavior="forbid")
    names = [field["name"] for field in fields]
    return core_schema.dataclass_schema(Reading, arguments, names, slots=True, frozen=True)


_PLAIN: Final = SchemaValidator(core_schema.list_schema(_plain_reading(), min_length=1))


def _plain_first(body: Any, explain: Callable[[Any], Any]) -> SentReadings:
    """Make readings that are plain at once; whatever else it is, or is wrong with it, is explained.

    Of a long list the explaining takes turns with others, one call would not.
    """
    is_list = isinstance(body, list)
    entries = body if is_list else [body]
    if len(entries) <= _MOST_AT_ONCE:
        with suppress(ValidationError):
            return SentReadings(_PLAIN.validate_python(entries), is_list=is_list)
    explained = explain(body)
    schemas: Sequence[StatedReading] = explained if is_list else [explained]
    readings = [schema.to_reading() for schema in schemas]
    without = [schema.without for schema in schemas]
    return SentReadings(readings, without if any(without) else (), is_list)


OneOrMoreReadings = Annotated[_Explained, WrapValidator(_plain_first)]
"""A reading, or a list of them; checked it is `SentReadings`."""


class WithdrawnReadings(Schema):
    """How many readings were taken out of use."""

    withdrawn: int = Field(description="Readings that count nowhere from now on", examples=[1])
