"""Files of maps and checks: read, shown as they were read, stored, downloaded; templates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Union
from urllib.parse import quote

from fastapi import Depends, Header, Query, Request, Response
from fastapi import Path as PathOf

from app.answer import fields_of
from app.api.bodies import BodyRoute, FileRoute, in_a_thread
from app.api.dependencies import (
    AnalysisPath,
    ContextDep,
    MachinePath,
    MapPath,
    VerificationPath,
)
from app.api.media_types import CSV, HTML, JSON
from app.api.methods.registry import METHODS
from app.api.negotiation import chosen_form
from app.api.pages import Page, take_reader
from app.api.router import Router
from app.api.routes.error_maps import store_map
from app.api.routes.loop import answer_to_verification
from app.api.uploads import (
    FILE_BODY,
    BesideQuery,
    FileContent,
    FileName,
    FoundMap,
    FoundReadings,
    FoundVerification,
    StoringQuery,
    refuse_what_readings_have,
    uploaded_map,
    uploaded_verification,
)
from app.errors import FieldError, InvalidContent, UnknownThing, counted, list_names
from app.files.csv_writing import (
    check_template,
    csv_of_check,
    csv_of_map,
    csv_of_visit,
    map_template,
)
from app.files.file_kind import FileKind, kind_of_file
from app.geometry.needed_components import needed_components
from app.pages.dashboard.loop import check_preview
from app.pages.dashboard.maps import upload_preview
from app.pages.what_was_read import read_of_map, read_of_verification
from app.services.analyses import report_analysis
from app.services.context import Context
from app.services.error_maps import ErrorMapAnswer, MapPreview, preview_error_map
from app.services.machines import show_error_map, show_error_maps, show_machine
from app.services.measurements import MeasurementAnswer, Storing, measured_machine
from app.services.observations import PlannedVerification, VisitPreview
from app.services.verifications import (
    StoredVerificationAnswer,
    VerificationPreview,
    check_places,
    check_verification,
    extent_of,
    remarks_on_verification,
    show_verification,
    without_readings,
)

PlannedQuery = Annotated[
    bool,
    Query(
        description="Whether check measurements are yet to be made: they need no values, and a "
        "preview gives them as `…/analyses/plan` takes them"
    ),
]
Found = FoundMap | FoundReadings | FoundVerification

ImportedFile = (
    ErrorMapAnswer | StoredVerificationAnswer | MapPreview | VerificationPreview | VisitPreview
)
_ANSWER: Any = Union[ImportedFile, *(method.answer for method in METHODS.values())]

_NOTHING_NEW: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "model": _ANSWER,
        "description": "The preview; or what is stored already",
        "content": {HTML: {"schema": {"type": "string"}}},
    }
}


async def _recognised(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    content: FileContent,
    beside: BesideQuery,
    storing: StoringQuery,
    name: FileName = "file.csv",
    kind: Annotated[
        FileKind | None,
        Query(description="What it holds, `map` or `check`; one of the other kind is refused"),
    ] = None,
    expected: Annotated[
        FileKind,
        Query(description="What it is taken for where neither it nor `kind` says what it holds"),
    ] = FileKind.MAP,
    planned: PlannedQuery = False,
) -> Found:
    """Read a file as what it is; what looks like neither is read as what is expected."""
    if planned:
        kind = FileKind.CHECK
        if storing.store and not storing.preview:
            raise InvalidContent.of_field(
                "planned", "expected with `preview`: what is yet to be measured cannot be stored"
            )
    kind = kind or await in_a_thread(lambda: kind_of_file(content, Path(name))) or expected
    if kind is FileKind.MAP:
        found = await uploaded_map(request, context, machine, content, beside, storing, name)
        if isinstance(found, FoundMap):
            refuse_what_readings_have(name, beside, storing)
        return found
    if beside.names:
        message = f"expected for a map alone, but {name} holds {kind.words}"
        wrong = [FieldError(field, message) for field in beside.names]
        raise InvalidContent(f"{list_names(beside.names)}: {message}", wrong)
    return await uploaded_verification(machine, content, name, is_planned=planned)


_uploads = Router(route_class=FileRoute, read_first=_recognised, tags=["error maps"])


@_uploads.post(
    "/v1/machines/{machine}/files",
    status_code=201,
    summary="Store what a file holds: an error map, an instrument's readings or check measurements",
    response_model=_ANSWER,
    responses=_NOTHING_NEW,
    openapi_extra=FILE_BODY,
)
def post_file(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    upload: Annotated[Found, Depends(_recognised)],
    storing: StoringQuery,
    response: Response,
    name: FileName = "file.csv",
    planned: PlannedQuery = False,
    accept: Annotated[str, Header(description=f"`{JSON}`, or `{HTML}` for a preview")] = JSON,
) -> ImportedFile | MeasurementAnswer | Page:
    """Store an error map or check measurements: CSV, an Excel workbook, or JSON.

    Which of them it is, is recognised by its columns, or by the names in its JSON. A map may also
    be an instrument's own file (Renishaw's linear .rtl), or with `method` a table of readings that
    make one: they are answered as `…/measurements/{method}` answers. What is wrong in a file is
    answered with line and column, under `file`; what a map's file does not say under its own name,
    and is stated in the query. What is stated takes precedence over what the file says. Without a
    label check measurements are called as the file. What of the file was not read stands in
    `warnings`. All else is as with the same in JSON. A preview says how the file was read; whether
    tables change check measurements do not decide.
    """
    as_page = storing.preview and not planned and chosen_form(accept, [JSON, HTML]) == HTML
    if as_page:
        take_reader(request)
    if isinstance(upload, FoundVerification):
        answer = _answer_to_check(context, machine, upload, storing, response, planned=planned)
        if as_page and isinstance(answer, VerificationPreview):
            return _page(check_preview(upload.verification, name, answer.warnings))
        return answer
    if as_page:
        return _page(_preview_of_map(context, machine, upload, name))
    if isinstance(upload, FoundMap):
        return _answer_to_map(context, machine, upload, storing, response)
    return _answer_to_readings(context, upload, storing, response)


def _page(part: str) -> Page:
    return Page(part, scripts=0, headers={"Vary": "Accept", "Cache-Control": "no-store"})


def _answer_to_check(
    context: Context,
    machine: str,
    upload: FoundVerification,
    storing: Storing,
    response: Response,
    *,
    planned: bool,
) -> StoredVerificationAnswer | VerificationPreview | VisitPreview:
    check = upload.verification
    try:
        if planned:
            check_places(measured_machine(context, machine), check.observations)
        elif storing.preview:
            check_verification(context, machine, check)
        else:
            return answer_to_verification(context, machine, check, response, upload.remarks)
    except InvalidContent as error:
        raise upload.refusal(error) from None
    response.status_code = 200
    if planned:
        visit = PlannedVerification.model_validate(upload.body)
        return VisitPreview(planned=visit, warnings=[*upload.remarks, *check.remarks])
    remarks = [
        *upload.remarks,
        *remarks_on_verification(context, machine, check),
        *without_readings(context, machine, check),
    ]
    read = list(read_of_verification(check).lines())
    return VerificationPreview(**extent_of(check), warnings=remarks, read=read)


def _answer_to_map(
    context: Context, machine: str, found: FoundMap, storing: Storing, response: Response
) -> ErrorMapAnswer | MapPreview:
    error_map, notes = found.error_map, found.remarks
    if not storing.preview:
        return store_map(
            context,
            machine,
            error_map,
            response,
            accept_losses=storing.accept_losses,
            notes=notes,
        )
    response.status_code = 200
    previewed = preview_error_map(context, machine, error_map)
    fields = fields_of(previewed) | {"warnings": [*notes, *previewed.warnings]}
    return MapPreview(
        **fields,
        label=error_map.label,
        components=list(error_map.tables),
        read=list(read_of_map(error_map).lines()),
    )


def _answer_to_readings(
    context: Context, found: FoundReadings, storing: Storing, response: Response
) -> MeasurementAnswer:
    method = found.method
    answer = method.store(method, context, found.machine, found.body, found.evaluated, storing)
    if answer.map_id is not None:
        machine = found.machine.id
        response.headers["Location"] = f"/v1/machines/{machine}/error-maps/{answer.map_id}"
    if not answer.is_new:
        response.status_code = 200
    return replace(answer, warnings=found.remarks)


def _preview_of_map(
    context: Context, machine: str, found: FoundMap | FoundReadings, name: str
) -> str:
    """Write what was read of a file and what storing it would do, as a part of a page."""
    readings = found if isinstance(found, FoundReadings) else None
    found = found.as_map() if isinstance(found, FoundReadings) else found
    return upload_preview(
        preview_error_map(context, machine, found.error_map),
        name,
        found.error_map,
        found.remarks,
        readings.method.name if readings else None,
        readings.evaluated.result.figures if readings else {},
    )


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
    number: Annotated[
        int, PathOf(description="The visit's place on the list, from 1", examples=[1])
    ],
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


router.routes.extend(_uploads.routes)
