"""Who may ask for what: keys, on every request but those that are open to all.

What a request needs follows from its method and path alone, so that no route can be forgotten: what
is not named here is for viewers where it reads, and for metrologists where it may write.
"""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Callable
from time import monotonic
from typing import Final
from urllib.parse import quote

from fastapi import Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response
from starlette.types import Scope

from app.access.failures import Failures
from app.access.keys import AccessKey, Role, asking
from app.api.error_responses import problem, problem_for
from app.api.gate import SAFE_METHODS
from app.api.pages import wants_page
from app.events.event import LONGEST_NAME, acting
from app.services.access_keys import KeyRing

_LONGEST_AGENT: Final = 40
_BROWSERS: Final = (
    ("Edg", "Edge"),
    ("OPR", "Opera"),
    ("Firefox", "Firefox"),
    ("Chrome", "Chrome"),
    ("Safari", "Safari"),
)
"""A mark in User-Agent to the browser, those first that state others' marks too."""

COOKIE: Final = "thermap-session"

LOGIN: Final = "/login"

_OPEN: Final = re.compile(r"/(healthz|readyz|login|logout|favicon\.ico|(docs-)?assets/.*)")
"""Whether the service lives, and what a page needs on which a key is stated."""

_OF_MACHINE: Final = re.compile(r"/(?:v1/)?machines/([^/]+)(?:/.*)?")

_COMPUTES: Final = re.compile(
    r"/v1/(machines/[^/]+/(compensation(/(compare|export|grid|levels))?|models/compare|picture"
    r"|measurements/step-diagonal/simulate|predictions|residuals|rotary-axis-error"
    r"|sensor-assignment/correlate|volumetric-accuracy|volumetric-error|analyses/plan)"
    r"|controllers/[^/]+/parse|fleet/tried-effects|volumetric-accuracy/from-lines)"
)
"""POST, because the question is long; nothing is stored."""

_READINGS: Final = re.compile(r"/v1/machines/[^/]+/readings")
_MACHINE: Final = re.compile(r"/v1/machines(/[^/]+)?")
_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f]")

_KEYS: Final = re.compile(r"/v1/keys(/.*)?")

_ALL_MACHINES: Final = re.compile(r"/metrics|/fleet|/v1/fleet(/.*)?|/v1/keys(/.*)?")
"""What is of all machines at once, and cannot be told in part."""


def role_needed(method: str, path: str) -> Role | None:
    """Say which role a request needs; None for what is open to all.

    >>> str(role_needed("POST", "/v1/machines/vmc/readings"))
    'sensor'
    >>> role_needed("GET", "/healthz") is None
    True
    """
    if _OPEN.fullmatch(path) or method == "OPTIONS":
        return None
    if _KEYS.fullmatch(path):
        return Role.ADMIN
    if method in SAFE_METHODS or (method == "POST" and _COMPUTES.fullmatch(path)):
        return Role.VIEWER
    if method == "POST" and _READINGS.fullmatch(path):
        return Role.SENSOR
    return Role.ADMIN if _MACHINE.fullmatch(path) else Role.METROLOGIST


def machine_of(path: str) -> str | None:
    """Say which machine a request is about; None where it is about none, or about all."""
    found = _OF_MACHINE.fullmatch(path)
    return None if found is None else found[1]


