"""A fleet at work for an hour, with faults at random and every table computed again.

Starts the service, machines that are read, mapped, verified and asked without end, and what goes
wrong; ends with a page that says how many answers were checked, how many were wrong, and whether
memory or handles grew. Exit code 1 where an answer was wrong or something leaks.

    python -m benchmarks.soak [--minutes 60] [--machines 10] [--database postgresql://…]
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

from tests.faults.soak.run import soak


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--machines", type=int, default=10)
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--database", help="an empty one; a SQLite file of its own without it")
    parser.add_argument("--samples", type=Path, help="write memory, handles … over time there, CSV")
    parser.add_argument("--log", type=Path, help="keep the service's log there")
    stated = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        soaked = soak(
            stated.database or f"sqlite:///{folder}/soak.db",
            Path(folder),
            seconds=60.0 * stated.minutes,
            machines=stated.machines,
            seed=stated.seed,
            say=lambda words: print(words, flush=True),
        )
        if stated.log and (Path(folder) / "service.log").exists():
            shutil.copy(Path(folder) / "service.log", stated.log)
    if stated.samples:
        rows = [
            f"{s.at_s:.1f},{s.pid},{s.resident_mib:.1f},{s.handles},{s.threads},{s.database_mib:.2f}"
            for s in soaked.samples
        ]
        head = "at_s,pid,resident_mib,handles,threads,database_mib"
        stated.samples.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    print(soaked.page())
    sys.exit(0 if soaked.is_well else 1)


if __name__ == "__main__":
    main()
