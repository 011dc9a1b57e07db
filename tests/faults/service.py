"""The service, or a worker, in a process of its own, to be ended in any way."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROGRAM = [sys.executable, "-m", "app"]


class Service:
    """`thermap serve` on a free port of this computer.

    Parameters
    ----------
    log
        Where it writes what it has to say, after what is there; without it beside our own.
    """

    def __init__(self, database_url: str, *, log: Path | None = None, **environment: str) -> None:
        with log.open("ab") if log else nullcontext() as into:
            self._process = subprocess.Popen(
                [*PROGRAM, "serve", "--port", "0", "--database-url", database_url],
                cwd=ROOT,
                env=_unset() | {"THERMAP_LOCK_LIMIT_S": "60"} | environment,
                stdout=subprocess.PIPE,
                stderr=into,
                text=True,
            )
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if found := re.search(r"listens on (\S+)", line):
                self.url = found[1]
                return
        raise RuntimeError(f"thermap serve ended with {self._process.wait()}")

    @property
    def pid(self) -> int:
        return self._process.pid

    def send(self, number: signal.Signals) -> None:
        """Send a signal, and wait for nothing."""
        self._process.send_signal(number)

    def end(self, number: signal.Signals = signal.SIGKILL) -> int:
        """Send a signal, wait, and give the exit code."""
        self._process.send_signal(number)
        self._process.communicate()
        return self._process.returncode


class Worker:
    """`thermap worker` on this computer.

    Parameters
    ----------
    log
        Where it writes what it has to say, after what is there.
    """

    def __init__(self, database_url: str, log: Path) -> None:
        with log.open("ab") as into:
            self._process = subprocess.Popen(
                [*PROGRAM, "worker", "--database-url", database_url],
                cwd=ROOT,
                env=_unset(),
                stdout=into,
                stderr=into,
            )

    def expect_alive(self) -> None:
        """Raise RuntimeError where it ended by itself."""
        if (code := self._process.poll()) is not None:
            raise RuntimeError(f"thermap worker ended by itself with {code}")

    def analyses(self) -> set[int]:
        """Give the processes in which it analyses now, and not what Python runs beside them."""
        listed = Path(f"/proc/{self._process.pid}/task").glob("*/children")
        pids = {int(pid) for one in listed for pid in one.read_text().split()}
        return {pid for pid in pids if "spawn_main" in words_of(pid)}

    def end(self, number: signal.Signals = signal.SIGKILL) -> int:
        """Send a signal, wait, and give the exit code."""
        self._process.send_signal(number)
        return self._process.wait()


def words_of(pid: int) -> str:
    """Give the words of a process' command; none where it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _unset() -> dict[str, str]:
    """Give our environment without what anybody set for thermap."""
    return {name: value for name, value in os.environ.items() if "THERMAP_" not in name}
