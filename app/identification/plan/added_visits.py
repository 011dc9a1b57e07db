"""Visits that could be added to a plan: where the machine was unlike anything planned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray
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
    template = largest_visit(campaign)
    times_s = [o.time_s for o in template.observations]
    lasts_s = max(times_s) - min(times_s)
    begins_s, moments_s = moments(campaign, SECONDS_PER_H, lasts_s, after_s=SECONDS_PER_H)
    if not moments_s.size:
        return []
    there = conditions_at(campaign, np.concatenate([begins_s, moments_s]))
    names, features = _features(there, begins_s.size)
    complete = np.isfinite(features[begins_s.size :].sum(axis=1))
    chosen = _furthest(np.nan_to_num(features), begins_s.size, complete)
    return [_added(template, there, names, features, row, i) for i, row in enumerate(chosen)]


def largest_visit(campaign: Campaign) -> Verification:
    """Take the visit with most observations, in their order.

    What measured that visit measures the next one: its zero and its repeatability are the same.
    """
    rows = observation_rows(campaign.verifications)
    largest = rows.visit == int(np.argmax(np.bincount(rows.visit)))
    source = campaign.verifications[int(rows.verification[largest][0])]
    numbers = dict.fromkeys(rows.observation[largest].tolist())
    return replace(source, observations=[source.observations[i] for i in numbers])


def moments(
    campaign: Campaign, step_s: float, lasts_s: float, *, after_s: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Give the times at which visits began, and moments of the record at which one could [s].

    Parameters
    ----------
    step_s
        From one moment to the next, at least [s].
    lasts_s, after_s
        How long the visit lasts, and how long after the record's beginning it may begin [s].
    """
    rows = observation_rows(campaign.verifications)
    begins_s = np.array([rows.times_s[rows.visit == v].min() for v in np.unique(rows.visit)])
    first_s, last_s = campaign.readings.times_s[[0, -1]]
    step_s = max(step_s, (last_s - first_s) / MOST_MOMENTS)
    return begins_s, np.arange(first_s + after_s, last_s - lasts_s, step_s)


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
    by_s = time_s - min(o.time_s for o in template.observations)
    moved = [replace(o, time_s=o.time_s + by_s, state={}) for o in template.observations]
    label = f"added visit {number + 1}"
    visit = replace(template, label=label, observations=moved, is_planned=True)
    order = np.argsort(-np.abs(features[row]))
    leading = [names[i] for i in order if abs(features[row, i]) > STANDS_OUT]
    return AddedVisit(visit, time_s, leading or [names[i] for i in order[:1]])
