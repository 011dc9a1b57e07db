"""A machine and its measurement campaign, whole: what is handed out, and the truth behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from app.simulation.undeclared.base_machine import BaseMachine, machine_body, make_machine
from app.simulation.undeclared.bodies import (
    many_verifications,
    one_verification,
    prediction_bodies,
    reading_bodies,
)
from app.simulation.undeclared.components import COMPONENTS, BoolArray, FloatArray
from app.simulation.undeclared.conditions import RECORD_BEGINS_MIN, Conditions
from app.simulation.undeclared.duty_cycle import DAY_MIN
from app.simulation.undeclared.effect import Effect, amplitude_of, told_by
from app.simulation.undeclared.history import History, make_history
from app.simulation.undeclared.later import Later
from app.simulation.undeclared.mapped_model import predict
from app.simulation.undeclared.maps import (
    MeasuredMaps,
    measure_maps,
    sensor_bodies,
    thermal_states,
)
from app.simulation.undeclared.measurement_plan import plan_observations, visit_starts
from app.simulation.undeclared.observations import (
    Observations,
    evaluate,
    true_errors,
)
from app.simulation.undeclared.oracle import OracleFit, fit_oracle
from app.simulation.undeclared.planting import chance, plant_effects
from app.simulation.undeclared.scatter import Scatter, datum_of, draw_scatter, length_errors
from app.simulation.undeclared.sensors import SensorRecord, read_sensors
from app.simulation.undeclared.truth import Truth

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
    later
        What is true in the later visits, none of which is handed out.
    maps, record, history
        Maps, readings, and true temperatures and states as arrays.
    """

    machine: Body
    error_maps: list[Body]
    verifications: list[Body]
    truth: Truth
    later: Later
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

    def as_one_verification(self) -> Body:
        """Give all that was measured as one verification; see `one_verification`."""
        return one_verification(self.truth, self.history, self.conditions)

    def as_many_verifications(self, every_min: float | None = None) -> list[Body]:
        """Give the same values as a verification for each visit, block, or stretch of time.

        Parameters
        ----------
        every_min
            Length of a stretch [min]; None: a visit, or a block of a record.
        """
        return many_verifications(self.truth, self.history, self.conditions, every_min)

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

    def every_fourth_visit(self) -> list[int]:
        """Name every fourth visit: an interleaved hold-out."""
        return list(range(2, self.conditions.visits, 4))


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
    **conditions
        Fields of `Conditions`.

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
    days = under.history_days + under.visit_days
    begins = under.history_days * DAY_MIN + RECORD_BEGINS_MIN
    steps = (begins, int(under.record_min)) if under.is_record else None
    history = make_history(chance(seed, "history"), days, steps)
    starts = visit_starts(chance(seed, "visits"), under)
    planned = plan_observations(chance(seed, "plan"), under, starts)
    whole = history
    history = _until(whole, planned.time_min[-1])
    later = planned[planned.visit >= under.visits]
    planned = planned[planned.visit < under.visits]
    states = thermal_states(chance(seed, "states"), history, under)
    machine = make_machine(chance(seed, "machine"), states)
    machine, effects = plant_effects(seed, names, amplitudes, machine, history, planned, under)
    reported = told_by(effects, planned)
    is_cut = any(len(series) for effect in effects for series in effect.shown_c.values())
    if reported.time_min[-1] > history.minutes[-1] and not is_cut:
        history = _until(whole, reported.time_min[-1])
    return _measure(seed, names, effects, machine, history, planned, later, under)


