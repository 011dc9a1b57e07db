"""Two versions on the same checks: which leaves less, in numbers and beside each other."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from itertools import groupby
from statistics import median
from typing import Any

from app.identification.analysis.residual_report import Size
from app.pages.dashboard.numbers import clock
from app.pages.environment import render_live
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.words import decimals_for, figure_text, zeros_text
from app.pages.wording import _, counted
from app.services.loop import ComparedCheck, ComparedChecks, Pair
from app.units import Unit


def compared_residuals(found: ComparedChecks, machine: str, now: datetime) -> str:
    """Write what two versions leave, together, check by check and by component."""
    noise = [size.repeatability for size, _ in found.components if size.repeatability is not None]
    decimals = decimals_for(median(noise)) if noise else 1
    pairs = [one.lengths for one in found.checks if one.lengths is not None]
    reach = 1.05 * max((max(p.a_um, p.b_um) for p in pairs), default=0.0) or 1.0
    return render_live(
        "dashboard/compared_residuals.html",
        machine=machine,
        found=found,
        sentence=_sentence(found, decimals),
        zeros=zeros_text(size.zero for size, _ in found.components),
        checks=[_check(one, decimals, reach, now) for one in reversed(found.checks)],
        reach=f"{reach:.2g}",
        by_unit=list(_by_unit(found)),
        is_marked=any(one.learned_from for one in found.checks),
    )


def _sentence(found: ComparedChecks, decimals: int) -> str:
    """Say which leaves less; first of all where nothing was learned."""
    pair = found.independent or found.together
    if pair is None:
        return _("No length was measured that both versions can be held against.")
    words = _pair_words(found, pair, decimals)
    if found.independent is None:
        proof = _("An adopted effect was learned from each of these checks: no proof.")
        return f"{words} {proof}"
    new = sum(1 for one in found.checks if one.lengths and not one.learned_from)
    if new == len([one for one in found.checks if one.lengths]):
        return words
    independent = counted(
        new,
        "That is of %(count)s check from which no adopted effect was learned.",
        "That is of %(count)s checks from which no adopted effect was learned.",
    )
    return f"{words} {independent}"


def _pair_words(found: ComparedChecks, pair: Pair, decimals: int) -> str:
    a, b = figure_text(pair.a_um, decimals), figure_text(pair.b_um, decimals)
    of = counted(pair.count, "%(count)s length", "%(count)s lengths")
    if a == b:
        return _(
            "v%(one)s and v%(other)s leave the same of %(lengths)s: %(size)s µm RMS.",
            one=found.a,
            other=found.b,
            lengths=of,
            size=a,
        )
    less = found.b if pair.b_um < pair.a_um else found.a
    sizes = f"v{found.a} {a}, v{found.b} {b} µm RMS"
    return _("v%(less)s leaves less of %(lengths)s: %(sizes)s.", less=less, lengths=of, sizes=sizes)


def _check(one: ComparedCheck, decimals: int, reach: float, now: datetime) -> dict[str, Any]:
    pair = one.lengths
    row: dict[str, Any] = {
        "stored": one.check,
        "when": clock(one.check.first_at, now),
        "is_marked": one.learned_from,
        "is_changed": False,
        "count": 0 if pair is None else pair.count,
    }
    return row | ({} if pair is None else _row(pair.a_um, pair.b_um, None, decimals, reach))


def _row(a: float, b: float, floor: float | None, decimals: int, reach: float) -> dict[str, Any]:
    """Write two sizes, and where they stand on a scale from zero to `reach` [%]."""
    return {
        "a": figure_text(a, decimals),
        "b": figure_text(b, decimals),
        "floor": figure_text(floor, decimals),
        "is_changed": figure_text(a, decimals) != figure_text(b, decimals),
        "at_before": round(100.0 * a / reach, 2),
        "at_after": round(100.0 * b / reach, 2),
        "at_floor": None if floor is None else round(100.0 * floor / reach, 2),
    }


def _by_unit(found: ComparedChecks) -> Iterator[dict[str, Any]]:
    """Group the components of one unit on one scale, the largest first."""
    order = [unit.symbol for unit in Unit]

    def place(pair: tuple[Size, Size]) -> tuple[int, float]:
        return order.index(pair[0].unit), -max(one.rms for one in pair)

    for unit, together in groupby(sorted(found.components, key=place), lambda p: p[0].unit):
        own = list(together)
        noise = [a.repeatability for a, _ in own if a.repeatability is not None]
        decimals = decimals_for(median(noise)) if noise else 1
        sizes = [x for a, b in own for x in (a.rms, b.rms, a.repeatability or 0.0)]
        reach = 1.05 * max(sizes) or 1.0
        rows = [
            _row(a.rms, b.rms, a.repeatability, decimals, reach)
            | {"name": component_name(a.component), "count": a.count}
            for a, b in own
        ]
        yield {
            "unit": unit,
            "reach": f"{reach:.2g}",
            "rows": [row for row in rows if row["is_changed"]],
            "same": [row["name"] for row in rows if not row["is_changed"]],
        }
