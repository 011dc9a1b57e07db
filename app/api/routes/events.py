"""What happened to machines, and by whose doing."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import orjson
from fastapi import Query, Request
from starlette.responses import Response

from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep, MachinePath
from app.api.router import Router
from app.api.routes.readings import SinceQuery, UntilQuery
from app.csv_text import csv_line
from app.events.event import Event, EventKind, Events
from app.services.events import show_events
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


@router.get("/events", summary="What happened", response_model=Events, responses=_RESPONSES)
def get_all_events(
    request: Request,
    context: ContextDep,
    since: SinceQuery = None,
    until: UntilQuery = None,
    kind: KindQuery = None,
    before: BeforeQuery = None,
    limit: LimitQuery = 100,
    form: FormatQuery = "json",
) -> Events | Response:
    """List the events of all machines, and those about keys."""
    events = show_events(
        context, None, since=since, until=until, kinds=kind or (), before=before, limit=limit
    )
    return _answer(request, events, form)


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
    since: SinceQuery = None,
    until: UntilQuery = None,
    kind: KindQuery = None,
    before: BeforeQuery = None,
    limit: LimitQuery = 100,
    form: FormatQuery = "json",
) -> Events | Response:
    """List who or what changed which version when, alarms, and sensors lost and back.

    Alarms and sensors' failures are kept for 90 days after they went, changes for ever.
    """
    events = show_events(
        context, machine, since=since, until=until, kinds=kind or (), before=before, limit=limit
    )
    return _answer(request, events, form)


def _answer(request: Request, events: Events, form: str) -> Events | Response:
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
