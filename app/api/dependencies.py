"""What routes are handed.

All of it is `async`: a function that is not takes a thread, which may be waiting elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Annotated, Any

from fastapi import Depends, Path, Query, Request
from fastapi.dependencies.models import Dependant
from starlette.concurrency import run_in_threadpool

from app.api.turns import Turns
from app.errors import InvalidContent, StorageUnavailable, list_names
from app.live.registry import LiveMachine
from app.services.context import Context
from app.services.fleet import HOLDOUT, FleetRequest
from app.services.load_machine import lacks_reading, load_machine, restore_past
from app.services.run_analyses import AnalysisRunner


async def get_context(request: Request) -> Context:
    """Give the application's context."""
    context: Context = request.app.state.context
    return context


async def get_runner(request: Request) -> AnalysisRunner:
    """Give who runs the queued analyses."""
    runner: AnalysisRunner = request.app.state.runner
    return runner


async def machine_in_memory(request: Request, context: Context, machine_id: str) -> LiveMachine:
    """Find a machine in memory, or bring it there once, when it is our turn."""
    live = context.live.get(machine_id)
    if live is None:
        turns: Turns = request.app.state.turns
        async with turns.taken():
            live = await run_in_threadpool(load_machine, context, machine_id)
    return live


async def machine_with_readings(request: Request, context: Context, machine_id: str) -> LiveMachine:
    """Find the same, with its latest readings as far as the database is there."""
    live = await machine_in_memory(request, context, machine_id)
    if lacks_reading(context, live) and context.live.database.trouble is None:
        turns: Turns = request.app.state.turns
        with suppress(StorageUnavailable):
            async with turns.taken():
                await run_in_threadpool(restore_past, context, live)
    return live


async def refuse_unknown_query(request: Request) -> None:
    """Refuse parameters that a route does not know: a misspelt one would not be missed.

    Raises
    ------
    InvalidContent
        That names the parameters of the route.
    """
    params = _query_params(request.scope["route"].dependant)
    names = dict.fromkeys(field.alias for field in params)
    for name in request.query_params:
        if name not in names:
            expected = (
                f"the query parameters {list_names(names)}" if names else "no query parameter"
            )
            raise InvalidContent.of_field(name, f"expected {expected}, got {name!r}")


def _query_params(dependant: Dependant) -> Iterator[Any]:
    """List the parameters of a route and of what it depends on."""
    yield from dependant.query_params
    for further in dependant.dependencies:
        yield from _query_params(further)


PreviewQuery = Annotated[
    bool,
    Query(
        description="Whether nothing is stored, and the answer says what tables would lose, gain "
        "and change"
    ),
]
AcceptLossesQuery = Annotated[
    bool,
    Query(
        description="Whether the version is activated at once although its tables lose something"
    ),
]
CourseQuery = Annotated[
    bool,
    Query(
        description="Whether the course is stored as a verification of one set-up, zeroed at "
        "its first observation, with its temperatures as readings of the machine"
    ),
]

ContextDep = Annotated[Context, Depends(get_context)]
RunnerDep = Annotated[AnalysisRunner, Depends(get_runner)]
MapPath = Annotated[int, Path(description="The map's number", examples=[1])]
VerificationPath = Annotated[int, Path(description="The verification's number", examples=[1])]
AnalysisPath = Annotated[int, Path(description="The analysis' number", examples=[1])]
VersionPath = Annotated[int, Path(description="Number of the version", examples=[3])]
MachinePath = Annotated[str, Path(description="The machine's id", examples=["mcfv5050"])]


def fleet_question(
    effects: Annotated[
        list[str] | None,
        Query(max_length=100, description="A kind of effect that is looked for; all without it"),
    ] = None,
    holdout_fraction: Annotated[
        float,
        Query(
            gt=0.0,
            lt=0.9,
            description="Share of the visits that take no part in the search, below 0.9",
        ),
    ] = HOLDOUT,
) -> FleetRequest:
    """Read what the machines' analyses are asked."""
    return FleetRequest(effects=effects, holdout_fraction=holdout_fraction)


FleetQuestionQuery = Annotated[FleetRequest, Depends(fleet_question)]
