"""The top of a report: whose, the verdict, the answer in two sentences, four figures, what next."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC

from app.errors import counted, list_names
from app.identification.analysis import Analysis, Figures
from app.pages.analysis_report.names import MARKS, VERDICTS
from app.pages.report_parts.words import (
    chance_text,
    decimals_for,
    escaped,
    figure_text,
    sentence,
)
from app.services.report_head import ReportHead

MOST_LABELS = 12


def header(head: ReportHead, result: Analysis) -> str:
    """Write title, verdict, summary, and what was analysed when.

    Parameters
    ----------
    head
        Which analysis.
    result
        Its answer.

    Returns
    -------
    str
        HTML.
    """
    verdict = result.verdict
    facts = "".join(
        f"<dt>{escaped(name)}</dt><dd>{value}</dd>" for name, value in _facts(head, result).items()
    )
    return f"""<header>
<p class="quiet">Analysis of residuals</p>
<h1>{escaped(head.machine_name)}</h1>
<p><span class="badge {escaped(verdict)}">{MARKS[verdict]} {escaped(VERDICTS[verdict])}</span></p>
<p class="summary">{sentence(result.summary)}</p>
<dl class="facts">{facts}</dl>
</header>"""


def tiles(result: Analysis) -> str:
    """Write the figures that count: before, after, floor, chance.

    Parameters
    ----------
    result
        The analysis' answer.

    Returns
    -------
    str
        HTML.
    """
    decimals, unit = decimals_for(result.noise_um), result.unit
    before, after = (_size(one, decimals, unit) for one in (result.before, result.after))
    found = [("before", before), ("after", after)]
    if not result.effects:
        found = [("residuals", before)]
    tiles = [
        f'<div class="tile"><span>{name}</span><b>{size}</b><span>{note}</span></div>'
        for name, (size, note) in found
    ]
    floor = figure_text(result.noise_floor_um, decimals)
    is_known = result.floor_um is not None
    origin = "repeatability and set-up scatter" if is_known else "repeatability"
    chance = chance_text(result.p_global)
    tiles += [
        f'<div class="tile"><span>noise floor</span><b>{floor} {unit}</b>'
        f"<span>RMS that {origin} alone would leave</span></div>",
        f'<div class="tile"><span>chance</span><b>{chance}</b><span>probability that noise alone '
        "surprises as much anywhere as the strongest candidate</span></div>",
    ]
    return f'<div class="tiles">{"".join(tiles)}</div>'


def next_steps(result: Analysis) -> str:
    """Write what to measure or to check next.

    Parameters
    ----------
    result
        The analysis' answer.

    Returns
    -------
    str
        HTML.
    """
    steps = "".join(f"<li>{sentence(step)}</li>" for step in result.what_next)
    return f'<section class="next"><h2>What to measure or check next</h2><ol>{steps}</ol></section>'


def _facts(head: ReportHead, result: Analysis) -> Mapping[str, str]:
    """What was analysed, as HTML."""
    return {
        "machine": escaped(f"{head.machine_id} ({head.chain})"),
        "model": sentence(_model(head)),
        "verifications": escaped(list_names(head.verifications, MOST_LABELS)),
        "observations": f"{counted(result.values, 'value')} of {counted(result.visits, 'visit')}",
        "analysed": f"{head.analysed_at.astimezone(UTC):%Y-%m-%d %H:%M} UTC, seed {head.seed}",
        "adopted": sentence(_adopted(head)),
    }


def _model(head: ReportHead) -> str:
    """Name the version with the effects that it had before."""
    had = counted(len(head.had), "adopted effect")
    version = f"version {head.model_version}"
    return f"{version}, with {had}: {'; '.join(head.had)}" if head.had else version


def _adopted(head: ReportHead) -> str:
    """Say what of this analysis went into which version."""
    if head.adopted_version is None:
        return "nothing of this analysis"
    version = f"as model version {head.adopted_version}"
    return f"{version}: {'; '.join(head.adopted)}" if head.adopted else version


def _size(figures: Figures, decimals: int, unit: str) -> tuple[str, str]:
    """Write an RMS and what it is of."""
    size = f"{figure_text(figures.shown_rms_um, decimals)} {unit}"
    if figures.holdout_rms_ci95_um is None:
        return size, "RMS of all visits; none held out"
    low, high = (figure_text(limit, decimals) for limit in figures.holdout_rms_ci95_um)
    return size, f"RMS on held-out visits, 95 % interval {low} to {high} {unit}"
