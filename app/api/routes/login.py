"""Stating a key in a browser: after that its pages may ask for what the key may."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Final
from urllib.parse import parse_qs

from fastapi import Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response

from app.access.keys import Role
from app.api.access import COOKIE, LOGIN, Access, AccessControl, stated_secret
from app.api.bodies import received
from app.api.pages import Page, take_reader
from app.api.router import Router
from app.errors import InvalidContent
from app.pages.environment import render_live
from app.services.access_keys import BROWSER_LASTS


async def _for_the_reader(request: Request) -> None:
    take_reader(request)


router = Router(access=Access(None), read_first=_for_the_reader, include_in_schema=False)

_LONGEST_FORM: Final = 4096
_MOST_FIELDS: Final = 8
_HEADERS: Final = {"Cache-Control": "no-store"}

_NO_KEY: Final = "This is no key, or no longer."

NextQuery = Annotated[str, Query(max_length=1024)]


@router.get(LOGIN, response_class=Page)
async def get_login(request: Request, next: NextQuery = "/") -> Response:
    """Ask for a key."""
    control: AccessControl = request.app.state.access
    if not control.is_on:
        return RedirectResponse("/", status_code=303)
    was_known = COOKIE in request.cookies
    words = "The key of this browser was revoked, or its 30 days are over." if was_known else ""
    return _page(next, words)


@router.post(LOGIN, response_class=Page)
async def post_login(request: Request) -> Response:
    """Take a key, and let the browser have something to state in its place."""
    control: AccessControl = request.app.state.access
    form = await _form(request)
    onward = form.get("next", "/")
    secret = form.get("key", "").strip()
    stored = await control.find(secret)
    if stored is None:
        wait_s = control.wait_s(request.scope)
        if wait_s > 0.0:
            wait_s = math.ceil(wait_s)
            words = f"Wrong keys come too often from this address; try again in {wait_s} s."
            return _page(onward, words, 429, {"Retry-After": f"{wait_s}"})
        return _page(onward, _NO_KEY, 403)
    if not stored.key.role.includes(Role.VIEWER):
        return _page(onward, f"The key {stored.key.name} is for sending readings only.", 403)
    session = await run_in_threadpool(control.ring.open_browser, secret)
    if session is None:
        return _page(onward, _NO_KEY, 403)
    answer = RedirectResponse(_path_of_ours(onward), status_code=303)
    answer.set_cookie(
        COOKIE,
        session,
        max_age=int(BROWSER_LASTS.total_seconds()),
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
    return answer


@router.post("/logout")
async def post_logout(request: Request) -> Response:
    """Forget this browser."""
    control: AccessControl = request.app.state.access
    secret = stated_secret(request.scope)
    # Another worker may have opened the session just now; who has none writes nothing.
    if secret is not None and await control.find(secret) is not None:
        await run_in_threadpool(control.ring.close_browser, secret)
    answer = RedirectResponse(LOGIN, status_code=303)
    answer.delete_cookie(COOKIE)
    return answer


def _page(
    onward: str, wrong: str, status: int = 200, headers: Mapping[str, str] | None = None
) -> Page:
    page = render_live("login.html", onward=_path_of_ours(onward), wrong=wrong)
    all_headers = {**_HEADERS, **(headers or {})}
    return Page(page, scripts=0, headers=all_headers, status=status, has_form=True)


def _path_of_ours(path: str) -> str:
    """Give a path of the service's own pages: nobody is sent on to another host."""
    is_own = path.startswith("/") and not path.startswith(("//", "/\\")) and path.isprintable()
    return path if is_own else "/"


async def _form(request: Request) -> dict[str, str]:
    """Read a short form."""
    body = await received(request, _LONGEST_FORM)
    try:
        fields = parse_qs(body.decode("utf-8", "replace"), max_num_fields=_MOST_FIELDS)
    except ValueError:
        raise InvalidContent.of_field(
            "body", f"expected at most {_MOST_FIELDS} fields, got more"
        ) from None
    return {name: values[-1] for name, values in fields.items()}
