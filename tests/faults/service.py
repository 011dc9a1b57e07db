"""The service in a process of its own, to be ended in any way."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

ROOT = Path(__file__).parents[2]
WORDS = [sys.executable, "-m", "app", "serve"]


class Service:
    """`thermap serve` on a free port of this computer.

    Parameters
    ----------
    log
        Where it writes what it has to say, after what is there; without it beside our own.
    """

    def __init__(self, database_url: str, *, log: Path | None = None, **environment: str) -> None:
        named = {name: value for name, value in os.environ.items() if "THERMAP_" not in name}
        with log.open("ab") if log else nullcontext() as into:
            self._process = subprocess.Popen(
                [*WORDS, "--port", "0", "--database-url", database_url],
                cwd=ROOT,
                env=named | {"THERMAP_LOCK_LIMIT_S": "60"} | environment,
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
