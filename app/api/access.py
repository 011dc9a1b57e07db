"""Who may ask for what: keys, on every request but those that are open to all.

What a request needs stands at its route: what neither the route nor its router names is for
viewers where it reads, and for metrologists where it may write. It is decided on the route that
answers, so that no way of writing a path leads past it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import Final, NamedTuple, TypeVar
from urllib.parse import quote

from fastapi import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import BaseRoute
from starlette.types import Scope

from app.access.authorization import Authorization, Requirement, asking
from app.access.failures import Failures, source_of
from app.access.keys import Role, digest_of
from app.api.error_responses import problem, problem_for, problem_of
from app.api.pages import wants_page
from app.api.turns import SharedQuestion
from app.errors import AccessRefused, KeyUnknown, NotAllowed
from app.events.event import LONGEST_NAME
from app.services.access_keys import KeyRing
from app.storage.access_keys import StoredKey

LOOK_AGAIN_S: Final = 0.1
"""Who states an unknown key lets the database be asked again no sooner than after so long [s]."""

LOOK_AGAIN_PATIENCE_S: Final = 4.0
"""How long who states an unknown key waits for the database [s]."""

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

_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f]")


class Access(NamedTuple):
    """Who may use a route.

    Parameters
    ----------
    role
        None for what is open to all.
    all_machines
        Whether it is of all machines at once, and cannot be answered in part.
    """

    role: Role | None
    all_machines: bool = False


_UNROUTED: Final = Access(Role.VIEWER)
"""To be told that there is nothing at a path."""

_UNSTATED: Final = Access(Role.ADMIN, all_machines=True)
"""Of a route that says nothing; a test finds those."""

_Routed = TypeVar("_Routed")


def needs(role: Role | None, *, all_machines: bool = False) -> Callable[[_Routed], _Routed]:
    """State who may use the route of a function, or a route."""

    def state(routed: _Routed) -> _Routed:
        vars(routed)["access"] = Access(role, all_machines)
        return routed

    return state


def access_to(route: BaseRoute | None) -> Access:
    """Say who may use a route; None stands for what no route answers."""
    return _UNROUTED if route is None else getattr(route, "access", _UNSTATED)


def requirement_of(scope: Scope) -> Requirement | None:
    """Say what a request needs of a key, by its route; None for what is open to all."""
    role, all_machines = access_to(scope.get("route"))
    if role is None or scope["method"] == "OPTIONS":
        return None
    return Requirement(role, scope.get("path_params", {}).get("machine"), all_machines)


class AccessControl:
    """Refuses who has no key, or not the right one."""

    def __init__(self, ring: KeyRing, *, is_on: bool) -> None:
        self.ring = ring
        self.is_on = is_on
        self._failures = Failures()
        self._looking_again = SharedQuestion(ring.refresh, LOOK_AGAIN_PATIENCE_S)

    async def refusal(self, scope: Scope) -> Response | None:
        """Give the answer to a request that is refused, None for one that is answered.

        What it was let in by is left in `asking`, and in the request's state.
        """
        requirement = requirement_of(scope)
        if not self.is_on or requirement is None:
            return None
        if _CONTROL.search(scope["path"]):
            # Routes match a path that ends with a newline, as if it did not.
            return problem(400, "Bad request", "expected a path without control characters")
        secret = stated_secret(scope)
        stored = None if secret is None else await self.find(secret)
        if secret is None or stored is None:
            return self._unknown(scope, secret)
        authorization = Authorization(
            digest_of(secret), stored.key, requirement, stored.expires_at, self.ring.now
        )
        try:
            requirement.check(stored.key)
            self.confirm(authorization)
        except AccessRefused as error:
            return problem_of(scope, error)
        scope.setdefault("state", {})["authorization"] = authorization
        asking.set(authorization)
        return None

    async def find(self, secret: str) -> StoredKey | None:
        """Find a key in memory: who has one does not wait for the database, however slow it is.

        Who states what is not known waits until memory has looked again, as the key may have been
        made just now: all of them together, and not very often.
        """
        digest = digest_of(secret)
        stored = self.ring.find(digest)
        if stored is None and monotonic() - self.ring.asked_s >= LOOK_AGAIN_S:
            await self._looking_again.answer()
            stored = self.ring.find(digest)
        return stored

    def confirm(self, authorization: Authorization) -> None:
        """Look in memory whether a request may still do what it asks.

        Raises
        ------
        AccessRefused, Conflict
            If it may not.
        """
        stored = self.ring.find(authorization.digest)
        authorization.confirm(None if stored is None else stored.key)
        machine = authorization.requirement.machine
        if stored is not None and machine is not None and not self.ring.sees(stored, machine):
            raise NotAllowed(
                f"the key {stored.key.name!r} is for an older machine {machine[:80]!r}, which was "
                "deleted"
            )

    def confirm_request(self, scope: Scope) -> None:
        """Do the same for a request that has waited, for its body for example."""
        authorization: Authorization | None = scope.get("state", {}).get("authorization")
        if authorization is not None:
            self.confirm(authorization)

    def wait_s(self, scope: Scope) -> float:
        """Count a wrong key, and say how long its sender has to wait [s]."""
        client = scope.get("client")
        return self._failures.count(client[0] if client else "", monotonic())

    def _unknown(self, scope: Scope, secret: str | None) -> Response:
        if secret is None:
            return _to_login(scope) or problem_of(scope, KeyUnknown("none"))
        if not self.ring.is_known:
            return problem_for(
                scope,
                503,
                "The database is away",
                "the keys cannot be read, so nobody can be known",
                headers={"Retry-After": "5"},
            )
        if (wait_s := self.wait_s(scope)) > 0.0:
            return _too_many(scope, wait_s)
        return _to_login(scope) or problem_of(scope, KeyUnknown())


class Viewer:
    """Who follows a stream: what may be sent, looked at anew for each event.

    Parameters
    ----------
    ring
        The keys; without it all there is may be sent.
    authorization
        By what the stream was let in; None where no key is asked for.
    """

    def __init__(
        self, ring: KeyRing | None = None, authorization: Authorization | None = None
    ) -> None:
        self._ring = ring
        self._authorization = authorization

    def is_welcome(self) -> bool:
        """Whether the key is still one, and may follow the stream."""
        if self._ring is None or self._authorization is None:
            return True
        stored = self._ring.find(self._authorization.digest)
        try:
            self._authorization.requirement.check(None if stored is None else stored.key)
        except AccessRefused:
            return False
        return True

    def sees(self, machine_id: str) -> bool:
        """Whether what is about the machine that has this id now may be sent."""
        if self._ring is None or self._authorization is None:
            return True
        stored = self._ring.find(self._authorization.digest)
        return stored is not None and self._ring.sees(stored, machine_id)

    def sees_entry(self, machine_id: str | None, number: int) -> bool:
        """Whether an entry of the event log may be sent, which has this number."""
        if self._ring is None or self._authorization is None:
            return True
        stored = self._ring.find(self._authorization.digest)
        if stored is None or stored.key.machines is None:
            return stored is not None
        birth = stored.births.get(machine_id or "")
        return birth is not None and number > birth.entries_after


def holder_of(scope: Scope) -> str:
    """Name who is to have a fair share of what there is little of: a key, else an address."""
    authorization: Authorization | None = scope.get("state", {}).get("authorization")
    client = scope.get("client")
    if authorization is not None:
        return f"key {authorization.key.name}"
    return f"address {source_of(client[0]) if client else ''}"


@dataclass(frozen=True, slots=True)
class Asker:
    """Who sent a request, named as the log has it, and only where something is written there."""

    scope: Scope

    def __str__(self) -> str:
        """Name the key, the address and the program, as far as there are any."""
        authorization: Authorization | None = self.scope.get("state", {}).get("authorization")
        client = self.scope.get("client")
        agent = dict(self.scope["headers"]).get(b"user-agent", b"").decode("latin-1")
        program = program_name("".join(letter for letter in agent if letter.isprintable()))
        whom = [] if authorization is None else [authorization.key.name]
        named = ", ".join([*whom, client[0] if client else "", program]).strip(", ")
        return named[:LONGEST_NAME] or "unknown"


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


def sees(request: Request) -> Callable[[str], bool]:
    """Say of which machines the one who asks may be told."""
    authorization: Authorization | None = getattr(request.state, "authorization", None)
    return (lambda _machine_id: True) if authorization is None else authorization.key.sees


def viewer(request: Request) -> Viewer:
    """Give who follows the stream that a request opens."""
    control: AccessControl = request.app.state.access
    return Viewer(control.ring, getattr(request.state, "authorization", None))


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
    for cookie in cookies.split(";"):
        name, _, value = cookie.strip().partition("=")
        if name == COOKIE:
            return value.strip('"')
    return None


def _to_login(scope: Scope) -> Response | None:
    """Lead a person's browser to the page that asks for a key; None for other programs."""
    if not wants_page(scope):
        return None
    query = scope["query_string"].decode("latin-1")
    onward = scope["path"] + (f"?{query}" if query else "")
    return RedirectResponse(f"{LOGIN}?next={quote(onward)}", status_code=303)


def _too_many(scope: Scope, wait_s: float) -> Response:
    """Write the answer to who has come with too many wrong keys."""
    return problem_for(
        scope,
        429,
        "Too many wrong keys",
        f"wrong keys come too often from this address; try again in {math.ceil(wait_s)} s",
        headers={"Retry-After": str(math.ceil(wait_s))},
    )
