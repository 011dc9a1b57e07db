"""The instrument settles after each mounting: a laser that warms up alike in every visit."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray
from app.effects.campaign_view import CampaignView
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Hypothesis, Nonlinear
from app.effects.kind import EffectKind, Proposed
from app.effects.observations import ObservationRows
from app.effects.projection import Projection
from app.effects.words import parameter
from app.errors import list_names
from app.geometry.components import COMPONENTS
from app.units import SECONDS_PER_MIN, Unit

FEWEST_VISITS: Final = 3
"""In fewer nothing tells what each mounting begins from what the day begins."""

TIME_CONSTANTS_S: Final = tuple(t * SECONDS_PER_MIN for t in (2.0, 4.0, 8.0, 16.0, 32.0))

SETTLES_BY: Final = "settles_by"
WITHIN: Final = "within_min"
TIME_CONSTANT: Final = "time_constant_min"

TIME_KNOWN: Final = 0.5
"""Standard error of a time constant, as a share of it, up to which it is told."""


class InstrumentWarmUp(EffectKind):
    """Measured minus predicted grows as 1 − exp(−t/τ) in every visit, t since it began.

    Its size is what it comes to in the longest visit: where visits end before it has settled,
    nobody knows by how much it would settle in the end, only how fast it goes.

    Of one channel alone: what an instrument does to one component says nothing of another, nor
    of points. What the machine itself does whenever it is measured looks the same.
    """

    kind = "instrument-warm-up"
    text = "readings settle alike after each mounting, as with a laser that is warming up"
    drawn_over = "time"
    only_once = True
    shown_by = (
        "leave the instrument switched on for two hours, aligned and untouched, and record "
        "{component} at one place"
    )
    not_adopted = (
        "it starts afresh with each mounting, so it comes from the instrument, or from what "
        "measuring does to the machine: machined parts never meet it"
    )

    spoils = {
        "outdated-map": (
            "the instrument settles in every visit, so a constant reading may be its own: "
            "measure with a warm instrument first"
        )
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every component, and every direction at points, that was observed in some visits."""
        for code in view.rows.channels:
            chosen = view.rows.of_channel(code)
            visits = np.unique(view.rows.visit[chosen]).size
            if visits < FEWEST_VISITS:
                reason = (
                    f"needs at least {FEWEST_VISITS} set-ups in which it was observed, got {visits}"
                )
                yield self.refuse(code, reason)
            else:
                yield _hypothesis(code, _longest_s(view.rows, chosen))

    def explain(self, effect: Effect) -> str:
        """Say what settles, by how much, how fast."""
        (code,) = effect.components
        (name,) = (name for name in effect.parameters if name.startswith(SETTLES_BY))
        size = parameter(effect, name, _unit(code).symbol)
        late = ""
        if _is_settling(effect):
            late = f", with a time constant of {parameter(effect, TIME_CONSTANT, 'min')}"
        return (
            f"in every visit {code} settles by {size} within {effect.parameters[WITHIN]:.3g} "
            f"min{late}: the instrument is warming up, or measuring itself warms what is "
            "measured"
        )

    def what_to_do(self, effect: Effect) -> str:
        """Say how to measure without it."""
        how_long = "until its reading no longer moves"
        if _is_settling(effect):
            how_long = f"for {3.0 * effect.parameters[TIME_CONSTANT]:.2g} min after mounting"
        return (
            f"Before measuring {list_names(effect.components)}, leave the instrument on {how_long}"
            "; then measure and analyse again."
        )


def _is_settling(effect: Effect) -> bool:
    """Whether its time constant is known: what visits do not last long enough for is not told."""
    error = effect.standard_errors.get(TIME_CONSTANT, np.inf)
    return error <= TIME_KNOWN * effect.parameters[TIME_CONSTANT]


def _longest_s(rows: ObservationRows, chosen: IntArray) -> float:
    """Say how long after a visit began one of its rows was observed, at most [s]."""
    return max(float(np.max(_since_s(rows, chosen))), 1.0)


def _since_s(rows: ObservationRows, chosen: IntArray) -> FloatArray:
    """Say for each of some rows how long ago its visit began [s]."""
    begun_s = np.full(int(rows.visit.max()) + 1, np.inf)
    np.minimum.at(begun_s, rows.visit, rows.times_s)
    return np.asarray(rows.times_s[chosen] - begun_s[rows.visit[chosen]])


def _hypothesis(code: str, longest_s: float) -> Hypothesis:
    return Hypothesis(
        kind=InstrumentWarmUp.kind,
        components=(code,),
        amplitudes=(Amplitude(f"{SETTLES_BY}_{_unit(code)}"),),
        nonlinear=Nonlinear(
            TIME_CONSTANT,
            SECONDS_PER_MIN,
            TIME_CONSTANTS_S,
            (TIME_CONSTANTS_S[0], TIME_CONSTANTS_S[-1]),
        ),
        stated={WITHIN: longest_s / SECONDS_PER_MIN},
        supposed=partial(_supposed, code, longest_s),
        within_visit=True,
        of_setups=True,
    )


def _unit(channel: str) -> Unit:
    return COMPONENTS[channel].unit if channel in COMPONENTS else Unit.UM


def _supposed(
    code: str, longest_s: float, projection: Projection, theta: float | None
) -> FloatArray:
    rows, tau_s = projection.rows, float(theta or TIME_CONSTANTS_S[0])
    supposed = np.zeros(len(rows))
    measured = rows.of_channel(code)
    # (1 − e^(−t/τ)) / (1 − e^(−T/τ)), 1 at the end T of the longest visit; by expm1, since of
    # visits much shorter than τ both are nearly 0.
    supposed[measured] = np.expm1(-_since_s(rows, measured) / tau_s) / np.expm1(-longest_s / tau_s)
    return supposed
