"""A sensor reports late: what it says now was so some time ago."""

from __future__ import annotations

from functools import partial
from typing import Final

from app.arrays import FloatArray
from app.effects.campaign_view import CampaignView
from app.effects.effect import Effect
from app.effects.hypothesis import WHOLE, Hypothesis, Nonlinear
from app.effects.kind import EffectKind, Need, Proposed, Shakes
from app.effects.kinds.clock_offset import (
    FEWEST_COMPONENTS,
    is_known_apart,
    later_readings,
)
from app.effects.projection import Projection
from app.effects.words import components, parameter
from app.units import SECONDS_PER_MIN

LATE_S: Final = tuple(minutes * SECONDS_PER_MIN for minutes in (3.0, 6.0, 12.0, 24.0, 48.0, 96.0))
"""Twice as long each time."""


class LateSensor(EffectKind):
    """All components of a sensor are ahead of what it says, by as much.

    Measured minus predicted is E(T(t + late)) − E(T(t)): the opposite of a late structure, which
    is behind its sensor.
    """

    kind = "late-sensor"
    text = "a sensor reports late"
    drawn_over = "time"
    share_of = "of what a sensor this late would cause: 1 if it is"
    needs = Need.MOMENTS
    only_once = True
    shown_by = "warm {sensor} by hand, and note how long its reading takes to rise and to arrive"
    not_adopted = (
        "when a table is asked for, what the sensor has yet to report is unknown: the sensor "
        "must be made to report without delay"
    )
    shakes = Shakes.TEMPERATURES

    def propose(self, view: CampaignView) -> Proposed:
        """Every sensor that several components follow."""
        for sensor, codes in view.components_by_sensor.items():
            if len(codes) < FEWEST_COMPONENTS:
                reason = f"only {codes[0]} follows it, and may lead it for reasons of its own"
                yield self.refuse(sensor, reason)
                continue
            grid = tuple(by_s for by_s in LATE_S if is_known_apart(view, sensor, by_s))
            if sensor not in view.varying_sensors or not grid:
                reason = (
                    "it did not change, or has too few readings some minutes after the observations"
                )
                yield self.refuse(sensor, reason)
            else:
                yield _hypothesis(view, sensor, codes, grid)

    def explain(self, effect: Effect) -> str:
        """Say how late."""
        return (
            f"{effect.sensors[0]} reports {parameter(effect, 'late_min', 'min')} late (seen in "
            f"{components(effect)})"
        )

    def what_to_do(self, effect: Effect) -> str:
        """Say what to look for."""
        return (
            f"Find out why {effect.sensors[0]} is late: a long averaging time or a buffer in "
            "whatever sends its readings, a wrong clock there, or poor contact between the "
            "sensor and its body; then measure again."
        )


def _hypothesis(
    view: CampaignView, sensor: str, codes: tuple[str, ...], grid: tuple[float, ...]
) -> Hypothesis:
    """Let a sensor be late, in the maps' temperatures too."""

    def supposed(projection: Projection, by_s: float | None) -> FloatArray:
        in_maps_k = partial(view.ahead_in_maps, by_s=by_s or 0.0)
        return later_readings((sensor,), projection, by_s, in_maps_k)

    return Hypothesis(
        kind=LateSensor.kind,
        components=codes,
        sensors=(sensor,),
        nonlinear=Nonlinear("late_min", SECONDS_PER_MIN, grid, (grid[0], grid[-1])),
        supposed=supposed,
        expected=WHOLE,
    )
