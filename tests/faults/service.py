"""The service, or a worker, in a process of its own, to be ended in any way.

Each is forked from a process that has imported the program, which is most of what one does until
it works. `tests/cli` and `tests/hostile` start it as people do.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import re
import signal
import sys
from multiprocessing.connection import Connection
from pathlib import Path

from app.cli import main

ROOT = Path(__file__).parents[2]

_FORKING = multiprocessing.get_context("forkserver")
_FORKING.set_forkserver_preload(["app.main", "app.cli.serve", "app.cli.worker"])


class Program:
    """`thermap` with some words, and nothing else of thermap in its environment.

    Parameters
    ----------
    log
        Where it writes what is wrong, after what is there; without it beside our own.
    """

    def __init__(self, *words: str, log: Path | None = None, **environment: str) -> None:
        says, into = _FORKING.Pipe(duplex=False)
        self._process = _FORKING.Process(target=_run, args=(words, into, log, environment))
        self._process.start()
        into.close()
        # Open as long as it runs: who writes where nobody can read is ended.
        self._said = os.fdopen(os.dup(says.fileno()), encoding="utf-8")
        says.close()
        assert self._process.pid is not None
        self.pid = self._process.pid
        self.code: int | None = None
        # Else Python would wait at its own end for what a failed test has left running.
        atexit.register(self._end_if_left)

    def expect_alive(self) -> None:
        """Raise RuntimeError where it ended by itself."""
        code = self._process.exitcode if self.code is None else self.code
        if code is not None:
            raise RuntimeError(f"thermap ended by itself with {code}")

    def send(self, number: signal.Signals) -> None:
        """Send a signal, and wait for nothing."""
        if self.code is None:
            os.kill(self.pid, number)

    def wait(self) -> int:
        """Wait for its end, and give the exit code."""
        if self.code is None:
            self._process.join()
            self._said.close()
            assert self._process.exitcode is not None
            self.code = self._process.exitcode
            self._process.close()
        return self.code

    def _end_if_left(self) -> None:
        if self.code is None and self._process.exitcode is None:
            self.end()

    def end(self, number: signal.Signals = signal.SIGKILL) -> int:
        """Send a signal, wait, and give the exit code."""
        self.send(number)
        return self.wait()


class Service(Program):
    """`thermap serve` on this computer, on a free port where none is given."""

    def __init__(
        self, database_url: str, *, port: int = 0, log: Path | None = None, **environment: str
    ) -> None:
        words = ("serve", "--port", str(port), "--database-url", database_url)
        super().__init__(*words, log=log, **{"THERMAP_LOCK_LIMIT_S": "60"} | environment)
        for line in self._said:
            if found := re.search(r"listens on (\S+)", line):
                self.url = found[1]
                return
        raise RuntimeError(f"thermap serve ended with {self.wait()}")


class Worker(Program):
    """`thermap worker` on this computer."""

    def __init__(self, database_url: str, *options: str, log: Path | None = None) -> None:
        super().__init__("worker", "--database-url", database_url, *options, log=log)

    def analyses(self) -> set[int]:
        """Give the processes in which it analyses now, and not what Python runs beside them."""
        listed = Path(f"/proc/{self.pid}/task").glob("*/children")
        pids = {int(pid) for one in listed for pid in one.read_text().split()}
        return {pid for pid in pids if "spawn_main" in words_of(pid)}


def words_of(pid: int) -> str:
    """Give the words of a process' command; none where it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _run(
    words: tuple[str, ...], into: Connection, log: Path | None, environment: dict[str, str]
) -> None:
    """Be the program; in the forked process."""
    os.dup2(into.fileno(), 1)
    into.close()
    if log:
        with log.open("ab") as file:
            os.dup2(file.fileno(), 2)
    sys.stdout, sys.stderr = (os.fdopen(fd, "w", encoding="utf-8", closefd=False) for fd in (1, 2))
    for name in [name for name in os.environ if "THERMAP_" in name]:
        del os.environ[name]
    os.environ.update(environment)
    os.chdir(ROOT)
    sys.argv = ["thermap", *words]
    main()
