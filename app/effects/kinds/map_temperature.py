"""A map's temperature was noted wrongly: of one sensor, in one map."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

from app.effects.campaign_view import CampaignView
from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.hypothesis import WHOLE, Amplitudes, Estimate, Hypothesis, Nonlinear, Reported
from app.effects.kind import EffectKind, Need, Proposed
from app.effects.shape import Exchange
from app.effects.term import Term
from app.effects.words import components, parameter

OFF_BY_K: Final = (-10.0, -6.0, -4.0, -2.5, -1.5, -0.75, 0.75, 1.5, 2.5, 4.0, 6.0, 10.0)
"""How much warmer than noted the sensor may have been [K]."""

OF_THE_GAP: Final = 0.7
"""A map moves by no more of the gap to its neighbour. Near to it the map no longer enters, which
tells nothing of its temperature, and whose own errors would seem to want it."""

NOTED, REALLY, OFF = "noted_c", "really_c", "off_by_k"


class MapTemperature(EffectKind):
    """The same maps on a scale that has one of them at another temperature.

    It shows in all components of the sensor, between that map and its neighbours. What is adopted
    is that scale.
    """

    kind = "map-temperature"
    text = "the temperature of a map was recorded wrongly"
    gone = "its map is gone, or its temperature has been put right"
    share_of = "of what the tables say once that temperature is put right"
    needs = Need.MOMENTS
    shown_by = (
        "look up {sensor} in the records of the day on which the map was measured, or measure "
        "the map of {component} again"
    )

    def propose(self, view: CampaignView) -> Proposed:
        """Every map of every sensor that components follow."""
        for sensor, label, codes, stated_c in _noted(view):
            grid = _grid_k(stated_c, label)
            yield Hypothesis(
                kind=self.kind,
                variant=label,
                components=codes,
                sensors=(sensor,),
                unit_terms=partial(_terms, sensor, label, codes, stated_c),
                nonlinear=Nonlinear(OFF, 1.0, grid, (grid[0], grid[-1]), log_scale=False),
                expected=WHOLE,
                report=partial(_reported, stated_c[label]),
            )

    def explain(self, effect: Effect) -> str:
        """Say what was noted, and what the data say."""
        sensor = effect.sensors[0]
        return (
            f"map {effect.variant!r} is recorded at {effect.parameters[NOTED]:.1f} °C of "
            f"{sensor}, but the data say {parameter(effect, REALLY, '°C')} (seen in "
            f"{components(effect)})"
        )

    def which_map(self, variant: str) -> str:
        """Give the map's label: the variant."""
        return variant

    def what_to_do(self, effect: Effect) -> str:
        """Say what to look up."""
        return (
            f"Look up what {effect.sensors[0]} read when map {effect.variant!r} was measured, and "
            "store the map again with that; until then the correction may be adopted."
        )


def _noted(view: CampaignView) -> Iterator[tuple[str, str, tuple[str, ...], dict[str, float]]]:
    """List sensor, map and components that have it, with the temperatures of all their maps."""
    for sensor, codes in view.components_by_sensor.items():
        if sensor not in view.varying_sensors:
            continue
        scales: dict[tuple[tuple[str, float], ...], list[str]] = {}
        for code in codes:
            located = view.model.find(code)
            if located is not None:
                group, scale = located[0], located[0].scales[0]
                temperatures = zip(scale.rows, scale.temperatures_c, strict=True)
                scales.setdefault(tuple((group.labels[r], t) for r, t in temperatures), []).append(
                    code
                )
        for label in dict.fromkeys(label for scale in scales for label, _ in scale):
            having = {
                scale: followers for scale, followers in scales.items() if label in dict(scale)
            }
            affected = tuple(code for codes_ in having.values() for code in codes_)
            stated_c = {name: t for scale in having for name, t in scale}
            yield sensor, label, affected, stated_c


def _grid_k(stated_c: dict[str, float], label: str) -> tuple[float, ...]:
    """List by how much a map's temperature may be off [K]: as far as no other map is reached."""
    gaps_k = [t - stated_c[label] for name, t in stated_c.items() if name != label]
    below = OF_THE_GAP * max((gap for gap in gaps_k if gap < 0.0), default=OFF_BY_K[0])
    above = OF_THE_GAP * min((gap for gap in gaps_k if gap > 0.0), default=OFF_BY_K[-1])
    inner = [off_k for off_k in OFF_BY_K if below < off_k < above]
    return tuple(sorted({below, *inner, above}))


def _terms(
    sensor: str,
    label: str,
    codes: tuple[str, ...],
    stated_c: dict[str, float],
    theta: float | None,
) -> Amplitudes:
    right = Exchange.of(sensor, {**stated_c, label: stated_c[label] + float(theta or 0.0)})
    return [[Term(code, Always(), right) for code in codes]]


def _reported(noted_c: float, estimate: Estimate) -> Reported:
    off_k = float(estimate.theta or 0.0)
    share, variance = float(estimate.coefficients[0]), float(estimate.covariance[0, 0])
    errors = {"share": variance**0.5}
    if estimate.theta_error is not None and estimate.theta_error < float("inf"):
        errors[REALLY] = estimate.theta_error
    return Reported({NOTED: noted_c, REALLY: noted_c + off_k, "share": share}, errors)
