"""Read the requests of `scripts/http_requests.sh`, and say which routes they show."""

from __future__ import annotations

import re
import shlex
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

SCRIPT: Final = Path(__file__).with_suffix(".sh")

_STATED: Final = re.compile(r"# (\d{3})(?: when it is done, (\d{3}) before)?(?:: .+)?")

_CURL: Final = ArgumentParser(prog="curl", add_help=False)
_CURL.add_argument("-X", dest="method")
_CURL.add_argument("-H", dest="headers", action="append", default=[])
_CURL.add_argument("-d", dest="body")
_CURL.add_argument("-o", dest="output")
_CURL.add_argument("-N", dest="has_no_end", action="store_true")
_CURL.add_argument("url", nargs="?")


@dataclass(frozen=True, slots=True)
class CurlRequest:
    """One curl command with the status that is stated above it.

    Parameters
    ----------
    text
        The paragraph as it stands in the script: a comment, and the command.
    status
        Status of its answer.
    status_before
        Its status as long as the analysis that it is about is not done, where it has one.
    method, url, headers, body
        What curl sends.
    has_no_end
        Whether its answer goes on for as long as somebody listens.
    """

    text: str
    status: int
    status_before: int | None
    method: str
    url: str
    headers: Mapping[str, str]
    body: str | None
    has_no_end: bool

    @classmethod
    def of(cls, text: str) -> Self:
        r"""Read a paragraph; ValueError if it is not a status and one curl command.

        Examples
        --------
        >>> request = CurlRequest.of("# 200: does it live?\ncurl http://127.0.0.1:8000/healthz")
        >>> request.status, request.method, request.path
        (200, 'GET', '/healthz')
        """
        comment, _, command = text.partition("\n")
        stated = _STATED.fullmatch(comment)
        name, *words = shlex.split(command.replace("\\\n", " ")) or [""]
        curl, unknown = _CURL.parse_known_args(words)
        if stated is None or name != "curl" or curl.url is None or unknown:
            raise ValueError(
                "expected `# STATUS: words` above one curl command with no options but "
                f"-X, -H, -d, -o and -N, got\n{text}"
            )
        return cls(
            text=text,
            status=int(stated[1]),
            status_before=int(stated[2]) if stated[2] else None,
            method=curl.method or ("GET" if curl.body is None else "POST"),
            url=curl.url,
            headers=dict(header.split(": ", 1) for header in curl.headers),
            body=curl.body,
            has_no_end=curl.has_no_end,
        )

    @property
    def path(self) -> str:
        """The URL's path, without what asks."""
        return re.sub(r"^http://[^/]+|\?.*$", "", self.url)


def requests_of_script() -> list[CurlRequest]:
    """Read the script; its head, a paragraph of comments alone, is for people."""
    _, *paragraphs = SCRIPT.read_text(encoding="utf-8").strip().split("\n\n")
    return [CurlRequest.of(paragraph) for paragraph in paragraphs]


def route_of(request: CurlRequest, document: dict[str, Any]) -> tuple[str, str]:
    """Find the route that answers a request: its method and path as the document has them.

    Raises
    ------
    ValueError
        If the document has none.
    """
    fitting = [
        path
        for path, operations in document["paths"].items()
        if request.method.lower() in operations
        and re.fullmatch(re.sub(r"\{\w+\}", "[^/]+", path), request.path)
    ]
    if not fitting:
        raise ValueError(f"no route answers {request.method} {request.path}")
    # A route of fixed words comes before one with a number in their place.
    return request.method.lower(), min(fitting, key=lambda path: path.count("{"))


def routes_without_request(
    requests: Sequence[CurlRequest], document: dict[str, Any]
) -> list[tuple[str, str]]:
    """List the document's routes that no request shows: method and path."""
    shown = {route_of(request, document) for request in requests}
    routes = ((m, path) for path, operations in document["paths"].items() for m in operations)
    return [route for route in routes if route not in shown]
