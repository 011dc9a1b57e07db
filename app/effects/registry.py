"""Every kind of effect, listed: adding one is a file, a line here, and its test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis
from app.effects.kind import EffectKind, Named, NotTested
from app.effects.kinds.additional_sensor import AdditionalSensor
from app.effects.kinds.angular import Angular
from app.effects.kinds.backlash import Backlash
from app.effects.kinds.drift import Drift
from app.effects.kinds.nonrigid_slope import NonrigidSlope
from app.effects.kinds.other_sensor import OtherSensor
from app.effects.kinds.outdated_map import OutdatedMap
from app.effects.kinds.periodic import Periodic
from app.effects.kinds.sensor_fault import SensorFault
from app.effects.kinds.sensor_gradient import SensorGradient
from app.effects.kinds.state_variable import StateVariable
from app.effects.kinds.step import Step
from app.effects.kinds.temperature_curvature import TemperatureCurvature
from app.effects.kinds.thermal_lag import ThermalLag
from app.effects.site import Site
from app.errors import InvalidContent, list_names
from app.search.candidate import Candidate

KINDS: Final[dict[str, EffectKind]] = {
    kind.kind: kind
    for kind in (
        ThermalLag(),
        OtherSensor(),
        AdditionalSensor(),
        SensorGradient(),
        TemperatureCurvature(),
        StateVariable(),
        Backlash(),
        Periodic(),
        Angular(),
        NonrigidSlope(),
        Drift(),
        Step(),
        SensorFault(),
        OutdatedMap(),
    )
}
"""Kind to what it does."""


@dataclass(frozen=True, eq=False)
class Repertoire:
    """Everything that can be tested at a site, and everything that cannot.

    Parameters
    ----------
    hypotheses
        Key to hypothesis; the search's candidates have the same keys.
    candidates
        The hypotheses as the search takes them.
    not_testable
        What these observations cannot show, with the reason.
    """

    hypotheses: dict[str, Hypothesis]
    candidates: list[Candidate]
    not_testable: list[NotTested]


def repertoire(site: Site, kinds: Sequence[str] | None = None) -> Repertoire:
    """Ask every kind what can be tested.

    Parameters
    ----------
    site
        The machine and the campaign.
    kinds
        Which kinds; all without it.

    Returns
    -------
    Repertoire

    Raises
    ------
    InvalidContent
        If there is no such kind.
    """
    hypotheses: dict[str, Hypothesis] = {}
    not_testable: list[NotTested] = []
    for name in KINDS if kinds is None else kinds:
        proposals = kind_of(name).candidates(site)
        hypotheses.update({h.key: h for h in proposals.hypotheses})
        not_testable.extend(proposals.not_testable)
    candidates = [h.candidate(site.projection) for h in hypotheses.values()]
    return Repertoire(hypotheses, candidates, not_testable)


def kind_of(name: str) -> EffectKind:
    """Find a kind by its name, or raise InvalidContent that lists what exists."""
    if name not in KINDS:
        raise InvalidContent.of_field(
            "effects", f"expected kinds of effects ({list_names(KINDS)}), came {name!r}"
        )
    return KINDS[name]


def explain(effect: Effect) -> str:
    """Say in one plain sentence what an effect is."""
    return kind_of(effect.kind).explain(effect)


def separating_measurement(effect: Named, rival: Named) -> str:
    """Name what to measure to tell an effect from a rival.

    Parameters
    ----------
    effect, rival
        Effects or hypotheses.
    """
    return kind_of(effect.kind).separating_measurement(effect, rival)
