"""The machine in three dimensions: errors at points, grids, accuracy, levels, and pictures."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import orjson
from fastapi import Header, Query
from starlette.responses import Response

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute, body_of_at_most
from app.api.dependencies import ContextDep, MachinePath
from app.api.media_types import ANSWER_HEADER, ARROW, HTML, JSON, NPY
from app.api.negotiation import chosen_form
from app.api.pages import Page
from app.api.router import Router
from app.api.table_json import OPTIONS
from app.api.vectors import vectors_response
from app.geometry.line_accuracy import LineAccuracy, LinesRequest, line_accuracy
from app.geometry.nonrigid_presets import NONRIGID_PRESETS, NonrigidPreset
from app.pages.picture_page import picture_page
from app.pages.plotly_script import INLINE
from app.pictures.figure_json import figure_json
from app.services.compute_grid import Grid, GridRequest, compute_grid
from app.services.context import Context
from app.services.geometry import (
    Accuracy,
    AccuracyRequest,
    Levels,
    LevelsRequest,
    NeededComponents,
    PictureRequest,
    RotaryError,
    RotaryErrorRequest,
    VolumetricError,
    VolumetricErrorRequest,
    assess_accuracy,
    check_components,
    compare_levels,
    compute_rotary_error,
    compute_volumetric_error,
    picture_work_volume,
)

router = Router(route_class=BodyRoute, tags=["geometry"])
MACHINE = "/v1/machines/{machine}"

_VECTORS: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {
            NPY: {"schema": {"type": "string", "format": "binary"}},
            ARROW: {"schema": {"type": "string", "format": "binary"}},
        },
        "headers": {
            ANSWER_HEADER: {
                "description": "What the answer says of itself, with npy and Arrow",
                "content": {JSON: {"schema": {"$ref": "#/components/schemas/AnswerHead"}}},
            }
        },
    }
}


@router.post(
    MACHINE + "/volumetric-error",
    summary="Volumetric error at points",
    response_model=VolumetricError,
    responses=_VECTORS,
    openapi_extra=body_of_at_most(64),
)
@needs(Role.VIEWER)
def post_volumetric_error(
    context: ContextDep,
    machine: MachinePath,
    body: VolumetricErrorRequest,
    accept: Annotated[str, Header(description=f"`{JSON}`, `{NPY}` or `{ARROW}`")] = JSON,
) -> Response:
    """Sum all errors, with squareness, lever arms and tool offset, at up to a million points.

    With `Accept: application/x-npy` the answer is one numpy array of shape (n, 6), errors
    x, y, z [µm] and orientation x, y, z [µrad]; as an Arrow stream it has these as
    columns. What JSON says beside the numbers is then in the header `Thermap-Answer`.
    """
    errors = compute_volumetric_error(context, machine, body)
    return vectors_response(chosen_form(accept, [JSON, NPY, ARROW]), errors)


@router.post(
    MACHINE + "/compensation/grid",
    summary="Grid of errors for a controller that interpolates trilinearly",
    response_model=Grid,
)
@needs(Role.VIEWER)
def post_grid(context: ContextDep, machine: MachinePath, body: GridRequest) -> Response:
    """Give the corner values at stated nodes, or of the coarsest grid for a tolerance.

    Beside them stands, for each cell, how far trilinear interpolation is from the model.
    """
    grid = compute_grid(context, machine, body)
    return Response(orjson.dumps(grid, option=OPTIONS), media_type=JSON)


@router.post(MACHINE + "/volumetric-accuracy", summary="Volumetric accuracy by every definition")
@needs(Role.VIEWER)
def post_accuracy(context: ContextDep, machine: MachinePath, body: AccuracyRequest) -> Accuracy:
    """Measure the work volume by the chapter's sums, definitions 1 and 2, diagonals and lines."""
    return assess_accuracy(context, machine, body)


@router.post("/v1/volumetric-accuracy/from-lines", summary="ELv and ELSv from measured lines")
@needs(Role.VIEWER)
def post_accuracy_from_lines(body: LinesRequest) -> LineAccuracy:
    """Compute ELv and ELSv as the chapter's Table 8.2 has them; nothing is stored."""
    return line_accuracy(body.linear_um, body.straightness_um)


