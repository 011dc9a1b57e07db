"""Several processes that serve one socket: started, watched, started again, and ended together."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import socket
import time
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from threading import Thread
from typing import Final

from app.cli.listening import END_S, make_service, server_for
from app.cli.logs import LogFormat, write_log_as
from app.settings import Settings

log = logging.getLogger("thermap")

AGAIN_AFTER_S: Final = 1.0
"""A worker that dies is started again no sooner than so long after its start [s]."""

_SPAWN: Final = multiprocessing.get_context("spawn")


class Workers:
    """The workers of one host, numbered from 1.

    Each is a service of its own with all machines in its memory; PostgreSQL tells each what the
    others stored. What runs once a host, runs in the first.

    Parameters
    ----------
    opened
        The listening socket, from which each takes connections.
    """

    def __init__(
        self, settings: Settings, opened: socket.socket, count: int, log_format: LogFormat
    ) -> None:
        self._settings = settings
        self._opened = opened
        self._log_format = log_format
        self._running: dict[int, BaseProcess] = {}
        self._started_s = dict.fromkeys(range(1, count + 1), -AGAIN_AFTER_S)

    def run(self) -> None:
        """Keep all of them running until an exception, such as a signal's, ends the block."""
        try:
            while True:
                self._start_missing()
                ends = [process.sentinel for process in self._running.values()]
                wait(ends, AGAIN_AFTER_S)
                self._bury()
        finally:
            self._end()

    def _start_missing(self) -> None:
        for number, started_s in self._started_s.items():
            now_s = time.monotonic()
            if number not in self._running and now_s - started_s >= AGAIN_AFTER_S:
                process = _SPAWN.Process(
                    target=serve_as_worker,
                    args=(worker_settings(self._settings, number), self._opened, self._log_format),
                    name=f"thermap-worker-{number}",
                )
                process.start()
                self._running[number] = process
                self._started_s[number] = now_s

    def _bury(self) -> None:
        for number, process in list(self._running.items()):
            if not process.is_alive():
                log.error(
                    "worker %d has died (exit code %s), starts again", number, process.exitcode
                )
                del self._running[number]
                process.close()
        if len(self._running) < len(self._started_s):
            time.sleep(AGAIN_AFTER_S / 10)

    def _end(self) -> None:
        """End all, each as a service of its own ends; who hangs is killed."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # the end has begun
        for process in self._running.values():
            process.terminate()
        end_s = time.monotonic() + END_S + 1.0
        for process in self._running.values():
            process.join(max(0.0, end_s - time.monotonic()))
            if process.is_alive():
                process.kill()
                process.join()


def worker_settings(settings: Settings, number: int) -> Settings:
    """Give a worker's settings: connections and the OPC UA server are the first one's alone."""
    settings_of_worker: dict[str, object] = {"worker": number}
    if number > 1:
        settings_of_worker |= {"config": None, "opcua_endpoint": ""}
    return settings.model_copy(update=settings_of_worker)


def serve_as_worker(settings: Settings, opened: socket.socket, log_format: LogFormat) -> None:
    """Serve until a signal, or until the process that started this one is gone."""
    if os.name == "posix":
        os.setpgrp()  # Ctrl-C is for the one that started us, which ends us
    write_log_as(log_format)
    server = server_for(make_service(settings), settings.log_level)
    Thread(target=_end_with_parent, name="parent", daemon=True).start()
    server.run([opened])


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
