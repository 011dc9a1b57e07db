"""Maps and checks as files to keep or to change, and templates to fill in."""

from __future__ import annotations

from typing import Annotated, Any, Final
from urllib.parse import quote

from fastapi import Path, Query, Response

from app.api.bodies import BodyRoute
from app.api.dependencies import (
    AnalysisPath,
    ContextDep,
    MachinePath,
    MapPath,
    VerificationPath,
)
from app.api.media_types import CSV
from app.api.router import Router
from app.errors import UnknownThing, counted
from app.files.csv_writing import (
    check_template,
    csv_of_check,
    csv_of_map,
    csv_of_visit,
    map_template,
)
from app.files.file_kind import FileKind
from app.geometry.needed_components import needed_components
from app.services.analyses import report_analysis
from app.services.machines import show_error_map, show_error_maps, show_machine
from app.services.verifications import show_verification

_ANY_TOOL: Final = (1.0, 1.0, 1.0)
"""An offset with which every rotation has a lever arm [mm]."""

_FILE: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The file", "content": {CSV: {"schema": {"type": "string"}}}}
}

router = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}")


@router.get(
    "/error-maps/{map_id}/file",
    summary="Download an error map as CSV",
    tags=["error maps"],
    response_class=Response,
    responses=_FILE,
)
def get_map_file(context: ContextDep, machine: MachinePath, map_id: MapPath) -> Response:
    """Write a map as the file that `…/files` reads; a comment names what it has no column for."""
    stored, _ = show_error_map(context, machine, map_id)
    return _file(csv_of_map(machine, stored.error_map), stored.error_map.label)


@router.get(
    "/verifications/{verification_id}/file",
    summary="Download a verification as CSV",
    tags=["closing the loop"],
    response_class=Response,
    responses=_FILE,
)
def get_verification_file(
    context: ContextDep, machine: MachinePath, verification_id: VerificationPath
) -> Response:
    """Write a verification as the file that `…/files` reads."""
    _, check = show_verification(context, machine, verification_id)
    return _file(csv_of_check(machine, check), check.label)


@router.get(
    "/analyses/{analysis_id}/visits/{number}",
    summary="Download a visit to make as CSV",
    tags=["closing the loop"],
    response_class=Response,
    responses=_FILE,
)
def get_visit_file(
    context: ContextDep,
    machine: MachinePath,
    analysis_id: AnalysisPath,
    number: Annotated[int, Path(description="The visit's place on the list, from 1", examples=[1])],
) -> Response:
    """Write a visit as the file that planning and `thermap program visit` read."""
    _, result = report_analysis(context, machine, analysis_id)
    if not 0 < number <= len(result.next_visits):
        proposed = counted(len(result.next_visits), "visit")
        raise UnknownThing(f"analysis {analysis_id} proposes {proposed}, and no visit {number}")
    return _file(csv_of_visit(machine, result.next_visits[number - 1]), f"visit-{number}")


@router.get(
    "/files/template",
    summary="Download a file to fill in",
    tags=["error maps"],
    response_class=Response,
    responses=_FILE,
)
def get_template(
    context: ContextDep,
    machine: MachinePath,
    kind: Annotated[FileKind, Query(description="What it is to hold")] = FileKind.MAP,
) -> Response:
    """Write an empty file with this machine's sensors, axes and components.

    The components are those of its maps, before the first map those that a rigid machine of its
    configuration has.
    """
    described = show_machine(context, machine).machine
    maps, _ = show_error_maps(context, machine)
    of_maps = {code for stored in maps for code in stored.error_map.tables}
    codes = of_maps or needed_components(described.chain, _ANY_TOOL)
    write = map_template if kind is FileKind.MAP else check_template
    return _file(write(described, codes), f"{machine}-{kind}")


def _file(text: str, name: str) -> Response:
    """Send a file under a name of which no program makes anything else."""
    plain = "".join(letter if letter.isalnum() or letter in " ._-" else "_" for letter in name)
    named = f"attachment; filename*=UTF-8''{quote(plain[:100])}.csv"
    return Response(text, media_type=CSV, headers={"Content-Disposition": named})
