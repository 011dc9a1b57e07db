"""The turning centre: every third day unseen, the others analysed and adopted.

Maps are two states of day 2 over the ambient temperature; each day is one verification that was
zeroed at its start, with the day's readings and nothing between days. Rows are taken to be a
minute apart: the source has no times.
"""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import numpy as np

from app.arrays import FloatArray, rms
from app.effects.observations import Observation, Verification
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.identification.campaign import Campaign
from app.search.rows import Datum
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, OutOfRange, Sensor, sensors_by_name
from app.thermal.temperature_history import TemperatureHistory
from examples.measured.loop import adopt_what_helps, measured_and_left

FOLDER: Final = "turning-2023"
CODE: Final = "EXX"
MAPPED: Final = "day02"
FOLLOWED: Final = "ambient"
FIRST: Final = datetime(2023, 1, 1, 6, tzinfo=UTC)
PARTS: Final = 3
MARGIN_C: Final = 20.0


@dataclass(frozen=True, eq=False)
class Day:
    """One day: times [s], temperatures [°C] by sensor, the diameter [µm] from its start."""

    name: str
    times_s: FloatArray
    temperatures_c: dict[str, FloatArray]
    diameter_um: FloatArray


def read_days(data: Path) -> list[Day]:
    """Read all days."""
    days = []
    for path in sorted((data / FOLDER / "days").glob("day*.csv")):
        with path.open(encoding="utf-8-sig", newline="") as lines:
            names, *rows = csv.reader(lines)
        minutes, *temperatures, diameter = np.array(rows, dtype=float).T
        began = FIRST + timedelta(days=int(path.stem[3:]))
        times_s = began.timestamp() + 60.0 * (minutes - minutes[0])
        by_name = dict(zip(names[1:-1], temperatures, strict=True))
        days.append(Day(path.stem, times_s, by_name, diameter - diameter[0]))
    return days


def campaign(days: Iterable[Day], known: Collection[str]) -> Campaign:
    """Make the campaign of some days; the readings are of all."""
    days = list(days)
    machine = Machine(
        id="turning-centre",
        name="Turning centre",
        chain=Chain.parse("FZX"),
        sensors=sensors_by_name(
            [Sensor(name, max_age_s=3600.0, stuck_after_s=None) for name in days[0].temperatures_c]
        ),
        out_of_range=OutOfRange.EXTRAPOLATE,
        extrapolation_margin_c=MARGIN_C,
    )
    (mapped,) = (day for day in days if day.name == MAPPED)
    maps = [_map(mapped, i) for i in (0, -1)]
    readings = TemperatureHistory(
        np.concatenate([day.times_s for day in days]),
        {
            name: np.concatenate([day.temperatures_c[name] for day in days])
            for name in machine.sensors
        },
    )
    model = compile_model(machine, maps, {CODE: FOLLOWED})
    return Campaign(model, maps, [verification(d) for d in days if d.name in known], readings)


def verification(day: Day) -> Verification:
    """Write a day as a verification."""
    return Verification(
        day.name,
        [
            Observation(float(t), (float(value),), CODE, 0.0)
            for t, value in zip(day.times_s, day.diameter_um, strict=True)
        ],
        Datum.FIRST,
    )


def print_report(data: Path) -> None:
    """Print what unseen days are left with, every third day unseen in turn."""
    days = read_days(data)
    raw, before, after = [], [], []
    for part in range(PARTS):
        unseen = [day for i, day in enumerate(days) if i % PARTS == part]
        learnt = campaign(days, [day.name for day in days if day not in unseen])
        effects = adopt_what_helps(learnt)
        print(f"  part {part + 1}: {', '.join(one.kind for one in effects) or 'nothing'} adopted")
        for day in unseen:
            asked = [verification(day)]
            _, measured, by_maps = measured_and_left(learnt, asked)
            _, _, left = measured_and_left(learnt, asked, effects)
            raw.append(measured)
            before.append(by_maps)
            after.append(left)
            print(f"    {day.name}: {rms(measured):.1f}, maps {rms(by_maps):.1f}, {rms(left):.1f}")
    each = (f"{rms(np.concatenate(one)):.2f}" for one in (raw, before, after))
    print("  uncompensated {}, maps {}, after adoption {} µm".format(*each))


def _map(day: Day, i: int) -> ErrorMap:
    return ErrorMap(
        label=f"{day.name}, row {i}",
        measured_at=datetime.fromtimestamp(float(day.times_s[i]), UTC),
        temperatures_c={name: float(t[i]) for name, t in day.temperatures_c.items()},
        tables={CODE: ComponentTable.make(COMPONENTS[CODE], [float(day.diameter_um[i])], [0.0])},
        repeatability_um=0.5,
    )
