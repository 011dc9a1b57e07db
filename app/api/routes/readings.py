"""Readings."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from app.api.dependencies import ContextDep, MachinePath
from app.api.schemas.base import UtcTime
from app.api.schemas.readings import OneOrMoreReadings, ReadingSchema, StoredReadings
from app.errors import FieldError, InvalidContent
from app.services.context import Context
from app.services.show_machines import show_readings
from app.services.store_readings import store_readings

router = APIRouter(prefix="/v1/machines/{machine}/readings", tags=["readings"])


@router.post("", status_code=201, summary="Store readings")
def post_readings(
    context: ContextDep, machine: MachinePath, body: OneOrMoreReadings
) -> StoredReadings:
    """Store one reading or up to 10,000: all of them or, if one is wrong, none.

    A time that is known with the same content is a duplicate, with other content a
    conflict. A value out of its sensor's range is stored and marks the sensor.
    """
    if isinstance(body, list):
        stored, duplicates = store_readings(context, machine, [r.to_reading() for r in body])
    else:
        stored, duplicates = _store_one(context, machine, body)
    return StoredReadings(stored=stored, duplicates=duplicates)


@router.get("", summary="List readings")
def get_readings(
    context: ContextDep,
    machine: MachinePath,
    since: Annotated[UtcTime | None, Query(alias="from", description="From this time on")] = None,
    until: Annotated[UtcTime | None, Query(alias="to", description="Up to this time")] = None,
    every_s: Annotated[
        float,
        Query(ge=0, allow_inf_nan=False, description="At most one in so many seconds [s]"),
    ] = 0.0,
    limit: Annotated[int, Query(ge=1, le=100_000, description="At most so many")] = 10_000,
) -> list[ReadingSchema]:
    """List readings in order of time; go on from the last one's time for more."""
    found = show_readings(context, machine, since, until, every_s, limit)
    return [ReadingSchema.of(reading) for reading in found]


def _store_one(context: Context, machine: str, stated: ReadingSchema) -> tuple[int, int]:
    """Store a reading that came alone: its fields are not named as in a list."""
    try:
        return store_readings(context, machine, [stated.to_reading()])
    except InvalidContent as error:
        errors = [FieldError(e.field.removeprefix("0."), e.message) for e in error.errors]
        detail = "; ".join(f"{e.field}: {e.message}" for e in errors)
        raise InvalidContent(detail, errors) from None
