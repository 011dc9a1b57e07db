"""Sensors that read wrong by their own record: no measured error is needed to see it.

A sensor that stands still while its neighbours move, or whose single readings jump away and
back, is found among the readings. Such readings are left out before the search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import median_filter

from app.arrays import BoolArray, FloatArray, robust_sd
from app.effects.driver import StepAfter
from app.effects.effect import Effect
from app.effects.kinds.sensor_fault import SPIKES, STUCK, SensorFault
from app.effects.shape import Sensitivity
from app.effects.term import Term
from app.identification.campaign import Campaign
from app.thermal.coarse_readings import step_k as reading_step_k
from app.thermal.compiled_model import CompiledModel
from app.thermal.sensor_health import CLEARLY, Health, goes_on, judge_record
from app.thermal.temperature_history import TemperatureHistory
from app.units import SECONDS_PER_H

WINDOW: Final = 9
"""Readings of which the middle one by size tells what a single one should have been."""

PASSES: Final = 2

SPIKE_FROM: Final = 8.0
"""Robust standard deviations from the median of its neighbours."""

FASTEST: Final = 0.99
FAST_STEPS: Final = 6.0
"""A spike is larger than so many of the sensor's own fast steps."""

COARSE_STEPS: Final = 1.5
"""Steps of a coarse sensor: between one, which is none, and two."""

OFTEN: Final = 20
OFTEN_SHARE: Final = 0.005
"""So many spikes are a fault; fewer are accidents, and only left out."""

RARE: Final = 0.3
"""More than this share away from the median of neighbours is not spikes, but the temperature."""

LONG_H: Final = 6.5
"""A sensor that stands still for longer than a shift is faulty; less is a gap in the record."""


@dataclass(frozen=True, eq=False)
class ReadingFaults:
    """What is wrong with the readings by themselves.

    Parameters
    ----------
    campaign
        The same campaign, single readings that jump away and back left out.
    """

    campaign: Campaign
    effects: tuple[Effect, ...]
    words: tuple[str, ...]


def reading_faults(campaign: Campaign) -> ReadingFaults:
    """Look for sensors that spike or stand still, beyond what the version has adopted already."""
    readings = campaign.readings
    spikes = {name: spike_rows(campaign, name) for name in readings.temperatures_c}
    cleaned = TemperatureHistory(
        readings.times_s,
        {n: np.where(spikes[n], np.nan, t) for n, t in readings.temperatures_c.items()},
    )
    faults = []
    for sensor in readings.temperatures_c:
        if int(spikes[sensor].sum()) >= OFTEN:
            effect, words = _spiking(campaign, sensor, spikes[sensor], cleaned)
            if effect.parameters["share"] >= OFTEN_SHARE:
                faults.append((effect, words))
        faults.extend(_stuck(campaign, sensor, cleaned))
    faults = [fault for fault in faults if not _is_known(fault[0], campaign.effects)]
    return ReadingFaults(
        replace(campaign, readings=cleaned),
        tuple(effect for effect, _ in faults),
        tuple(words for _, words in faults),
    )


def _is_known(effect: Effect, adopted: Sequence[Effect]) -> bool:
    """Whether an adopted effect tells of the same sensor and at least partly the same time."""
    begin_s, end_s = _episode(effect)
    return any(
        (other.kind, other.variant, other.sensors) == (effect.kind, effect.variant, effect.sensors)
        and _episode(other)[0] <= end_s
        and begin_s <= _episode(other)[1]
        for other in adopted
    )


def _episode(effect: Effect) -> tuple[float, float]:
    """From when to when a sensor read wrong [s]; without end where it goes on."""
    begin_s, hours = effect.parameters["changed_at_unix_s"], effect.parameters.get("lasted_h")
    if effect.terms or hours is None:
        return begin_s, np.inf
    return begin_s, begin_s + hours * SECONDS_PER_H


def spike_rows(campaign: Campaign, sensor: str) -> BoolArray:
    """Find readings that lie far from those before and after them.

    Returns
    -------
    ndarray, shape (n,)
        One for each time of the record.
    """
    values = campaign.readings.temperatures_c[sensor].copy()
    spikes = np.zeros(values.shape, dtype=np.bool_)
    resolution_c = campaign.model.machine.sensor(sensor).resolution_c
    for _ in range(PASSES):
        # Several spikes in a row are seen when the first of them are gone.
        far = _far(values, resolution_c)
        spikes |= far
        values[far] = np.nan
    return spikes


