"""Verifications: what was measured to compare the model with."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, Final

import orjson
from fastapi import Response
from pydantic import TypeAdapter

from app.answer import fields_of
from app.api.bodies import BodyRoute, body_of_at_most
from app.api.dependencies import ContextDep, MachinePath, VerificationPath
from app.api.media_types import JSON
from app.api.router import Router
from app.api.table_json import OPTIONS
from app.effects.observations import Verification
from app.services.context import Context
from app.services.observations import MeasuredObservation, VerificationRequest
from app.services.verifications import (
    StoredVerificationAnswer,
    Watch,
    WholeVerificationAnswer,
    delete_verification,
    remarks_on_verification,
    show_verification,
    show_verifications,
    show_watch,
    store_verification,
)
from app.storage.records import StoredVerification

router = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}", tags=["closing the loop"])
PATH = "/verifications"

_STORED: Final = TypeAdapter(StoredVerification)

NOTHING_NEW: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "model": StoredVerificationAnswer,
        "description": "The verification, which is stored already",
    }
}


@router.post(
    PATH,
    status_code=201,
    summary="Store a verification",
    responses=NOTHING_NEW,
    openapi_extra=body_of_at_most(32),
)
def post_verification(
    context: ContextDep, machine: MachinePath, body: VerificationRequest, response: Response
) -> StoredVerificationAnswer:
    """Store up to 100,000 observations: all of them or, if one is wrong, none.

    The same content under the same label again answers 200 with the stored verification. What
    the active model has no table for is stored too; `warnings` say that nothing is compared
    with it.
    """
    return answer_to_verification(context, machine, body.to_verification(), response)


@router.get(PATH, summary="List verifications")
def get_verifications(context: ContextDep, machine: MachinePath) -> list[StoredVerification]:
    """List a machine's verifications without their observations, oldest first."""
    return show_verifications(context, machine)


@router.get(
    PATH + "/{verification_id}",
    summary="Show a verification",
    response_model=WholeVerificationAnswer,
)
def get_verification(
    context: ContextDep, machine: MachinePath, verification_id: VerificationPath
) -> Response:
    """Show one verification with its observations, in our components and signs."""
    stored, verification = show_verification(context, machine, verification_id)
    head = _STORED.dump_python(stored)
    head["observations"] = [
        MeasuredObservation.of(o, datetime.fromtimestamp(o.time_s, UTC))
        for o in verification.observations
    ]
    return Response(orjson.dumps(head, option=OPTIONS), media_type=JSON)


@router.delete(PATH + "/{verification_id}", status_code=204, summary="Delete a verification")
def remove_verification(
    context: ContextDep, machine: MachinePath, verification_id: VerificationPath
) -> None:
    """Delete a verification; analyses of it keep their results."""
    delete_verification(context, machine, verification_id)


@router.get("/watch", summary="Whether the machine still is as its model says")
def get_watch(context: ContextDep, machine: MachinePath) -> Watch:
    """Show where the sequential test of the active version stands, over all verifications.

    An unchanged machine is ever called changed with a probability of at most `false_alarm`,
    however often it is looked at. Each model version has a test of its own.
    """
    return show_watch(context, machine)


def answer_to_verification(
    context: Context,
    machine: str,
    verification: Verification,
    response: Response,
    notes: Sequence[str] = (),
) -> StoredVerificationAnswer:
    """Store a verification, whichever way it came; `notes` are of its file."""
    outcome = store_verification(context, machine, verification)
    response.status_code = 201 if outcome.is_new else 200
    response.headers["Location"] = f"/v1/machines/{machine}/verifications/{outcome.stored.id}"
    remarks = remarks_on_verification(context, machine, verification)
    return StoredVerificationAnswer(**fields_of(outcome.stored), warnings=[*notes, *remarks])
