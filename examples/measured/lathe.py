"""The lathe: maps from two states of one run, effects from other runs, predictions of the rest.

Every run is one verification that was zeroed at its start (datum `first`). The machine had
stood before each run; its first reading is taken to have held for the fourteen hours before,
as a filter of 160 min needs them. That is an assumption: nothing was recorded then.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.effects.observations import Observation, Verification
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.identification.campaign import Campaign
from app.search.rows import Datum
from app.thermal.compile_model import compile_model
from app.thermal.compiled_model import CompiledModel
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, OutOfRange, SameTemperature, Sensor, sensors_by_name
from app.thermal.sensor_assignment import propose_assignment
from app.thermal.temperature_history import TemperatureHistory
from examples.measured.lathe_runs import SENSORS, Run

MAPPED: Final = "20200817"
"""The widest range of room temperature, 20 to 30 °C, at 2000 1/min."""

STATES_TO_CORRELATE: Final = 6
REST_S: Final = 14 * 3600.0
REST_EVERY_S: Final = 1800.0
MARGIN_C: Final = 20.0
"""Rooms from 13 to 34 °C against maps from 17 to 27: the machine extrapolates."""

MAP_REPEATABILITY_UM: Final = 0.3


@dataclass(frozen=True, eq=False)
class Lathe:
    """All runs, the model of the first maps, and the whole record."""

    runs: Sequence[Run]
    maps: Sequence[ErrorMap]
    model: CompiledModel
    readings: TemperatureHistory
    states: Sequence[tuple[float, dict[str, float]]]
    every_s: float

    @property
    def dates(self) -> list[str]:
        """The runs that the maps were not made of."""
        return [run.date for run in self.runs if run.date != MAPPED]

    def verifications(self, dates: Collection[str]) -> list[Verification]:
        """Make a verification of each of some runs."""
        return [verification(run, self.every_s) for run in self.runs if run.date in dates]

    def campaign(self, dates: Collection[str]) -> Campaign:
        """Make the campaign of some runs."""
        return Campaign(
            self.model, self.maps, self.verifications(dates), self.readings, self.states
        )


def make_lathe(runs: Sequence[Run], every_s: float = 600.0) -> Lathe:
    """Compile the first model; its sensors are those that the service proposes.

    Parameters
    ----------
    runs
        All runs.
    every_s
        Time between two observations of a run [s].
    """
    (mapped,) = (run for run in runs if run.date == MAPPED)
    machine = _machine()
    proposals = propose_assignment(machine, _maps(mapped, STATES_TO_CORRELATE), {})
    assignment = {p.code: str(p.proposed_sensor) for p in proposals}
    maps = _maps(mapped, 2)
    model = compile_model(machine, maps, assignment)
    readings, states = _record(runs)
    return Lathe(runs, maps, model, readings, states, every_s)


def verification(run: Run, every_s: float) -> Verification:
    """Thin one run out; nothing is left out, stopped logs included."""
    observations: list[Observation] = []
    for i in _every(run.times_s, every_s):
        observations += [
            Observation(float(run.times_s[i]), (float(values[i]),), code, 0.0)
            for code, values in run.displacement_um.items()
        ]
    return Verification(run.date, observations, Datum.FIRST)


def _machine() -> Machine:
    sensors = [
        Sensor(
            name,
            max_age_s=3600.0,
            resolution_c=1.0 if name.endswith("Motor") else 0.1,
            stuck_after_s=None,
        )
        for name in SENSORS
    ]
    return Machine(
        id="gv1-1203",
        name="CNC lathe",
        chain=Chain.parse("FZX"),
        sensors=sensors_by_name(sensors),
        out_of_range=OutOfRange.EXTRAPOLATE,
        extrapolation_margin_c=MARGIN_C,
        same_temperature=SameTemperature.MEAN,
    )


def _maps(run: Run, count: int) -> list[ErrorMap]:
    """Take states of one run, evenly spread over it, as maps with one position each."""
    return [
        ErrorMap(
            label=f"{run.date} {run.minutes[i]:.0f} min",
            measured_at=datetime.fromtimestamp(float(run.times_s[i]), UTC),
            temperatures_c={name: float(t[i]) for name, t in run.temperatures_c.items()},
            tables={
                code: ComponentTable.make(COMPONENTS[code], [values[i]], [0.0])
                for code, values in run.displacement_um.items()
            },
            repeatability_um=MAP_REPEATABILITY_UM,
        )
        for i in np.linspace(0, len(run.times_s) - 1, count).astype(int)
    ]


def _record(
    runs: Sequence[Run],
) -> tuple[TemperatureHistory, list[tuple[float, dict[str, float]]]]:
    """Put the runs one after the other, each with its rest before it."""
    rests = [run.times_s[0] - np.arange(REST_S, 0.0, -REST_EVERY_S) for run in runs]
    times = np.concatenate(
        [t for r, run in zip(rests, runs, strict=True) for t in (r, run.times_s)]
    )
    temperatures = {
        name: np.concatenate(
            [
                np.concatenate(
                    [np.full(rest.shape, run.temperatures_c[name][0]), run.temperatures_c[name]]
                )
                for rest, run in zip(rests, runs, strict=True)
            ]
        )
        for name in SENSORS
    }
    speeds = np.concatenate(
        [
            np.concatenate([np.zeros(rest.shape), run.spindle_rpm])
            for rest, run in zip(rests, runs, strict=True)
        ]
    )
    states = [
        (t, {"spindle_rpm": rpm}) for t, rpm in zip(times.tolist(), speeds.tolist(), strict=True)
    ]
    return TemperatureHistory(times, temperatures), states


def _every(times_s: FloatArray, every_s: float) -> list[int]:
    """Choose rows that lie at least so far apart."""
    chosen = [0]
    for i in range(1, len(times_s)):
        if times_s[i] >= times_s[chosen[-1]] + every_s:
            chosen.append(i)
    return chosen
