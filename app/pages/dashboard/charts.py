"""Small charts as inline SVG: as wide as their container, text beside them and not in them.

A chart is drawn on 1000 × 1000 and stretched to its box; strokes keep their width
(`non-scaling-stroke`), and everything that is read stands in HTML over it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup

from app.arrays import FloatArray
from app.compensation.table import ComponentCompensation
from app.services.dashboard import COURSE_S, Course, Curve

SIZE: Final = 1000.0
_ROUND: Final = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Scale:
    """A range of numbers with round ticks."""

    low: float
    high: float
    ticks: tuple[float, ...]

    @classmethod
    def over(cls, values: Iterable[float], about: int = 4) -> Scale:
        """Take a range that holds values and zero, in round steps.

        >>> Scale.over([-21.9, 3.0]).ticks
        (-30.0, -20.0, -10.0, 0.0, 10.0)
        """
        own = [0.0, *values]
        low, high = min(own), max(own)
        if high - low < 1.0:
            low, high = low - 0.5, high + 0.5
        step = _round_step((high - low) / about)
        first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
        ticks = tuple(round(step * i, 9) + 0.0 for i in range(first, last + 1))
        return cls(ticks[0], ticks[-1], ticks)

    def share(self, value: float) -> float:
        """How far up a value lies: 0 at the low end, 1 at the high one."""
        return (value - self.low) / (self.high - self.low)


def ticks_between(low: float, high: float, about: int = 5) -> tuple[float, ...]:
    """Give two to six round numbers between two ends; the one number where there is but one.

    >>> ticks_between(-0.852, 0.431), ticks_between(29.4, 29.4)
    ((-0.5, 0.0), (29.4,))
    """
    if high <= low:
        return (low,)
    step = _round_step((high - low) / about)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return tuple(float(f"{step * i:.12g}") + 0.0 for i in range(first, last + 1))


def round_up(value: float) -> float:
    """Give the next number of two digits that is not below a positive one.

    >>> round_up(7.497), round_up(3.14), round_up(12345.0), round_up(0.5)
    (7.5, 3.2, 13000.0, 0.5)
    """
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{step * math.ceil(value / step - 1e-9):.12g}")


def positions_scale(low: float, high: float) -> tuple[float, ...]:
    """Five positions, both ends among them [mm]."""
    return tuple(float(x) for x in np.linspace(low, high, 5)) if high > low else (low,)


def course_svg(
    course: Course, maps_c: Sequence[float] | None, name: str, *, is_old: bool = False
) -> Markup:
    """Draw two hours of a temperature over the band of its maps.

    A gap stays a gap; what is old goes on as a dotted line to now. What was not believed does not
    set the scale: it is a mark, at the edge where it lies beyond.
    """
    values = course.temperatures_c
    known = [*values, *(maps_c or ())]
    if not known:
        return _svg("course", name, [])
    low, high = float(min(known)), float(max(known))
    margin = 0.12 * max(high - low, 0.5)
    low, high = low - margin, high + margin

    def y(value: float) -> float:
        return SIZE * (1.0 - (float(value) - low) / (high - low))

    def x(time_s: float) -> float:
        return SIZE * (1.0 + time_s / COURSE_S)

    parts = []
    if maps_c is not None:
        top, bottom = y(maps_c[-1]), y(maps_c[0])
        parts.append(f'<rect class="band" y="{top:.0f}" width="1000" height="{bottom - top:.0f}"/>')
    for stretch in _stretches(course):
        points = [f"{x(course.times_s[i]):.0f},{y(values[i]):.0f}" for i in stretch]
        if len(points) == 1:  # a reading without neighbours is seen as well
            parts.append(f'<path class="dot" d="M{points[0]}h0"/>')
        else:
            parts.append(f'<polyline class="now" points="{" ".join(points)}"/>')
    for time_s, value in zip(course.rejected_s, course.rejected_c, strict=True):
        at = min(max(y(value), 0.0), SIZE)
        parts.append(f'<path class="rejected" d="M{x(time_s):.0f},{at:.0f}h0"/>')
    if is_old and values.size:
        at = y(values[-1])
        parts.append(
            f'<line class="gone" x1="{x(course.times_s[-1]):.0f}" x2="1000" '
            f'y1="{at:.0f}" y2="{at:.0f}"/>'
        )
    return _svg("course", name, parts)


def curve_svg(curve: Curve, scale: Scale, ends_mm: Sequence[float], name: str) -> Markup:
    """Draw a component's compensation now, its two maps, its uncertainty and where it is held.

    What is thin is approached backward; maps and uncertainty are drawn forward.
    """
    entry = curve.entry
    parts = [
        f'<line class="{"zero" if tick == 0.0 else "grid"}" x2="1000" '
        f'y1="{_up(scale, tick):.0f}" y2="{_up(scale, tick):.0f}"/>'
        for tick in scale.ticks
    ]
    if entry.standard_errors is not None and entry.positions_mm.size > 1:
        parts.append(_band(curve, scale, ends_mm))
    for style, one in zip(("lower", "upper"), curve.maps, strict=False):
        parts.append(_line(style, one.positions_mm, one.compensation, scale, ends_mm))
    if curve.trend is not None:
        parts.append(_line("held", entry.positions_mm, entry.compensation, scale, ends_mm))
        trend = curve.trend
        parts.append(_line("trend", trend.positions_mm, trend.compensation, scale, ends_mm))
    parts += _both_ways("now", entry, scale, ends_mm)
    return _svg("curve", name, parts)


def small_svg(curve: Curve, largest: float, ends_mm: Sequence[float]) -> Markup:
    """Draw a component's shape in a row: over positions, or a bar from the middle."""
    entry = curve.entry
    scale = Scale(-largest, largest, ())
    if not entry.component.is_table or entry.positions_mm.size < 2:
        value = float(entry.compensation[0])
        width = abs(value) / largest * SIZE / 2.0
        left = SIZE / 2.0 - (width if value < 0.0 else 0.0)
        return _svg(
            "small",
            "",
            [
                '<line class="zero" x1="500" x2="500" y2="1000"/>',
                f'<rect class="bar" x="{left:.0f}" y="300" width="{width:.0f}" height="400"/>',
            ],
        )
    parts = ['<line class="zero" x2="1000" y1="500" y2="500"/>']
    parts += _both_ways("now", entry, scale, ends_mm)
    return _svg("small", "", parts)


