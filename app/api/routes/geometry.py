"""The machine in three dimensions: errors at points, grids, accuracy, levels, rotary axes."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import orjson
from fastapi import Header, Query
from starlette.responses import Response

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute, body_of_at_most
from app.api.dependencies import ContextDep, MachinePath
from app.api.media_types import ANSWER_HEADER, ARROW, JSON, NPY
from app.api.negotiation import chosen_form
from app.api.router import Router
from app.api.schemas.accuracy import (
    AccuracyAnswer,
    AccuracyRequest,
    LevelAnswer,
    LevelsAnswer,
    LevelsRequest,
    LinesRequest,
    volume_of,
)
from app.api.schemas.error_field import head_of
from app.api.schemas.grids import GridAnswer, GridRequest
from app.api.schemas.rotary import RotaryErrorAnswer, RotaryErrorRequest
from app.api.schemas.volumetric_error import VolumetricErrorAnswer, VolumetricErrorRequest
from app.api.table_json import OPTIONS
from app.api.vectors import vectors_response
from app.arrays import largest_length, rms_length
from app.geometry.line_accuracy import LineAccuracy, line_accuracy
from app.geometry.nonrigid_presets import NONRIGID_PRESETS, NonrigidPreset
from app.rounding import rounded, rounded_up, to_tenth_nm
from app.services.compute_grid import Grid, compute_grid, grid_for_tolerance
from app.services.geometry import (
    NeededComponents,
    assess_accuracy,
    check_components,
    compare_levels,
    compute_rotary_error,
    compute_volumetric_error,
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
    response_model=VolumetricErrorAnswer,
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
    errors = compute_volumetric_error(
        context,
        machine,
        body.question(),
        np.asarray(body.points_mm),
        outside_travel_allowed=body.outside_travel == "allow",
    )
    head = head_of(errors.answer, errors.warnings)
    form = chosen_form(accept, [JSON, NPY, ARROW])
    if form == JSON:
        head["outside_travel"] = errors.outside_travel
    errors_um, orientation_urad = errors.errors_um, errors.orientation_urad
    if body.several_states and errors_um.ndim == 2:
        errors_um, orientation_urad = errors_um[None], orientation_urad[None]
    return vectors_response(form, head, errors_um, orientation_urad)


@router.post(
    MACHINE + "/compensation/grid",
    summary="Grid of errors for a controller that interpolates trilinearly",
    response_model=GridAnswer,
)
@needs(Role.VIEWER)
def post_grid(context: ContextDep, machine: MachinePath, body: GridRequest) -> Response:
    """Give the corner values at stated nodes, or of the coarsest grid for a tolerance.

    Beside them stands, for each cell, how far trilinear interpolation is from the model.
    """
    nodes = body.nodes()
    if nodes is None:
        tolerance_um = body.tolerance_um or 0.0
        grid = grid_for_tolerance(context, machine, body.question(), tolerance_um, body.travels())
    else:
        x, y, z = (np.array(along, dtype=np.float64) for along in nodes)
        grid = compute_grid(context, machine, body.question(), (x, y, z))
    return Response(_grid_json(grid), media_type=JSON)


@router.post(MACHINE + "/volumetric-accuracy", summary="Volumetric accuracy by every definition")
@needs(Role.VIEWER)
def post_accuracy(
    context: ContextDep, machine: MachinePath, body: AccuracyRequest
) -> AccuracyAnswer:
    """Measure the work volume by the chapter's sums, definitions 1 and 2, diagonals and lines."""
    accuracy = assess_accuracy(context, machine, body.question(), body.travels())
    return AccuracyAnswer.of(
        head_of(accuracy.answer, accuracy.warnings), accuracy.volume, accuracy.accuracy
    )


@router.post("/v1/volumetric-accuracy/from-lines", summary="ELv and ELSv from measured lines")
@needs(Role.VIEWER)
def post_accuracy_from_lines(body: LinesRequest) -> LineAccuracy:
    """Compute ELv and ELSv as the chapter's Table 8.2 has them; nothing is stored."""
    return line_accuracy(body.linear_um, body.straightness_um)


@router.post(
    MACHINE + "/compensation/levels", summary="What better controllers would leave of the error"
)
@needs(Role.VIEWER)
def post_levels(context: ContextDep, machine: MachinePath, body: LevelsRequest) -> LevelsAnswer:
    """Compare controllers that know displacement, straightness, angles or slopes.

    Each level has the tables that such a controller needs, with squareness folded into
    straightness, and what it leaves of the volumetric error over the work volume.
    """
    levels = compare_levels(context, machine, body.question(), body.travels(), body.points_per_axis)
    return LevelsAnswer(
        **head_of(levels.answer, levels.warnings),
        volume=volume_of(levels.volume),
        levels=[LevelAnswer.of(level) for level in levels.levels],
    )


@router.post(
    MACHINE + "/rotary-axis-error",
    summary="What location errors of rotary axes do to carried points",
    response_model=RotaryErrorAnswer,
)
@needs(Role.VIEWER)
def post_rotary_error(
    context: ContextDep, machine: MachinePath, body: RotaryErrorRequest
) -> Response:
    """Turn points about the axes where they are and where they should be: the difference."""
    points_mm = np.array(body.points_mm, dtype=np.float64)
    rotary = compute_rotary_error(
        context,
        machine,
        body.question(),
        points_mm,
        body.angles(),
        body.order,
        body.pivots(),
        body.compensated,
    )
    lengths = {
        f"{which}{name}_um": to_tenth_nm(of(vectors))
        for which, vectors in (("", rotary.errors_um), ("left_", rotary.left_um))
        for name, of in (("rms", rms_length), ("max", largest_length))
    }
    fields = head_of(rotary.answer, list(rotary.answer.warnings)) | {
        "errors_um": rounded(rotary.errors_um),
        "left_um": rounded(rotary.left_um),
        **lengths,
        "locations": {code: to_tenth_nm(value) for code, value in rotary.locations.items()},
    }
    return Response(orjson.dumps(fields, option=OPTIONS), media_type=JSON)


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


def _grid_json(found: Grid) -> bytes:
    grid, difference = found.grid, found.difference
    fields = head_of(found.answer, found.warnings) | {
        "x_mm": grid.x_mm,
        "y_mm": grid.y_mm,
        "z_mm": grid.z_mm,
        "errors_um": rounded(grid.errors_um),
        "compensation_um": rounded(0.0 - grid.errors_um),
        "largest_difference_um": rounded_up(difference.bound_length_um),
        "attained_difference_um": rounded(difference.attained_length_um),
        "largest_um": rounded_up(np.array(found.bound_um)).item(),
    }
    return orjson.dumps(fields, option=OPTIONS)
