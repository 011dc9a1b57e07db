"""What must not happen, tried as often as it takes; the tests do the same in small.

    python -m tests.faults ending [--times 100]
    python -m tests.faults workers [--times 100] [--server postgresql://…]
    python -m tests.faults requests [--cases 10000]
    python -m tests.faults full [--times 10]

`ending` kills the service with -9 under load, and looks for everything that was answered.
`workers` kills two workers with -9 while analyses of several machines are asked for, on a database
of its own on a PostgreSQL server: each analysis comes to its end, and of a machine one at a time.
`requests` sends what schemathesis makes of the OpenAPI document: no 5xx, and no answer that the
document does not have. `full` fills the disk of the database, a small one of its own, under load:
who stores is told, what was answered is there, and with room it goes on. It needs root.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from pathlib import Path

from tests.faults.cluster import Cluster, programs
from tests.faults.ending import end_under_load
from tests.faults.full import database_on, fill_under_load, small_disk, why_not
from tests.faults.killed_workers import kill_workers, scratch_database
from tests.faults.requests import send_cases
from tests.faults.writers import ROUNDS


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    faults = parser.add_subparsers(dest="fault", required=True)
    ending = faults.add_parser("ending")
    ending.add_argument("--times", type=int, default=100)
    ending.add_argument("--sigterm", action="store_true", help="end it as an operator does")
    workers = faults.add_parser("workers")
    workers.add_argument("--times", type=int, default=100)
    workers.add_argument("--seed", type=int, default=1)
    workers.add_argument("--server", default="postgresql://postgres@127.0.0.1:5432/postgres")
    requests = faults.add_parser("requests")
    requests.add_argument("--cases", type=int, default=10_000)
    requests.add_argument("--seed", type=int, default=1)
    full = faults.add_parser("full")
    full.add_argument("--times", type=int, default=10)
    asked = parser.parse_args()
    if asked.fault == "full" and (reason := why_not()):
        parser.error(reason)
    with tempfile.TemporaryDirectory() as folder:
        if asked.fault == "ending":
            end(Path(folder), asked.times, signal.SIGTERM if asked.sigterm else signal.SIGKILL)
        elif asked.fault == "workers":
            kill(Path(folder), asked.server, asked.times, asked.seed)
        elif asked.fault == "full":
            Path(folder).chmod(0o755)  # the server's user looks into it
            fill(Path(folder), asked.times)
        else:
            url = f"sqlite:///{folder}/requests.db"
            sys.exit(send_cases(url, cases=asked.cases, seed=asked.seed))


def end(folder: Path, times: int, number: signal.Signals) -> None:
    """End it some times on a database, then on another, until it was ended often enough."""
    began = time.monotonic()
    total = maps = readings = 0
    while total < times:
        url = f"sqlite:///{folder}/ending-{total}.db"
        ended = end_under_load(url, min(ROUNDS, times - total), number)
        total, maps, readings = (
            total + ended.times,
            maps + ended.maps,
            readings + ended.readings,
        )
        print(
            f"{time.monotonic() - began:6.0f} s: ended {total} times by {number.name}; all of "
            f"{maps} maps and {readings} readings that were answered are there",
            flush=True,
        )


def kill(folder: Path, server: str, times: int, seed: int) -> None:
    """Kill workers so often on one database."""
    began = time.monotonic()

    def say(words: str) -> None:
        print(f"{time.monotonic() - began:6.0f} s: {words}", flush=True)

    with scratch_database(server) as url:
        killed = kill_workers(url, folder, times, seed=seed, say=say)
    say(
        f"killed {killed.times} times by SIGKILL, {killed.in_the_middle} times in the middle of an "
        f"analysis; of {killed.asked} that were accepted {killed.done} have their right result, "
        f"{killed.failed} failed after three takes, and of a machine one ran at a time"
    )


def fill(folder: Path, times: int) -> None:
    """Fill the disk some times below a file, and below a server's tablespace where there is one."""
    for kind in ("SQLite", "PostgreSQL") if programs() else ("SQLite",):
        for i in range(times):
            place = folder / f"{kind}-{i}"
            place.mkdir(mode=0o755)
            cluster = Cluster(place) if kind == "PostgreSQL" else None
            try:
                with small_disk(4 if cluster is None else 32) as disk:
                    filled = fill_under_load(disk, database_on(disk, cluster))
                    if cluster is not None:
                        cluster.stop()
            finally:
                if cluster is not None:
                    cluster.stop()
            print(
                f"{kind} {i + 1}: {filled.no_room} times there was no room; all of "
                f"{filled.before} batches before and {filled.after} after are there",
                flush=True,
            )


if __name__ == "__main__":
    main()
