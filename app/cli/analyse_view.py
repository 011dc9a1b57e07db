"""What an analysis found, for a terminal: the verdict, before and after, effects, what next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from app.errors import counted
from app.identification.analysis.analysis import Analysis, ComponentFigures, FoundEffect
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.effect_names import (
    VERDICTS,
    learnt_words,
    parameter_name,
    parameter_text,
    rival_name,
    status_words,
)
from app.pages.report_parts.words import decimals_for, figure_text

COMPONENTS_SHOWN: Final = 12
"""Those that changed come first, then those that stand out most; the report has all."""

_STYLES: Final = {
    "effects-found": "bold green",
    "nothing-found": "bold",
    "unexplained": "bold yellow",
}


def analysis_view(result: Analysis) -> RenderableType:
    """Lay out an analysis' answer.

    Parameters
    ----------
    result
        What was found.
    """
    parts: list[RenderableType] = [
        Text(VERDICTS[result.verdict], style=_STYLES[result.verdict]),
        Text(result.summary),
        Text(),
        _components(result),
        Text(),
        *_effects(result.effects),
        *_remains(result),
        Text("next:", style="bold"),
        *(Padding(Text(step), (0, 0, 0, 2)) for step in result.what_next),
    ]
    return Group(*parts)


def _components(result: Analysis) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="bold")
    table.add_column("RMS of residuals", no_wrap=True)
    for heading in ("before", "after", "floor"):
        table.add_column(heading, justify="right")
    table.add_column("unit", no_wrap=True)
    table.add_column("values", justify="right")
    components = sorted(result.components, key=_is_unchanged)
    for one in components[:COMPONENTS_SHOWN]:
        decimals = decimals_for(one.noise)
        sizes = (*one.shown_rms, one.noise_floor)
        cells = [figure_text(size, decimals) for size in sizes]
        name = component_name(one.component)
        table.add_row(name, *cells, one.unit, str(one.count))
    before, after = (one.shown_rms_um for one in (result.before, result.after))
    decimals = decimals_for(result.noise_um)
    cells = [figure_text(size, decimals) for size in (before, after, result.noise_floor_um)]
    more = len(components) - COMPONENTS_SHOWN
    unit = result.unit
    name = f"all in {unit}" + (f" (and {more} more)" if more > 0 else "")
    table.add_row(name, *cells, unit, str(result.overall_count), style="bold")
    return table


def _is_unchanged(component: ComponentFigures) -> bool:
    before, after = component.shown_rms
    return before == after


def _effects(effects: Sequence[FoundEffect]) -> Iterator[RenderableType]:
    for number, effect in enumerate(effects, start=1):
        yield Text(f"{number}. {effect.explanation}", style="bold")
        for line in _told_of(effect):
            yield Padding(Text(line), (0, 0, 0, 3))
        yield Text()


def _told_of(effect: FoundEffect) -> Iterator[str]:
    evidence, seen = (
        effect.evidence.two_ln_bayes_factor,
        effect.evidence.seen_in_readings,
    )
    sure = f": {seen}" if seen else f"; evidence {figure_text(evidence, 0)}"
    proxy = "; a proxy: something unexplained remains beside it" if effect.is_proxy else ""
    yield f"{status_words(effect.status, effect.evidence)}{sure}{proxy}"
    errors = effect.standard_errors
    for name, value in effect.parameters.items():
        yield f"{parameter_name(name)}: {parameter_text(name, value, errors.get(name))}"
    for rival in effect.ties:
        yield f"cannot be told from {rival_name(effect, rival)}"
    if effect.leverage_warning:
        yield effect.leverage_warning
    if learnt := learnt_words(effect.valid):
        yield f"learnt in: {learnt}; held at the edge beyond"
    if effect.measure_again:
        yield f"{effect.measure_again}."


def _remains(result: Analysis) -> Iterator[RenderableType]:
    for part in result.unexplained:
        leads = f"; it moves with {', '.join(part.leads)}" if part.leads else ""
        decimals = decimals_for(part.noise_um)
        sizes = [figure_text(size, decimals) for size in (part.rms_um, part.noise_um)]
        yield Text(
            f"unexplained in {component_name(part.component)}: {sizes[0]} {part.unit} RMS, "
            f"where one observation scatters by {sizes[1]}{leads}",
            style="yellow",
        )
    for one in result.excluded:
        yield Text(f"left out: {counted(one.count, 'value')}, {one.reason}")
    if result.unexplained or result.excluded:
        yield Text()
