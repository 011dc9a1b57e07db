"""What is asked of several machines together."""

from __future__ import annotations

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep, FleetQuestionQuery, RunnerDep
from app.api.router import Router
from app.identification.analysis.tried_effect import TriedEffect
from app.services.analyses import TriedEffectRequest, try_found_effect
from app.services.fleet import FleetRequest, FleetView, analyse_fleet, cancel_fleet, show_fleet

router = Router(route_class=BodyRoute, prefix="/v1/fleet", tags=["closing the loop"])


@router.get("", summary="Show what all machines' analyses say together")
@needs(Role.VIEWER, all_machines=True)
def get_fleet(context: ContextDep, question: FleetQuestionQuery) -> FleetView:
    """Say how far the analysis of every machine is, and what they all say together.

    An analysis serves that asked the same of the active model and all stored verifications. What
    helps where it was found is tried on sisters: for two seconds at most in one answer, so ask
    again until nothing goes on.
    """
    return show_fleet(context, question)


@router.post("/analyses", status_code=202, summary="Analyse every machine")
@needs(Role.METROLOGIST, all_machines=True)
def post_analyses(
    context: ContextDep, runner: RunnerDep, body: FleetRequest | None = None
) -> FleetView:
    """Ask for the analyses that are missing, and again for those that failed or were cancelled.

    What was asked already serves, by whomever. `refused` says which machine's could not be asked.
    """
    view = analyse_fleet(context, body or FleetRequest())
    runner.wake()
    return view


@router.post("/analyses/cancel", summary="Cancel the analyses of every machine")
@needs(Role.METROLOGIST, all_machines=True)
def post_cancel(
    context: ContextDep, runner: RunnerDep, body: FleetRequest | None = None
) -> FleetView:
    """Cancel the waiting and running analyses that asked this; finished ones stay."""
    view = cancel_fleet(context, body or FleetRequest())
    runner.wake()
    return view


@router.post("/tried-effects", summary="Try an effect of one machine on another")
@needs(Role.VIEWER, all_machines=True)
def post_tried_effect(context: ContextDep, body: TriedEffectRequest) -> TriedEffect:
    """Try an effect that was found on one machine, unchanged, on another one.

    Nothing is fitted and nothing is stored: every set-up of the other machine is held out.
    """
    return try_found_effect(context, body)
