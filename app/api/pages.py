"""Pages on their way to a browser: nothing runs in them but what the service wrote itself."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import HTMLResponse
from starlette.types import Scope

from app.pages.reader import read_reader

_SCRIPT: Final = re.compile(r"<script\b([^<>]*)>|</script>", re.IGNORECASE)
_NOT_RUN: Final = re.compile(r"\ssrc\s*=|application/json", re.IGNORECASE)

_POLICY: Final = (
    "default-src 'none'; script-src 'self'{hashes}; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action {forms}; frame-ancestors 'none'"
)
"""Scripts from the service's files, and those that stand in the page, by their hashes.

Styles are free: plotly and Swagger write their own.
"""


PAGE_HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
}


class Page(HTMLResponse):
    """A page with the policy that a browser holds it to.

    Parameters
    ----------
    scripts
        How many scripts were written into it; their hashes become part of the policy. Where
        others stand in it, somebody else wrote one: then none of them may run.
    """

    def __init__(
        self,
        content: str,
        scripts: int,
        headers: Mapping[str, str] | None = None,
        *,
        status: int = 200,
        has_form: bool = False,
    ) -> None:
        inline_scripts = _scripts(content)
        hashes = (
            "".join(map(_hash_source, inline_scripts)) if len(inline_scripts) == scripts else ""
        )
        forms = "'self'" if has_form else "'none'"
        policy = {"Content-Security-Policy": _POLICY.format(hashes=hashes, forms=forms)}
        super().__init__(content, status, headers={**PAGE_HEADERS, **policy, **(headers or {})})


class LivePage(Page):
    """A page of the dashboard, as what writes it gives it."""

    def __init__(self, content: str, *_named: Any, **_more: Any) -> None:
        super().__init__(content, 0, {"Cache-Control": "no-store"})


def take_reader(request: Request) -> None:
    """Let pages be written as who asks reads them: language, units, zone."""
    read_reader(request.cookies, request.headers.get("accept-language", ""))


def wants_page(scope: Scope) -> bool:
    """Whether a person's browser asks for a page."""
    path = scope["path"]
    accepts = dict(scope["headers"]).get(b"accept", b"")
    is_page = path in ("/", "/docs", "/fleet", "/new-machine") or path.startswith("/machines/")
    return scope["method"] in ("GET", "HEAD") and is_page and b"text/html" in accepts


def _scripts(content: str) -> list[str]:
    """Find the scripts that stand in a page: no files, and no data."""
    scripts, begin = [], None
    for tag in _SCRIPT.finditer(content):
        if tag[1] is not None:
            begin = begin or tag
        elif begin is not None:
            if not _NOT_RUN.search(begin[1]):
                scripts.append(content[begin.end() : tag.start()])
            begin = None
    return scripts


def _hash_source(script: str) -> str:
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return f" 'sha256-{digest}'"
