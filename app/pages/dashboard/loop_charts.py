"""Charts of the loop: rings before, dots after, over what drives an effect or by visit.

Places are shares of the box in per cent, so that marks stay round however wide it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from math import ceil, floor
from typing import Any, Final

from markupsafe import Markup

from app.pages.dashboard.charts import Scale, ticks_between
from app.pages.dashboard.numbers import MINUS, marked
from app.pages.reader import local
from app.units import SECONDS_PER_H

INSET: Final = 3.0
"""Room on both sides for a mark that stands at an end [%]."""

MOST_TIMES: Final = 4
"""Times below a chart: more do not stand beside each other on a phone."""

TIME_STEPS_S: Final = tuple(
    hours * SECONDS_PER_H for hours in (1, 2, 3, 6, 12, 24, 48, 96, 168, 336, 720, 1440, 2160, 4320)
)
"""From one time below a chart to the next [s]."""


@dataclass(frozen=True, slots=True)
class Marks:
    """What is drawn at each place: before, after, and what the effect explains."""

    at: Sequence[float]
    before: Sequence[float]
    after: Sequence[float]
    explained: Sequence[float] = ()


def residual_chart(marks: Marks, band: float | None, name: str, *, over_time: bool) -> Any:
    """Draw residuals before and after; the band is what noise alone would leave.

    Returns
    -------
    dict
        `svg`, and the `ticks` and `positions` that stand in HTML beside it.
    """
    reach = [] if band is None else [-band, band]
    scale = Scale.over([*marks.before, *marks.after, *marks.explained, *reach])
    low, high = min(marks.at), max(marks.at)
    return {
        "svg": _svg(marks, scale, band, low, high, name),
        "ticks": [
            {"top": round(100.0 * (1.0 - scale.share(t)), 2), "words": _tick(t)}
            for t in scale.ticks
        ],
        "positions": _positions(low, high, over_time=over_time),
    }


def _svg(
    marks: Marks, scale: Scale, band: float | None, low: float, high: float, name: str
) -> Markup:
    def x(value: float) -> str:
        return f"{_across(value, low, high):.2f}%"

    def y(value: float) -> str:
        return f"{100.0 * (1.0 - scale.share(value)):.2f}%"

    parts = []
    if band is not None:
        height = 100.0 * (scale.share(band) - scale.share(-band))
        parts.append(f'<rect class="band" y="{y(band)}" width="100%" height="{height:.2f}%"/>')
    for tick in scale.ticks:
        kind = "grid" if tick else "zero"
        parts.append(f'<line class="{kind}" x2="100%" y1="{y(tick)}" y2="{y(tick)}"/>')
    parts += _marks(marks, x, y)
    said = Markup('role="img" aria-label="{}"').format(name)
    return Markup(f'<svg class="residuals" {said}>{"".join(parts)}</svg>')


def _marks(marks: Marks, x: Any, y: Any) -> Iterable[str]:
    """Rings that a dot fits into, joined; short dashes where the effect says that they are."""
    places = list(zip(marks.at, marks.before, marks.after, strict=True))
    for at, before, after in places:
        yield f'<line class="way" x1="{x(at)}" x2="{x(at)}" y1="{y(before)}" y2="{y(after)}"/>'
    for at, said in zip(marks.at, marks.explained, strict=False):
        yield (
            f'<svg class="here" x="{x(at)}" y="{y(said)}">'
            '<line class="explained" x1="-9" x2="9" y1="0" y2="0"/></svg>'
        )
    for at, before, _ in places:
        yield f'<circle class="before" cx="{x(at)}" cy="{y(before)}" r="5"/>'
    for at, _, after in places:
        yield f'<circle class="dot" cx="{x(at)}" cy="{y(after)}" r="3"/>'


def _positions(low: float, high: float, *, over_time: bool) -> list[dict[str, Any]]:
    """Write round numbers, or times, where they stand."""
    ticks = _times(low, high) if over_time else ticks_between(low, high)
    return [
        {"left": round(_across(tick, low, high), 2), "words": words}
        for tick, words in zip(
            ticks, _dated(ticks) if over_time else map(_tick, ticks), strict=True
        )
    ]


def _across(value: float, low: float, high: float) -> float:
    """How far to the right a value stands [%]."""
    share = 0.5 if high <= low else (value - low) / (high - low)
    return INSET + (100.0 - 2.0 * INSET) * share


def _times(low: float, high: float) -> tuple[float, ...]:
    """Choose whole hours, days or weeks between two times; the first where there is none.

    They are whole on the reader's clock, as it goes at the first of the two times.

    >>> [t / 3600.0 for t in _times(1800.0, 86400.0)]
    [6.0, 12.0, 18.0, 24.0]
    """
    step = next((s for s in TIME_STEPS_S if (high - low) / s < MOST_TIMES), None)
    if step is None:
        return ticks_between(low, high, about=MOST_TIMES)
    shift = local(datetime.fromtimestamp(low, UTC)).utcoffset() or timedelta(0)
    ahead = shift.total_seconds()
    first, last = ceil((low + ahead) / step), floor((high + ahead) / step)
    found = tuple(i * step - ahead for i in range(first, last + 1))
    return found or (low,)


def _dated(times_s: Sequence[float]) -> list[str]:
    """Write times: as days where all are midnights."""
    moments = [local(datetime.fromtimestamp(t, UTC)) for t in times_s]
    is_days = all((m.hour, m.minute) == (0, 0) for m in moments)
    years = {m.year for m in moments}
    form = "%-d %b" if is_days else "%-d %b %H:%M"
    return [f"{m:{form if len(years) == 1 or not is_days else '%b %Y'}}" for m in moments]


def _tick(value: float) -> str:
    return marked(f"{value:.10g}".replace("-", MINUS))
