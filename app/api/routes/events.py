"""What happened to machines, over time, who is told of it, and how connections fare."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from typing import Annotated, Any, Final, Literal

import orjson
from fastapi import Depends, Path, Query, Request
from starlette.responses import Response

from app.api.access import sees
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep, MachinePath
from app.api.router import Router
from app.api.routes.readings import SinceQuery, UntilQuery
from app.connections.reports import ConnectionReports
from app.connections.running import ConnectionsNow
from app.csv_text import csv_line
from app.events.event import Event, EventKind, Events
from app.services.context import Context
from app.services.events import show_events
from app.services.history import History, Place, show_history
from app.services.tell_receivers import (
    Receiver,
    Receivers,
    ask_for_test_message,
    show_receivers,
)
from app.stated import StoredInteger

router = Router(route_class=BodyRoute, prefix="/v1", tags=["events"])

CSV = "text/csv"

KindQuery = Annotated[
    list[EventKind] | None, Query(alias="kind", description="Of this kind only; may be repeated")
]
BeforeQuery = Annotated[
    StoredInteger | None,
    Query(ge=1, description="Only events before this number: an answer's `next`"),
]
LimitQuery = Annotated[int, Query(ge=1, le=10_000, description="At most so many")]
FormatQuery = Annotated[
    Literal["json", "csv"],
    Query(alias="format", description="`csv` for a table, as `Accept: text/csv` has it"),
]

_RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "The newest first; as a table with `Accept: text/csv`",
        "content": {CSV: {"schema": {"type": "string"}}},
    }
}


async def _asked(
    since: SinceQuery = None,
    until: UntilQuery = None,
    kind: KindQuery = None,
    before: BeforeQuery = None,
    limit: LimitQuery = 100,
) -> dict[str, Any]:
    return {
        "since": since,
        "until": until,
        "kinds": kind or (),
        "before": before,
        "limit": limit,
    }


Asked = Annotated[dict[str, Any], Depends(_asked)]


@router.get("/events", summary="What happened", response_model=Events, responses=_RESPONSES)
def get_all_events(
    request: Request, context: ContextDep, asked: Asked, form: FormatQuery = "json"
) -> Events | Response:
    """List the events of all machines, and those about keys."""
    return _events_answer(request, show_events(context, None, **asked), form)


@router.get(
    "/machines/{machine}/events",
    summary="What happened to a machine",
    response_model=Events,
    responses=_RESPONSES,
)
def get_events(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    asked: Asked,
    form: FormatQuery = "json",
) -> Events | Response:
    """List who or what changed which version when, alarms, and sensors lost and back.

    Alarms and sensors' failures are kept for 90 days after they went, changes for ever.
    """
    return _events_answer(request, show_events(context, machine, **asked), form)


def _events_answer(request: Request, events: Events, form: str) -> Events | Response:
    if form != "csv" and CSV not in request.headers.get("accept", ""):
        return events
    heading = ("time", "until", "kind", "machine", "who", "count", "text", "details")
    text = "".join(map(csv_line, (heading, *map(_row, events.events))))
    headers = {"Content-Disposition": 'attachment; filename="events.csv"'}
    return Response(text, media_type=CSV, headers=headers)


def _row(event: Event) -> tuple[str, ...]:
    until = "" if event.until is None else event.until.isoformat()
    return (
        event.time.isoformat(),
        until,
        str(event.kind),
        event.machine or "",
        event.who,
        str(event.count),
        event.text,
        orjson.dumps(event.details).decode(),
    )


_receivers = Router(route_class=BodyRoute, prefix="/v1", tags=["events"])

NamePath = Annotated[str, Path(max_length=64, description="Name of the receiver in the file")]


@_receivers.get("/receivers", summary="Who is told of alarms")
def get_receivers(request: Request, context: ContextDep) -> Receivers:
    """List the receivers of the file of connections: what was sent last, what waits, what failed.

    All services on one database say the same. A key for some machines is told of receivers that
    are told of no others.
    """
    return Receivers(tuple(_seen(request, context)))


@_receivers.post("/receivers/{name}/test", summary="Send a test message", status_code=202)
def post_test(request: Request, context: ContextDep, name: NamePath) -> Receiver:
    """Ask for a test message to a receiver.

    The service that has the receiver sends it within seconds: `tested_at` of `GET …/receivers` is
    then after `test_asked_at`, and `test_failure` says why it could not be sent.
    """
    return ask_for_test_message(
        context, name, [receiver.name for receiver in _seen(request, context)]
    )


def _seen(request: Request, context: Context) -> list[Receiver]:
    may_see = sees(request)
    receivers = show_receivers(context).receivers
    if may_see(""):
        return list(receivers)
    return [
        receiver
        for receiver in receivers
        if receiver.machines and all(map(may_see, receiver.machines))
    ]


_connections = Router(route_class=BodyRoute, prefix="/v1", tags=["connections"])


@_connections.get("/connections", summary="How the connections fare")
def get_connections(request: Request) -> ConnectionsNow:
    """List what the service reads beside HTTP: whether there is contact, and what is the matter.

    Of several workers, or several services on one PostgreSQL database, all say the same within a
    second or two. The counts below the list are of all connections together, since their service
    began.
    """
    reports: ConnectionReports = request.app.state.connection_reports
    may_see = sees(request)
    now = reports.now()
    seen = tuple(
        connection for connection in now.connections if all(map(may_see, connection.machines))
    )
    clocks = tuple(filter(may_see, now.machines_with_wrong_clocks))
    words = now.last_refusal if len(seen) == len(now.connections) else ""
    return replace(now, connections=seen, last_refusal=words, machines_with_wrong_clocks=clocks)


_history = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}/history", tags=["readings"])

_BINS: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "Temperatures in bins, and what else there was; bins as a table with "
        "`Accept: text/csv`",
        "content": {CSV: {"schema": {"type": "string"}}},
    }
}

_HEADING: Final = ("time", "of", "unit", "mean", "low", "high", "readings", "longest_gap_s")


@_history.get("", summary="What was over time", response_model=History, responses=_BINS)
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


router.routes.extend([*_history.routes, *_receivers.routes, *_connections.routes])
