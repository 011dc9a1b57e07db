"""The live table, from memory, and predictions."""

from __future__ import annotations

from typing import Any

import orjson
from fastapi import APIRouter, FastAPI
from pydantic import TypeAdapter
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from app.api.dependencies import ContextDep, MachinePath
from app.api.live_table_route import LiveTableRoute, documented_by
from app.api.schemas.compensation import (
    CompensationAnswer,
    CompensationRequest,
    CurrentCompensationAnswer,
    current_document,
    table_document,
)
from app.api.schemas.predictions import PredictionAnswer, PredictionRequest
from app.live.registry import LiveMachine
from app.services.context import Context
from app.services.live_table import current_state, current_table, table_at
from app.services.load_machine import load_machine
from app.services.predict_errors import predict_errors

router = APIRouter(prefix="/v1/machines/{machine}", tags=["live"])
PATH = "/v1/machines/{machine}/compensation"
ORJSON_OPTIONS = orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_UTC_Z
_REQUEST = TypeAdapter(CompensationRequest)


def add_live_routes(app: FastAPI) -> None:
    """Add the live table's routes, first so that no other pattern is tried before them."""
    common: dict[str, Any] = {
        "route_class_override": LiveTableRoute,
        "tags": ["live"],
        "response_model_exclude_none": True,
    }
    app.router.add_api_route(
        PATH,
        _post_compensation,
        methods=["POST"],
        summary="Compensation table for stated temperatures",
        response_model=CompensationAnswer,
        **common,
    )
    app.router.add_api_route(
        PATH,
        _get_compensation,
        methods=["GET"],
        summary="Compensation table at the latest reading",
        response_model=CurrentCompensationAnswer,
        responses={304: {"description": "Unchanged since the ETag in If-None-Match"}},
        **common,
    )


@router.post("/predictions", tags=["live"], summary="Predict errors at given times")
def post_predictions(
    context: ContextDep, machine: MachinePath, body: PredictionRequest
) -> PredictionAnswer:
    """Say what the model predicts, with the stored readings' temperatures at each time."""
    found = predict_errors(context, machine, body.to_observations(), body.model_version)
    return PredictionAnswer(
        model_version=found.model_version,
        predicted_um=found.values,
        status=found.status,
        warnings=found.warnings,
    )


async def _post_document(machine: MachinePath, body: CompensationRequest) -> None:
    """Compute the table at these temperatures; nothing is stored."""


async def _get_document(machine: MachinePath) -> None:
    """Compute the table at the latest reading, with every sensor's state.

    The ETag changes with the model, the reading and the sensors' states; while it
    does not, If-None-Match is answered with 304.
    """


@documented_by(_post_document)
async def _post_compensation(request: Request) -> Response:
    context, live = await _live(request)
    stated = _REQUEST.validate_json(await request.body())
    return _json(table_document(table_at(context, live, stated.temperatures_c)))


@documented_by(_get_document)
async def _get_compensation(request: Request) -> Response:
    context, live = await _live(request)
    state = current_state(context, request.path_params["machine"], live)
    headers = {"ETag": f'W/"{state.tag}"', "Cache-Control": "no-cache"}
    if _matches(request.headers.get("if-none-match", ""), state.tag):
        return Response(status_code=304, headers=headers)
    return _json(current_document(current_table(context, live, state)), headers)


async def _live(request: Request) -> tuple[Context, LiveMachine]:
    """Find the machine in memory, or bring it there once."""
    context: Context = request.app.state.context
    machine_id = request.path_params["machine"]
    live = context.live.get(machine_id)
    if live is None:
        live = await run_in_threadpool(load_machine, context, machine_id)
    return context, live


def _json(document: dict[str, Any], headers: dict[str, str] | None = None) -> Response:
    content = orjson.dumps(document, option=ORJSON_OPTIONS)
    return Response(content, media_type="application/json", headers=headers)


def _matches(if_none_match: str, tag: str) -> bool:
    """Compare weakly (RFC 9110, 13.1.2)."""
    stated = {part.strip().removeprefix("W/") for part in if_none_match.split(",")}
    return f'"{tag}"' in stated or "*" in stated
