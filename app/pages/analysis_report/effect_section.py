"""What was found: each effect with its figures, its plots, and the evidence against rivals."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import Final

from app.errors import list_names
from app.identification.analysis import Analysis, Evidence, FoundEffect
from app.pages.analysis_report.effect_plots import caption, effect_drawings
from app.pages.analysis_report.names import (
    MARKS,
    SHARES,
    explanation_name,
    kind_name,
    learnt_words,
    parameter_name,
    parameter_text,
    rival_name,
    status_words,
)
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.drawing import Drawing
from app.pages.report_parts.tables import BARS, NUMBER, Column, body, row, table
from app.pages.report_parts.words import (
    chance_text,
    decimals_for,
    escaped,
    figure_text,
    sentence,
)

MOST_RIVALS: Final = 6
VERY_STRONG: Final = 10.0
"""2 ln B above which Kass and Raftery (1995) call evidence very strong."""


def effect_section(result: Analysis) -> tuple[str, list[Drawing]]:
    """Write all effects that were found.

    Parameters
    ----------
    result
        The analysis' answer.

    Returns
    -------
    tuple of str and list of Drawing
        HTML, empty where nothing was found, and the figures in it.
    """
    written: list[str] = []
    drawings: list[Drawing] = []
    # What the readings show by themselves has no residuals to draw, and comes last.
    pairs = zip_longest(result.effects, result.plots.effects)
    for number, (effect, curve) in enumerate(pairs, start=1):
        own = effect_drawings(number, effect, curve) if curve else []
        written.append(_article(number, effect, own, result.noise_um))
        drawings += own
    if not written:
        return "", []
    title = "What the model lacks"
    return f"<section><h2>{title}</h2>{''.join(written)}</section>", drawings


def _article(
    number: int, effect: FoundEffect, drawings: Sequence[Drawing], noise_um: float | None
) -> str:
    plots = "".join(d.place() for d in drawings)
    if plots:
        plots = (
            f'<div class="plots two">{plots}</div><p class="quiet">{escaped(caption(effect))}</p>'
        )
    warnings = "".join(f'<p class="warning">{w}</p>' for w in _warnings(effect))
    return f"""<article class="effect">
