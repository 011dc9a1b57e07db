"""Run the loop on measured data and print what it found, before and after.

python -m examples.measured [lathe|responses|unseen|drive|slit|printers …]
    [--data FOLDER] [--folds N]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from examples.measured import (
    drive_report,
    lathe_public,
    lathe_report,
    lathe_responses,
    printers_report,
    slit_report,
)
from examples.measured.data_folder import data_folder

REPORTS = {
    "lathe": lathe_report.print_report,
    "responses": lathe_responses.print_report,
    "unseen": lathe_public.print_report,
    "drive": drive_report.print_report,
    "slit": slit_report.print_report,
    "printers": printers_report.print_report,
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
        "--folds", type=int, default=7, help="parts in which the lathe's runs are left out"
    )
    asked = parser.parse_args(arguments)
    for name in asked.what or REPORTS:
        if name not in REPORTS:
            parser.error(f"expected {', '.join(REPORTS)}, got {name}")
    for name in asked.what or REPORTS:
        print(f"== {name}")
        begun = time.perf_counter()
        REPORTS[name](asked.data, asked.folds)
        print(f"  {time.perf_counter() - begun:.0f} s\n")


if __name__ == "__main__":
    main()
