"""A machine over time."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import timedelta
from typing import Annotated, Any, Final

from fastapi import Query, Request
from starlette.responses import Response

from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep, MachinePath
from app.api.router import Router
from app.api.routes.events import CSV, FormatQuery
from app.api.routes.readings import SinceQuery, UntilQuery
from app.csv_text import csv_line
from app.services.history import History, Place, show_history

router = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}/history", tags=["readings"])

_RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "Temperatures in bins, and what else there was; bins as a table with "
        "`Accept: text/csv`",
        "content": {CSV: {"schema": {"type": "string"}}},
    }
}

_HEADING: Final = ("time", "of", "unit", "mean", "low", "high", "readings", "longest_gap_s")


@router.get("", summary="What was over time", response_model=History, responses=_RESPONSES)
def get_history(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    since: SinceQuery = None,
    until: UntilQuery = None,
    sensor: Annotated[
        list[str] | None, Query(description="Of this sensor only; may be repeated", max_length=100)
    ] = None,
    points: Annotated[int, Query(ge=10, le=2000, description="At most about so many bins")] = 1000,
    component: Annotated[
        str | None,
        Query(
            max_length=16, description="The compensation of this component, too", examples=["EXX"]
        ),
    ] = None,
    position_mm: Annotated[
        float | None,
        Query(ge=-1e5, le=1e5, allow_inf_nan=False, description="At this position [mm]"),
    ] = None,
    residuals: Annotated[
        bool, Query(description="What the active version leaves of the latest 50 checks, too")
    ] = False,
    form: FormatQuery = "json",
) -> History | Response:
    """Show temperatures over hours to years, the compensation at a place, checks and events.

    Without `from` it is of the 24 hours before `to`, or before now. Of each bin there are the
    lowest, the highest and the mean temperature; bins of less than a minute only within three
    hours. A bin without a reading is left out, and `gap_s` says how long there was none. The
    compensation is what the active version makes of the bins' mean temperatures, whichever version
    was active then.
    """
    place = None if component is None else Place(component, position_mm)
    sensors = sensor or ()
    history = show_history(
        context, machine, since, until, sensors, points, place, residuals=residuals
    )
    if form != "csv" and CSV not in request.headers.get("accept", ""):
        return history
    text = "".join(map(csv_line, (_HEADING, *_rows(history))))
    headers = {"Content-Disposition": 'attachment; filename="history.csv"'}
    return Response(text, media_type=CSV, headers=headers)


def _rows(history: History) -> Iterator[tuple[Any, ...]]:
    def at(after_s: float) -> str:
        return (history.since + timedelta(seconds=after_s)).isoformat()

    for sensor in history.sensors:
        columns = (
            sensor.after_s,
            sensor.mean_c,
            sensor.low_c,
            sensor.high_c,
            sensor.count,
            sensor.gap_s,
        )
        for after_s, *values in zip(*columns, strict=True):
            yield (at(after_s), sensor.sensor, "°C", *values)
    for check in history.checks:
        if check.left_um is not None:
            yield (check.time.isoformat(), f"check {check.label}", "µm", check.left_um, *4 * ("",))
    course = history.compensation
    if course is not None:
        where = "" if course.position_mm is None else f" at {course.position_mm:g} mm"
        for after_s, value in zip(course.after_s, course.values, strict=True):
            of = f"compensation {course.component}{where}"
            yield (at(after_s), of, course.unit, "" if value is None else value, "", "", "", "")
