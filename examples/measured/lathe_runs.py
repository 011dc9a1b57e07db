"""The measured runs of a CNC lathe (IMBD competition 2025), as they were published."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from app.arrays import FloatArray
from app.units import SECONDS_PER_MIN

FOLDER = "lathe-imbd2025"

FAILED = "PT10"
"""Its owner does not say so: it is the analysis that must."""

SENSORS = (
    *(f"PT{i:02d}" for i in range(1, 14)),
    *(f"TC{i:02d}" for i in range(1, 9)),
    *("Spindle Motor", "X Motor", "Z Motor"),
)

SPLICED_MIN = {"20200706": 329.0}
"""From then on a run's file holds something else: a saturated piece was spliced in [min]."""

DISPLACEMENTS = {"EXX": "Disp. X", "EZZ": "Disp. Z"}
"""Component to column: tool against workpiece, along the axis, at one position."""


@dataclass(frozen=True, eq=False)
class Run:
    """One run: temperatures, and displacement since its start.

    Parameters
    ----------
    date
        Day on which it began, YYYYMMDD: its name.
    times_s : ndarray, shape (n,) [s]
        Seconds since 1970-01-01 UTC, as if the run had begun at midnight.
    temperatures_c : mapping of sensor to ndarray, shape (n,) [°C]
        As published, failed sensor included.
    displacement_um : mapping of component to ndarray, shape (n,) [µm]
        Zero at the start of the run.
    spindle_rpm : ndarray, shape (n,) [1/min]
        From the owner's schedule; 0 after its end.
    """

    date: str
    times_s: FloatArray
    temperatures_c: dict[str, FloatArray]
    displacement_um: dict[str, FloatArray]
    spindle_rpm: FloatArray

    @property
    def minutes(self) -> FloatArray:
        """Time since midnight of the first day [min], shape (n,)."""
        return (self.times_s - _midnight_s(self.date)) / SECONDS_PER_MIN


def read_runs(data: Path) -> list[Run]:
    """Read all published runs in order of time."""
    folder = data / FOLDER
    with (folder / "conditions.csv").open(encoding="utf-8-sig", newline="") as lines:
        schedules = {row["date"]: row for row in csv.DictReader(lines)}
    paths = sorted((folder / "runs").glob("*.csv"), key=lambda path: path.name)
    return [_read(path, schedules) for path in paths]


def _read(path: Path, schedules: dict[str, dict[str, str]]) -> Run:
    date = path.name.split("_")[1]
    with path.open(encoding="utf-8-sig", newline="") as lines:
        header, *rows = csv.reader(lines)
    columns = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    kept = np.concatenate([[True], np.diff(np.maximum.accumulate(columns["Time"])) > 0])
    kept &= columns["Time"] < SPLICED_MIN.get(date, np.inf)
    minutes = columns["Time"][kept]
    return Run(
        date=date,
        times_s=_midnight_s(date) + minutes * SECONDS_PER_MIN,
        temperatures_c={name: columns[name][kept] for name in SENSORS},
        displacement_um={code: columns[name][kept] for code, name in DISPLACEMENTS.items()},
        spindle_rpm=_speeds(schedules[date], minutes),
    )


def _midnight_s(date: str) -> float:
    return datetime.strptime(date, "%Y%m%d").replace(tzinfo=UTC).timestamp()


def _speeds(schedule: dict[str, str], minutes: FloatArray) -> FloatArray:
    """Lay the schedule's speeds out over the minutes of a run [1/min]."""
    found, end = np.zeros(minutes.shape), 0.0
    for part in ("1", "2", "3"):
        if schedule[f"hours_{part}"]:
            begin, end = end, end + 60.0 * float(schedule[f"hours_{part}"])
            here = (minutes >= begin) & (minutes < end)
            found[here] = float(schedule[f"rpm_{part}"])
    return found