<h3>{number}. {sentence(effect.explanation)}</h3>
<p>{_badges(effect)}</p>
{warnings}
<dl class="facts">{_facts(effect, noise_um)}</dl>
{_parameters(effect)}
{plots}
{_evidence(effect)}
</article>"""


def _badges(effect: FoundEffect) -> str:
    status = effect.status
    told = f"{MARKS[status]} {status_words(status, effect.evidence)}"
    badges = [f'<span class="badge {status}">{told}</span>']
    if effect.is_proxy:
        badges.append('<span class="badge proxy">≈ proxy</span>')
    return " ".join(badges)


def _facts(effect: FoundEffect, noise_um: float | None) -> str:
    decimals, unit = decimals_for(noise_um), effect.unit
    sizes = [figure_text(rms, decimals) for rms in (effect.before_rms_um, effect.after_rms_um)]
    evidence = effect.evidence
    drivers = [*effect.sensors, *effect.states]
    variant = f", {effect.variant}" if effect.variant else ""
    facts = {
        "kind": f"{kind_name(effect.kind)}{variant}",
        "acts on": list_names(map(component_name, effect.components)),
        "driven by": list_names(drivers) if drivers else "",
        "residual there": f"{sizes[0]} → {sizes[1]} {unit} RMS, with all effects",
        **_sureness(evidence),
        "learnt in": learnt_words(effect.valid),
        "use": effect.measure_again or "",
    }
    return "".join(
        f"<dt>{name}</dt><dd>{escaped(value)}</dd>" for name, value in facts.items() if value
    )


def _sureness(evidence: Evidence) -> dict[str, str]:
    """Say how sure it is: by its readings, or by visits that took no part and by chance."""
    if evidence.seen_in_readings:
        return {"in the readings": evidence.seen_in_readings}
    return {
        "held-out visits": _held_out(evidence),
        "by chance": _by_chance(evidence.p_global),
    }


def _by_chance(probability: float | None) -> str:
    return "" if probability is None else f"{chance_text(probability)} anywhere in the library"


def _held_out(evidence: Evidence) -> str:
    """Say what visits say that took no part in finding it."""
    slope, error = evidence.calibration_slope, evidence.calibration_slope_error
    told = "could not say anything"
    if slope is not None:
        size = figure_text(slope, 2) + (f" ± {figure_text(error, 2)}" if error else "")
        told = f"show {size} of what it predicts (1 is right, 0 is nothing)"
    forward, again = evidence.forward_slope, evidence.found_again_share
    if forward is not None:
        told += f"; the last visits, from the earlier ones: {figure_text(forward, 2)}"
    if again is not None:
        told += f"; found again in {100.0 * again:.0f} % of the splits"
    return told


def _parameters(effect: FoundEffect) -> str:
    errors = effect.standard_errors
    columns = (Column("parameter"), Column("± one standard error", NUMBER))
    rows = [
        row(
            columns,
            [_parameter(effect.kind, n), escaped(parameter_text(n, value, errors.get(n)))],
        )
        for n, value in effect.parameters.items()
    ]
    return f'<div class="narrow">{table(columns, body(rows))}</div>'


def _parameter(kind: str, name: str) -> str:
    """Name a parameter; of a share say of what."""
    told = SHARES.get(kind) if name == "share" else None
    what = f' <span class="quiet">{escaped(told)}</span>' if told else ""
    return f"{escaped(parameter_name(name))}{what}"


def _warnings(effect: FoundEffect) -> list[str]:
    """Say what should make a person careful; HTML."""
    found = []
    for tie in effect.ties:
        measure = tie.separating_measurement
        found.append(
            f"These observations cannot tell it from <b>{escaped(rival_name(effect, tie))}</b> "
            f"(evidence {figure_text(tie.evidence, 0)} against "
            f"{figure_text(effect.evidence.two_ln_bayes_factor, 0)})."
            + (f" What would separate the two: {sentence(measure)}." if measure else "")
        )
    if effect.is_proxy:
        found.append(
            "Something unexplained remains beside it. It may stand for something else that moves "
            "alike: a proxy."
        )
    if effect.leverage_warning:
        warning = effect.leverage_warning
        found.append(f"{sentence(warning[:1].upper() + warning[1:])}.")
    return found


def _evidence(effect: FoundEffect) -> str:
    """Bars of 2 ln B against no effect: its own, then its rivals', ties first."""
    own = effect.evidence.two_ln_bayes_factor
    if own is None:
        return ""
    shown = effect.alternatives[:MOST_RIVALS]
    reach = max([own, *(a.evidence for a in shown), 1.0])
    columns = (Column("explanation"), Column("2 ln B", NUMBER), Column("", BARS))
    rows = [row(columns, _bar(explanation_name(effect), "this effect", own, reach), "own")]
    for rival in shown:
        remark = "tied" if rival.tied else f"behind by {figure_text(rival.behind, 0)}"
        bar = _bar(rival_name(effect, rival), remark, rival.evidence, reach)
        rows.append(row(columns, bar, "tied" if rival.tied else ""))
    more = len(effect.alternatives) - len(shown)
    caption = (
        f"Evidence against no effect, 2 ln B. Above {VERY_STRONG:g} is very strong, and so is a "
        f"lead of {VERY_STRONG:g} before a rival."
        + (f" Further behind: {more} more." if more > 0 else "")
    )
    return f'<div class="evidence">{table(columns, body(rows), caption=caption)}</div>'


def _bar(name: str, remark: str, evidence: float, reach: float) -> list[str]:
    width = 100.0 * max(evidence, 0.0) / reach
    return [
        f'{escaped(name)} <span class="quiet">– {remark}</span>',
        figure_text(evidence, 0),
        f'<span class="bar" style="width: {width:.1f}%"></span>',
    ]
