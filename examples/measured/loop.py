"""The loop: analyse, adopt what lowers held-out residuals, analyse again, until nothing is left.

All effects of a component are adopted whose held-out RMS they lower, confirmed or not.
`thermap analyse --adopt` is stricter: each effect must help by itself (`adopt_what_helps`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.effects.effect import Effect
from app.effects.observations import ObservationRows, Verification
from app.effects.registry import KINDS
from app.identification.analysis.analyse import analyse
from app.identification.analysis.analysis import Analysis
from app.identification.analysis.found_effect import FoundEffect
from app.identification.analysis.refits import effects_after
from app.identification.campaign import Campaign, residuals_of
from app.search.rows import Datum

MOST_ROUNDS = 6


MAY_BE_ADOPTED: Final = tuple(name for name, kind in KINDS.items() if not kind.not_adopted)
"""What the records are asked for: all kinds but mistakes that are put right elsewhere."""


@dataclass(frozen=True, eq=False)
class Round:
    """One analysis and what was adopted of it."""

    analysis: Analysis
    adopted: tuple[FoundEffect, ...]


@dataclass(frozen=True, slots=True)
class Figures:
    """Size of one component's residuals [its unit]."""

    rms: float
    p95: float
    largest: float

    @classmethod
    def of(cls, values: FloatArray) -> Figures:
        """Work out the figures of what was measured or is left."""
        size = np.abs(values)
        rms = float(np.sqrt(np.mean(values**2)))
        return cls(rms, float(np.quantile(size, 0.95)), float(size.max()))


def close_the_loop(
    campaign: Campaign, kinds: Collection[str] = MAY_BE_ADOPTED, most_rounds: int = MOST_ROUNDS
) -> list[Round]:
    """Analyse and adopt until an analysis has nothing that is worth adopting.

    Parameters
    ----------
    campaign
        What the model is to learn from.
    kinds
        Kinds of effects to look for.
    most_rounds
        Most analyses.
    """
    rounds: list[Round] = []
    for _ in range(most_rounds):
        analysis = analyse(replace(campaign, effects=effects_of(campaign, rounds)), kinds=kinds)
        adopted = tuple(worth_adopting(analysis))
        rounds.append(Round(analysis, adopted))
        if not adopted:
            break
    return rounds


def adopt_what_helps(campaign: Campaign) -> list[Effect]:
    """Adopt as the service does unasked, until an analysis has nothing to add.

    Parameters
    ----------
    campaign
        What the model is to learn from.

    Returns
    -------
    list of Effect
        What the model has then, what was adopted earlier as it was fitted anew.
    """
    effects = list(campaign.effects)
    for _ in range(MOST_ROUNDS):
        analysis = analyse(replace(campaign, effects=effects))
        new = [found.effect for found in analysis.effects if found.helps]
        if not new:
            break
        effects = effects_after(effects, analysis.refitted, new)
    return effects


def effects_of(campaign: Campaign, rounds: Iterable[Round]) -> list[Effect]:
    """List what a model has after some rounds."""
    return [*campaign.effects, *(found.effect for each in rounds for found in each.adopted)]


def without_ranges(effects: Iterable[Effect]) -> list[Effect]:
    """Take off the ranges at whose edges effects are held: what they would say of any state.

    No live table does this. It shows what of an error is left because nobody has measured
    there, and what because the effect is wrong.
    """
    return [replace(effect, valid=None) for effect in effects]


def worth_adopting(analysis: Analysis) -> list[FoundEffect]:
    """Pick the effects of components whose held-out residuals they make smaller.

    A component's effects were fitted together, so they are adopted together.
    """
    better = {
        each.component
        for each in analysis.components
        if each.holdout_before_rms is not None
        and each.holdout_after_rms is not None
        and each.holdout_after_rms < each.holdout_before_rms
    }
    return [found for found in analysis.effects if better.issuperset(found.effect.components)]


def measured_and_left(
    campaign: Campaign, verifications: Iterable[Verification], effects: Iterable[Effect] = ()
) -> tuple[ObservationRows, FloatArray, FloatArray]:
    """Predict verifications as an instrument with their datum would read them.

    Returns
    -------
    rows, measured, left : ObservationRows, and ndarrays of shape (n,)
        With datum `first`, every visit's own first value is taken off both.
    """
    asked = replace(campaign, verifications=list(verifications), effects=list(effects))
    residuals = residuals_of(asked)
    rows = residuals.rows
    return rows, _from_first(rows, rows.measured), _from_first(rows, residuals.values)


def by_component(rows: ObservationRows, values: FloatArray) -> dict[str, FloatArray]:
    """Part values by component."""
    return {name: values[rows.of_channel(name)] for name in rows.channels}


def without_means(rows: ObservationRows, values: FloatArray) -> FloatArray:
    """Take every visit's mean off: what is left of its course, whatever its zero."""
    found = values.copy()
    for visit, channel in np.unique([rows.visit, rows.channel], axis=1).T.tolist():
        own = (rows.visit == visit) & (rows.channel == channel)
        found[own] -= values[own].mean()
    return found


def _from_first(rows: ObservationRows, values: FloatArray) -> FloatArray:
    """Take every visit's first value off, where its datum says so."""
    found = values.copy()
    for (visit, channel), datum in rows.datum().items():
        if datum is Datum.FIRST:
            own = np.flatnonzero((rows.visit == visit) & (rows.channel == channel))
            found[own] -= values[own[np.argmin(rows.times_s[own])]]
    return found
