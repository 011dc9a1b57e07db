"""Running the service: its socket, its server, and a clean end."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from threading import Thread
from types import FrameType
from typing import Final, cast

import uvicorn
from fastapi import FastAPI

from app.api.metrics import UNKNOWN, Metrics
from app.api.streams import TableStreams
from app.api.turns import Turns
from app.arrays import one_blas_thread
from app.cli.http_protocol import PatientProtocol, PatientServer, SharedLimits
from app.cli.http_refusals import MOST_BODY_BYTES, MOST_CONNECTIONS
from app.cli.settings_options import blamed_option
from app.errors import InvalidContent, ThermapError
from app.main import create_app
from app.settings import Settings

BACKLOG: Final = 2048
GRACE_S: Final = 5
"""How long a request may still take when the service ends [s]."""

ANSWER_S: Final = 4.5
"""When what has no answer until then is told that the service ends [s]."""

END_S: Final = 10
"""When the process ends at the latest after it was told to [s], whatever hangs."""

HANDLED_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)

NOTICED_S: Final = 0.5
"""How soon a signal is noticed that another thread has taken [s]."""

_NEEDED_FILES: Final = 2 * MOST_CONNECTIONS
"""Connections of HTTP have half of them at most: databases, files and others have the rest."""


class CannotListen(ThermapError):
    """The service cannot listen where it should."""


class EndingServer(PatientServer):
    """A server that ends in time: threads that hang in the database do not keep it.

    Who waits for a turn at the database is sent away at once, streams end, who is at work has
    until `ANSWER_S`; everybody gets an answer. What was answered with 201 is on the disk before the
    answer, so nothing is lost.
    """

    def __init__(
        self, config: uvicorn.Config, patience_s: float, turns: Turns, streams: TableStreams
    ) -> None:
        super().__init__(config, patience_s)
        self._turns = turns
        self._streams = streams

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Let every request that has come have an answer, and end."""
        self._turns.end()
        self._streams.end()
        asyncio.get_running_loop().call_later(ANSWER_S, self.end_connections)
        await super().shutdown(sockets)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to end, and see to it that there is an end."""
        if not self.should_exit:
            Thread(target=_exit_anyway, name="end", daemon=True).start()
        super().handle_exit(sig, frame)


def make_service(settings: Settings) -> FastAPI:
    """Make the service; a URL that is none, or that nothing installed serves, is wrong usage."""
    # For good: what watches learn and adoptions refit are small matrices, and their threads would
    # take the processors from live tables.
    one_blas_thread()
    try:
        return create_app(settings)
    except InvalidContent as error:
        raise blamed_option(error) or error from None


@contextmanager
def listening(host: str, port: int, command: str) -> Iterator[socket.socket]:
    """Listen on an address before anything else is done, so that a clash changes nothing.

    Raises
    ------
    CannotListen
        If the port is in use, or the address is not this computer's.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except OSError as error:
        raise CannotListen(f"cannot listen on {host!r}: {error.strerror}") from error
    with socket.socket(family, kind, protocol) as opened:
        if os.name == "posix":
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            opened.bind(address)
            opened.listen(BACKLOG)
        except OSError as error:
            raise CannotListen(_why_not(error, host, port, command)) from error
        yield opened


def url_of(opened: socket.socket) -> str:
    """Write the URL at which this computer reaches a listening socket."""
    host, port = opened.getsockname()[:2]
    reachable = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host)
    return f"http://{reachable or (f'[{host}]' if ':' in host else host)}:{port}"


def database_of(service: FastAPI) -> str:
    """Name a service's database as a person would: the file, or the URL without its password."""
    name: str = service.state.context.database.name
    return name.removeprefix("sqlite:///")


def new_database_note(service: FastAPI) -> str:
    """Say so of a database that was made just now: its name may be misspelt."""
    return " (a new database, made just now)" if service.state.database_is_new else ""


def server_for(service: FastAPI, log_level: str) -> uvicorn.Server:
    """Make the server of one process."""
    for name in ("thermap", "uvicorn"):
        logging.getLogger(name).setLevel(log_level.upper())
    metrics: Metrics = service.state.metrics
    limits = SharedLimits(
        lambda status: metrics.count(UNKNOWN, UNKNOWN, status, 0.0),
        min(MOST_CONNECTIONS, _most_files() // 2),
        max(MOST_BODY_BYTES, 2 * service.state.max_body_bytes),
    )
    return EndingServer(
        uvicorn.Config(
            service,
            http=cast("type[PatientProtocol]", partial(PatientProtocol, limits=limits)),
            ws="none",
            log_level=log_level,
            log_config=None,
            access_log=False,
            lifespan="on",
            timeout_graceful_shutdown=GRACE_S,
            server_header=False,
            # Else the server believes whoever comes from 127.0.0.1, where other users are, too.
            proxy_headers=bool(service.state.forwarded_allow_ips),
            forwarded_allow_ips=service.state.forwarded_allow_ips,
        ),
        service.state.patience_s,
        service.state.turns,
        service.state.streams,
    )


def _most_files() -> int:
    """Let this process open as many files as the system allows it, and say how many."""
    if sys.platform == "win32":
        return 2 * MOST_CONNECTIONS
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = _NEEDED_FILES if hard == resource.RLIM_INFINITY else min(hard, _NEEDED_FILES)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
        return most
    return _NEEDED_FILES if soft == resource.RLIM_INFINITY else soft


@contextmanager
def serving(service: FastAPI, opened: socket.socket, log_level: str) -> Iterator[None]:
    """Serve in a thread for as long as the block lasts.

    Raises
    ------
    CannotListen
        If the service does not start; its log has said why.
    """
    server = server_for(service, log_level)
    thread = Thread(target=server.run, args=([opened],), name="service", daemon=True)
    thread.start()
    try:
        while not server.started:
            if not thread.is_alive():
                raise CannotListen("the service did not start")
            time.sleep(0.01)
        yield
    finally:
        server.should_exit = True
        thread.join(2.0 * GRACE_S)


@contextmanager
def exiting_on_signals() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end the block, and the command, with exit code 0."""

    def leave(_signal: int, _frame: FrameType | None) -> None:
        raise SystemExit(0)

    before = {number: signal.signal(number, leave) for number in HANDLED_SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def wait_for_signal() -> None:
    """Wait, within `exiting_on_signals`, for a signal.

    It is never waited without a limit. The system may hand a signal of the process to any thread
    that lets it pass, as to one that has just started a process and opens its mask again. Python
    runs the handler in the main thread, but nothing wakes that one there.
    """
    while True:
        time.sleep(NOTICED_S)


def _exit_anyway() -> None:
    time.sleep(END_S)
    logging.getLogger("thermap").warning(
        "ends %d s after it was told to, though something still hangs", END_S
    )
    os._exit(0)


def _why_not(error: OSError, host: str, port: int, command: str) -> str:
    other = port + 1 if port < 65535 else 8001
    if "in use" in str(error.strerror).lower():
        return f"port {port} on {host} is in use: try `thermap {command} --port {other}`"
    return f"cannot listen on port {port} of {host}: {error.strerror}"
