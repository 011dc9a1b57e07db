"""What is asked of several machines together."""

from __future__ import annotations

from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep
from app.api.router import Router
from app.api.schemas.analyses import TriedEffectRequest
from app.identification.analysis.tried_effect import TriedEffect
from app.services.analyses import try_found_effect

router = Router(route_class=BodyRoute, prefix="/v1/fleet", tags=["closing the loop"])


@router.post("/tried-effects", summary="Try an effect of one machine on another")
def post_tried_effect(context: ContextDep, body: TriedEffectRequest) -> TriedEffect:
    """Hold an effect that was found on one machine, as it stands, against another one.

    Nothing is fitted and nothing is stored: every set-up of the other machine is held out.
    """
    return try_found_effect(
        context,
        body.machine,
        body.analysis,
        body.effect,
        body.on,
        body.verifications,
        body.tried_together,
    )
