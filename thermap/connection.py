"""Where a service is, and what it means when it does not answer."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from typing import Any

import httpx

from thermap import DEFAULT_URL, KEY_VARIABLE, URL_VARIABLE, __version__
from thermap.errors import NotListeningError, ServiceUnavailableError


def service_url(base_url: str | None) -> httpx.URL:
    """Read a service's URL: stated, or THERMAP_URL in the environment, or the default.

    Raises
    ------
    ValueError
        If it is no http:// or https:// URL with a host.

    Examples
    --------
    >>> service_url("http://127.0.0.1:8001/")
    URL('http://127.0.0.1:8001')
    """
    base = base_url or os.environ.get(URL_VARIABLE) or DEFAULT_URL
    try:
        url = httpx.URL(base.rstrip("/"))
    except httpx.InvalidURL:
        url = httpx.URL()
    if url.scheme not in ("http", "https") or not url.host:
        raise ValueError(f"expected a URL such as {DEFAULT_URL}, got {base!r}")
    return url


def without_password(url: httpx.URL) -> str:
    """Write a URL as it may be shown."""
    return str(url.copy_with(userinfo=b""))


def httpx_options(url: httpx.URL, timeout_s: float, key: str | None = None) -> dict[str, Any]:
    """Write what both kinds of httpx client are made with."""
    key = key or os.environ.get(KEY_VARIABLE)
    headers = {"User-Agent": f"thermap/{__version__}"}
    if key:
        headers["Authorization"] = f"Bearer {key}"
    return {
        "base_url": url,
        "timeout": timeout_s,
        "headers": headers,
        # A proxy for the world outside has never been the way to this computer itself.
        "trust_env": not _is_this_computer(url.host),
    }


@contextmanager
def explaining(url: httpx.URL, timeout_s: float) -> Iterator[None]:
    """Turn httpx' many ways of getting no answer into two, in words."""
    where = without_password(url)
    try:
        yield
    except httpx.TimeoutException as error:
        # What was sent whole goes on being worked at.
        rest = "; it may still be at work" if isinstance(error, httpx.ReadTimeout) else ""
        raise ServiceUnavailableError(
            f"no answer from {where} within {timeout_s:g} s{rest}"
        ) from error
    except httpx.ConnectError as error:
        raise NotListeningError(
            f"no thermap at {where}{_reason(error)}: is `thermap serve` running there?"
        ) from error
    except httpx.TransportError as error:
        raise ServiceUnavailableError(f"the connection to {where} broke: {error}") from error


def _reason(error: httpx.ConnectError) -> str:
    """Say why there is no connection, unless it is the plain reason: nobody listens."""
    text = str(error)
    plain = "refused" in text or "All connection attempts failed" in text
    return "" if plain or not text else f" ({text})"


def _is_this_computer(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False
