"""Measurements that make maps: what an instrument read goes in, components come out."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

from fastapi import Depends, Query, Request
from starlette.concurrency import run_in_threadpool

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute, in_a_thread
from app.api.dependencies import (
    AcceptLossesQuery,
    ContextDep,
    CourseQuery,
    MachinePath,
    PreviewQuery,
    machine_in_memory,
)
from app.api.methods.method import Method
from app.api.methods.registry import METHODS
from app.api.router import Router
from app.api.turns import Turns
from app.services.measurements import (
    MeasurementAnswer,
    SimulatedStepDiagonal,
    StepDiagonalSimulation,
    Storing,
    simulate_step_diagonal,
)

router = Router(
    route_class=BodyRoute, prefix="/v1/machines/{machine}/measurements", tags=["measurements"]
)


def _storing(
    store: Annotated[
        bool, Query(description="Whether the components are stored as an error map")
    ] = False,
    preview: PreviewQuery = False,
    accept_losses: AcceptLossesQuery = False,
) -> Storing:
    return Storing(store, preview, accept_losses)


def _storing_course(
    storing: Annotated[Storing, Depends(_storing)], store_verification: CourseQuery = False
) -> Storing:
    return replace(storing, course=store_verification)


def _add_route(method: Method[Any, Any]) -> None:
    """Let a method be asked under its name."""

    async def measure(
        request: Request, context: ContextDep, machine: MachinePath, body: Any, storing: Any
    ) -> MeasurementAnswer:
        described = (await machine_in_memory(request, context, machine)).current.model.machine
        # A million readings take seconds: they are evaluated before it is our turn at the database.
        evaluated = await in_a_thread(lambda: method.evaluate(context, described, body))
        turns: Turns = request.app.state.turns
        async with turns.taken():
            return await run_in_threadpool(
                method.store, method, context, described, body, evaluated, storing
            )

    beside = _storing_course if method.has_course else _storing
    measure.__name__ = f"post_{method.name.replace('-', '_')}"
    measure.__annotations__ |= {
        "body": method.request,
        "storing": Annotated[Storing, Depends(beside)],
        "return": method.answer,
    }
    router.post(
        f"/{method.name}",
        summary=method.summary,
        description=method.about,
    )(measure)


for _method in METHODS.values():
    _add_route(_method)


@router.post("/step-diagonal/simulate", summary="What a laser would read on the step diagonals")
@needs(Role.VIEWER)
def post_simulation(
    context: ContextDep, machine: MachinePath, body: StepDiagonalSimulation
) -> SimulatedStepDiagonal:
    """Walk the stored machine along its diagonals: for training, and to check a set-up."""
    return simulate_step_diagonal(context, machine, body)
