"""Pictures: the work volume as it is distorted, as a page for people or a figure for programs."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import Header, Query
from starlette.responses import Response

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep, MachinePath
from app.api.media_types import HTML, JSON
from app.api.negotiation import chosen_form
from app.api.pages import Page
from app.api.router import Router
from app.pages.picture_page import picture_page
from app.pages.plotly_script import INLINE
from app.pictures.figure_json import figure_json
from app.services.context import Context
from app.services.geometry import PictureRequest, picture_work_volume

router = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}", tags=["geometry"])

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


@router.get(
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


@router.post(
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
