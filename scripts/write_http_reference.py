"""Write docs/http.md from the service's own OpenAPI: every route, and every field with its unit.

Each route has its requests of `scripts/http_requests.sh`, and the routes stand in the order
of these. A test holds that the page is what this script writes, so that no route or field
changes without being seen.

    python scripts/write_http_reference.py
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from app.api.bodies import LIMIT_NAME, MEGABYTE, USUAL_LIMIT
from app.main import create_app
from app.settings import LARGEST_BODY, Settings
from scripts.http_requests import (
    CurlRequest,
    requests_by_route,
    requests_of_script,
    routes_without_request,
)

PAGE = Path(__file__).parent.parent / "docs" / "http.md"

_USUAL, _LARGEST = USUAL_LIMIT // MEGABYTE, LARGEST_BODY // MEGABYTE

HEAD = f"""# HTTP reference

Written by `scripts/write_http_reference.py` from the service's OpenAPI document, which
the service serves at `/openapi.json` and shows at `/docs`.

The base path is `/v1`. Bodies are JSON, times UTC in ISO 8601, and units are in the fields' names.
Refusals are `application/problem+json` (`Problem`). Fields marked * are required.
If the service asks for [keys](keys.md), send one with each request: `Authorization: Bearer KEY`.

A body may have {_USUAL} MiB, or what its route states below. No route takes more than
THERMAP_MAX_BODY_BYTES, which is {_LARGEST} MiB unless the operator sets it. A larger body is
refused with 413: send it in parts.

Every route has a request to copy. The number above each request is the status of its answer.
In the order of this page the requests work against `thermap demo` on a new database. Those that
only read use the demo's machine, `mcfv5050`. Those that change something use a machine `practice`,
which they make and at the end delete. On another database maps, verifications and analyses have
other numbers, which the listings show.
"""


@cache
def openapi_document() -> dict[str, Any]:
    """Ask a service on an empty database for its document, which is the same for all services."""
    with tempfile.TemporaryDirectory() as folder:
        service = create_app(Settings(database_url=f"sqlite:///{folder}/empty.db"))
        try:
            return service.openapi()
        finally:
            service.state.context.database.close()


def write_page(document: dict[str, Any]) -> str:
    """Write the page."""
    parts = [HEAD, "## Routes\n", *_routes(document), "## Shapes\n", *_shapes(document)]
    return "\n".join(parts).rstrip() + "\n"


def _routes(document: dict[str, Any]) -> Iterator[str]:
    requests = requests_of_script()
    shown: dict[tuple[str, str], list[CurlRequest]] = requests_by_route(requests, document)
    shown |= {route: [] for route in routes_without_request(requests, document)}
    for (method, path), of_route in shown.items():
        yield f"### {method.upper()} {path}\n"
        yield from _route(document["paths"][path][method])
        yield from (f"```sh\n{request.text}\n```\n" for request in of_route)


def _route(operation: dict[str, Any]) -> Iterator[str]:
    yield f"{operation['summary']}. {operation.get('description', '')}\n"
    for parameter in operation.get("parameters", []):
        words = parameter.get("description", "")
        yield f"- `{parameter['name']}` ({parameter['in']}): {words}"
    body = operation.get("requestBody", {}).get("content", {}).get("application/json")
    if body:
        limit = operation.get(LIMIT_NAME)
        most = f", up to {limit // MEGABYTE} MiB" if limit else ""
        yield f"- body: {_kind(body['schema'])}{most}"
    for status, answer in sorted(operation["responses"].items()):
        if not status.startswith(("4", "5")):
            content = answer.get("content", {}).get("application/json", {})
            yield f"- {status}: {_kind(content.get('schema', {})) or '–'}"
    yield ""


def _shapes(document: dict[str, Any]) -> Iterator[str]:
    for name, schema in sorted(document["components"]["schemas"].items()):
        yield f"### {name}\n"
        yield f"{schema.get('description', '')}\n"
        required = set(schema.get("required", []))
        for field, described in schema.get("properties", {}).items():
            star = "*" if field in required else ""
            yield f"- `{field}`{star}: {_kind(described)}. {described.get('description', '')}"
        if "enum" in schema:
            yield f"One of {', '.join(f'`{value}`' for value in schema['enum'])}."
        yield ""


def _kind(schema: dict[str, Any]) -> str:
    """Say what a schema takes, in a few words."""
    if "$ref" in schema:
        return schema["$ref"].rsplit("/", 1)[-1]
    for several in ("anyOf", "oneOf", "allOf"):
        if several in schema:
            return " or ".join(dict.fromkeys(_kind(one) for one in schema[several]))
    if schema.get("type") == "array":
        return f"list of {_kind(schema.get('items', {})) or 'anything'}"
    if schema.get("type") == "object" and isinstance(schema.get("additionalProperties"), dict):
        return f"name to {_kind(schema['additionalProperties'])}"
    if schema.get("format") == "date-time":
        return "time"
    return str(schema.get("type", ""))


if __name__ == "__main__":
    PAGE.write_text(write_page(openapi_document()), encoding="utf-8")
    print(f"wrote {PAGE}")
