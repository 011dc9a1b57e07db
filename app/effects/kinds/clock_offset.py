"""The clocks of readings and observations are apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.effects.campaign_view import CampaignView
from app.effects.conditions import Conditions
from app.effects.effect import Effect
from app.effects.hypothesis import WHOLE, Hypothesis, Nonlinear
from app.effects.kind import EffectKind, Need, Proposed, Shakes
from app.effects.kinds.step import times_within
from app.effects.projection import Projection
from app.effects.supposition import InMaps, left_by_temperatures, since
from app.effects.words import TWO_ERRORS, components
from app.units import SECONDS_PER_MIN, date_text, plus_minus

APART_MIN: Final = (5, 10, 20, 40, 60, 90, 120, 180, 240, 300, 360, 480, 600, 720)
"""How far apart they may be, either way: a slow clock, daylight saving time, another zone."""

KNOWN_APART: Final = 0.85
"""A temperature must be known some time later, or earlier, in so much of a campaign.

The rest counts as moved as far as is known. Readings often end with the last observation, so that
of the last visit nothing is known later: one visit of eight is not to hide what all others show.
Else a sensor half an hour late is taken for a component that overshoots, and that is confirmed.
"""

FEWEST_COMPONENTS: Final = 2
"""One component that is ahead of its sensor may as well follow something quicker beside it, as that
of a printer's frame follows the bed. That several are ahead by as much is what a clock does."""

HALVED: Final = 12
"""So often a time is halved to find until when readings are known: to some seconds."""

APART_NAME: Final = "apart_min"
HOUR_MIN: Final = 60.0
AN_HOUR: Final = {
    "an hour early since a visit": HOUR_MIN,
    "an hour late since a visit": -HOUR_MIN,
}
"""How observations are stamped from some visit on, and by how much their readings are later."""

NEARLY_MIN: Final = 5.0


class ClockOffset(EffectKind):
    """Observations were made at other times than noted: all by as much, or some by an hour.

    Measured minus predicted is E(T(t + apart)) − E(T(t)), of all sensors that components follow.
    """

    kind = "clock-offset"
    text = "the clocks of the readings and of the observations disagree"
    drawn_over = "time"
    share_of = "of what this clock difference would cause: 1 if the clocks differ by it"
    needs = Need.MOMENTS
    only_once = True
    shown_by = (
        "compare the clock of the computer that sends the readings with that of the measuring "
        "computer, including time zone and daylight saving time"
    )
    not_adopted = (
        "the times of the observations are wrong, not the model: store the verifications again "
        "with the right times"
    )
    shakes = Shakes.TEMPERATURES

    def propose(self, view: CampaignView) -> Proposed:
        """One for everything, over the offsets at which the readings are known."""
        followed = [s for s in view.components_by_sensor if s in view.varying_sensors]
        codes = tuple(c for s in followed for c in view.components_by_sensor[s])
        if 0 < len(codes) < FEWEST_COMPONENTS:
            reason = (
                f"only {codes[0]} was observed, and it may lead or lag its sensor for reasons of "
                "its own"
            )
            yield self.refuse("clocks", reason)
            return
        grid = [
            by_s
            for sign in (-1.0, 1.0)
            for by_s in (sign * minutes * SECONDS_PER_MIN for minutes in APART_MIN)
            if all(is_known_apart(view, sensor, by_s) for sensor in followed)
        ]
        if not codes or not grid:
            reason = (
                "no sensor that components follow changes and has enough readings some minutes "
                "before or after the observations"
            )
            yield self.refuse("clocks", reason)
            return
        grid.sort()
        nonlinear = Nonlinear(
            APART_NAME, SECONDS_PER_MIN, tuple(grid), (grid[0], grid[-1]), log_scale=False
        )
        always = Hypothesis(
            kind=self.kind,
            components=codes,
            nonlinear=nonlinear,
            supposed=partial(later_readings, tuple(followed)),
            expected=WHOLE,
        )
        yield always
        yield from _of_an_hour(view, always, tuple(followed))

    def explain(self, effect: Effect) -> str:
        """Say how far apart, and which way."""
        way, then = "early" if effect.parameters[APART_NAME] > 0.0 else "late", _since(effect)
        return (
            f"the clocks of the readings and of the observations differ by {_apart(effect)}{then}: "
            f"the observations are stamped too {way}{_zone(effect)} (seen in {components(effect)})"
        )

    def what_to_do(self, effect: Effect) -> str:
        """Say what to store anew."""
        way = "later" if effect.parameters[APART_NAME] > 0.0 else "earlier"
        whole = " (by whole hours, if it is a time zone)" if _zone(effect) else ""
        return (
            "Compare the two clocks, including their time zones and daylight saving time; store "
            f"the verifications{_since(effect)} again with times {_apart(effect)} {way}{whole}, "
            "then analyse again."
        )