class AccessControl:
    """Refuses who has no key, or not the right one.

    Parameters
    ----------
    ring
        The keys in memory.
    is_on
        Whether keys are asked for at all.
    workers
        Processes of this host that answer side by side.
    """

    def __init__(self, ring: KeyRing, *, is_on: bool, workers: int = 1) -> None:
        self.ring = ring
        self.is_on = is_on
        self.failures = Failures(workers)
        self._asking = asyncio.Lock()
        self._following: asyncio.Task[None] | None = None

    async def refusal(self, scope: Scope) -> Response | None:
        """Give the answer to a request that is refused, None for one that is answered.

        Its key is left in the request's state.
        """
        needed = role_needed(scope["method"], scope["path"])
        if not self.is_on or needed is None:
            return None
        if _CONTROL.search(scope["path"]):
            # Routes match a path that ends with a newline; what is said here of paths does not.
            return problem(400, "Bad request", "expected a path without control characters")
        secret = stated_secret(scope)
        key = None if secret is None else await self.find(secret)
        if key is None:
            return self._unknown(scope, secret)
        if needed is not Role.SENSOR and key.role is Role.SENSOR:
            return _forbidden(scope, f"the key {key.name!r} is for sending readings only")
        if not key.role.includes(needed):
            return _forbidden(scope, f"expected a key of the role {needed}, got one of {key.role}")
        machine = machine_of(scope["path"])
        if machine is not None and not key.sees(machine):
            return _forbidden(
                scope, f"the key {key.name!r} is not for the machine {machine[:80]!r}"
            )
        if key.machines is not None and _ALL_MACHINES.fullmatch(scope["path"]):
            return _forbidden(scope, "expected a key for all machines, got one for some")
        scope.setdefault("state", {})["access_key"] = key
        scope["state"]["access_secret"] = secret
        asking.set(key)
        return None

    async def find(self, secret: str) -> AccessKey | None:
        """Find a key: who has one does not wait for the database, however slow it is.

        Memory follows it beside the requests. Who states what is not known yet waits: it may
        have been made just now.
        """
        key = self.ring.find(secret)
        if key is None:
            await self._ask_again()
            return self.ring.find(secret)
        if self.ring.is_due and (self._following is None or self._following.done()):
            self._following = asyncio.create_task(self._ask_again())
        return key

    async def _ask_again(self) -> None:
        """Let memory follow the database where that is due."""
        async with self._asking:
            if not self.ring.is_known or self.ring.is_due:
                await run_in_threadpool(self.ring.refresh)

    def wait_s(self, scope: Scope) -> float:
        """Count a wrong key, and say how long its sender has to wait [s]."""
        client = scope.get("client")
        return self.failures.count(client[0] if client else "", monotonic())

    def _unknown(self, scope: Scope, secret: str | None) -> Response:
        if secret is not None and not self.ring.is_known:
            return problem_for(
                scope,
                503,
                "The database is away",
                "the keys cannot be read, so nobody can be known",
                headers={"Retry-After": "5"},
            )
        if wants_page(scope):
            query = scope["query_string"].decode("latin-1")
            onward = scope["path"] + (f"?{query}" if query else "")
            return RedirectResponse(f"{LOGIN}?next={quote(onward)}", status_code=303)
        if secret is not None and (wait_s := self.wait_s(scope)) > 0.0:
            return too_many(wait_s)
        what = "none" if secret is None else "one that is unknown, revoked or too old"
        return problem(
            401,
            "A key is needed",
            f"expected a key in the header Authorization: Bearer KEY, got {what}; "
            "`thermap keys create` makes one",
            headers={"WWW-Authenticate": "Bearer"},
        )


def holder_of(scope: Scope) -> str:
    """Name who is to have a fair share of what there is little of: a key, else an address."""
    key: AccessKey | None = scope.get("state", {}).get("access_key")
    client = scope.get("client")
    return f"key {key.name}" if key is not None else f"address {client[0] if client else ''}"


def name_who_asks(scope: Scope) -> None:
    """Let what is written into the log name who asks, from here on."""
    key: AccessKey | None = scope.get("state", {}).get("access_key")
    client = scope.get("client")
    agent = dict(scope["headers"]).get(b"user-agent", b"").decode("latin-1")
    program = program_name("".join(letter for letter in agent if letter.isprintable()))
    whom = [key.name] if key is not None else []
    named = ", ".join([*whom, client[0] if client else "", program]).strip(", ")
    acting.set(named[:LONGEST_NAME] or "unknown")


def program_name(agent: str) -> str:
    """Name a program by its User-Agent; a browser, which names all others too, by itself.

    >>> program_name("Mozilla/5.0 (X11; Linux x86_64; rv:128.0) Gecko/20100101 Firefox/128.0")
    'Firefox'
    >>> program_name("cell-controller/7")
    'cell-controller/7'
    """
    if not agent.startswith("Mozilla/"):
        return agent[:_LONGEST_AGENT]
    return next((name for mark, name in _BROWSERS if f"{mark}/" in agent), "browser")


def too_many(wait_s: float) -> Response:
    """Write the answer to who has come with too many wrong keys."""
    return problem(
        429,
        "Too many wrong keys",
        f"wrong keys come too often from this address; try again in {math.ceil(wait_s)} s",
        headers={"Retry-After": str(math.ceil(wait_s))},
    )


def sees(request: Request) -> Callable[[str], bool]:
    """Say of which machines the one who asks may be told."""
    key: AccessKey | None = getattr(request.state, "access_key", None)
    return (lambda _machine_id: True) if key is None else key.sees


def stays_welcome(request: Request) -> Callable[[], bool]:
    """Say, again and again, whether the key of a long answer is still one."""
    control: AccessControl = request.app.state.access
    secret: str | None = getattr(request.state, "access_secret", None)
    return lambda: secret is None or control.ring.find(secret) is not None


def stated_secret(scope: Scope) -> str | None:
    """Read the key from a request's head, or what a browser has instead; None without either."""
    found: str | None = None
    name: bytes
    value: bytes
    for name, value in scope["headers"]:
        if name == b"authorization":
            kind, _, secret = value.decode("latin-1").partition(" ")
            # Another kind is meant for a proxy before the service.
            if kind.lower() == "bearer":
                return secret.strip()
        if name == b"cookie" and found is None:
            found = _session_of(value.decode("latin-1"))
    return found


def _session_of(cookies: str) -> str | None:
    """Read the session; cookies of others on this computer may be written in any way."""
    for one in cookies.split(";"):
        name, _, value = one.strip().partition("=")
        if name == COOKIE:
            return value.strip('"')
    return None


def _forbidden(scope: Scope, detail: str) -> Response:
    return problem_for(scope, 403, "Not allowed", detail)
