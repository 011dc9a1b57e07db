"""The measured runs of a CNC lathe (IMBD competition 2025): read, and cleaned of frozen rows.

The data's owner states no licence, so they are no part of the project: they are looked
for where THERMAP_MEASURED_DATA says, or in shared/data/measured beside the checkout.
"""

import csv
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

FOLDER = (
    Path(
        os.environ.get(
            "THERMAP_MEASURED_DATA",
            Path(__file__).parents[3] / "shared" / "data" / "measured",
        )
    )
    / "lathe-imbd2025"
)

FAILED = {"PT10"}
"""Climbs to 30 K above its neighbours in run 20200821 and stays there."""

SENSORS = [f"PT{i:02d}" for i in range(1, 14)] + [f"TC{i:02d}" for i in range(1, 9)]
SENSORS = [name for name in SENSORS if name not in FAILED]


@dataclass(frozen=True, eq=False)
class LatheRun:
    """One run: minutes from its start, temperatures, displacement zeroed at the start."""

    date: str
    time_min: np.ndarray
    temperatures_c: dict[str, np.ndarray]
    displacement_um: dict[str, np.ndarray]


def read_run(date):
    """Read the run that began on a date (YYYYMMDD), without rows in which X and Z are frozen."""
    (path,) = (FOLDER / "runs").glob(f"_{date}_*.csv")
    with path.open(encoding="utf-8-sig", newline="") as lines:
        header, *rows = csv.reader(lines)
    columns = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    x, z = columns["Disp. X"], columns["Disp. Z"]
    frozen = np.concatenate([[False], (np.diff(x) == 0) & (np.diff(z) == 0)])
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(columns["Time"])) > 0])
    kept = ~frozen & rising
    return LatheRun(
        date=date,
        time_min=columns["Time"][kept],
        temperatures_c={name: columns[name][kept] for name in SENSORS},
        displacement_um={"EXX": x[kept], "EZZ": z[kept]},
    )


def dates():
    """List the dates of all runs."""
    return sorted(path.name.split("_")[1] for path in (FOLDER / "runs").glob("*.csv"))
