"""Every kind of effect, listed: adding one is a file, a line here, and its test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from app.effects.campaign_view import CampaignView
from app.effects.claim import Claim, Named, claim_of
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis
from app.effects.kind import EffectKind, NotTested
from app.effects.kinds.additional_sensor import AdditionalSensor
from app.effects.kinds.ageing_sensor import AgeingSensor
from app.effects.kinds.angular import Angular
from app.effects.kinds.backlash import Backlash
from app.effects.kinds.clock_offset import ClockOffset
from app.effects.kinds.detached_sensor import DetachedSensor
from app.effects.kinds.drift import Drift
from app.effects.kinds.exchanged_sensors import ExchangedSensors
from app.effects.kinds.instrument_compensation import InstrumentCompensation
from app.effects.kinds.instrument_warm_up import InstrumentWarmUp
from app.effects.kinds.late_sensor import LateSensor
from app.effects.kinds.map_factor import MapFactor
from app.effects.kinds.map_temperature import MapTemperature
from app.effects.kinds.mirrored_axis import MirroredAxis
from app.effects.kinds.nonrigid_slope import NonrigidSlope
from app.effects.kinds.other_sensor import OtherSensor
from app.effects.kinds.outdated_map import OutdatedMap
from app.effects.kinds.periodic import Periodic
from app.effects.kinds.response import Response
from app.effects.kinds.sensor_fault import SensorFault
from app.effects.kinds.sensor_gradient import SensorGradient
from app.effects.kinds.state_variable import StateVariable
from app.effects.kinds.step import Step
from app.effects.kinds.temperature_curvature import TemperatureCurvature
from app.effects.kinds.thermal_lag import ThermalLag
from app.effects.kinds.tool_length import ToolLength
from app.effects.kinds.wrong_map import WrongMap
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
        Response(),
        ExchangedSensors(),
        MapFactor(),
        MapTemperature(),
        WrongMap(),
        InstrumentWarmUp(),
        InstrumentCompensation(),
        ClockOffset(),
        MirroredAxis(),
        LateSensor(),
        AgeingSensor(),
        DetachedSensor(),
        ToolLength(),
    )
}
"""Kind to what it does."""


@dataclass(frozen=True, eq=False)
class Repertoire:
    """Everything that can be tested in a campaign, and everything that cannot.

    Parameters
    ----------
    hypotheses
        Key to hypothesis; the search's candidates have the same keys.
    not_testable
        What these observations cannot show, with the reason.
    """

    hypotheses: dict[str, Hypothesis]
    candidates: list[Candidate]
    not_testable: list[NotTested]

    @property
    def with_forms(self) -> dict[str, Hypothesis]:
        """Key to hypothesis, of their other forms too: what a rival may be."""
        forms = {form.key: form for h in self.hypotheses.values() for form in h.forms}
        return {**self.hypotheses, **forms}


def repertoire(view: CampaignView, kinds: Sequence[str] | None = None) -> Repertoire:
    """Ask every kind what can be tested.

    Parameters
    ----------
    kinds
        Which kinds; all without it.
    """
    hypotheses: dict[str, Hypothesis] = {}
    not_testable: list[NotTested] = []
    for name in KINDS if kinds is None else kinds:
        proposals = kind_of(name).candidates(view)
        hypotheses.update({h.key: h for h in proposals.hypotheses})
        not_testable.extend(proposals.not_testable)
    candidates = [h.candidate(view.projection) for h in hypotheses.values()]
    return Repertoire(hypotheses, candidates, not_testable)


def kind_of(name: str) -> EffectKind:
    """Find a kind by its name, or raise InvalidContent that lists what exists."""
    if name not in KINDS:
        raise InvalidContent.of_field(
            "effects", f"expected kinds of effects ({list_names(KINDS)}), got {name!r}"
        )
    return KINDS[name]


def do_the_same(effect: Named, other: Named) -> bool:
    """Whether two are the same kind with the same drivers: forms of one thing, such as late or not.

    What they do here is then the same. Of two maps it is not.
    """
    return _whatever_the_form(effect) == _whatever_the_form(other)


def _whatever_the_form(named: Named) -> Claim:
    return claim_of(named)._replace(variant=kind_of(named.kind).which_map(named.variant))


def explain(effect: Effect) -> str:
    """Say in one plain sentence what an effect is."""
    return kind_of(effect.kind).explain(effect)


def separating_measurement(effect: Named, rival: Named) -> str:
    """Name what to measure to tell an effect from a rival."""
    return kind_of(effect.kind).separating_measurement(effect, rival)
