"""Readings."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from typing import Annotated, Any, Final, NamedTuple, cast

from fastapi import Query, Request
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
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute, DirectRoute, Written, body_of_at_most
from app.api.dependencies import ContextDep, MachinePath
from app.api.router import Router
from app.api.turns import Turns
from app.errors import FieldError, InvalidContent, UnknownThing, counted, list_names
from app.field_errors import way_of
from app.in_pieces import InPieces
from app.services.context import Context
from app.services.machines import show_readings, show_withdrawn_readings
from app.services.readings import (
    StoreOutcome,
    note_absent,
    store_at_once,
    store_readings,
    withdraw_reading,
    withdraw_readings,
)
from app.services.status import machine_in_memory
from app.stated import MachineState, Schema, StatedTemperatures, Temperatures, UtcTime
from app.storage.readings import WithdrawnReading
from app.thermal.reading import Reading

_PREFIX: Final = "/v1/machines/{machine}/readings"

_direct = Router(route_class=DirectRoute, prefix=_PREFIX, tags=["readings"])
router = Router(route_class=BodyRoute, prefix=_PREFIX, tags=["readings"])

_OUTCOME: Final = TypeAdapter(StoreOutcome)


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


SinceQuery = Annotated[UtcTime | None, Query(alias="from", description="From this time on")]
UntilQuery = Annotated[UtcTime | None, Query(alias="to", description="Up to this time")]
LimitQuery = Annotated[int, Query(ge=1, le=100_000, description="At most so many")]


@_direct.post(
    "",
    status_code=201,
    summary="Store readings",
    response_model=StoreOutcome,
    openapi_extra=body_of_at_most(16),
)
@needs(Role.SENSOR)
async def post_readings(
    request: Request, context: ContextDep, machine: MachinePath, body: OneOrMoreReadings
) -> Response:
    """Store one reading or up to 10,000: all of them or, if one is wrong, none.

    A time that is known with the same content is a duplicate, with other content a
    conflict. A value out of its sensor's range is stored and marks the sensor. A time that
    is more than 2 s ahead of the service's clock is stored, named here and in the table at the
    latest reading, and not used before it has come; once it is used the table goes on naming it
    and is not `complete`, until there are newer values. More than a day ahead it is refused. A
    time of more than ten years ago is stored and named here.
    """
    sent = cast("SentReadings", body)
    done = None if sent.without else await store_at_once(context, machine, sent.readings)
    if done is None:
        turns: Turns = request.app.state.turns
        async with turns.taken():
            done = await run_in_threadpool(_store, context, machine, sent)
    return Written(_OUTCOME.dump_json(done, exclude_defaults=True), status=201)


router.routes.extend(_direct.routes)


@router.get("", summary="List readings")
def get_readings(
    context: ContextDep,
    machine: MachinePath,
    since: SinceQuery = None,
    until: UntilQuery = None,
    every_s: Annotated[
        float,
        Query(ge=0, allow_inf_nan=False, description="At most one in so many seconds [s]"),
    ] = 0.0,
    limit: LimitQuery = 10_000,
) -> list[Reading]:
    """List readings in order of time; go on from the last one's time for more.

    Those that lie in the future are among them.
    """
    return show_readings(context, machine, since, until, every_s, limit)


@router.get("/withdrawn", summary="List withdrawn readings")
def get_withdrawn_readings(
    context: ContextDep,
    machine: MachinePath,
    since: SinceQuery = None,
    until: UntilQuery = None,
    limit: LimitQuery = 10_000,
) -> list[WithdrawnReading]:
    """List what was withdrawn, in order of the readings' times, with when it was withdrawn.

    It counts nowhere; to have it back, store it again. A time that was stored and withdrawn
    more than once is listed as often.
    """
    return show_withdrawn_readings(context, machine, since, until, limit)


@router.delete("", summary="Withdraw readings")
def delete_readings(
    context: ContextDep,
    machine: MachinePath,
    time: Annotated[UtcTime | None, Query(description="The one of exactly this time")] = None,
    since: Annotated[
        UtcTime | None, Query(alias="from", description="All from this time on, with `to`")
    ] = None,
    until: Annotated[
        UtcTime | None, Query(alias="to", description="All up to this time, with `from`")
    ] = None,
) -> WithdrawnReadings:
    """Take one reading, or all between two times (both included), out of use.

    They count nowhere from then on: in no table, prediction or analysis. Stored again, they
    are readings like any others.
    """
    if time is not None and since is None and until is None:
        return WithdrawnReadings(withdrawn=withdraw_reading(context, machine, time))
    if time is None and since is not None and until is not None:
        return WithdrawnReadings(withdrawn=withdraw_readings(context, machine, since, until))
    bounds = [n for n, t in (("time", time), ("from", since), ("to", until)) if t is not None]
    field = "time" if time is not None or not bounds else "to" if until is None else "from"
    raise InvalidContent.of_field(
        field,
        "expected the time of one reading, or from and to of a range (one without the other "
        f"would mean all before or after it), got {list_names(bounds)}",
    )


def _store(context: Context, machine: str, sent: SentReadings) -> StoreOutcome:
    """Store those that have a value, and take note of what has none."""
    try:
        if not sent.without:
            return store_readings(context, machine, sent.readings)
        return _store_valued(context, machine, sent)
    except InvalidContent as error:
        if sent.is_list:
            raise
        # One that came alone: its fields are not named as in a list.
        errors = [FieldError(e.field.removeprefix("0."), e.message) for e in error.errors]
        detail = "; ".join(f"{e.field}: {e.message}" for e in errors)
        raise InvalidContent(detail, errors) from None


def _store_valued(context: Context, machine: str, sent: SentReadings) -> StoreOutcome:
    current = machine_in_memory(context, machine).current.model.machine
    for i, names in enumerate(sent.without):
        for name in names:
            try:
                current.sensor(name)
            except UnknownThing as unknown:
                field = f"{i}.temperatures_c.{name}"
                raise InvalidContent.of_field(field, unknown.detail) from None
    valued = [reading for reading in sent.readings if reading.temperatures_c]
    done = store_readings(context, machine, valued) if valued else StoreOutcome(0, 0)
    pairs = zip(sent.readings, sent.without, strict=True)
    note_absent(context, machine, [(pair.time, names) for pair, names in pairs if names])
    if len(valued) == len(sent.readings):
        return done
    unstored = counted(len(sent.readings) - len(valued), "reading")
    return replace(done, warnings=(*done.warnings, f"{unstored} without a value not stored"))
