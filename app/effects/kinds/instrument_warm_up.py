"""The instrument settles after each mounting: a laser that warms up alike in every visit."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import ClassVar, Final

import numpy as np

from app.arrays import FloatArray
from app.effects.campaign_view import CampaignView
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Hypothesis, Nonlinear, no_terms
from app.effects.kind import DrawnOver, EffectKind, Proposals
from app.effects.projection import Projection
from app.effects.words import parameter
from app.errors import list_names
from app.geometry.components import COMPONENTS
from app.units import SECONDS_PER_MIN, Unit

FEWEST_VISITS: Final = 3
"""In fewer nothing tells what each mounting begins from what the day begins."""

TIME_CONSTANTS_S: Final = tuple(t * SECONDS_PER_MIN for t in (2.0, 4.0, 8.0, 16.0, 32.0))

SETTLES_BY: Final = "settles_by"
TIME_CONSTANT: Final = "time_constant_min"


class InstrumentWarmUp(EffectKind):
    """Measured minus predicted grows by a (1 − exp(−t/τ)) in every visit, t since it began.

    Of one channel alone: what an instrument does to one component says nothing of another, nor
    of points. What the machine itself does whenever it is measured looks the same.
    """

    kind: ClassVar[str] = "instrument-warm-up"
    text: ClassVar[str] = "readings settle alike after each mounting, as of a laser that warms up"
    drawn_over: ClassVar[DrawnOver] = "time"
    only_once: ClassVar[bool] = True
    shown_by: ClassVar[str] = (
        "leave the instrument on for two hours, aimed and not moved, and record {component} at one "
        "place"
    )
    not_adopted: ClassVar[str] = (
        "it begins anew with each mounting, so it is of the instrument, or of what measuring does "
        "to the machine: a part that is made meets nothing of it"
    )

    spoils: ClassVar[Mapping[str, str]] = {
        "outdated-map": "the instrument settles in every visit, so that what it reads constantly "
        "may be its own: measure with a warm instrument first"
    }

    def propose(self, view: CampaignView) -> Proposals:
        """Every component, and every direction at points, that was observed in some visits."""
        found = Proposals()
        for code in view.rows.channels:
            own = view.rows.of_channel(code)
            visits = np.unique(view.rows.visit[own]).size
            if visits < FEWEST_VISITS:
                reason = f"needs {FEWEST_VISITS} set-ups of {code}, got {visits}"
                found.not_testable.append(self.refuse(code, reason))
                continue
            found.hypotheses.append(_hypothesis(code))
        return found

    def explain(self, effect: Effect) -> str:
        """Say what settles, by how much, how fast."""
        (code,) = effect.components
        (name,) = (name for name in effect.parameters if name.startswith(SETTLES_BY))
        return (
            f"{code} settles in every visit by {parameter(effect, name, _unit(code).symbol)}, with "
            f"a time constant of {parameter(effect, TIME_CONSTANT, 'min')}: the instrument warms "
            "up, or measuring itself warms what it measures"
        )

    def what_to_do(self, effect: Effect) -> str:
        """Say how to measure without it."""
        minutes = 3.0 * effect.parameters[TIME_CONSTANT]
        return (
            f"Leave the instrument on for {minutes:.2g} min after mounting it before "
            f"{list_names(effect.components)} is measured, then measure and analyse again."
        )


def _hypothesis(code: str) -> Hypothesis:
    ends = (TIME_CONSTANTS_S[0], TIME_CONSTANTS_S[-1])
    return Hypothesis(
        kind=InstrumentWarmUp.kind,
        components=(code,),
        unit_terms=no_terms,
        adopted_terms=no_terms,
        amplitudes=(Amplitude(f"{SETTLES_BY}_{_unit(code)}"),),
        nonlinear=Nonlinear(TIME_CONSTANT, SECONDS_PER_MIN, TIME_CONSTANTS_S, ends),
        supposed=partial(_supposed, code),
        is_within_visit=True,
    )


def _unit(channel: str) -> Unit:
    return COMPONENTS[channel].unit if channel in COMPONENTS else Unit.UM


def _supposed(code: str, projection: Projection, theta: float | None) -> FloatArray:
    rows = projection.rows
    begun_s = np.full(int(rows.visit.max()) + 1, np.inf)
    np.minimum.at(begun_s, rows.visit, rows.times_s)
    found = np.zeros(len(rows))
    own = rows.of_channel(code)
    since_s = rows.times_s[own] - begun_s[rows.visit[own]]
    found[own] = -np.expm1(-since_s / float(theta or TIME_CONSTANTS_S[0]))
    return found
