"""Tables, verdicts and news as they change: server-sent events."""

from __future__ import annotations

import re
from typing import Annotated, Any, Final, Literal

from fastapi import Depends, Header, Query, Request
from starlette.responses import Response, StreamingResponse

from app.api.access import viewer
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep, MachinePath, machine_with_readings
from app.api.router import Router
from app.api.service import WITHOUT_BODY
from app.api.streams import TABLES, TableStreams, Wanted
from app.compensation.table_steps import SMALLEST_STEP

router = Router(route_class=BodyRoute, prefix="/v1", tags=["live"])

EVENTS: Final = "text/event-stream"

_HEADERS: Final = {"Cache-Control": "no-cache", "X-Accel-Buffering": "no"}
"""Proxies are to pass on every event when it comes."""

_SHAPES: Final = {
    "table": "CurrentCompensationAnswer",
    "state": "CurrentCompensationAnswer",
    "status": "MachineStatus",
    "event": "Event",
    "watch": "WatchChange",
    "analysis": "AnalysisNews",
    "missed": "MissedEntries",
}
"""Names of events, and what their JSON is."""

_RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "Events without end. `table`: the JSON of `GET …/compensation`. `state`: "
        "the same, because completeness, a sensor's health or the model version changed although "
        "no value did; without `components` and with the reason in `detail` where there is no "
        "table. `status`: the JSON of `GET …/status`, when the verdict or its words change.\n\n"
        "Where `kind` asks for them, entries of the event log, each once and in their order: "
        "`watch`, a `WatchChange`; `analysis`, an `AnalysisNews`; `event`, every other one as `GET "
        "…/events` has it, an alarm again when it goes or comes again. Between them `analysis` "
        "says, about every 2 s, how far those are that run. `missed`, a `MissedEntries`: how many "
        "entries came that cannot be sent any more, because one came back late or reads slowly; "
        "those after them follow.\n\n"
        "A comment every 15 s without an event",
        "content": {
            EVENTS: {
                "schema": {"type": "string"},
                "x-events": {
                    name: {"$ref": f"#/components/schemas/{shape}"}
                    for name, shape in _SHAPES.items()
                },
                "example": 'event: table\ndata: {"machine": "mcfv5050", …}\nid: 1764000000001\n\n',
            }
        },
    }
}

MinChange = Annotated[
    float,
    Query(
        ge=0.0,
        allow_inf_nan=False,
        description="A table comes when one of its values has changed by more than this since the "
        "last one that was sent [µm; angular components µrad, squareness µm/m]",
    ),
]
MaxStep = Annotated[
    float | None,
    Query(
        ge=SMALLEST_STEP,
        allow_inf_nan=False,
        description="No value changes by more than this from one table to the next, at any "
        "position [µm; angular components µrad, squareness µm/m]: a larger change comes in several "
        "tables, one a second, that say `stepping` and have the positions of both; a component "
        "comes from 0 and goes to 0. A jump would mark the surface",
    ),
]
Heartbeat = Annotated[
    float | None,
    Query(
        ge=0.5,
        le=60.0,
        description="After so long without an event one of the name `heartbeat` comes [s]; without "
        "it a comment after 15 s, which programs in a browser do not see",
    ),
]
Kinds = Annotated[
    list[Literal["table", "status", "event", "watch", "analysis"]] | None,
    Query(
        alias="kind",
        description="What is sent; may be repeated. `table` brings `state` with it. If left out, "
        "`table` and `status`",
    ),
]
LastEventId = Annotated[
    str,
    Header(
        description="`id` of the last event that came: the table comes again only if it has "
        "changed since, and the event log continues from there"
    ),
]

_ID: Final = re.compile(r"([0-9]{1,18})(?:-([0-9]{1,18})?)?")
"""The last table's number, and the last entry's of the log where that is followed."""


async def _wanted(
    min_change_um: MinChange = 0.1,
    max_step_um: MaxStep = None,
    heartbeat_s: Heartbeat = None,
    kind: Kinds = None,
    last_event_id: LastEventId = "",
) -> Wanted:
    """Read what a follower wants to be sent."""
    table, entry = _numbers(last_event_id)
    kinds = TABLES if kind is None else frozenset(kind)
    return Wanted(min_change_um, max_step_um, table, heartbeat_s, kinds, entry)


WantedDep = Annotated[Wanted, Depends(_wanted)]


@router.get(
    "/machines/{machine}/compensation/stream",
    summary="The compensation table whenever it changes",
    response_class=StreamingResponse,
    responses=_RESPONSES,
)
async def get_table_stream(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    wanted: WantedDep,
) -> Response:
    """Send the table at the latest reading at once, and whenever it has changed.

    A follower that reads slowly gets the newest table, not all between. With `kind` it also gets
    what comes into the event log from now on: alarms, changes, what the watch says, analyses.
    The stream ends when the machine is deleted, its key revoked, or the service ends.
    """
    await machine_with_readings(request, context, machine)
    return _stream(request, machine, wanted)


@router.get(
    "/stream",
    summary="The tables of all machines whenever they change",
    response_class=StreamingResponse,
    responses=_RESPONSES,
)
async def get_stream(
    request: Request,
    wanted: WantedDep,
) -> Response:
    """Send the same of every machine; each event's JSON names its `machine`.

    A key for some machines gets the events of these alone.
    """
    return _stream(request, None, wanted)


def _stream(request: Request, machine_id: str | None, wanted: Wanted) -> Response:
    if WITHOUT_BODY in request.scope:
        return Response(media_type=EVENTS, headers=_HEADERS)
    streams: TableStreams = request.app.state.streams
    events = streams.follow(machine_id, wanted, viewer(request))
    return StreamingResponse(events, media_type=EVENTS, headers=_HEADERS)


def _numbers(last_event_id: str) -> tuple[int | None, int | None]:
    """Read the id of an event: the last table's number, and the last entry's of the log.

    None where it is not one of ours: the table is sent then, and the log from now on.
    """
    match = _ID.fullmatch(last_event_id)
    table, entry = (None, None) if match is None else match.groups()
    return None if table is None else int(table), None if entry is None else int(entry)
