"""What a model version covers that another does not: components, ranges, directions, completeness.

A live table that is shorter than the one before is wrong in a way that nobody sees: so before a
version goes live it is held against the active one here, at all temperatures at once.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from app.answer import Answer
from app.effects.effect import Effect
from app.errors import list_names
from app.geometry.components import COMPONENTS, ORDER
from app.thermal.compiled_model import CompiledModel
from app.thermal.coverage import Coverage, coverage
from app.thermal.group import Scale
from app.thermal.machine import Machine


@dataclass(frozen=True, slots=True)
class Part(Answer, published_as="CoverageAnswer", whole=False):
    """One thing that one version's table has and another's lacks."""

    what: Annotated[
        Literal["component", "positions", "temperatures", "direction", "completeness"],
        Field(examples=["positions"]),
    ]
    """`component`, `positions`, `temperatures` (between maps), `direction` (the two directions of
    approach) or `completeness`"""
    text: Annotated[str, Field(examples=["EXX from 100 to 500 mm"])]
    """The same in words"""
    component: Annotated[str | None, Field(examples=["EXX"])] = None
    """Component code; null where it concerns no single one"""
    from_mm: Annotated[float | None, Field(examples=[100.0])] = None
    """Lowest position [mm]; null for an open end, and without positions"""
    to_mm: Annotated[float | None, Field(examples=[500.0])] = None
    """Highest position [mm]"""
    sensor: Annotated[str | None, Field(examples=["x-middle"])] = None
    """Sensor whose temperatures bound it; null where it holds at all of them"""
    from_c: Annotated[float | None, Field(examples=[20.0])] = None
    """Lowest temperature of that sensor [°C]; null for an open end"""
    to_c: Annotated[float | None, Field(examples=[24.0])] = None
    """Highest temperature [°C]"""

    def contains(self, other: Part) -> bool:
        """Whether another one is this one, or a part of it."""
        return (
            (self.component, self.what, self.sensor) == (other.component, other.what, other.sensor)
            and _within(other.from_mm, other.to_mm, self.from_mm, self.to_mm)
            and _within(other.from_c, other.to_c, self.from_c, self.to_c)
        )


def _within(low: float | None, high: float | None, from_: float | None, to: float | None) -> bool:
    """Whether one range lies in another; None is an open end."""
    return (from_ is None or (low is not None and low >= from_)) and (
        to is None or (high is not None and high <= to)
    )


@dataclass(frozen=True, slots=True)
class ModelDifference:
    """What one version lacks against another, and what it has beyond it."""

    loses: tuple[Part, ...] = ()
    gains: tuple[Part, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class ModelWithEffects:
    """A compiled model and the effects that its version has adopted."""

    model: CompiledModel
    effects: Sequence[Effect] = ()

    @property
    def codes(self) -> set[str]:
        """The components of its tables."""
        of_maps = {code for group in self.model.groups for code in group.codes}
        return of_maps | {term.component for effect in self.effects for term in effect.terms}


def model_difference(
    before: ModelWithEffects,
    after: ModelWithEffects,
    known_states: Collection[str] | None = None,
) -> ModelDifference:
    """Compare what two versions of one machine's model cover.

    Parameters
    ----------
    known_states
        States of the machine that readings state, such as spindle_rpm; None where there is no
        reading to tell: then no effect is said to lack one.

    Returns
    -------
    ModelDifference
        A version without any component has nothing to lose.
    """
    loses = (_with_reason(part, after) for part in _beyond(before, after, known_states))
    return ModelDifference(tuple(loses), tuple(_beyond(after, before, known_states)))


def _with_reason(part: Part, after: ModelWithEffects) -> Part:
    """Say why a component would be in no table."""
    why = None if part.component is None else after.model.omitted.get(part.component)
    if part.what != "component" or why is None:
        return part
    return replace(part, text=f"{part.component} ({why})")


def _beyond(
    before: ModelWithEffects, other: ModelWithEffects, known_states: Collection[str] | None
) -> Iterator[Part]:
    """List what one has beyond the other, in the order of the components."""
    gone = before.codes - other.codes
    covered, others = coverage(before.model), coverage(other.model)
    for code in sorted(before.codes, key=ORDER.__getitem__):
        if code in gone:
            yield Part("component", code, code)
        else:
            yield from _table_beyond(code, before.model, other.model)
            if code in covered and code in others:
                both = (_on_axis(code, c[code], before.model.machine) for c in (covered, others))
                for span in spans_beyond(*both):
                    yield _positions_part(code, covered[code].sensor, span)
    if before.codes:
        # Another reason than what is incomplete already counts for itself.
        already = {_about(part) for part in _incomplete(before, known_states)}
        for part in _incomplete(other, known_states):
            if part.component not in gone and _about(part) not in already:
                yield part


def _incomplete(before: ModelWithEffects, known_states: Collection[str] | None) -> Iterator[Part]:
    """List why tables of a version can never be complete."""
    for code, why in before.model.omitted.items():
        yield Part("completeness", f"completeness: {code} would not be in it, {why}", code)
    for effect in before.effects:
        unknown = () if known_states is None else set(effect.states) - set(known_states)
        if unknown:
            yield Part(
                "completeness",
                f"completeness: {effect.kind} of {list_names(effect.components)} needs "
                f"{list_names(sorted(unknown))}, which the latest reading does not state",
            )


def _about(part: Part) -> str:
    """Say what is incomplete, whatever the reason: a component, or by its words an effect."""
    return part.component or part.text


class Span(NamedTuple):
    """A range of positions over an interval of temperatures [°C, mm]; infinite for open ends."""

    from_c: float
    to_c: float
    from_mm: float
    to_mm: float


def spans_beyond(mine: Coverage, other: Coverage) -> list[Span]:
    """List the positions that one model's table has and another's lacks.

    Returns
    -------
    list of Span
        Each over the widest interval of temperatures. Where the component follows another
        sensor, temperatures cannot be held against each other: then what one has at every
        temperature, and the other does not have at every temperature.

    Examples
    --------
    >>> from app.thermal.coverage import CoveredInterval
    >>> long = Coverage("x", (CoveredInterval(20.0, 30.0, 0.0, 500.0, "a", "b"),))
    >>> short = Coverage("x", (CoveredInterval(20.0, 24.0, 0.0, 100.0, "a", "c"),
    ...                        CoveredInterval(24.0, 30.0, 0.0, 500.0, "c", "b")))
    >>> spans_beyond(long, short)
    [Span(from_c=20.0, to_c=24.0, from_mm=100.0, to_mm=500.0)]
    """
    if mine.sensor != other.sensor:
        everywhere = (-math.inf, math.inf)
        return [Span(*everywhere, *gap) for gap in _gaps(_always(mine), _always(other))]
    ends = sorted({t for i in (*mine.intervals, *other.intervals) for t in (i.from_c, i.to_c)})
    spans: list[Span] = []
    for low_c, high_c in pairwise(ends):
        inside_c = _between(low_c, high_c)
        for gap in _gaps(_at(mine, inside_c), _at(other, inside_c)):
            before = next((s for s in spans if s.to_c == low_c and s[2:] == gap), None)
            if before is not None:
                spans.remove(before)
            spans.append(Span(low_c if before is None else before.from_c, high_c, *gap))
    return spans


def _between(low_c: float, high_c: float) -> float:
    """Choose a temperature between two, of which either may be infinite [°C]."""
    if math.isinf(low_c):
        return 0.0 if math.isinf(high_c) else high_c - 1.0
    return low_c + 1.0 if math.isinf(high_c) else (low_c + high_c) / 2.0


def _at(covered: Coverage, t_c: float) -> tuple[float, float] | None:
    """Give the positions that are covered at a temperature [mm]; None without a table."""
    interval = next((i for i in covered.intervals if i.from_c <= t_c <= i.to_c), None)
    return None if interval is None else (interval.from_mm, interval.to_mm)


def _always(covered: Coverage) -> tuple[float, float] | None:
    """Give the positions that are covered at every temperature [mm]."""
    low = max(i.from_mm for i in covered.intervals)
    high = min(i.to_mm for i in covered.intervals)
    return (low, high) if low < high else None


def _gaps(
    mine: tuple[float, float] | None, others: tuple[float, float] | None
) -> Iterator[tuple[float, float]]:
    """List the parts of one range that another leaves out [mm]."""
    if mine is None:
        return
    if others is None:
        yield mine
        return
    for low, high in ((mine[0], min(mine[1], others[0])), (max(mine[0], others[1]), mine[1])):
        if low < high:
            yield low, high


def _on_axis(code: str, covered: Coverage, machine: Machine) -> Coverage:
    """Let errors that do not depend on position go as far as the axis does."""
    travel = machine.axes.get(COMPONENTS[code].axis or "")
    if travel is None:
        return covered
    return replace(
        covered,
        intervals=tuple(
            i
            if math.isfinite(i.from_mm)
            else replace(i, from_mm=travel.min_mm, to_mm=travel.max_mm)
            for i in covered.intervals
        ),
    )


def _table_beyond(code: str, before: CompiledModel, other: CompiledModel) -> Iterator[Part]:
    """List the directions and the temperatures between maps that one has of a component."""
    located, others = before.find(code), other.find(code)
    if located is None or others is None:  # it consists of effects there
        return
    if located[1].backward is not None and others[1].backward is None:
        yield Part("direction", f"the two directions of {code}", code)
    if located[0].sensor == others[0].sensor:
        yield from _temperatures_beyond(code, located[0].scales[0], others[0].scales[0])


def _temperatures_beyond(code: str, before: Scale, other: Scale) -> Iterator[Part]:
    """List the temperatures between the maps of one that are outside those of the other."""
    (first, *_, last), (others_first, *_, others_last) = before.temperatures_c, other.temperatures_c
    for low, high in ((first, min(last, others_first)), (max(first, others_last), last)):
        if low < high:
            text = f"maps of {code} between {low:g} and {high:g} °C of {before.sensor}"
            yield Part("temperatures", text, code, None, None, before.sensor, low, high)


def _positions_part(code: str, sensor: str, span: Span) -> Part:
    from_c, to_c = _finite(span.from_c), _finite(span.to_c)
    where = _range_text("from {0:g} to {1:g} mm", _finite(span.from_mm), _finite(span.to_mm), "mm")
    when = _range_text("between {0:g} and {1:g} °C", from_c, to_c, "°C")
    bounded = from_c is not None or to_c is not None
    return Part(
        "positions",
        f"{code} {where}" + (f", {when} of {sensor}" if bounded else ""),
        code,
        _finite(span.from_mm),
        _finite(span.to_mm),
        sensor if bounded else None,
        from_c,
        to_c,
    )


def _range_text(both: str, low: float | None, high: float | None, unit: str) -> str:
    if low is None and high is None:
        return "everywhere"
    if low is None:
        return f"below {high:g} {unit}"
    return f"above {low:g} {unit}" if high is None else both.format(low, high)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
