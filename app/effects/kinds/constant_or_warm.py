"""Effects that no map has: constant in time, or growing with a temperature."""

from __future__ import annotations

from typing import Final

from app.effects.campaign_view import CampaignView
from app.effects.driver import AboveReference, Always, Driver
from app.effects.hypothesis import Hypothesis
from app.effects.kind import amplitudes_of
from app.effects.term import Term
from app.geometry.components import COMPONENTS

CONSTANT: Final = "constant"
WITH_TEMPERATURE: Final = "with temperature"


def constant_or_warm(
    kind: str, view: CampaignView, code: str, sensor: str | None, constant: str
) -> Hypothesis:
    """Make the hypothesis that a component without a map is there.

    Parameters
    ----------
    sensor
        What it grows with; None: it is constant in time, and a single visit shows it.
    constant
        What the amplitude of a constant one is called, without its unit.
    """
    unit, shapes = COMPONENTS[code].unit, view.shapes(code)
    driver: Driver = Always()
    if sensor is not None:
        driver = AboveReference(sensor, view.reference_c(sensor))
    name = f"{constant}_{unit}" if sensor is None else f"slope_{unit}_per_k"
    return Hypothesis(
        kind=kind,
        variant=CONSTANT if sensor is None else WITH_TEMPERATURE,
        components=(code,),
        sensors=() if sensor is None else (sensor,),
        unit_terms=lambda _: [[Term(code, driver, shape)] for shape in shapes],
        amplitudes=amplitudes_of(shapes, name),
        standing=sensor is None,
        within_visit=sensor is None,
    )
