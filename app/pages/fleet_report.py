"""The page of a fleet: which machines drift, and which effects sisters share."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from app.identification.analysis.tried_effect import TriedEffect
from app.identification.fleet import FleetJudgement, SharedEffect
from app.pages.environment import render
from app.pages.plotly_script import INLINE
from app.pages.report_parts.effect_names import (
    MARKS,
    STATUSES,
    VERDICTS,
    explanation_name,
    parameter_text,
)
from app.pages.report_parts.words import decimals_for, figure_text
from app.pages.wording import message
from app.units import true_minus

ANSWERS: Final = {
    "yes": (message("yes"), "confirmed"),
    "no": (message("no"), "nothing-found"),
    "cannot-be-told": (message("cannot be told"), "suspected"),
    "adopted": (message("adopted already"), "nothing-found"),
}
"""An answer of a trial in words, and its style."""


def fleet_report(judgement: FleetJudgement) -> str:
    """Write the page of a fleet; it needs no other file, and prints."""
    return render(
        "fleet_report.html",
        plotly_js=INLINE,
        drawings=[],
        judgement=judgement,
        drifting=[m for m in judgement.machines if m.drifts],
        not_judged=[m for m in judgement.machines if m.why_not],
        several=[e for e in judgement.effects if len(e.found_on) > 1],
        rms_text=rms_text,
        gain_text=gain_text,
        share_text=share_text,
        parameters=lambda effect: list(parameters(effect)),
        explanation_name=explanation_name,
        ANSWERS=ANSWERS,
        MARKS=MARKS,
        STATUSES=STATUSES,
        VERDICTS=VERDICTS,
    )


def rms_text(value: float | None, unit: str | None) -> str:
    """Write a root mean square with its unit; a dash where there is none.

    >>> rms_text(1.234, "µm"), rms_text(None, None)
    ('1.23 µm', '–')
    """
    return "–" if value is None else f"{figure_text(value, decimals_for(value))} {unit}"


def gain_text(result: TriedEffect) -> str:
    """Write by how much less a trial leaves, with its interval."""
    if result.gain is None or result.before_rms is None:
        return "–"
    decimals = decimals_for(result.before_rms)
    gain = true_minus(f"{result.gain:+.{decimals}f} {result.unit}")
    if result.gain_ci95 is None:
        return gain
    low, high = result.gain_ci95
    return f"{gain} ({true_minus(f'{low:+.{decimals}f}')} to {true_minus(f'{high:+.{decimals}f}')})"


def share_text(result: TriedEffect) -> str:
    """Write how much of an effect a machine shows, with its interval."""
    if result.share is None:
        return "–"
    share = true_minus(f"{result.share:.2f}")
    if result.share_interval is None:
        return share
    low, high = result.share_interval
    return f"{share} ({true_minus(f'{low:.2f}')} to {true_minus(f'{high:.2f}')})"


def parameters(effect: SharedEffect) -> Iterator[tuple[str, list[str]]]:
    """Give each machine's own parameters of an effect, as text."""
    for one in effect.found_on:
        errors = one.standard_errors
        yield one.machine, [parameter_text(n, v, errors.get(n)) for n, v in one.parameters.items()]