def _far(values: FloatArray, resolution_c: float) -> BoolArray:
    spikes = np.zeros(values.shape, dtype=np.bool_)
    present = np.flatnonzero(~np.isnan(values))
    if present.size < WINDOW:
        return spikes
    middle = median_filter(values[present], size=WINDOW, mode="nearest")
    away = values[present] - middle
    usual = robust_sd(away)
    # Where heating begins or ends, a true reading lies one step from its neighbours' median.
    step_c = float(np.quantile(np.abs(np.diff(middle)), FASTEST))
    # What a coarse sensor reads near the middle between two of its steps changes by one of them.
    coarse_c = COARSE_STEPS * reading_step_k(values[present])
    far = np.abs(away) > max(
        CLEARLY * resolution_c, SPIKE_FROM * usual, FAST_STEPS * step_c, coarse_c
    )
    if far.mean() < RARE:
        spikes[present[far]] = True
    return spikes


def _spiking(
    campaign: Campaign, sensor: str, spikes: BoolArray, cleaned: TemperatureHistory
) -> tuple[Effect, str]:
    times_s = campaign.readings.times_s
    known_s, known_c = cleaned.series(sensor)
    away = campaign.readings.temperatures_c[sensor][spikes] - np.interp(
        times_s[spikes], known_s, known_c
    )
    since_s = float(times_s[spikes][0])
    share = float(spikes[times_s >= since_s].mean())
    parameters = {
        "changed_at_unix_s": since_s,
        "spike_k": float(np.median(away)),
        "share": share,
    }
    errors = {"spike_k": robust_sd(away - np.median(away))}
    words = (
        f"{int(spikes.sum())} single readings of {sensor} lie {np.median(np.abs(away)):.1f} K "
        "from those before and after them"
    )
    return _effect(campaign.model, SPIKES, sensor, parameters, errors, since_s), words


def _stuck(
    campaign: Campaign, sensor: str, cleaned: TemperatureHistory
) -> Sequence[tuple[Effect, str]]:
    machine = campaign.model.machine
    times_s, values = cleaned.series(sensor)
    declared = machine.sensor(sensor)
    verdicts = judge_record(machine, declared, cleaned)
    still = np.array([v is Health.STUCK for v in verdicts])
    if not still.any():
        return []
    # A run is as long as the value was the same, from before it could be called stuck.
    same = np.concatenate([[0], np.cumsum(np.diff(values) != 0)])
    runs = [np.flatnonzero(same == number) for number in np.unique(same[still])]
    runs = [run for run in runs if not goes_on(declared, times_s, values, int(run[-1]))]
    if not runs:
        return []
    longest = max(runs, key=lambda run: float(times_s[run[-1]] - times_s[run[0]]))
    begin_s, end_s = float(times_s[longest[0]]), float(times_s[longest[-1]])
    if end_s - begin_s <= LONG_H * SECONDS_PER_H:
        return []
    hours = (end_s - begin_s) / SECONDS_PER_H
    parameters = {"changed_at_unix_s": begin_s, "lasted_h": hours}
    lasts = end_s >= float(campaign.readings.times_s[-1])
    effect = _effect(campaign.model, STUCK, sensor, parameters, {}, begin_s if lasts else None)
    words = f"{sensor} showed exactly {values[longest[0]]:g} °C for {hours:.0f} h"
    return [(effect, f"{words} while its neighbours moved")]


def _effect(
    model: CompiledModel,
    variant: str,
    sensor: str,
    parameters: dict[str, float],
    errors: dict[str, float],
    since_s: float | None,
) -> Effect:
    """Make the effect; its terms add nothing, but say from when on a stand-in must serve."""
    codes = tuple(c for group in model.groups if group.sensor == sensor for c in group.codes)
    terms: tuple[Term, ...] = ()
    if since_s is not None:
        shape, driver = Sensitivity(is_local=True), StepAfter(since_s)
        terms = tuple(Term(code, driver, shape, coefficient=0.0) for code in codes)
    return Effect(
        kind=SensorFault.kind,
        variant=variant,
        components=codes,
        sensors=(sensor,),
        parameters=parameters,
        standard_errors=errors,
        terms=terms,
    )
