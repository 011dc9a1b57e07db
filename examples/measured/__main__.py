"""Run the loop on measured data and print what it found, before and after.

python -m examples.measured [responses|unseen|drive|slit|printers|turning …]
    [--data FOLDER] [--from DATE …]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from examples.measured import (
    drive_report,
    lathe_public,
    lathe_responses,
    printers_report,
    slit_report,
    turning,
)
from examples.measured.data_folder import data_folder

REPORTS: dict[str, Callable[[Path], None]] = {
    "responses": lathe_responses.print_report,
    "unseen": lathe_public.print_report,
    "drive": drive_report.print_report,
    "slit": slit_report.print_report,
    "printers": printers_report.print_report,
    "turning": turning.print_report,
}


def main(arguments: list[str] | None = None) -> None:
    """Print the reports that were asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m examples.measured",
        description="The loop on measured data: what it finds, and the error before and after.",
    )
    parser.add_argument("what", nargs="*", metavar="DATA", help=f"{', '.join(REPORTS)}; all")
    parser.add_argument("--data", type=Path, default=data_folder(), metavar="FOLDER")
    parser.add_argument(
        "--from",
        dest="since",
        nargs="+",
        choices=lathe_public.FIRST_UNSEEN,
        default=lathe_public.FIRST_UNSEEN,
        help="first unseen run of each split of `unseen`",
    )
    asked = parser.parse_args(arguments)
    for name in asked.what or REPORTS:
        if name not in REPORTS:
            parser.error(f"expected {', '.join(REPORTS)}, got {name}")
    reports = REPORTS | {"unseen": partial(lathe_public.print_report, since=asked.since)}
    for name in asked.what or REPORTS:
        print(f"== {name}")
        begun = time.perf_counter()
        reports[name](asked.data)
        print(f"  {time.perf_counter() - begun:.0f} s\n")


if __name__ == "__main__":
    main()
