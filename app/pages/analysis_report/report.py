"""The report of an analysis: one page that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby, zip_longest
from statistics import median
from typing import Final

from app.effects.registry import kind_of
from app.identification.analysis.analysis import Analysis, SmallestSeen
from app.identification.analysis.figures import ComponentFigures
from app.identification.analysis.found_effect import FoundEffect
from app.pages.analysis_report.effect_plots import caption, effect_drawings
from app.pages.analysis_report.facts import effect_facts, head_facts
from app.pages.analysis_report.visit_plots import visit_drawings
from app.pages.environment import render
from app.pages.plotly_script import INLINE
from app.pages.report_parts.assignment_words import proposal_words, staying_words
from app.pages.report_parts.drawing import Drawing, largest
from app.pages.report_parts.effect_names import (
    MARKS,
    VERDICTS,
    adoption_text,
    explanation_name,
    parameter_text,
    rival_name,
    status_words,
    untested_together,
)
from app.pages.report_parts.smallest_seen import size_range, units_of
from app.pages.report_parts.words import decimals_for
from app.services.analyses import ReportHead
from app.units import Unit

MOST_RIVALS: Final = 6


def analysis_report(
    head: ReportHead, result: Analysis, *, plotly_js: str = INLINE, back: str = ""
) -> str:
    """Write the page of an analysis.

    Parameters
    ----------
    back
        Where it was opened; empty where that is nowhere.
    """
    effects = list(_with_drawings(result))
    visits = visit_drawings(result)
    return render(
        "analysis_report.html",
        plotly_js=plotly_js,
        head=head,
        back=back,
        result=result,
        head_facts=head_facts(head, result).items(),
        decimals=decimals_for(result.noise),
        by_unit=list(_by_unit(result.components)),
        all_held_out=all(c.is_held_out for c in result.components),
        proposals=list(map(proposal_words, result.proposals)),
        staying=staying_words(result.assignments),
        effects=effects,
        visits=visits,
        has_sides=any(any(v.direction) for v in result.plots.visits),
        seen_units=units_of(result.detectable),
        seen_by_kind=_by_kind(result.detectable),
        drawings=[d for _, own in effects for d in own] + visits,
        caption=caption,
        effect_facts=lambda *of: effect_facts(*of).items(),
        explanation_name=explanation_name,
        parameter_text=parameter_text,
        rival_name=rival_name,
        size_range=size_range,
        status_words=status_words,
        untested_together=untested_together,
        MARKS=MARKS,
        MOST_RIVALS=MOST_RIVALS,
        kind_of=kind_of,
        adoption_text=adoption_text,
        VERDICTS=VERDICTS,
    )


def _with_drawings(result: Analysis) -> Iterator[tuple[FoundEffect, list[Drawing]]]:
    """Give each effect with its figures."""
    # What the readings show by themselves has no residuals to draw, and comes last.
    pairs = zip_longest(result.effects, result.plots.effects)
    for number, (effect, curve) in enumerate(pairs, start=1):
        yield effect, effect_drawings(number, effect, curve) if curve else []


def _by_unit(
    components: Sequence[ComponentFigures],
) -> Iterator[tuple[str, list[ComponentFigures], int, float]]:
    """Put components of one unit together, with their decimals and how far their pictures reach."""
    order = [unit.symbol for unit in Unit]
    ordered = sorted(components, key=lambda c: order.index(c.unit))
    for unit, together in groupby(ordered, lambda c: c.unit):
        own = list(together)
        reach = largest((*c.shown_rms, c.floor or c.noise) for c in own)
        yield unit, own, decimals_for(median(c.noise for c in own)), 1.05 * reach or 1.0


def _by_kind(seen: Sequence[SmallestSeen]) -> Mapping[str, list[SmallestSeen]]:
    kinds = dict.fromkeys(one.kind for one in seen)
    return {kind: [one for one in seen if one.kind == kind] for kind in kinds}
