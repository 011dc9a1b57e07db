"""Predictions."""

from __future__ import annotations

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute, body_of_at_most
from app.api.dependencies import ContextDep, MachinePath
from app.api.router import Router
from app.services.observations import PredictionRequest
from app.services.predictions import Predictions, predict_errors

router = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}", tags=["live"])


@router.post(
    "/predictions", summary="Predict errors at given times", openapi_extra=body_of_at_most(32)
)
@needs(Role.VIEWER)
def post_predictions(
    context: ContextDep, machine: MachinePath, body: PredictionRequest
) -> Predictions:
    """Say what the model predicts, with the stored readings' temperatures at each time."""
    return predict_errors(
        context,
        machine,
        body.observations,
        body.model_version,
        missing_as_zero=body.missing_components == "zero",
    )
