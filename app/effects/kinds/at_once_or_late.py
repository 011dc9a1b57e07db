"""A component that moves with a temperature or a difference of two, at once or late."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Final, TypeAlias

from app.effects.campaign_view import CampaignView
from app.effects.driver import AboveReference, BeyondMaps, Difference
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis, Nonlinear
from app.effects.kind import additive
from app.effects.words import parameter

BEYOND, SINCE = "beyond the maps", "since the maps"
"""It acted when the maps were measured, and they contain its part; or it did not."""

LATE: Final = "late"
"""Through a low-pass. What was followed when the maps were measured is what the record knows of it;
maps from before the record count as measured when all had settled."""

EACH: Final = 2
"""Of the time constants that can be tested each second one is looked at first, from the shortest
on: four times as long each time. What follows late is more like its neighbours than what a lag
leaves."""

Course: TypeAlias = AboveReference | BeyondMaps | Difference
"""What it moves with [K]."""


def at_once_and_late(
    kind: str,
    view: CampaignView,
    code: str,
    drivers: Mapping[str, Course | None],
    grid_s: tuple[float, ...],
    late: Collection[str] = (BEYOND, SINCE),
) -> Iterator[Hypothesis]:
    """Make the hypotheses that a component moves with a course, in all their forms.

    Parameters
    ----------
    drivers
        Variant to the course at once; None where it is not known.
    grid_s
        Time constants that can be tested [s].
    late
        Variants of which the late form is tested too.
    """
    for variant, driver in drivers.items():
        if driver is not None:
            yield _hypothesis(kind, view, code, driver, variant)
            if grid_s and variant in late:
                tau = Nonlinear.time_constant(grid_s, EACH)
                hypothesis = _hypothesis(kind, view, code, driver, f"{variant}, {LATE}")
                yield replace(hypothesis, nonlinear=tau)


def how_late(effect: Effect) -> str:
    """Say how late an effect comes, as a clause; empty where it comes at once."""
    if "time_constant_min" not in effect.parameters:
        return ""
    return f", {parameter(effect, 'time_constant_min', 'min')} late"


def since_maps_clause(effect: Effect) -> str:
    """Say of an effect of the variant `SINCE` that it was not there when the maps were measured."""
    is_since = effect.variant.startswith(SINCE)
    return " (it did not when the maps were measured)" if is_since else ""


def _hypothesis(
    kind: str, view: CampaignView, code: str, driver: Course, variant: str
) -> Hypothesis:
    minus = "" if isinstance(driver, AboveReference) else driver.minus
    follows = {driver.sensor: 1, minus: -1} if minus else {driver.sensor: 1}

    def course(theta: float | None) -> Course:
        if theta is None:
            return driver
        if isinstance(driver, BeyondMaps):
            return view.late_beyond_maps(code, driver, theta)
        return replace(driver, time_constant_s=theta)

    return additive(
        *(kind, code, course, view.shapes(code)),
        sizes="slope_{unit}_per_k",
        variant=variant,
        sensors=tuple(follows),
        follows=follows,
    )
