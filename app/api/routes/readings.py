"""Readings."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from app.api.dependencies import ContextDep, MachinePath
from app.api.schemas.base import UtcTime
from app.api.schemas.readings import Readings, ReadingSchema, StoredReadings
from app.services.show_machines import show_readings
from app.services.store_readings import store_readings

router = APIRouter(prefix="/v1/machines/{machine}/readings", tags=["readings"])


@router.post("", status_code=201, summary="Store readings")
def post_readings(
    context: ContextDep, machine: MachinePath, body: ReadingSchema | Readings
) -> StoredReadings:
    """Store one reading or up to 10,000: all of them or, if one is wrong, none.

    A time that is known with the same content is a duplicate, with other content a
    conflict. A value out of its sensor's range is stored and marks the sensor.
    """
    stated = body if isinstance(body, list) else [body]
    stored, duplicates = store_readings(context, machine, [r.to_reading() for r in stated])
    return StoredReadings(stored=stored, duplicates=duplicates)


@router.get("", summary="List readings")
def get_readings(
    context: ContextDep,
    machine: MachinePath,
    since: Annotated[UtcTime | None, Query(alias="from", description="From this time on")] = None,
    until: Annotated[UtcTime | None, Query(alias="to", description="Up to this time")] = None,
    every_s: Annotated[float, Query(ge=0, description="At most one in so many seconds [s]")] = 0.0,
    limit: Annotated[int, Query(ge=1, le=100_000, description="At most so many")] = 10_000,
) -> list[ReadingSchema]:
    """List readings in order of time; go on from the last one's time for more."""
    found = show_readings(context, machine, since, until, every_s, limit)
    return [ReadingSchema.of(reading) for reading in found]
