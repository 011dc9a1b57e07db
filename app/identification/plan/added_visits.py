"""Visits that could be added to a plan: where the machine was unlike anything planned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.effects.conditions import Conditions, recorded_conditions
from app.effects.observations import Verification, observation_rows
from app.identification.campaign import Campaign
from app.thermal.sensor_health import believed
from app.units import SECONDS_PER_H

MOST_VISITS: Final = 6
"""So many visits are tried."""

MOST_MOMENTS: Final = 2000
"""Moments of the record that are looked at."""

STANDS_OUT: Final = 0.7
"""Standard deviations from the planned visits' mean from which something is warm or cold."""


@dataclass(frozen=True, eq=False)
class AddedVisit:
    """A planned visit again, at another moment of the record.

    `leading` names the sensors and states that stand out then, the furthest first.
    """

    visit: Verification
    time_s: float
    leading: Sequence[str]


def choose_added_visits(campaign: Campaign) -> list[AddedVisit]:
    """Choose moments of the record that differ most from the planned visits, and each other.

    Returns
    -------
    list of AddedVisit
        Each repeats the planned visit that has most observations.
    """
    rows = observation_rows(campaign.verifications)
    visits = np.unique(rows.visit)
    begins_s = np.array([rows.times_s[rows.visit == v].min() for v in visits])
    template, lasts_s = _template(campaign, rows.visit, rows.verification, rows.times_s)
    first_s, last_s = campaign.readings.times_s[[0, -1]]
    step_s = max(SECONDS_PER_H, (last_s - first_s) / MOST_MOMENTS)
    moments_s = np.arange(first_s + SECONDS_PER_H, last_s - lasts_s, step_s)
    if not moments_s.size:
        return []
    there = conditions_at(campaign, np.concatenate([begins_s, moments_s]))
    names, features = _features(there, begins_s.size)
    complete = np.isfinite(features[begins_s.size :].sum(axis=1))
    chosen = _furthest(np.nan_to_num(features), begins_s.size, complete)
    return [_added(template, there, names, features, row, i) for i, row in enumerate(chosen)]


def _template(
    campaign: Campaign,
    visit: IntArray,
    verification: IntArray,
    times_s: FloatArray,
) -> tuple[Verification, float]:
    """Take the visit with most observations out of its verification, and say how long it lasts."""
    largest = int(np.argmax(np.bincount(visit)))
    of_visit = visit == largest
    source = campaign.verifications[int(verification[of_visit][0])]
    begin_s, end_s = float(times_s[of_visit].min()), float(times_s[of_visit].max())
    observations = [
        replace(o, time_s=o.time_s - begin_s, state={})
        for o in source.observations
        if begin_s <= o.time_s <= end_s
    ]
    return replace(source, observations=observations, is_planned=True), end_s - begin_s


def conditions_at(campaign: Campaign, times_s: FloatArray) -> Conditions:
    """Read temperatures and states off the record.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Since 1970-01-01 UTC.
    """
    machine = campaign.model.machine
    return recorded_conditions(
        machine.sensors, believed(machine, campaign.readings), campaign.state_readings, times_s
    )


def _features(there: Conditions, planned: int) -> tuple[list[str], FloatArray]:
    """Standardise everything that changes, by its mean over the plan and its spread in all."""
    everything = {**there.temperatures_c, **there.states}
    # By its ends: rounding may give what never changes a spread.
    names = [n for n, x in everything.items() if np.fmin.reduce(x) < np.fmax.reduce(x)]
    if not names:
        return [], np.zeros((len(there), 0))
    columns = np.column_stack([everything[n] for n in names])
    middle = np.nan_to_num(np.nanmean(columns[:planned], axis=0))
    scaled: FloatArray = (columns - middle) / np.nanstd(columns, axis=0)
    return names, scaled


def _furthest(features: FloatArray, planned: int, complete: BoolArray) -> list[int]:
    """Choose one moment after the other, each furthest from all before it."""
    chosen: list[int] = []
    away = np.full(len(features) - planned, np.inf)
    for row in range(planned):
        away = np.minimum(away, np.linalg.norm(features[planned:] - features[row], axis=1))
    away = np.where(complete, away, -1.0)
    while len(chosen) < MOST_VISITS and away.max(initial=-1.0) > 0:
        best = int(away.argmax())
        chosen.append(planned + best)
        away = np.minimum(
            away, np.linalg.norm(features[planned:] - features[planned + best], axis=1)
        )
    return chosen


def _added(
    template: Verification,
    there: Conditions,
    names: list[str],
    features: FloatArray,
    row: int,
    number: int,
) -> AddedVisit:
    time_s = float(there.times_s[row])
    moved = [replace(o, time_s=o.time_s + time_s) for o in template.observations]
    visit = replace(template, label=f"added visit {number + 1}", observations=moved)
    order = np.argsort(-np.abs(features[row]))
    leading = [names[i] for i in order if abs(features[row, i]) > STANDS_OUT]
    return AddedVisit(visit, time_s, leading or [names[i] for i in order[:1]])
