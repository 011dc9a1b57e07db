"""Readings."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Final, cast

from fastapi import Query, Request
from pydantic import TypeAdapter
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute, DirectRoute, Written, body_of_at_most
from app.api.dependencies import ContextDep, MachinePath
from app.api.router import Router
from app.api.schemas.readings import (
    OneOrMoreReadings,
    SentReadings,
    WithdrawnReadings,
)
from app.api.turns import Turns
from app.errors import FieldError, InvalidContent, UnknownThing, counted, list_names
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
from app.stated import UtcTime
from app.storage.readings import WithdrawnReading
from app.thermal.reading import Reading

_PREFIX: Final = "/v1/machines/{machine}/readings"

_direct = Router(route_class=DirectRoute, prefix=_PREFIX, tags=["readings"])
router = Router(route_class=BodyRoute, prefix=_PREFIX, tags=["readings"])

_OUTCOME: Final = TypeAdapter(StoreOutcome)


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
