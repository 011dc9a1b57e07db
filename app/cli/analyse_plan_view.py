"""What planned observations could see, for a terminal: by kind, and which visit to add."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf, isinf
from typing import Final

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from app.errors import counted
from app.identification.plan.plan import Plan, PlannedEffect
from app.pages.report_parts.effect_names import kind_name, untested_together
from app.pages.report_parts.smallest_seen import size_range, units_of

DECIMALS: Final = 2

NO_LARGER: Final = 1.05
"""A factor below this is none."""


def plan_view(plan: Plan) -> RenderableType:
    """Lay out what a plan could see.

    Parameters
    ----------
    plan
        The service's answer.
    """
    parts: list[RenderableType] = [Text(plan.summary), Text(), _effects(plan.effects), Text()]
    parts += [Text(f"cannot be tested: {line}") for line in _not_testable(plan)]
    parts += [Text(f"left out: {counted(o.count, 'value')}, {o.reason}") for o in plan.excluded]
    parts += [Text(f"note: {note}") for note in plan.notes]
    if plan.suggestions:
        parts.append(Text("visits to add:", style="bold"))
    parts += [Padding(Text(s.sentence), (0, 0, 0, 2)) for s in plan.suggestions]
    return Group(*parts)


def told_apart(seen: Sequence[PlannedEffect]) -> str:
    """Say how much larger effects of a kind must typically be to be told from their rivals.

    Parameters
    ----------
    seen
        Effects of one kind.

    >>> from dataclasses import replace
    >>> from app.identification.plan.plan import PlannedRival
    >>> rival = PlannedRival("other-sensor", (), (), (), 0.9, None)
    >>> one = PlannedEffect("step", "", ("EXX",), (), (), "µm", 0.2, 0.5, rival)
    >>> told_apart([one])
    '2.5 × (other sensor)'
    >>> told_apart([replace(one, distinguishable_rms=None)])
    'never (other sensor)'
    """
    factors = sorted((_factor(one), one.rival.kind) for one in seen if one.rival)
    if not factors:
        return "it has no rival"
    factor, rival = factors[len(factors) // 2]
    if isinf(factor):
        return f"never ({kind_name(rival)})"
    if factor < NO_LARGER:
        return "no larger"
    return f"{factor:.2g} × ({kind_name(rival)})"


def _factor(one: PlannedEffect) -> float:
    if one.distinguishable_rms is None:
        return inf
    return one.distinguishable_rms / max(one.smallest_rms, 1e-12)


def _effects(seen: Sequence[PlannedEffect]) -> Table:
    units = units_of(seen)
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="bold")
    table.add_column("smallest seen (RMS)", no_wrap=True)
    for unit in units:
        table.add_column(unit, justify="right", no_wrap=True)
    table.add_column("told from its rival")
    for kind in dict.fromkeys(one.kind for one in seen):
        own = [one for one in seen if one.kind == kind]
        ranges = [size_range(own, unit, DECIMALS) for unit in units]
        table.add_row(kind_name(kind), *ranges, told_apart(own))
    return table


def _not_testable(plan: Plan) -> Iterator[str]:
    for kinds, on, reason in untested_together(plan.not_testable):
        subject = f" of {on}" if on else ""
        yield f"{kinds}{subject}: {reason}"
