"""What must not happen, tried as often as it takes; the tests do the same in small.

    python -m tests.faults ending [--times 100]
    python -m tests.faults requests [--cases 10000]

`ending` kills the service with -9 under load, and looks for everything that was answered.
`requests` sends what schemathesis makes of the OpenAPI document: no 5xx, and no answer that the
document does not have.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from pathlib import Path

from tests.faults.ending import end_under_load
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
    requests = faults.add_parser("requests")
    requests.add_argument("--cases", type=int, default=10_000)
    requests.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if asked.fault == "ending":
            end(Path(folder), asked.times, signal.SIGTERM if asked.sigterm else signal.SIGKILL)
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


if __name__ == "__main__":
    main()
