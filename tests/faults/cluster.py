"""A PostgreSQL server of our own in a folder, to be stopped and paused."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path
from typing import Any

import psycopg

PATIENCE_S = 120.0
QUIET: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def programs() -> Path | None:
    """Find the newest server's programs; None where there is none that could be started here."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if not found or (os.geteuid() == 0 and shutil.which("setpriv") is None):
        return None
    return found[-1].parent


class Cluster:
    """A server on a free port, run by the user postgres where this is root.

    Parameters
    ----------
    folder
        An empty folder that everybody may look into.
    """

    def __init__(self, folder: Path) -> None:
        found = programs()
        if found is None:
            raise RuntimeError("there is no PostgreSQL here to be started")
        self._programs = found
        self._folder = folder / "cluster"
        self._folder.mkdir()
        if os.geteuid() == 0:
            shutil.chown(self._folder, "postgres", "postgres")
        subprocess.run(
            [*_as_postgres(), found / "initdb", "-D", self._folder, "-A", "trust", "-U", "thermap"],
            check=True,
            capture_output=True,
            cwd="/",
        )
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port: int = free.getsockname()[1]
        self._server: subprocess.Popen[bytes] | None = None
        self.start()
        self.execute("CREATE DATABASE thermap")
        self.url = f"postgresql://thermap@127.0.0.1:{self.port}/thermap"

    def start(self) -> None:
        """Start it and wait until it answers."""
        words = [
            *_as_postgres(),
            *(self._programs / "postgres", "-D", self._folder, "-k", "", "-p", self.port),
            *("-c", "listen_addresses=127.0.0.1"),
        ]
        deadline = time.monotonic() + PATIENCE_S
        while True:
            # It ends at once while something of the one before is still there.
            if self._server is None or self._server.poll() is not None:
                self._server = subprocess.Popen(list(map(str, words)), cwd="/", **QUIET)
            try:
                self.execute("SELECT 1")
                return
            except psycopg.OperationalError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.1)

    def stop(self) -> None:
        """Stop it at once, as when the power goes."""
        if self._server is not None and self._server.poll() is None:
            self._signal(signal.SIGCONT)
            self._server.send_signal(signal.SIGQUIT)
            self._server.wait()
        self._server = None

    def pause(self) -> None:
        """Let all its processes stand still; connections stay open."""
        self._signal(signal.SIGSTOP)

    def resume(self) -> None:
        """Let them go on."""
        self._signal(signal.SIGCONT)

    def execute(self, statement: Any) -> None:
        with psycopg.connect(
            f"postgresql://thermap@127.0.0.1:{self.port}/postgres",
            autocommit=True,
            connect_timeout=10,
        ) as connection:
            connection.execute(statement)

    def _signal(self, number: signal.Signals) -> None:
        assert self._server is not None
        children = Path(f"/proc/{self._server.pid}/task/{self._server.pid}/children")
        # The one that starts others first: none is missed.
        for pid in (self._server.pid, *map(int, children.read_text().split())):
            try:
                os.kill(pid, number)
            except ProcessLookupError:
                continue


def _as_postgres() -> list[str]:
    if os.geteuid() != 0:
        return []
    return ["setpriv", "--reuid=postgres", "--regid=postgres", "--clear-groups"]
