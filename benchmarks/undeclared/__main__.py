"""Write a campaign with an undeclared effect as JSON files.

python -m benchmarks.undeclared --seed 3 --planted thermal-lag --amplitude 2 --out FOLDER
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.undeclared.campaign import make_campaign
from benchmarks.undeclared.conditions import DATUMS
from benchmarks.undeclared.json_files import write_campaign
from benchmarks.undeclared.planting import ALL


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.undeclared",
        description="Write a simulated campaign as the bodies of HTTP requests, and its truth.",
        epilog="effects: " + "; ".join(f"{n}:{'|'.join(f.variants)}" for n, f in ALL.items()),
    )
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument(
        "--planted", nargs="*", default=[], metavar="EFFECT", help="names, with :variant or without"
    )
    parser.add_argument(
        "--amplitude", type=float, default=2.0, help="in units of the repeatability"
    )
    parser.add_argument("--visits", type=int, default=100)
    parser.add_argument("--observations-per-visit", type=int, default=40)
    parser.add_argument("--days", type=int, help="over which the visits spread")
    parser.add_argument("--repeatability-um", type=float, default=1.0)
    parser.add_argument("--quantum-c", type=float, default=0.01, help="rounding of readings")
    parser.add_argument("--datum", choices=DATUMS, default="absolute")
    parser.add_argument("--one-verification", action="store_true", help="all visits in one")
    parser.add_argument("--outliers", type=float, default=0.0, help="share of blunders")
    parser.add_argument("--frozen", type=int, default=0, help="stand-stills of sensors")
    parser.add_argument("--ar1-um", type=float, default=0.0, help="lingering scatter")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    return parser


def main(arguments: list[str] | None = None) -> None:
    """Write the files and say what they are."""
    parser = _arguments()
    asked = vars(parser.parse_args(arguments))
    folder = asked.pop("out")
    try:
        campaign = make_campaign(**asked)
    except ValueError as wrong:
        parser.error(str(wrong))
    files = write_campaign(campaign, folder)
    values = campaign.truth.measured_um.size
    print(f"{len(files)} files in {folder}: {len(campaign.readings)} readings, {values} values")
    for effect in campaign.truth.effects:
        print(f"{effect['kind']} ({effect['variant']}) on {', '.join(effect['components'])}")  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