def _of_an_hour(
    view: CampaignView, always: Hypothesis, sensors: tuple[str, ...]
) -> Iterator[Hypothesis]:
    """Let an hour come in between: summer time begins or ends, and one clock does not follow."""
    times = times_within(view)
    for variant, apart_min in AN_HOUR.items():
        by_s = apart_min * SECONDS_PER_MIN
        if times is None or not all(is_known_apart(view, sensor, by_s) for sensor in sensors):
            continue

        def hour(projection: Projection, _: float | None, by_s: float = by_s) -> FloatArray:
            return later_readings(sensors, projection, by_s)

        yield replace(
            always,
            variant=variant,
            nonlinear=times,
            supposed=since(hour),
            stated={APART_NAME: apart_min},
        )


def _since(effect: Effect) -> str:
    """Say since when, where it is not since ever."""
    changed_at_s = effect.parameters.get("changed_at_unix_s")
    return "" if changed_at_s is None else f" since about {date_text(changed_at_s)}"


def later_readings(
    sensors: tuple[str, ...],
    projection: Projection,
    by_s: float | None,
    in_maps_k: InMaps | None = None,
) -> FloatArray:
    """Say what is left where sensors should have been read some time later [s].

    Parameters
    ----------
    in_maps_k
        What they would have read more in the maps, too; None: those have the right temperatures.
    """
    conditions = projection.conditions
    return left_by_temperatures(
        projection,
        {
            s: _as_far_as_known(conditions, s, by_s or 0.0) - conditions.temperature(s)
            for s in sensors
        },
        in_maps_k,
    )


def _as_far_as_known(conditions: Conditions, sensor: str, by_s: float) -> FloatArray:
    """Give what a sensor read later, or as much later as is known, shape (n,) [°C].

    If rows whose readings end before were not moved at all, one after the other would stop to be
    as the time grows, and what is likely would jump with each.
    """
    values = conditions.temperature_later(sensor, by_s)
    rows = np.flatnonzero(np.isnan(values))
    if rows.size:
        some = conditions.take(rows)
        reached, unknown = np.zeros(rows.size), np.full(rows.size, by_s)
        for _ in range(HALVED):
            between = 0.5 * (reached + unknown)
            is_known = some.is_known_later(sensor, between)
            reached = np.where(is_known, between, reached)
            unknown = np.where(is_known, unknown, between)
        values[rows] = some.temperature_later(sensor, reached)
    return values


def is_known_apart(view: CampaignView, sensor: str, by_s: float) -> bool:
    """Whether enough is known of what a sensor read some time later, or earlier [s]."""
    return bool(np.mean(view.conditions.is_known_later(sensor, by_s)) >= KNOWN_APART)


def _apart(effect: Effect) -> str:
    return plus_minus(
        abs(effect.parameters[APART_NAME]), effect.standard_errors.get(APART_NAME), "min"
    )


def _zone(effect: Effect) -> str:
    """Say that it is a whole number of hours, where it is."""
    apart = abs(effect.parameters[APART_NAME])
    off = abs(apart - HOUR_MIN * max(round(apart / HOUR_MIN), 1))
    error = effect.standard_errors.get(APART_NAME, 0.0)
    near = off <= min(max(TWO_ERRORS * error, 1.0), NEARLY_MIN)
    return ", by whole hours as from another time zone" if near else ""