def make_record(
    seed: int,
    planted: str | Sequence[str] | None = None,
    amplitude: float | Sequence[float] = 2.0,
    hours: float = 5.0,
    every_min: float = 20.0,
    observations: int = 24,
    **conditions: Any,
) -> Campaign:
    """Simulate one continuous record: one set-up, spindle steps, a block each so many minutes.

    Parameters
    ----------
    seed, planted, amplitude
        As for `make_campaign`.
    every_min
        Time from the beginning of a block to that of the next [min].
    observations
        In each block; of fewer than 12 all are points.
    **conditions
        Fields of `Conditions`.

    Returns
    -------
    Campaign
        One verification; `as_many_verifications` gives the same values as many.

    Raises
    ------
    ValueError
        As `make_campaign`, and if a block does not end before the next begins.

    Examples
    --------
    >>> record = make_record(3, "backlash", hours=2.0, wander_um=1.0, later_visits=4)
    >>> len(record.verifications), len(record.as_many_verifications()), record.later.error_um() > 0
    (1, 6, True)
    """
    settings = {"one_verification": True, **conditions}
    return make_campaign(
        seed,
        planted,
        amplitude,
        visits=int(hours * 60.0 / every_min),
        observations_per_visit=observations,
        block_every_min=every_min,
        **settings,
    )


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
    planned_later: Observations,
    under: Conditions,
) -> Campaign:
    """Measure maps, temperatures and errors, and write the bodies."""
    maps = measure_maps(chance(seed, "maps"), machine, under)
    for effect in effects:
        maps = effect.maps(maps) if effect.maps else maps
    faulty_c = {sensor: series for e in effects for sensor, series in e.shown_c.items()}
    starts_min = planned.time_min[np.unique(planned.visit, return_index=True)[1]]
    record = read_sensors(chance(seed, "sensors"), history, under, faulty_c, starts_min)
    observations = planned.without(machine.unmeasured)
    drawn = draw_scatter(chance(seed, "scatter"), planned, under)
    drawn = replace(drawn, instrument=drawn.instrument + length_errors(planned, history, under))
    scatter = _scatter_of(drawn, planned, machine)
    truth = _truth(seed, names, effects, machine, history, observations)
    measured = truth.true_um + scatter.total()
    zero = datum_of(chance(seed, "datum"), measured, observations, under)
    truth = replace(
        truth,
        scatter=replace(scatter, datum=zero),
        measured_um=_read(measured + zero, under),
        predicted_um=predict(maps, record, truth.reported, history),
        is_frozen=_frozen_values(record, observations),
    )
    identifier = f"undeclared-{seed}"
    verifications = (
        [one_verification(truth, history, under)]
        if under.one_verification
        else many_verifications(truth, history, under)
    )
    return Campaign(
        machine_body(identifier, f"Simulated machine {seed}", sensor_bodies(under)),
        maps.bodies(under),
        verifications,
        truth,
        _later(
            effects,
            machine,
            history,
            planned_later.without(machine.unmeasured),
            maps,
            record,
            under,
        ),
        under,
        maps,
        record,
        history,
    )


def _read(values: FloatArray, under: Conditions) -> FloatArray:
    """Round as the instrument does, at least to 0.1 nm."""
    quantum = under.measured_quantum_um
    return np.round(np.round(values / quantum) * quantum if quantum else values, 4)


def _later(
    effects: Sequence[Effect],
    machine: BaseMachine,
    history: History,
    observations: Observations,
    maps: MeasuredMaps,
    record: SensorRecord,
    under: Conditions,
) -> Later:
    """Work out what is true where nobody measures."""
    base = evaluate(true_errors(machine), observations, history)
    # What was written wrongly beside one campaign's values says nothing of later ones.
    lasting = [effect for effect in effects if effect.reported is None]
    each = [(effect, effect.contribution(observations, history)) for effect in lasting]
    nothing = np.zeros(base.size)
    return Later(
        observations,
        prediction_bodies(observations, history, under),
        base + sum((c for effect, c in each if effect.is_of_machine), nothing),
        sum((c for _, c in each), nothing),
        predict(maps, record, observations, history),
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
    base = evaluate(true_errors(machine), observations, history)
    m = base.size
    each = [effect.contribution(observations, history) for effect in effects]
    of_machine = [c for c, e in zip(each, effects, strict=True) if e.is_of_machine]
    true = base + sum(of_machine, np.zeros(m))
    contributions = np.array(each).reshape(len(each), m)
    nothing, never = np.zeros(m), np.zeros(m, dtype=bool)
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
        Scatter(nothing, nothing, nothing, nothing, nothing, never),
        never,
        told_by(effects, observations),
    )


def _described(
    effect: Effect, contribution: FloatArray, observations: Observations
) -> dict[str, object]:
    amplitude = amplitude_of(contribution, observations, effect.about_zero)
    measure = "root mean square" if effect.about_zero else "standard deviation"
    return effect.described() | {"amplitude_um": amplitude, "amplitude_is": measure}


def _scatter_of(drawn: Scatter, planned: Observations, machine: BaseMachine) -> Scatter:
    """Leave out the scatter of lines that no map can be compared with."""
    lines = [planned.of(code) for code in machine.unmeasured]
    remaining = ~np.any([np.zeros(len(planned), dtype=bool), *lines], axis=0)[planned.of_value]
    return Scatter(
        drawn.setup[remaining],
        drawn.noise[remaining],
        drawn.instrument[remaining],
        drawn.blunder[remaining],
        drawn.datum[remaining],
        drawn.is_blunder[remaining],
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
