"""The answer in plain sentences: what was found, and what to do next."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

from app.effects.kind import NotTested
from app.effects.registry import kind_of
from app.errors import list_names
from app.identification.analysis.analysis import Alternative, Figures, FoundEffect, UnexplainedPart
from app.search.visit_scatter import FEWEST_VISITS

ENOUGH_VISITS: Final = 20
"""From so many visits on no more are asked for."""


def summary(
    verdict: str,
    effects: Sequence[FoundEffect],
    unexplained: Sequence[UnexplainedPart],
    before: Figures,
    after: Figures,
    noise_um: float | None,
    unit: str,
    kinds: Collection[str] | None,
) -> str:
    """Say the answer in two sentences.

    Parameters
    ----------
    verdict
        `effects-found`, `nothing-found` or `unexplained`.
    effects, unexplained
        What was found, and what was left.
    before, after
        Figures with and without the effects.
    noise_um
        Repeatability.
    unit
        Of the figures and the repeatability.
    kinds
        The kinds that were looked for; None: all.
    """
    noise = "" if noise_um is None else f", where one observation scatters by {noise_um:.2g} {unit}"
    size = before.holdout_rms_um or before.rms_um
    if verdict == "nothing-found":
        return (
            f"Nothing was found that the model lacks{_of_kinds(kinds)}. The residuals are "
            f"{size:.3g} {unit} (root mean square){noise}."
        )
    left = after.holdout_rms_um or after.rms_um
    where = list_names([part.component for part in unexplained], 4)
    if not effects:
        return (
            f"Something is left in {where} that no effect of the library explains. The residuals "
            f"are {size:.3g} {unit} (root mean square){noise}."
        )
    found = "; ".join(effect.explanation for effect in effects)
    changed = f"The residuals fall from {size:.3g} to {left:.3g} {unit} on visits held out{noise}"
    if after.holdout_rms_um is None:
        changed = f"The residuals fall from {size:.3g} to {left:.3g} {unit}{noise}"
    rest = f"; in {where} something unexplained remains" if verdict == "unexplained" else ""
    return f"{found}. {changed}{rest}."


def _of_kinds(kinds: Collection[str] | None) -> str:
    return "" if kinds is None else f" among the kinds looked for ({list_names(kinds)})"


def what_next(
    effects: Sequence[FoundEffect],
    unexplained: Sequence[UnexplainedPart],
    not_testable: Sequence[NotTested],
    visits: int,
    apart: Sequence[str] = (),
) -> tuple[str, ...]:
    """Say what to measure or to do next, the most useful first.

    Parameters
    ----------
    effects, unexplained, not_testable
        What was found, what was left, and what could not be looked for.
    visits
        How many visits took part.
    apart
        Components with the visit that was left out because it stands far from all others.
    """
    found = [
        f"Ask what happened at {one}: it stands far from all other visits and was left out as a "
        "slip; measure there again."
        for one in apart
    ]
    for effect in effects:
        found += _of_effect(effect)
    for part in unexplained:
        moves = f": it moves with {list_names(part.leads, 3)}" if part.leads else ""
        found.append(
            f"Look at {part.component}{moves}. Record what else changes there (coolant, doors, "
            "clamping, other machines), and measure it again with that beside it."
        )
    asked = any("visits" in one.reason for one in not_testable)
    if visits < (ENOUGH_VISITS if asked else FEWEST_VISITS):
        found.append(
            f"Add visits at other temperatures: {visits} took part, and effects that change from "
            f"visit to visit need at least {FEWEST_VISITS}, better {ENOUGH_VISITS}."
        )
    if not found:
        found.append(
            "Nothing needs to be done; measure again after the time in which the machine may wear."
        )
    return tuple(dict.fromkeys(found))


def _is_other_form(effect: FoundEffect, other: Alternative) -> bool:
    """Two forms of one effect that are tied do the same here: nothing need be measured."""
    own = effect.effect
    return (own.kind, own.components, own.sensors, own.states) == (
        other.kind,
        other.components,
        other.sensors,
        other.states,
    )


def _of_effect(effect: FoundEffect) -> list[str]:
    found = [
        f"{a.separating_measurement[:1].upper()}{a.separating_measurement[1:]} (separates "
        f"{effect.effect.kind} from {a.kind})."
        for a in effect.ties[:2]
        if a.separating_measurement and not _is_other_form(effect, a)
    ]
    if effect.status != "confirmed":
        shown_by = kind_of(effect.effect.kind).separating_measurement(effect.effect, effect.effect)
        found.append(
            f"The {effect.effect.kind} of {list_names(effect.effect.components, 3)} is "
            f"{effect.status}: {shown_by}."
        )
    if effect.leverage_warning:
        found.append(f"{effect.leverage_warning[:1].upper()}{effect.leverage_warning[1:]}.")
    if effect.effect.kind == "outdated-map":
        found.append(
            f"Measure a new map of {list_names(effect.effect.components, 3)}; until then the "
            "correction may be adopted."
        )
    if effect.measure_again:
        found.append(f"{effect.measure_again}.")
    return found