@router.post(
    MACHINE + "/compensation/levels", summary="What better controllers would leave of the error"
)
@needs(Role.VIEWER)
def post_levels(context: ContextDep, machine: MachinePath, body: LevelsRequest) -> Levels:
    """Compare controllers that know displacement, straightness, angles or slopes.

    Each level has the tables that such a controller needs, with squareness folded into
    straightness, and what it leaves of the volumetric error over the work volume.
    """
    return compare_levels(context, machine, body)


@router.post(
    MACHINE + "/rotary-axis-error",
    summary="What location errors of rotary axes do to carried points",
    response_model=RotaryError,
)
@needs(Role.VIEWER)
def post_rotary_error(
    context: ContextDep, machine: MachinePath, body: RotaryErrorRequest
) -> Response:
    """Turn points about the axes where they are and where they should be: the difference."""
    rotary = compute_rotary_error(context, machine, body)
    return Response(orjson.dumps(rotary, option=OPTIONS), media_type=JSON)


@router.get(MACHINE + "/needed-components", summary="Which errors have to be measured")
def get_needed_components(
    context: ContextDep,
    machine: MachinePath,
    preset: Annotated[
        str | None,
        Query(
            description="A kind of machine that is not rigid, which adds its slopes: "
            "`horizontal-counterweight` (8.19–8.36) or `large-gantry` (8.37–8.54)",
            examples=["large-gantry"],
        ),
    ] = None,
    tool_length_mm: Annotated[
        float,
        Query(ge=-1e6, le=1e6, allow_inf_nan=False, description="Tool offset T along z [mm]"),
    ] = 0.0,
) -> NeededComponents:
    """List the errors that the volumetric error consists of, and which the model lacks."""
    return check_components(context, machine, (0.0, 0.0, tool_length_mm), preset)


@router.get("/v1/nonrigid-presets", summary="List the kinds of machines that are not rigid")
def get_nonrigid_presets() -> list[NonrigidPreset]:
    """List which nonrigid slopes each kind of machine has (8.19–8.54)."""
    return list(NONRIGID_PRESETS.values())


_pictures = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}", tags=["geometry"])

PLOTLY_JS = "/docs-assets/plotly.min.js"
"""Where a browser finds plotly, and keeps it; a page that is asked for as a file contains it."""

_FORMS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "A page, or a plotly figure as JSON: what other answers about the machine "
        "in three dimensions have as `complete`, `warnings` and `counted_as_zero` stands in its "
        "`layout.meta`",
        "content": {HTML: {"schema": {"type": "string"}}, JSON: {"schema": {"type": "object"}}},
    }
}
AcceptHeader = Annotated[str, Header(description=f"`{HTML}` or `{JSON}`")]


@_pictures.get(
    "/picture",
    summary="Picture of the distorted work volume at the latest reading",
    responses=_FORMS,
    response_class=Response,
)
def get_picture(
    context: ContextDep,
    machine: MachinePath,
    missing_components: Annotated[
        Literal["refuse", "zero"],
        Query(description="Whether components that no two maps have may count as zero"),
    ] = "refuse",
    accept: AcceptHeader = JSON,
) -> Response:
    """Draw the work volume with exaggerated error vectors; a browser is shown a page.

    The page loads plotly from the service: it is no file to be kept. `POST` writes one that is.
    """
    body = PictureRequest.model_validate({"missing_components": missing_components})
    return _picture(context, machine, body, accept, PLOTLY_JS)


@_pictures.post(
    "/picture",
    summary="Picture of the distorted work volume",
    responses=_FORMS,
    response_class=Response,
)
@needs(Role.VIEWER)
def post_picture(
    context: ContextDep, machine: MachinePath, body: PictureRequest, accept: AcceptHeader = JSON
) -> Response:
    """Draw the work volume at stated temperatures, with a tool offset, in a stated volume.

    The page contains plotly, some 5 MB: as a file it needs no other.
    """
    return _picture(context, machine, body, accept, INLINE)


def _picture(
    context: Context, machine: str, body: PictureRequest, accept: str, plotly_js: str
) -> Response:
    figure = picture_work_volume(context, machine, body)
    headers = {"Vary": "Accept", "Cache-Control": "no-cache"}
    if chosen_form(accept, [JSON, HTML]) == HTML:
        written = picture_page(figure, plotly_js=plotly_js)
        return Page(written, scripts=2 if plotly_js == INLINE else 1, headers=headers)
    return Response(figure_json(figure), media_type=JSON, headers=headers)


router.routes.extend(_pictures.routes)
