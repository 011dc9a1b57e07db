"""The printers: maps over the frame's temperature, and the bed that the maps do not know.

Each sample (three homings within a minute) is one verification; its zero is the switch, the
same for all. Two stretches of three are learnt from, the third is predicted, in turn. The
bed of the second printer changed in its first ten minutes only: its stretches are short.
The printer had stood before; its first reading is taken to have held for fourteen hours.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.effects.observations import Observation, Verification
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.identification.campaign import Campaign
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, OutOfRange, Sensor, sensors_by_name
from app.thermal.temperature_history import TemperatureHistory

FOLDER = "printer-frame-z"
SENSORS: Final = {"frame": "frame_t", "chamber": "chamber_t", "bed": "bed_t", "nozzle": "he_t"}
REST_S: Final = 14 * 3600.0
REST_EVERY_S: Final = 1800.0
PARTS: Final = 3
REPEATABILITY_UM: Final = 1.0


@dataclass(frozen=True, slots=True)
class Printer:
    """One recorded run: file, step of its Z axis, samples that become maps, stretch left out."""

    file: str
    step_um: float
    mapped: tuple[int, ...]
    stretch_s: float


PRINTERS: Final = {
    "voron": Printer("voron350_run1_thermistor_beta.csv", 2.5, (0, 30, 90, 180), 1200.0),
    "annex": Printer("annex_k3_run.csv", 1.25, (0, 20, 60, 150), 240.0),
}
"""All mapped while they heat up, at frame temperatures some kelvin apart."""


@dataclass(frozen=True, eq=False)
class Homings:
    """Homings in order of time: sample, time [s], Z [µm] from the first, temperatures [°C]."""

    samples: np.ndarray
    times_s: FloatArray
    z_um: FloatArray
    temperatures_c: dict[str, FloatArray]


def read_homings(data: Path, printer: Printer) -> Homings:
    """Read one run; homings of the same second follow each other by a tenth."""
    text = (data / FOLDER / printer.file).read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in text if not line.startswith("#")))
    columns = {name: np.array([float(row[name]) for row in rows]) for name in SENSORS.values()}
    steps = np.array([float(row["mcu_pos_z"]) for row in rows])
    seconds = np.array([_seconds(row["time"]) for row in rows])
    return Homings(
        samples=np.array([int(row["sample"]) for row in rows]),
        times_s=seconds + 0.1 * (np.arange(len(rows)) - np.searchsorted(seconds, seconds)),
        z_um=(steps - steps[0]) * printer.step_um,
        temperatures_c={name: columns[column] for name, column in SENSORS.items()},
    )


def campaign(printer: Printer, homings: Homings, part: int) -> tuple[Campaign, list[Verification]]:
    """Make the campaign of two thirds of the stretches, and the verifications of the rest."""
    machine = _machine(printer)
    maps = [_map(homings, sample) for sample in printer.mapped]
    model = compile_model(machine, maps, {"EZZ": "frame"})
    learn: list[Verification] = []
    predict: list[Verification] = []
    for verification in _verifications(homings):
        since_s = verification.observations[0].time_s - homings.times_s[0]
        (predict if int(since_s // printer.stretch_s) % PARTS == part else learn).append(
            verification
        )
    return Campaign(model, maps, learn, _record(homings)), predict


def _machine(printer: Printer) -> Machine:
    sensors = [
        Sensor(name, max_age_s=3600.0, stuck_after_s=None, max_rate_c_per_min=100.0)
        for name in SENSORS
    ]
    return Machine(
        id="printer",
        name=printer.file,
        chain=Chain.parse("XYFZ"),
        sensors=sensors_by_name(sensors),
        out_of_range=OutOfRange.EXTRAPOLATE,
    )


def _map(homings: Homings, sample: int) -> ErrorMap:
    own = homings.samples == sample
    return ErrorMap(
        label=f"sample {sample}",
        measured_at=datetime.fromtimestamp(float(homings.times_s[own][0]), UTC),
        temperatures_c={n: float(t[own].mean()) for n, t in homings.temperatures_c.items()},
        tables={"EZZ": ComponentTable.make(COMPONENTS["EZZ"], [homings.z_um[own].mean()], [0.0])},
        repeatability_um=REPEATABILITY_UM,
    )


def _verifications(homings: Homings) -> list[Verification]:
    values = zip(
        homings.samples.tolist(), homings.times_s.tolist(), homings.z_um.tolist(), strict=True
    )
    return [
        Verification(f"sample {sample}", [Observation(t, (z,), "EZZ", 0.0) for _, t, z in together])
        for sample, together in groupby(values, lambda row: row[0])
    ]


def _record(homings: Homings) -> TemperatureHistory:
    rest = homings.times_s[0] - np.arange(REST_S, 0.0, -REST_EVERY_S)
    return TemperatureHistory(
        np.concatenate([rest, homings.times_s]),
        {
            name: np.concatenate([np.full(rest.shape, t[0]), t])
            for name, t in homings.temperatures_c.items()
        },
    )


def _seconds(text: str) -> float:
    return datetime.strptime(text, "%Y/%m/%d-%H:%M:%S").replace(tzinfo=UTC).timestamp()
