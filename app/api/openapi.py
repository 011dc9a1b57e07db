"""The words around the documented routes, and the page that shows them."""

from __future__ import annotations

from collections.abc import Mapping
from threading import Lock
from typing import Any, Final

from fastapi import FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from pydantic import Field, TypeAdapter
from starlette.requests import Request
from starlette.responses import JSONResponse

from app.access.keys import Role
from app.answer import Answer, answers
from app.api.access import needs
from app.api.pages import Page
from app.events.news import AnalysisNews, MissedEntries, WatchChange
from app.services.ask_field import AnswerHead
from app.stated import Schema

DOCUMENT: Final = "/openapi.json"

DESCRIPTION = """
Stores error maps measured in several thermal states, with the temperatures of their
sensors, and answers with the **compensation table** for live temperatures: each error
component interpolated linearly with the sensor assigned to it (C. Wang, 8.105-8.107).

* An *error* is actual minus nominal; the *compensation* is minus the error: what is to be
  added to the command.
* Units are in the fields' names: `position_mm`, `errors_um`, `temperatures_c`. Times are UTC.
* What is refused is refused whole, as `application/problem+json` with one entry for each
  field that is to blame.
"""

TAGS = [
    {"name": "live", "description": "The compensation table now, and predictions."},
    {"name": "controllers", "description": "The table as files that controllers read."},
    {"name": "geometry", "description": "The machine in three dimensions, at any temperatures."},
    {"name": "machines", "description": "Axes, sensors, and what happens outside the maps."},
    {"name": "error maps", "description": "What was measured in one thermal state."},
    {"name": "measurements", "description": "From what an instrument read to error maps."},
    {"name": "models", "description": "Which sensor each component follows; model versions."},
    {"name": "readings", "description": "Recorded temperatures."},
    {
        "name": "closing the loop",
        "description": "Verifications, what the model leaves of them, and what it lacks.",
    },
    {"name": "events", "description": "What happened, and by whose doing."},
    {"name": "connections", "description": "What the service reads beside HTTP."},
    {"name": "keys", "description": "Who may ask for what, where the service asks for keys."},
    {"name": "health", "description": "Whether the service is well."},
]


PROBLEMS = {
    "404": "Something that is named does not exist; the detail lists what exists",
    "409": "What is stored contradicts it",
    "413": "The body is too large",
    "415": "The body is no JSON by its header",
    "421": "The host is not one of this service's names",
    "401": "A key is needed, and none came or a wrong one",
    "403": "The key does not allow it, or another web page sent it",
    "429": "Wrong keys came too often from this address, or too many analyses wait",
    "422": "The content cannot be right",
    "507": "The database's disk is full: nothing was stored, what is stored can be read",
    "503": "The database is away, or too much waits; try again later",
}
_IN_NO_ROUTE: tuple[type[Answer], ...] = (WatchChange, AnalysisNews, MissedEntries, AnswerHead)
"""Shapes that streams alone send, or a header."""

_NOT_OURS = ("HTTPValidationError", "ValidationError")


class ProblemField(Schema):
    """One field that is to blame."""

    field: str = Field(description="Path of the field", examples=["temperatures_c.x-middle"])
    message: str = Field(description="What was expected, what came, and the unit")


class Problem(Schema):
    """Problem details (RFC 9457), as application/problem+json."""

    type: str = Field(description="Kind of problem", examples=["about:blank"])
    title: str = Field(description="The kind in words", examples=["Invalid content"])
    status: int = Field(description="HTTP status", examples=[422])
    detail: str = Field(description="What is the matter, in a sentence")
    errors: list[ProblemField] = Field(description="The fields that are to blame")


def document_problems(service: FastAPI) -> None:
    """Document every refusal as what it is: problem details."""
    plain = service.openapi
    writing = Lock()

    def openapi() -> dict[str, Any]:
        with writing:
            return write()

    def write() -> dict[str, Any]:
        if service.openapi_schema is None:
            document = _as_published(plain())
            schemas = document["components"]["schemas"]
            for name in _NOT_OURS:
                schemas.pop(name, None)
            reference = "#/components/schemas/{model}"
            models: tuple[type[Schema], ...] = (ProblemField, Problem)
            for model in models:
                written = model.model_json_schema(ref_template=reference)
                schemas.update(written.pop("$defs", {}))
                schemas[model.__name__] = written
            for shape in _IN_NO_ROUTE:
                adapter: TypeAdapter[Any] = TypeAdapter(shape)
                schemas[shape.published_as] = adapter.json_schema(
                    mode="serialization", ref_template=reference
                )
            content = {
                "application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}
            }
            for path, operations in document["paths"].items():
                if path.startswith("/v1/"):
                    for operation in operations.values():
                        for status, words in PROBLEMS.items():
                            operation["responses"][status] = {
                                "description": words,
                                "content": content,
                            }
            service.openapi_schema = document
        return service.openapi_schema

    service.openapi = openapi  # type: ignore[method-assign]

    service.get(DOCUMENT, include_in_schema=False)(openapi_document)
    needs(Role.VIEWER)(service.router.routes[-1])


def openapi_document(request: Request) -> JSONResponse:
    """Answer with the document, in a thread: it takes seconds to write the first time.

    The service is the request's. FastAPI remembers each route's function for good, and with it
    whatever that function closes over: a service that has ended would stay in memory.
    """
    return JSONResponse(request.app.openapi())


def _as_published(document: dict[str, Any]) -> dict[str, Any]:
    """Name the domain's own shapes as they are published."""
    names = {shape.__name__: shape.published_as for shape in answers()}
    schemas = document["components"]["schemas"]
    document["components"]["schemas"] = dict(
        sorted((names.get(name, name), schema) for name, schema in schemas.items())
    )
    _follow_names(document, names)
    return document


def _follow_names(part: Any, names: Mapping[str, str]) -> None:
    """Let references follow their schemas' new names."""
    if isinstance(part, dict):
        stem, _, name = str(part.get("$ref", "")).rpartition("/")
        if name in names:
            part["$ref"] = f"{stem}/{names[name]}"
    inside = part.values() if isinstance(part, dict) else part
    for inner in inside if isinstance(part, dict | list) else ():
        _follow_names(inner, names)


def swagger_page(title: str) -> Page:
    """Make the page that lets people read and try the routes, without the internet."""
    written = get_swagger_ui_html(
        openapi_url=DOCUMENT,
        title=f"{title} · HTTP",
        swagger_js_url="/docs-assets/swagger-ui-bundle.js",
        swagger_css_url="/docs-assets/swagger-ui.css",
        swagger_favicon_url="/docs-assets/favicon-32x32.png",
        swagger_ui_parameters={"defaultModelsExpandDepth": 0, "displayRequestDuration": True},
    )
    return Page(bytes(written.body).decode(), scripts=1)
