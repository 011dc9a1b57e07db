"""A machine and its measurement campaign, whole: what is handed out, and the truth behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.undeclared.base_machine import BaseMachine, machine_body, make_machine
from benchmarks.undeclared.bodies import reading_bodies, verification_bodies
from benchmarks.undeclared.components import COMPONENTS, BoolArray, FloatArray
from benchmarks.undeclared.conditions import Conditions
from benchmarks.undeclared.effect import Effect, amplitude_of
from benchmarks.undeclared.history import History, make_history
from benchmarks.undeclared.mapped_model import predict
from benchmarks.undeclared.maps import (
    MeasuredMaps,
    measure_maps,
    sensor_bodies,
    thermal_states,
)
from benchmarks.undeclared.measurement_plan import plan_observations, visit_starts
from benchmarks.undeclared.observations import Circumstances, ErrorFunction, Observations, evaluate
from benchmarks.undeclared.oracle import OracleFit, fit_oracle
from benchmarks.undeclared.planting import chance, plant_effects
from benchmarks.undeclared.scatter import Scatter, datum_of, draw_scatter
from benchmarks.undeclared.sensors import SensorRecord, read_sensors
from benchmarks.undeclared.truth import Truth

Body = dict[str, Any]

MOST_READINGS: Final = 10_000
"""Readings that the service takes at once."""


@dataclass(frozen=True)
class Campaign:
    """A campaign as it is handed out, and its truth.

    Parameters
    ----------
    machine
        Body of `POST /v1/machines`.
    error_maps, verifications
        Bodies of the machine's maps and verifications.
    truth
        What was really so.
    conditions
        Under which it was made.
    maps, record, history
        Maps, readings, and true temperatures and states as arrays.
    """

    machine: Body
    error_maps: list[Body]
    verifications: list[Body]
    truth: Truth
    conditions: Conditions
    maps: MeasuredMaps
    record: SensorRecord
    history: History

    @cached_property
    def readings(self) -> list[Body]:
        """All readings, one a minute: `time`, `temperatures_c`, `state`."""
        return reading_bodies(self.record, self.history, self.conditions)

    @cached_property
    def reading_bodies(self) -> list[list[Body]]:
        """The readings in portions of at most 10,000."""
        return [
            self.readings[first : first + MOST_READINGS]
            for first in range(0, len(self.readings), MOST_READINGS)
        ]

    def oracle(self, held_out_visits: ArrayLike, *, refit_maps: bool = True) -> OracleFit:
        """Fit the true effects' amplitudes without the held-out visits; see `fit_oracle`."""
        return fit_oracle(
            self.truth,
            self.maps,
            self.record,
            self.conditions,
            held_out_visits,
            refit_maps=refit_maps,
        )

    def every_nth_visit(self, n: int = 4) -> list[int]:
        """Name every nth visit: an interleaved hold-out."""
        return list(range(n // 2, self.conditions.visits, n))


def make_campaign(
    seed: int,
    planted: str | Sequence[str] | None = None,
    amplitude: float | Sequence[float] = 2.0,
    visits: int = 100,
    **conditions: Any,
) -> Campaign:
    """Simulate a machine and a campaign with effects in them that nobody declared.

    Parameters
    ----------
    seed
        The same seed makes the same campaign. With another effect, or another amplitude, its
        temperatures, plan, maps' errors and scatter stay what they are.
    planted
        Names of effects: one of `FAMILIES` or `UNKNOWN`, with `:variant` where it is not to be
        drawn, such as `backlash` or `state-variable:payload`.
    amplitude
        Standard deviation of each effect over the values that it can reach, in units of the
        repeatability (of 1 µm where that is zero).
    visits
        Number of visits.
    **conditions
        Fields of `Conditions`.

    Returns
    -------
    Campaign

    Raises
    ------
    ValueError
        If there is no such effect or variant, or no component is left for it.

    Examples
    --------
    >>> campaign = make_campaign(3, "thermal-lag:component", visits=20)
    >>> campaign.truth.effects[0]["kind"], len(campaign.verifications)
    ('thermal-lag', 20)
    """
    under = Conditions(visits=visits, **conditions)
    names = (planted,) if isinstance(planted, str) else tuple(planted or ())
    amplitudes = np.broadcast_to(np.asarray(amplitude, dtype=float), len(names))
    history = make_history(chance(seed, "history"), under.history_days + under.visit_days)
    starts = visit_starts(chance(seed, "visits"), under)
    planned = plan_observations(chance(seed, "plan"), under, starts)
    history = _until(history, planned.time_min[-1])
    states = thermal_states(chance(seed, "states"), history, under)
    machine = make_machine(chance(seed, "machine"), states)
    machine, effects = plant_effects(seed, names, amplitudes, machine, history, planned, under)
    return _measure(seed, names, effects, machine, history, planned, starts, under)


def _until(history: History, last_min: float) -> History:
    """End the history some minutes after the last observation."""
    n = int(last_min - history.minutes[0]) + 5
    return History(
        history.minutes[:n],
        {sensor: series[:n] for sensor, series in history.temperatures_c.items()},
        {name: series[:n] for name, series in history.state.items()},
        history.working[:n],
    )


def _measure(
    seed: int,
    names: Sequence[str],
    effects: Sequence[Effect],
    machine: BaseMachine,
    history: History,
    planned: Observations,
    starts_min: FloatArray,
    under: Conditions,
) -> Campaign:
    """Measure maps, temperatures and errors, and write the bodies."""
    maps = measure_maps(chance(seed, "maps"), machine, under)
    shown = {sensor: series for e in effects for sensor, series in e.shown_c.items()}
    record = read_sensors(chance(seed, "sensors"), history, under, shown, starts_min)
    observations = planned.without(machine.unmeasured)
    scatter = _scatter_of(draw_scatter(chance(seed, "scatter"), planned, under), planned, machine)
    truth = _truth(seed, names, effects, machine, history, observations)
    measured = truth.true_um + scatter.total()
    zero = datum_of(chance(seed, "datum"), measured, observations, under)
    truth = replace(
        truth,
        scatter=replace(scatter, datum=zero),
        measured_um=np.round(measured + zero, 4),
        predicted_um=predict(maps, record, observations, history),
        is_frozen=_frozen_values(record, observations),
    )
    identifier = f"undeclared-{seed}"
    return Campaign(
        machine_body(identifier, f"Simulated machine {seed}", sensor_bodies(under)),
        maps.bodies(under),
        verification_bodies(truth, history, under),
        truth,
        under,
        maps,
        record,
        history,
    )


def _truth(
    seed: int,
    names: Sequence[str],
    effects: Sequence[Effect],
    machine: BaseMachine,
    history: History,
    observations: Observations,
) -> Truth:
    """Work out everything that is free of measurement."""
    base = evaluate(_true_errors(machine), observations, history)
    m = base.size
    each = [effect.contribution(observations, history) for effect in effects]
    of_machine = [c for c, e in zip(each, effects, strict=True) if not e.shown_c]
    true = base + sum(of_machine, np.zeros(m))
    contributions = np.array(each).reshape(len(each), m)
    never = np.zeros(m, dtype=bool)
    return Truth(
        seed,
        tuple(names),
        tuple(_described(e, c, observations) for e, c in zip(effects, each, strict=True)),
        observations,
        true,
        true - contributions.sum(axis=0),
        contributions,
        true,
        true,
        Scatter(np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m), never),
        never,
    )


def _true_errors(machine: BaseMachine) -> dict[str, ErrorFunction]:
    """Each component's error at the true temperature of its sensor."""

    def of(code: str) -> ErrorFunction:
        component, table = COMPONENTS[code], machine.table(code)

        def error(circumstances: Circumstances) -> FloatArray:
            position = circumstances.point_mm[:, component.axis or 0]
            return table.at(position, circumstances.temperature(component.sensor))

        return error

    return {code: of(code) for code in machine.measured_codes}


def _described(
    effect: Effect, contribution: FloatArray, observations: Observations
) -> dict[str, object]:
    amplitude = amplitude_of(contribution, observations, effect.about_zero)
    measure = "root mean square" if effect.about_zero else "standard deviation"
    return effect.described() | {"amplitude_um": amplitude, "amplitude_is": measure}


def _scatter_of(drawn: Scatter, planned: Observations, machine: BaseMachine) -> Scatter:
    """Leave out the scatter of lines that no map can be compared with."""
    lines = [planned.of(code) for code in machine.unmeasured]
    kept = ~np.any([np.zeros(len(planned), dtype=bool), *lines], axis=0)[planned.of_value]
    return Scatter(
        drawn.setup[kept],
        drawn.noise[kept],
        drawn.blunder[kept],
        drawn.datum[kept],
        drawn.is_blunder[kept],
    )


def _frozen_values(record: SensorRecord, observations: Observations) -> BoolArray:
    """Find the values that need a sensor while it stands still."""
    frozen = np.zeros(len(observations), dtype=bool)
    for still in record.standstills:
        during = (observations.time_min > still.from_min) & (observations.time_min < still.to_min)
        needs = observations.is_point.copy()
        for code, component in COMPONENTS.items():
            if component.sensor == still.sensor:
                needs |= observations.of(code)
        frozen |= during & needs
    return frozen[observations.of_value]
