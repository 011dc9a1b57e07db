"""Whom the service answers: hosts that are its own, and writes that no other web page sent.

A browser that runs on the shop floor reaches the service for any page that it shows. Two rules
keep such pages out. The host that a request names is the service's own: else a page could let
its own name point to this computer and read everything (DNS rebinding). And a request that may
change something comes from the service's own pages, or from no page at all: a browser says
which, in `Sec-Fetch-Site` or `Origin`, and no page can forge either.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterable
from functools import lru_cache
from typing import Final

from starlette.responses import Response
from starlette.types import Scope

from app.api.error_responses import problem

ANY_HOST: Final = "*"
SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing; what they answer is readable to our own pages alone."""

_LONGEST_SHOWN: Final = 100
_HOSTS_REMEMBERED: Final = 256
_OWN_SITES: Final = (b"same-origin", b"none")


class Gate:
    """Refuses requests to foreign hosts, and writes that a foreign page sent.

    Parameters
    ----------
    listens_on
        Name or address that the service is bound to.
    allowed_hosts
        Further names; `*.example.org` stands for all below example.org, `*` for every name.
        Numeric addresses, localhost and this computer's own name are always allowed: no page
        can let those point elsewhere.
    origins
        Other sites whose pages may write too.
    """

    def __init__(
        self,
        listens_on: str,
        allowed_hosts: Iterable[str] = (),
        origins: Iterable[str] = (),
    ) -> None:
        self._origins = frozenset(origin.encode("latin-1") for origin in origins)
        configured = {name.lower() for name in allowed_hosts}
        here = socket.gethostname().lower()
        short = here.partition(".")[0]
        self._own = {"localhost", here, short, f"{short}.local", listens_on.lower(), *configured}
        self._below = (".localhost", *(name[1:] for name in configured if name.startswith("*.")))
        self._any = ANY_HOST in configured
        self._stated = configured
        # Whoever polls names the same host each time; foreign ones cannot fill the memory.
        self._is_own = lru_cache(_HOSTS_REMEMBERED)(self._is_own_host)

    def refusal(self, scope: Scope) -> Response | None:
        """Give the answer to a request that is refused, None for one that is answered."""
        host = origin = site = None
        for name, value in scope["headers"]:
            if name == b"host":
                if host is not None:  # which one counts is read differently by every proxy
                    return problem(400, "Bad request", "expected one header Host, got several")
                host = value
            elif name == b"origin":
                origin = value
            elif name == b"sec-fetch-site":
                site = value
        # Without a host it is no browser: HTTP/1.1 demands one.
        if host is not None and not self._is_own(host):
            return problem(421, "Not this service's name", _foreign_host(host))
        if scope["method"] in SAFE_METHODS or (origin is None and site is None):
            return None
        if self._is_from_own_page(host, origin, site):
            return None
        return problem(403, "Sent by another site", _foreign_page(origin))

    def _is_from_own_page(
        self, host: bytes | None, origin: bytes | None, site: bytes | None
    ) -> bool:
        #     Origin     Sec-Fetch-Site           who sends it                       may it write
        #     listed     any                      a page that may                    yes
        #     any        cross-site, same-site    another site's page                no
        #     any        same-origin              our own page                       yes
        #     none       none                     an address that somebody typed     yes
        #     stated     none, or not stated      an older browser: see the host     if it is ours
        #
        # Without both it is no browser, and does not come here.
        if origin is not None and origin.lower() in self._origins:
            return True
        if site is not None and site not in _OWN_SITES:
            return False
        # `Sec-Fetch-Site: none` without an origin is an address that somebody typed.
        if origin is None or site == b"same-origin":
            return True
        scheme, _, authority = origin.lower().partition(b"://")
        if scheme not in (b"http", b"https"):
            return False  # "null", files, extensions
        # Behind a proxy that states its own address as the host, the name is an allowed one.
        return authority == (host or b"").lower() or _name_of(authority) in self._stated

    def _is_own_host(self, host: bytes) -> bool:
        name = _name_of(host)
        if not name:
            return False
        if self._any or name in self._own or name.endswith(self._below):
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True


def _name_of(host: bytes) -> str:
    """Take the port, the brackets of an IPv6 address and a final dot from a host."""
    text = host.decode("latin-1").strip().lower()
    if text.startswith("["):
        name, bracket, port = text[1:].partition("]")
        return name if bracket and (not port or port.startswith(":")) else ""
    name, _, port = text.partition(":")
    return "" if port and not port.isdecimal() else name.removesuffix(".")


def _foreign_host(host: bytes) -> str:
    name = host.decode("latin-1")[:_LONGEST_SHOWN]
    return (
        f"expected a host that is this service's own, got {name!r}; where it is, start the "
        f"service with --allowed-host NAME (THERMAP_ALLOWED_HOSTS)"
    )


def _foreign_page(origin: bytes | None) -> str:
    whose = "" if origin is None else f" of {origin.decode('latin-1')[:_LONGEST_SHOWN]!r}"
    return (
        f"expected a request of this service's own pages, or of a program, got one of a web "
        f"page{whose}; where that is this service behind a proxy, start it with --allowed-host NAME"
    )
