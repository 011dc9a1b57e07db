"""Where adopted effects lack something or lie outside what they learnt, and how that is said."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.conditions import Conditions, Signal
from app.effects.effect import Effect, ranges_of_quantities
from app.effects.map_tables import MapReading
from app.effects.response_driver import Responding
from app.effects.shape import Exchange, Places
from app.effects.term import Term
from app.effects.valid import DRIVER_MARGIN, Range, widened
from app.errors import list_names
from app.thermal.bracket import Status
from app.thermal.compiled_model import CompiledModel
from app.thermal.prediction import GRAVITY
from app.units import date_text, unit_of_field

HELD: Final = "held"
"""Status where an effect is held at the edge of what it was learnt in."""

EFFECTS_ONLY: Final = "effects-only"
"""Status where no two maps have the component, and effects alone give it an error."""

_LESS_GRAVE: Final = frozenset(
    {Status.AT_MAP, Status.INTERPOLATED, Status.STAND_IN, EFFECTS_ONLY, HELD}
)
"""What `held` takes precedence over; what says that the maps themselves are left, or that nothing
is known, comes first."""

_OUTSIDE: Final = tuple(s for s in GRAVITY if s in (Status.CLAMPED, Status.EXTRAPOLATED))
"""Where a temperature lies outside the maps, the less grave first."""

NO_NUMBER: Final = "what drives it has no usable value here"
NOT_COMMON: Final = "the maps that it reads here share no range of positions"


@dataclass(frozen=True, slots=True)
class Missing:
    """An effect that is not in an answer, and why."""

    effect: int
    kind: str
    reason: str


class Remark(NamedTuple):
    """A sentence on one of the effects, by its number."""

    effect: int
    sentence: str


class OutsideRange(NamedTuple):
    """A quantity that lies outside where an effect was learnt.

    `values` and `is_beyond` have shape (n,), one for each moment or place; `component` is the one
    whose position it is, or empty; `components` those that it acts on, `is_held` says
    whether it is moved to the edge: not where it is one of two signals of which the difference
    is what was learnt.
    """

    quantity: str
    unit: str
    learnt: Range
    values: FloatArray
    is_beyond: BoolArray
    component: str = ""
    is_time: bool = False
    is_held: bool = True
    components: tuple[str, ...] = ()


class ReadBeyondMaps(NamedTuple):
    """A temperature outside the maps at which an effect reads them.

    `ends_c` are the first and the last map's temperature [°C]; `is_refused` says that the machine's
    policy allows no table there; `values` is how many they are, 0 for one table.
    """

    effect: int
    component: str
    sensor: str
    temperature_c: float
    ends_c: Range
    status: str
    is_refused: bool
    values: int = 0


def read_beyond_maps(
    model: CompiledModel, effect: int, term: Term, reading: MapReading, use: BoolArray
) -> Iterator[ReadBeyondMaps]:
    """List where a term reads the maps outside of them, by the assigned sensor's temperature.

    Parameters
    ----------
    effect
        Its number.
    use : ndarray, shape (n,)
        At which of the reading's moments it takes part.

    Yields
    ------
    ReadBeyondMaps
        The farthest temperature of each status.
    """
    located = model.find(term.component)
    if located is None or isinstance(term.shape, Exchange):
        return
    ends_c = (reading.scale.temperatures_c[0], reading.scale.temperatures_c[-1])
    for status in _OUTSIDE:
        there = np.flatnonzero(use & reading.is_read & (reading.status == status))
        if there.size:
            beyond_c = np.abs(reading.temperatures_c[there] - np.mean(ends_c))
            yield ReadBeyondMaps(
                effect,
                term.component,
                reading.scale.sensor,
                float(reading.temperatures_c[there[int(np.argmax(beyond_c))]]),
                ends_c,
                status,
                bool(reading.is_refused[there].any()),
                there.size,
            )


def beyond_maps_sentences(
    effects: Sequence[Effect], moved: Sequence[ReadBeyondMaps]
) -> list[Remark]:
    """Say which effects read the maps outside of them, and what was done."""
    codes: dict[ReadBeyondMaps, list[str]] = {}
    for reading in moved:
        codes.setdefault(reading._replace(component=""), []).append(reading.component)
    remarks = []
    for reading, components in codes.items():
        done = "extrapolated" if reading.status == Status.EXTRAPOLATED else "held"
        refused = (
            ", because the machine's policy allows no table there" if reading.is_refused else ""
        )
        values = f" ({reading.values} values)" if reading.values else ""
        remarks.append(
            Remark(
                reading.effect,
                f"{effects[reading.effect].kind} of {list_names(components)} reads the maps at "
                f"{reading.temperature_c:g} °C of {reading.sensor}, outside their range of "
                f"{reading.ends_c[0]:g} to {reading.ends_c[1]:g} °C: {done}{refused}{values}",
            )
        )
    return remarks


def with_held(status: str) -> str:
    """Say that an effect is held, unless something graver is to be said.

    >>> with_held("interpolated"), with_held("clamped")
    ('held', 'clamped')
    """
    return HELD if status in _LESS_GRAVE else status


def conditions_beyond(
    model: CompiledModel, effect: Effect, conditions: Conditions
) -> Iterator[OutsideRange]:
    """Hold the conditions at n moments against where an effect was learnt.

    Yields
    ------
    OutsideRange
        Of every quantity that lies outside at some moment.
    """
    valid = effect.valid
    if valid is None:
        return
    for sensor, learnt in valid.temperatures_c.items():
        edges = widened(learnt, 0.0, _resolution_c(model, sensor))
        values = conditions.temperature(sensor)
        acts_on = _held_by(model, effect, Signal("temperature", sensor))
        for outside in _outside(f"{sensor}", "°C", learnt, edges, values):
            yield outside._replace(
                is_held=bool(acts_on), components=acts_on or _made_of(effect, sensor)
            )
    for name, learnt in valid.state.items():
        edges = widened(learnt, DRIVER_MARGIN)
        yield from _outside(name, unit_of_field(name) or "", learnt, edges, conditions.state(name))
    for driver, quantity, learnt, terms in ranges_of_quantities(effect.terms):
        least = max((_least(model, signal) for signal, _ in driver.signals), default=0.0)
        edges = widened(learnt, DRIVER_MARGIN, least)
        values = driver.at(conditions)
        for outside in _outside(quantity.name, quantity.unit, learnt, edges, values):
            low, high = learnt
            yield outside._replace(
                learnt=(low + quantity.zero, high + quantity.zero),
                values=values + quantity.zero,
                components=tuple(dict.fromkeys(term.component for term in terms)),
            )
    for term in effect.terms:
        if isinstance(term.driver, Responding):
            yield from _columns_beyond(term.driver, term.component, conditions)
    if any(term.driver.grows_with_time for term in effect.terms):
        until_s = valid.to_s if valid.use_until_s is None else valid.use_until_s
        # Backwards it leaves out as much as forwards.
        edges = (valid.from_s - (until_s - valid.grows_until_s), until_s)
        learnt = (valid.from_s, valid.to_s)
        for outside in _outside("time", "", learnt, edges, conditions.times_s):
            yield outside._replace(is_time=True)


def _columns_beyond(
    driver: Responding, component: str, conditions: Conditions
) -> Iterator[OutsideRange]:
    """Say of the column of a response that lies farthest outside where it is held."""
    outside = driver.farthest(conditions)
    if outside is not None:
        yield OutsideRange(
            outside.column.words,
            outside.column.unit,
            outside.learnt,
            outside.values,
            outside.is_beyond,
            components=(component,),
        )


def positions_beyond(effect: Effect, code: str, places: Places) -> Iterator[OutsideRange]:
    """Hold positions of a component's axis against where an effect was learnt along it.

    Parameters
    ----------
    places
        Where, shape (n,).
    """
    valid = effect.valid
    edges = None if valid is None else valid.edges_mm(code)
    along = any(t.component == code and t.shape.changes_along for t in effect.terms)
    if valid is None or edges is None or not along:
        return
    learnt = valid.positions_mm[code]
    for outside in _outside(f"positions of {code}", "mm", learnt, edges, places.positions_mm):
        yield outside._replace(component=code, components=(code,))


def held_sentence(effect: Effect, beyond: OutsideRange) -> str:
    """Say of one quantity that an effect is held because of it, and how far it was learnt."""
    codes = list_names(beyond.components or effect.components)
    if beyond.is_time:
        return _of_time(effect, codes, beyond)
    low, high = beyond.learnt
    unit = f" {beyond.unit}" if beyond.unit else ""
    outside = beyond.values[beyond.is_beyond]
    farthest = outside[np.argmax(np.maximum(low - outside, outside - high))]
    is_there = "reach" if beyond.component else "is"
    if not beyond.is_held:
        return (
            f"{effect.kind} of {codes} was not learnt here: {beyond.quantity} is "
            f"{farthest:g}{unit}, learnt from {low:g} to {high:g}{unit}; it depends on several "
            "signals together, so its value is left as it is"
        )
    return (
        f"{effect.kind} of {codes} is held at the edge of where it was learnt: {beyond.quantity} "
        f"{is_there} {farthest:g}{unit}, learnt from {low:g} to {high:g}{unit}"
    )


def unknown_range(effect: Effect) -> str:
    """Say that it is not known where an effect was learnt, empty where it is."""
    if effect.valid is not None or effect.adds_nothing:
        return ""
    return (
        f"{effect.kind} of {list_names(effect.components)}: the range in which it was learnt is "
        "not known, so this may lie far outside it; analyse the measurements again and adopt "
        "what is found"
    )


def use_until(effect: Effect) -> str:
    """Say until when an effect that grows with time may be used, and what to measure then.

    Returns
    -------
    str
        A sentence, empty for an effect that does not grow.
    """
    valid = effect.valid
    if valid is None or valid.use_until_s is None:
        return ""
    codes = list_names(effect.components)
    if valid.continued_until_s is not None:
        return (
            f"The {effect.kind} of {codes} was last observed at {date_text(valid.to_s)}. It is "
            f"continued as it was found until {date_text(valid.continued_until_s)} and then held. "
            f"It may be used until {date_text(valid.use_until_s)}: after that it may be wrong by "
            f"more than one observation scatters. Measure {codes} again before then"
        )
    return (
        f"The {effect.kind} of {codes} is not continued beyond its last observation at "
        f"{date_text(valid.to_s)}. It may be used until {date_text(valid.use_until_s)}: after "
        f"that it may have grown by more than one observation scatters. Measure {codes} again "
        "before then"
    )


def _of_time(effect: Effect, codes: str, beyond: OutsideRange) -> str:
    from_s, to_s = beyond.learnt
    until_s = effect.valid.use_until_s if effect.valid else None
    held_s = effect.valid.grows_until_s if effect.valid else to_s
    outside_s = beyond.values[beyond.is_beyond]
    if outside_s.max() > to_s:
        may = "" if until_s is None else f", and may be used until {date_text(until_s)}"
        when = "when it was last observed"
        if held_s > to_s:
            when = f"the end of its continuation (it was last observed at {date_text(to_s)})"
        return (
            f"{effect.kind} of {codes} is held at its value of {date_text(held_s)}, {when}{may}; "
            f"this is for {date_text(float(outside_s.max()))}: measure {codes} again, and analyse "
            "again"
        )
    return (
        f"{effect.kind} of {codes} is held at its value of {date_text(from_s)}, when it was first "
        f"observed; this is for {date_text(float(outside_s.min()))}"
    )


def _outside(
    quantity: str, unit: str, learnt: Range, edges: Range, values: FloatArray
) -> Iterator[OutsideRange]:
    # NaN lies nowhere: that something is missing is said elsewhere.
    is_beyond = (values < edges[0]) | (values > edges[1])
    if is_beyond.any():
        yield OutsideRange(quantity, unit, learnt, values, is_beyond)


def _held_by(model: CompiledModel, effect: Effect, signal: Signal) -> tuple[str, ...]:
    """List the components of which a signal is moved to the edge."""
    codes = (t.component for t in effect.terms if signal in t.held_signals(model))
    return tuple(dict.fromkeys(codes))


def _made_of(effect: Effect, sensor: str) -> tuple[str, ...]:
    """List the components that a sensor drives."""
    driven = (
        term.component
        for term in effect.terms
        if any(signal.name == sensor for signal, _ in term.driver.signals)
    )
    return tuple(dict.fromkeys(driven))


def _resolution_c(model: CompiledModel, sensor: str) -> float:
    declared = model.machine.sensors.get(sensor)
    return declared.resolution_c if declared else 0.0


def _least(model: CompiledModel, signal: Signal) -> float:
    return _resolution_c(model, signal.name) if signal.kind == "temperature" else 0.0