def before_after_svg(
    before: ComponentCompensation | None,
    after: ComponentCompensation | None,
    scale: Scale,
    ends_mm: Sequence[float],
    lost_mm: tuple[float, float] | None,
    name: str,
) -> Markup:
    """Draw a component's compensation as it is and as it would be, and where it would have none.

    What is thin is approached backward.
    """
    parts = [
        f'<line class="{"zero" if tick == 0.0 else "grid"}" x2="1000" '
        f'y1="{_up(scale, tick):.0f}" y2="{_up(scale, tick):.0f}"/>'
        for tick in scale.ticks
    ]
    if lost_mm is not None:
        span = (ends_mm[-1] - ends_mm[0]) or 1.0
        left, right = (SIZE * (x - ends_mm[0]) / span for x in lost_mm)
        parts.insert(
            0, f'<rect class="lost" x="{left:.0f}" width="{right - left:.0f}" height="1000"/>'
        )
    for style, one in (("before", before), ("now", after)):
        if one is not None:
            parts += _both_ways(style, one, scale, ends_mm)
    return _svg("curve", name, parts)


def values_of(entry: ComponentCompensation) -> FloatArray:
    """Every value that a drawing of both directions has to hold."""
    backward = entry.backward_compensation
    return entry.compensation if backward is None else np.append(entry.compensation, backward)


def _both_ways(
    style: str, entry: ComponentCompensation, scale: Scale, ends_mm: Sequence[float]
) -> Iterator[str]:
    if entry.backward_compensation is not None:
        back = entry.backward_compensation
        yield _line(f"{style} backward", entry.positions_mm, back, scale, ends_mm)
    yield _line(style, entry.positions_mm, entry.compensation, scale, ends_mm)


def _stretches(course: Course) -> Iterator[range]:
    """Part a course where neighbours are too far apart to be joined."""
    breaks = np.flatnonzero(np.diff(course.times_s) > course.max_gap_s) + 1
    starts = [0, *breaks.tolist()]
    ends = [*breaks.tolist(), course.times_s.size]
    for start, end in zip(starts, ends, strict=True):
        if end > start:
            yield range(start, end)


def _band(curve: Curve, scale: Scale, ends_mm: Sequence[float]) -> str:
    entry = curve.entry
    two_sigma = 2.0 * np.asarray(entry.standard_errors)
    upper = _points(entry.positions_mm, entry.compensation + two_sigma, scale, ends_mm)
    lower = _points(entry.positions_mm, entry.compensation - two_sigma, scale, ends_mm)
    return f'<polygon class="sure" points="{" ".join([*upper, *reversed(lower)])}"/>'


def _line(
    style: str, positions_mm: FloatArray, values: FloatArray, scale: Scale, ends_mm: Sequence[float]
) -> str:
    if positions_mm.size == 1:  # an error that does not depend on position
        positions_mm, values = np.array([ends_mm[0], ends_mm[-1]]), np.repeat(values, 2)
    points = " ".join(_points(positions_mm, values, scale, ends_mm))
    return f'<polyline class="{style}" points="{points}"/>'


def _points(
    positions_mm: FloatArray, values: FloatArray, scale: Scale, ends_mm: Sequence[float]
) -> list[str]:
    span = (ends_mm[-1] - ends_mm[0]) or 1.0
    return [
        f"{SIZE * (p - ends_mm[0]) / span:.1f},{_up(scale, v):.1f}"
        for p, v in zip(positions_mm, values, strict=True)
    ]


def _up(scale: Scale, value: float) -> float:
    return SIZE * (1.0 - scale.share(value))


def _svg(kind: str, name: str, parts: Iterable[str]) -> Markup:
    said = Markup('role="img" aria-label="{}"').format(name) if name else 'aria-hidden="true"'
    return Markup(
        f'<svg class="{kind}" viewBox="0 0 1000 1000" preserveAspectRatio="none" {said}>'
        f"{''.join(parts)}</svg>"
    )


def _round_step(about: float) -> float:
    power = 10.0 ** math.floor(math.log10(about))
    return next(step * power for step in _ROUND if step * power >= about - 1e-12)
