"""What thermap doctor asks of a service that runs."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Final

import httpx

import app as package
from app.cli.options import connect
from app.errors import list_names
from app.services.doctor import (
    Finding,
    examine_clock,
    examine_disk,
    examine_machines,
    ok,
    trouble,
    warning,
)
from app.settings import is_this_computer
from thermap.connection import service_url
from thermap.errors import (
    NotAllowedError,
    NotListeningError,
    ServiceUnavailableError,
    ThermapClientError,
)

if TYPE_CHECKING:
    from thermap import ThermapClient

_SECOND: Final = timedelta(seconds=1)
"""How exactly an answer says when it was written."""

_ASKED_S: Final = 5.0
"""Of what a service answers at once [s]."""


def examine_service(url: str, *, must_run: bool) -> Iterator[Finding]:
    """Look at a service; one that does not run is no trouble unless it must."""
    with connect(url) as thermap:
        try:
            version = thermap.health().version
        except NotListeningError as error:
            say = trouble if must_run else ok
            yield say("service", f"No service runs: {error.detail}")
            return
        except ThermapClientError as error:
            yield trouble("service", f"What answers at {thermap.base_url} is amiss: {error.detail}")
            return
        yield _version(thermap.base_url, version)
        yield _clock(thermap.base_url)
        yield from _keys(thermap.base_url)
        try:
            yield from _readiness(thermap)
            yield from examine_machines(thermap.statuses())
            yield from _connections(thermap)
            yield from _receivers(thermap)
        except NotAllowedError as error:
            yield warning(
                "service", f"It tells no more without a key (THERMAP_KEY): {error.detail}"
            )
        except ServiceUnavailableError as error:
            yield trouble("service", f"It does not answer as it should: {error.sentence}.")


def _version(url: str, version: str) -> Finding:
    if version == package.__version__:
        return ok("service", f"thermap {version} answers at {url}.")
    return warning(
        "service",
        f"thermap {version} answers at {url}, and this is {package.__version__}: take the same.",
    )


def _clock(url: str) -> Finding:
    before = datetime.now(UTC)
    date_header = _ask(url, "/healthz").headers.get("date", "")
    after = datetime.now(UTC)
    try:
        # Whole seconds, rounded down, and written down to a second before.
        service_time = parsedate_to_datetime(date_header) + _SECOND / 2
    except ValueError:
        return warning("clock of the service", f"{url} does not say what time it has.")
    ahead = service_time - (before + (after - before) / 2)
    return examine_clock("clock of the service", "The service's", ahead, _SECOND)


def _keys(url: str) -> Iterator[Finding]:
    """See whether whoever reaches the service from elsewhere needs a key."""
    elsewhere = _from_elsewhere(url)
    if elsewhere is None:
        return
    try:
        status = _ask(elsewhere, "/v1/machines").status_code
    except httpx.TransportError:
        yield ok("keys asked for", "Only this computer reaches the service.")
        return
    if status == httpx.codes.OK:
        yield trouble(
            "keys asked for",
            (
                f"Anybody who reaches {elsewhere} may change everything without a key: leave out "
                "--insecure."
            ),
        )
    elif status in (httpx.codes.UNAUTHORIZED, httpx.codes.TOO_MANY_REQUESTS):
        yield ok("keys asked for", f"A key is asked for at {elsewhere}.")
    else:
        yield warning("keys asked for", f"{elsewhere} answered {status} to who has no key.")


def _from_elsewhere(url: str) -> str | None:
    """Write the URL at which others would reach a service; None where there is no such way."""
    parsed = service_url(url)
    if not is_this_computer(parsed.host):
        return str(parsed)
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # nothing is sent: it only chooses an address of ours
        address = probe.getsockname()[0]
        if not is_this_computer(address):
            return str(parsed.copy_with(host=address))
    return None


def _readiness(thermap: ThermapClient) -> Iterator[Finding]:
    ready = thermap.ready()
    words = f"{ready.machines_in_memory} of {ready.machines} machines are in memory"
    if ready.database != "ok":
        yield trouble("readiness", f"The service's database is not: {ready.database}.")
    elif ready.status != "ready":
        yield warning("readiness", f"The service is not ready yet: {words}.")
    else:
        yield ok("readiness", f"The service is ready: {words}, its database answers.")
    if ready.disk_free_bytes is not None:
        yield examine_disk("disk of the service", ready.disk_free_bytes)


def _connections(thermap: ThermapClient) -> Iterator[Finding]:
    now = thermap.connections()
    for connection in now.connections:
        about = f"connection {connection.name}"
        if connection.connected and not connection.trouble:
            yield ok(about, f"There is contact with {connection.endpoint}.")
        else:
            say = warning if connection.connected else trouble
            what = f": {connection.trouble}" if connection.trouble else ""
            yield say(
                about,
                f"There is {'' if connection.connected else 'no '}contact with "
                f"{connection.endpoint}{what}.",
            )
    if now.machines_with_wrong_clocks:
        yield warning(
            "clocks of senders",
            f"Senders of {list_names(now.machines_with_wrong_clocks, limit=5)} state times that "
            "are more than 5 s off the service's clock.",
        )
    if now.dropped or now.refused:
        last = f", at last {now.last_refusal}" if now.last_refusal else ""
        yield warning(
            "connections",
            f"{now.dropped} readings were dropped and {now.refused} values refused since the "
            f"service began{last}.",
        )


def _receivers(thermap: ThermapClient) -> Iterator[Finding]:
    for receiver in thermap.receivers().receivers:
        about = f"receiver {receiver.name}"
        if receiver.trouble:
            waits = f"; {list_names(receiver.waiting, limit=5)} waits" if receiver.waiting else ""
            yield trouble(about, f"It is not told of alarms: {receiver.trouble}{waits}.")
        else:
            last = f"{receiver.sent_at:%Y-%m-%d %H:%M} UTC" if receiver.sent_at else "none yet"
            yield ok(about, f"It is told of alarms; the last message: {last}.")


def _ask(url: str, path: str) -> httpx.Response:
    """Ask as somebody who has no key."""
    return httpx.get(f"{url.rstrip('/')}{path}", timeout=_ASKED_S, trust_env=False)
