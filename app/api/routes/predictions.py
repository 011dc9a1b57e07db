"""Predictions."""

from __future__ import annotations

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute, body_of_at_most
from app.api.dependencies import ContextDep, MachinePath
from app.api.router import Router
from app.api.schemas.predictions import PredictionAnswer, PredictionRequest
from app.services.predictions import predict_errors

router = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}", tags=["live"])


@router.post(
    "/predictions", summary="Predict errors at given times", openapi_extra=body_of_at_most(32)
)
@needs(Role.VIEWER)
def post_predictions(
    context: ContextDep, machine: MachinePath, body: PredictionRequest
) -> PredictionAnswer:
    """Say what the model predicts, with the stored readings' temperatures at each time."""
    predicted = predict_errors(
        context,
        machine,
        body.to_observations(),
        body.model_version,
        missing_as_zero=body.missing_components == "zero",
    )
    return PredictionAnswer(
        model_version=predicted.model_version,
        predicted_um=predicted.values,
        status=predicted.status,
        counted_as_zero=predicted.counted_as_zero,
        warnings=predicted.warnings,
    )
