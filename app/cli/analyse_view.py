"""For a terminal: what an analysis found, and what planned observations could see."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf, isinf
from typing import Final

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from app.cli.answers import listing
from app.errors import counted
from app.identification.analysis.analysis import Analysis
from app.identification.analysis.figures import ComponentFigures
from app.identification.analysis.found_effect import FoundEffect, RefittedEffect
from app.identification.plan.plan import Plan, PlannedEffect
from app.pages.report_parts.assignment_words import proposal_words, staying_words
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.effect_names import (
    VERDICTS,
    adoption_text,
    kind_name,
    learnt_text,
    parameter_name,
    parameter_text,
    rival_name,
    status_words,
    untested_together,
)
from app.pages.report_parts.smallest_seen import size_range, units_of
from app.pages.report_parts.words import decimals_for, figure_text, sentence, zeros_text

COMPONENTS_SHOWN: Final = 12
"""Those that changed come first, then those that stand out most; the report has all."""

_STYLES: Final = {
    "effects-found": "bold green",
    "nothing-found": "bold",
    "unexplained": "bold yellow",
    "not-judged": "bold yellow",
}

DECIMALS: Final = 2

NO_LARGER: Final = 1.05
"""A factor below this is none."""


def analysis_view(result: Analysis) -> RenderableType:
    """Lay out an analysis' answer."""
    parts: list[RenderableType] = [
        Text(VERDICTS[result.verdict], style=_STYLES[result.verdict]),
        Text(sentence(result.summary)),
        Text(),
        *_assignments(result),
        _components(result),
        *_about_figures(result),
        Text(),
        *_effects(result.effects),
        *_refitted(result.refitted),
        *_unexplained_lines(result),
        Text("next:", style="bold"),
        *(Padding(Text(sentence(step)), (0, 0, 0, 2)) for step in result.what_next),
    ]
    return Group(*parts)


def _assignments(result: Analysis) -> Iterator[RenderableType]:
    """Say which components should follow another sensor, before what was found on the present."""
    lines = [
        *(Text(proposal_words(proposal), style="bold yellow") for proposal in result.proposals),
        *(Text(line, style="dim") for line in staying_words(result.assignments)),
    ]
    if lines:
        yield Text("assigned sensors:", style="bold")
        yield from (Padding(line, (0, 0, 0, 2)) for line in lines)
        yield Text()


def _about_figures(result: Analysis) -> Iterator[Text]:
    """Say from where figures count, and why a floor is not known."""
    zeros = zeros_text([result.before.zero, *(component.zero for component in result.components)])
    if zeros:
        yield Text(zeros)
    if result.floor_unknown:
        yield Text(f"floor unknown: {result.floor_unknown}")


def _components(result: Analysis) -> Table:
    table = listing(
        *("RMS of residuals", "before", "after", "floor", "unit", "values"), right="LrrrLr"
    )
    components = sorted(result.components, key=_is_unchanged)
    for component in components[:COMPONENTS_SHOWN]:
        decimals = decimals_for(component.noise)
        cells = [figure_text(size, decimals) for size in (*component.shown_rms, component.floor)]
        name = component_name(component.component)
        table.add_row(name, *cells, component.unit, str(component.count))
    before, after = (figures.shown_rms for figures in (result.before, result.after))
    decimals = decimals_for(result.noise)
    cells = [figure_text(size, decimals) for size in (before, after, result.floor)]
    more = len(components) - COMPONENTS_SHOWN
    unit = result.unit
    name = f"all in {unit}" + (f" (and {more} more)" if more > 0 else "")
    table.add_row(name, *cells, unit, str(result.overall_count), style="bold")
    return table


def _is_unchanged(component: ComponentFigures) -> bool:
    before, after = component.shown_rms
    return before == after


def _effects(effects: Sequence[FoundEffect]) -> Iterator[RenderableType]:
    for number, effect in enumerate(effects):
        yield Text(f"{number}. {sentence(effect.explanation)}", style="bold")
        for line in _effect_lines(effect):
            yield Padding(Text(sentence(line)), (0, 0, 0, 3))
        yield Text()


def _refitted(refitted: Sequence[RefittedEffect]) -> Iterator[RenderableType]:
    """Say what becomes of the effects that the model has."""
    if refitted:
        yield Text("adopted before:", style="bold")
        explanations = (
            Padding(Text(sentence(refit.explanation)), (0, 0, 0, 2)) for refit in refitted
        )
        yield from explanations
        yield Text()


