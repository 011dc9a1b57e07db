"""The answer in plain sentences: what was found, and what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from app.errors import list_names
from app.identification.analysis import Figures, FoundEffect, UnexplainedPart
from app.identification.effects.kind import NotTested
from app.identification.effects.registry import kind_of
from app.identification.search.visit_scatter import FEWEST_VISITS

ENOUGH_VISITS: Final = 20
"""From so many visits on no more are asked for."""


def summary(
    verdict: str,
    effects: Sequence[FoundEffect],
    unexplained: Sequence[UnexplainedPart],
    before: Figures,
    after: Figures,
    noise_um: float | None,
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
        Repeatability [µm].
    """
    noise = "" if noise_um is None else f", where one observation scatters by {noise_um:.2g} µm"
    size = before.holdout_rms_um or before.rms_um
    if verdict == "nothing-found":
        return (
            "Nothing was found that the model lacks. The residuals are "
            f"{size:.3g} µm (root mean square){noise}."
        )
    left = after.holdout_rms_um or after.rms_um
    where = list_names([part.component for part in unexplained], 4)
    if not effects:
        return (
            f"Something is left in {where} that no effect of the library explains. The residuals "
            f"are {size:.3g} µm (root mean square){noise}."
        )
    found = "; ".join(effect.explanation for effect in effects)
    changed = f"The residuals fall from {size:.3g} to {left:.3g} µm on visits held out{noise}"
    if after.holdout_rms_um is None:
        changed = f"The residuals fall from {size:.3g} to {left:.3g} µm{noise}"
    rest = f"; in {where} something unexplained remains" if verdict == "unexplained" else ""
    return f"{found}. {changed}{rest}."


def what_next(
    effects: Sequence[FoundEffect],
    unexplained: Sequence[UnexplainedPart],
    not_testable: Sequence[NotTested],
    visits: int,
) -> tuple[str, ...]:
    """Say what to measure or to do next, the most useful first.

    Parameters
    ----------
    effects, unexplained, not_testable
        What was found, what was left, and what could not be looked for.
    visits
        How many visits took part.
    """
    found: list[str] = []
    for effect in effects:
        found += _of_effect(effect)
    for part in unexplained:
        moves = f": it moves with {list_names(part.leads, 3)}" if part.leads else ""
        found.append(
            f"Look at {part.component}{moves}. Record what else changes there (coolant, doors, "
            "clamping, other machines), and measure it again with that beside it."
        )
    if any("visits" in one.reason for one in not_testable) and visits < ENOUGH_VISITS:
        found.append(
            f"Add visits at other temperatures: {visits} took part, and effects that change from "
            f"visit to visit need at least {FEWEST_VISITS}, better {ENOUGH_VISITS}."
        )
    if not found:
        found.append(
            "Nothing needs to be done; measure again after the time in which the machine may wear."
        )
    return tuple(dict.fromkeys(found))


def _of_effect(effect: FoundEffect) -> list[str]:
    found = [
        f"{a.separating_measurement[:1].upper()}{a.separating_measurement[1:]} (separates "
        f"{effect.effect.kind} from {a.kind})."
        for a in effect.ties[:2]
        if a.separating_measurement
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
    return found