def _effect_lines(effect: FoundEffect) -> Iterator[str]:
    evidence, seen = (
        effect.evidence.two_ln_bayes_factor,
        effect.evidence.seen_in_readings,
    )
    sure = f": {seen}" if seen else f"; evidence {figure_text(evidence, 0)}"
    proxy = "; a proxy: something unexplained remains beside it" if effect.is_proxy else ""
    yield f"{status_words(effect.status, effect.evidence)}{sure}{proxy}"
    yield adoption_text(effect)
    yield from (cause.sentence for cause in effect.causes)
    errors = effect.standard_errors
    for name, value in effect.parameters.items():
        yield f"{parameter_name(name)}: {parameter_text(name, value, errors.get(name))}"
    for rival in effect.ties:
        beside = " with a constant beside it" if rival.with_offset else ""
        yield f"cannot be told from {rival_name(effect, rival)}{beside}"
    if effect.doubt:
        yield effect.doubt
    if effect.leverage_warning:
        yield effect.leverage_warning
    if learnt := learnt_text(effect):
        yield f"learnt over: {learnt}; beyond that, held at the edge"
    if effect.measure_again:
        yield f"{effect.measure_again}."


def _unexplained_lines(result: Analysis) -> Iterator[RenderableType]:
    for part in result.unexplained:
        moving = f"; it moves with {', '.join(part.moves_with)}" if part.moves_with else ""
        decimals = decimals_for(part.noise)
        sizes = [figure_text(size, decimals) for size in (part.rms, part.noise)]
        yield Text(
            f"unexplained in {component_name(part.component)}: {sizes[0]} {part.unit} RMS; one "
            f"observation scatters by {sizes[1]}{moving}",
            style="yellow",
        )
    for group in result.excluded:
        yield Text(f"left out: {counted(group.count, 'value')}, {group.reason}")
    if result.unexplained or result.excluded:
        yield Text()


def plan_view(plan: Plan) -> RenderableType:
    """Lay out what a plan could see."""
    parts: list[RenderableType] = [Text(plan.summary), Text(), _smallest_seen(plan.effects), Text()]
    parts += [Text(f"cannot be tested: {line}") for line in _not_testable(plan)]
    parts += [Text(f"left out: {counted(o.count, 'value')}, {o.reason}") for o in plan.excluded]
    parts += [Text(f"note: {note}") for note in plan.notes]
    if plan.suggestions:
        parts.append(Text("visits to add:", style="bold"))
    parts += [Padding(Text(s.visit.sentence), (0, 0, 0, 2)) for s in plan.suggestions]
    return Group(*parts)


def told_apart(seen: Sequence[PlannedEffect]) -> str:
    """Say how much larger effects of a kind must typically be to be told from their rivals.

    >>> from dataclasses import replace
    >>> from app.identification.plan.plan import PlannedRival
    >>> rival = PlannedRival("other-sensor", "", (), (), (), 0.9, None)
    >>> one = PlannedEffect("step", "", ("EXX",), (), (), "µm", 0.2, 0.5, rival)
    >>> told_apart([one])
    '2.5 × (other sensor)'
    >>> told_apart([replace(one, distinguishable_rms=None)])
    'never (other sensor)'
    """
    factors = sorted((_factor(effect), effect.rival.kind) for effect in seen if effect.rival)
    if not factors:
        return "it has no rival"
    factor, rival = factors[len(factors) // 2]
    if isinf(factor):
        return f"never ({kind_name(rival)})"
    if factor < NO_LARGER:
        return "no larger"
    return f"{factor:.2g} × ({kind_name(rival)})"


def _factor(effect: PlannedEffect) -> float:
    if effect.distinguishable_rms is None:
        return inf
    return effect.distinguishable_rms / max(effect.smallest_rms, 1e-12)


def _smallest_seen(seen: Sequence[PlannedEffect]) -> Table:
    units = units_of(seen)
    headings = ("smallest seen (RMS)", *units, "size to tell it from its rival")
    table = listing(*headings, right=f"L{'R' * len(units)}l")
    for kind in dict.fromkeys(effect.kind for effect in seen):
        effects = [effect for effect in seen if effect.kind == kind]
        ranges = [size_range(effects, unit, DECIMALS) for unit in units]
        table.add_row(kind_name(kind), *ranges, told_apart(effects))
    return table


def _not_testable(plan: Plan) -> Iterator[str]:
    for kinds, on, reason in untested_together(plan.not_testable):
        subject = f" of {on}" if on else ""
        yield f"{kinds}{subject}: {reason}"
