"""The compensation table as JSON: what it says, and writing it fast.

The bytes are those that `CompensationAnswer` and `CurrentCompensationAnswer`
document, without a model being made of them: controllers wait for this answer.
All text that does not change with the temperatures is written once; the numbers,
errors, compensations and standard errors, are rounded and written in one go and cut apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter, itemgetter
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
import orjson
from pydantic import Field, create_model

from app.answer import IN_ITS_UNIT
from app.arrays import FloatArray, IntArray
from app.compensation.table import (
    Basis,
    CompensationTable,
    ComponentCompensation,
    EffectInTable,
)
from app.effects.valid import LearntIn
from app.geometry.components import ORDER, Component
from app.rounding import DECIMALS, rounded, to_digits, to_digits_in
from app.services.live_table import CurrentTable, is_stale
from app.stated import MachineState, Number, Schema, Temperatures, UtcTime
from app.thermal.error_map import backward, number_fields
from app.thermal.group import Member
from app.thermal.group_state import GroupState

OPTIONS = orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_UTC_Z

LAYOUTS_BYTES = 64 * 2**20
"""Room for the unchanging text of tables, over all machines: some 12 kB for 12 × 21 numbers.

Where maps have positions of their own, each pair of neighbours of each sensor makes another one.
"""

BASES_REMEMBERED = 4096
"""Sentences on what numbers rest on that are kept, some 300 bytes each."""

STEPS = 10.0**DECIMALS
"""Errors are written in steps of 0.1 nm or 0.1 nrad: so many are a µm or a µrad."""

WEIGHT_DECIMALS = 6
"""Of a weight: of maps 100 µm apart 0.1 nm."""

_BETWEEN = b",null,"
"""What stands between two ranges of numbers while they are one text."""


class CompensationRequest(Schema):
    """The live temperatures for which the table is asked."""

    temperatures_c: Temperatures = Field(description="Live temperatures by sensor [°C]")
    state: MachineState


class FollowsAnswer(Schema):
    """A sensor by whose temperature a component's maps are read."""

    sensor: str = Field(description="Sensor", examples=["spindle"])
    temperature_c: Number = Field(
        description="Its temperature [°C], at the edge of where the effect was learnt if beyond"
    )
    share: Number = Field(
        description="Share of that in the numbers; all sum to 1. Beyond where the effect was "
        "learnt, what it makes of the maps is held at the edge and the assigned sensor goes on: of "
        "a share of 0.9975 there are then 0.9975 of the other sensor at the edge, 1 of the "
        "assigned one now, and -0.9975 of the assigned one at the edge",
        examples=[0.97],
    )


class _Placed(Schema):
    component: str = Field(description="ISO 230-1 code", examples=["EXX"])
    chapter: str = Field(description="The chapter's notation", examples=["D_x(x)"])
    axis: str | None = Field(description="Axis of the positions, null for a single value")
    positions_mm: list[Number] | None = Field(None, description="Positions on the axis [mm]")


if TYPE_CHECKING:
    _Columns = _Placed
else:
    _ERROR, _STANDARD_ERROR = attrgetter("error_field"), attrgetter("standard_error_field")
    _COMPENSATION = attrgetter("compensation_field")
    _Columns = create_model(
        "_Columns",
        __base__=_Placed,
        **number_fields(_ERROR, "Actual minus nominal", list[Number], Number),
        **number_fields(
            _STANDARD_ERROR,
            "Standard error of each error and its compensation, as far as the measurement of the "
            "maps goes: temperatures count as exact at the maps and between them, beyond the maps "
            "what their resolution adds over the edge is in it; absent where a map that enters "
            "states none",
            list[Number],
            Number,
        ),
        **number_fields(
            _COMPENSATION,
            "Minus the error",
            *(2 * (list[Number] | Number,)),
        ),
        **number_fields(backward(_ERROR), "Approached in the negative direction", list[Number]),
        **number_fields(backward(_STANDARD_ERROR), "Of the backward errors", list[Number]),
        **number_fields(backward(_COMPENSATION), "Minus the backward error", list[Number]),
    )


class ComponentCompensationAnswer(_Columns):
    """One component's error and compensation at the live temperatures.

    Tables have `positions_mm` and lists; squareness and rotary-axis locations have
    single numbers. The compensation is minus the error: what is to be added to the
    command.
    """

    iso: str | None = Field(None, description="ISO 230-1 name of a squareness", examples=["C0Y"])
    iso_error_urad: Number | None = Field(None, description="Its error in ISO's sign [µrad]")
    sensor: str | None = Field(
        description="Sensor that was used, by an adopted effect too; null, as are the next four, "
        "where no two maps have the component and adopted effects alone give it an error",
        examples=["x-middle"],
    )
    stand_in_for: str | None = Field(
        None, description="Assigned sensor, where another one stands in for it"
    )
    follows: list[FollowsAnswer] | None = Field(
        None,
        description="Where an adopted effect says that the component follows another sensor than "
        "the assigned one: every sensor by whose temperature its maps are read, the largest share "
        "first; `sensor` is the first of them",
    )
    temperature_c: Number | None = Field(description="That sensor's temperature T_u [°C]")
    lower_map: str | None = Field(
        description="Label of the lower map (T_n); null, as are the next two, where several "
        "sensors are followed and the numbers are not on one line between two maps",
        examples=["Run #1"],
    )
    upper_map: str | None = Field(description="Label of the upper map (T_m)", examples=["Run #3"])
    weight: Number | None = Field(
        description="The upper map's share, (T_u − T_n)/(T_m − T_n)", examples=[0.42]
    )
    status: str = Field(
        description="`interpolated`, `at-map`, `clamped`, `extrapolated`, `stand-in`, "
        "`effects-only`, or `held`: an adopted effect lies outside where it was learnt, and is "
        "held at the edge of that. `clamped` and `extrapolated` go before `held`; the warnings "
        "say both",
        examples=["interpolated"],
    )
    effects: list[str] = Field(
        description="Kinds of the adopted effects that are in these numbers; a component with "
        "effects has no standard errors, because the maps do not say how sure an effect is",
        examples=[["thermal-lag"]],
    )


class SurenessAnswer(Schema):
    """How sure a learnt effect is of one component at this moment, in the component's unit."""

    component: str = Field(description="Component code", examples=["EZZ"])
    expected: float = Field(description=f"What was learnt beside the maps {IN_ITS_UNIT}")
    learnt_error: float = Field(description=f"Standard deviation of what was learnt {IN_ITS_UNIT}")
    wander_error: float = Field(
        description=f"Standard deviation of what no driver explains {IN_ITS_UNIT}"
    )
    corrected: float = Field(description=f"What of it is in the table {IN_ITS_UNIT}")


class EffectInTableAnswer(Schema):
    """An adopted effect of the model, and whether it is in the table."""

    kind: str = Field(description="Kind of the effect", examples=["thermal-lag"])
    components: list[str] = Field(description="Components that it acts on", examples=[["EZZ"]])
    sensors: list[str] = Field(description="Sensors that drive it", examples=[["z-column"]])
    explanation: str = Field(
        description="What it is, in a sentence", examples=["EZZ follows z-column 41 ± 2 min late"]
    )
    in_table: bool = Field(description="Whether it could be evaluated and is in the numbers")
    missing: str = Field(description="What it lacks, empty where nothing")
    held: list[str] = Field(
        [],
        description="Why it is held at the edge of where it was learnt: which quantity, its value, "
        "and the range; empty where it is not",
    )
    valid: LearntIn | None = Field(
        None,
        description="Where it was learnt; null where an older version of this software adopted it",
    )
    measure_again: str = Field(
        "", description="Until when one that grows with time may be used, and what to measure then"
    )
    sureness: list[SurenessAnswer] = Field(
        [],
        description="Of one that is corrected only as far as it is sure: how sure it is now, for "
        "each component; empty for others",
    )


class CompensationAnswer(Schema):
    """The compensation table at stated temperatures.

    Adopted effects act as far as the request carries what they need: temperatures, the
    machine's `state`, and the present time. Those that need the past, such as a thermal lag,
    are in the table at the latest reading only.
    """

    machine: str = Field(description="The machine's id", examples=["mcfv5050"])
    model_version: int = Field(description="Version of the model", examples=[3])
    computed_at: UtcTime = Field(description="When it was computed, UTC")
    complete: bool = Field(
        description=(
            "Whether every component of the maps and every adopted effect is in the table, none "
            "on an old temperature or ending where other maps of it go on, no effect outside "
            "where it was learnt, and no value in use from a reading that arrived before its time"
        )
    )
    warnings: list[str] = Field(description="All that is not as it should be, in sentences")
    effects: list[EffectInTableAnswer] = Field(
        [], description="The model's adopted effects, in the table or not"
    )
    components: list[ComponentCompensationAnswer] = Field(description="One for each component")


class SensorStateAnswer(Schema):
    """One sensor now."""

    sensor: str = Field(description="Sensor", examples=["x-middle"])
    health: str = Field(
        description="`ok`, `missing`, `stale`, `out-of-range`, `stuck`, `jump`, or `faulty`: an "
        "adopted effect says that it reads wrong, and another sensor stands in",
        examples=["ok"],
    )
    temperature_c: Number | None = Field(description="Its last value [°C]")
    age_s: Number | None = Field(description="Age of that value [s]")
    detail: str = Field(description="What is the matter, empty when all is well")


class CurrentCompensationAnswer(CompensationAnswer):
    """The compensation table at the latest reading."""

    reading_time: UtcTime = Field(description="Time of the latest reading, UTC")
    reading_age_s: Number = Field(description="Its age [s]")
    stale: bool = Field(description="Whether any sensor's value is older than it may be")
    sensors: list[SensorStateAnswer] = Field(description="Every sensor's state")


def table_json(table: CompensationTable) -> bytes:
    """Write a table as `CompensationAnswer`."""
    return orjson.dumps(_table_fields(table), option=OPTIONS)


def current_table_json(current: CurrentTable, *, stepping: bool | None = None) -> bytes:
    """Write the table at the latest reading as `CurrentCompensationAnswer`.

    `stepping` says to those who limit steps whether more tables are on the way.
    """
    state = current.state
    fields = _table_fields(current.table) | {
        "reading_time": state.reading.time,
        "reading_age_s": state.age_s,
        "stale": is_stale(state),
        "sensors": [
            {
                "sensor": sensor.sensor,
                "health": sensor.health,
                "temperature_c": sensor.temperature_c,
                "age_s": sensor.age_s,
                "detail": sensor.detail,
            }
            for sensor in state.sensors
        ],
    }
    if stepping is not None:
        fields["stepping"] = stepping
    return orjson.dumps(fields, option=OPTIONS)


def _table_fields(table: CompensationTable) -> dict[str, Any]:
    return {
        "machine": table.machine_id,
        "model_version": table.model_version,
        "computed_at": table.computed_at,
        "complete": table.complete,
        "warnings": table.warnings,
        "effects": [_effect_fields(effect) for effect in table.effects],
        "components": orjson.Fragment(_components_json(table)),
    }


def _components_json(table: CompensationTable) -> bytes:
    """Write all components: one array of numbers, one text of it, cut where the ranges end."""
    layout = LAYOUTS.of(
        tuple([state.members for state in table.states]),
        tuple([_error_flags(state) for state in table.states]),
        tuple([entry.component.code for entry in table.corrected]),
    )
    rows = [row for state in table.states for row in _rows(state)]
    texts = [_corrected_json(entry) for entry in table.corrected]
    texts += [_basis_json(state) for state in table.states]
    if len(layout.columns):
        numbers = np.concatenate(rows).take(layout.columns)
        numbers *= layout.steps
        np.rint(numbers, out=numbers)
        numbers /= STEPS
        numbers += 0.0  # no −0
        texts += orjson.dumps(numbers, option=OPTIONS)[1:-1].split(_BETWEEN)
    return layout.text % layout.in_order(texts)


def _rows(state: GroupState) -> tuple[FloatArray, ...]:
    """Give a group's errors, and its standard errors where it has any."""
    if state.variances is None:
        return (state.values,)
    return state.values, _never_0(np.sqrt(state.variances))


def _effect_fields(effect: EffectInTable) -> dict[str, Any]:
    return {
        "kind": effect.kind,
        "components": effect.components,
        "sensors": effect.sensors,
        "explanation": effect.explanation,
        "in_table": not effect.missing,
        "missing": effect.missing,
        "held": effect.held,
        "valid": to_digits_in(effect.learnt_in),
        "measure_again": effect.measure_again,
        "sureness": [
            {
                "component": term.component,
                "expected": round(term.expected, 4),
                "learnt_error": round(term.learnt_error, 4),
                "wander_error": round(term.wander_error, 4),
                "corrected": round(term.corrected, 4),
            }
            for term in effect.sureness
        ],
    }


def _head(component: Component, positions_mm: FloatArray) -> dict[str, Any]:
    """Say which component it is, and where: the first fields of each."""
    head: dict[str, Any] = {
        "component": component.code,
        "chapter": component.chapter,
        "axis": component.axis,
    }
    return head | {"positions_mm": positions_mm} if component.is_table else head


def _corrected_json(entry: ComponentCompensation) -> bytes:
    """Write a component with effects: it has positions of its own, so nothing is remembered."""
    component = entry.component
    fields = _head(component, entry.positions_mm)
    if component.iso:
        fields["iso"] = component.iso
        fields["iso_error_urad"] = float(rounded(component.iso_sign * entry.errors)[0])
    fields |= _direction_fields(entry, "", entry.errors, entry.standard_errors)
    if entry.backward_errors is not None:
        fields |= _direction_fields(
            entry, "backward_", entry.backward_errors, entry.backward_standard_errors
        )
    return orjson.dumps(fields | _basis_fields(entry.basis, entry.effects), option=OPTIONS)


def _direction_fields(
    entry: ComponentCompensation,
    before: str,
    errors: FloatArray,
    standard_errors: FloatArray | None,
) -> dict[str, Any]:
    component = entry.component
    columns = {component.error_field: errors, component.compensation_field: 0.0 - errors}
    if standard_errors is not None:
        columns[component.standard_error_field] = _never_0(standard_errors)
    fields = {before + name: rounded(values) for name, values in columns.items()}
    return fields if component.is_table else {k: float(v[0]) for k, v in fields.items()}


def _never_0(standard_errors: FloatArray) -> FloatArray:
    """Leave at least one step of what is not 0: others divide by it."""
    return np.maximum(standard_errors, (standard_errors > 0.0) / STEPS)


def _columns(members: Sequence[Member]) -> list[slice]:
    """List the columns of each member's tables."""
    return [c for member in members for c in (member.forward, member.backward) if c is not None]


def _error_flags(state: GroupState) -> tuple[bool, ...] | None:
    """Say of each range of columns whether its standard errors are known: all or none are.

    None: the group has none.
    """
    if state.variances is None:
        return None
    starts = [c.start for c in _columns(state.members)]
    return tuple((~np.isnan(state.variances[starts])).tolist())


@dataclass(frozen=True, slots=True)
class _Layout:
    """What of a table does not change with the temperatures.

    Parameters
    ----------
    text
        All text, with `%b` where one is filled in.
    in_order
        Picks the texts that are filled in, of: the corrected components, what is said of
        each group's origin, and the ranges of numbers.
    columns : ndarray of int
        For each number to be written its place in all groups' rows, one behind the other.
        Between two ranges stands one number more, which is written as null.
    steps : ndarray
        What each number is multiplied with: `STEPS`, minus that of a compensation, NaN between
        two ranges.
    """

    text: bytes
    in_order: Callable[[Sequence[bytes]], Sequence[bytes]]
    columns: IntArray
    steps: FloatArray


_Key: TypeAlias = tuple[
    tuple[tuple[Member, ...], ...], tuple[tuple[bool, ...] | None, ...], tuple[str, ...]
]


class Layouts:
    """Layouts that were made, in so much memory at most: the oldest go first.

    Bounded by what they take and not by their number, of which one may take a thousand times as
    much as another. Models that hold no more are in the keys until then.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._kept: dict[_Key, _Layout] = {}
        self._lock = Lock()
        self.bytes = 0

    def of(
        self,
        groups: tuple[tuple[Member, ...], ...],
        with_errors: tuple[tuple[bool, ...] | None, ...],
        corrected: tuple[str, ...],
    ) -> _Layout:
        """Find the layout of a table, or make it: arguments as `_layout`."""
        key = (groups, with_errors, corrected)
        layout = self._kept.get(key)
        if layout is None:
            layout = _layout(*key)
            self._keep(key, layout)
        return layout

    def _keep(self, key: _Key, layout: _Layout) -> None:
        with self._lock:
            if key not in self._kept:
                self._kept[key] = layout
                self.bytes += _size(key, layout)
            while self.bytes > self._most_bytes:
                oldest = next(iter(self._kept))
                self.bytes -= _size(oldest, self._kept.pop(oldest))


def _size(key: _Key, layout: _Layout) -> int:
    """Bytes that a layout takes, and the positions that its key holds."""
    positions = sum(member.positions_mm.nbytes for members in key[0] for member in members)
    return len(layout.text) + layout.columns.nbytes + layout.steps.nbytes + positions


LAYOUTS = Layouts(LAYOUTS_BYTES)


def _layout(
    groups: tuple[tuple[Member, ...], ...],
    with_errors: tuple[tuple[bool, ...] | None, ...],
    corrected: tuple[str, ...],
) -> _Layout:
    """Lay out the table of all states that share their positions.

    Parameters
    ----------
    corrected
        Codes of the components that are written by themselves.
    """
    components: dict[int, list[tuple[bytes, _Numbers | int]]] = {}
    start = 0
    for i, (members, has_standard_errors) in enumerate(zip(groups, with_errors, strict=True)):
        width = max((columns.stop for columns in _columns(members)), default=0)
        flags = iter(has_standard_errors or (False,) * len(_columns(members)))
        for member in members:
            fields = _member_fields(member, start, width, flags)
            closing = (b"]," if member.component.is_table else b",", len(corrected) + i)
            components[ORDER[member.component.code]] = [*fields, closing]
        start += width if has_standard_errors is None else 2 * width
    for i, code in enumerate(corrected):
        components[ORDER[code]] = [(b"", i)]
    text, order = [], []
    columns, steps = [], []
    ranges = len(corrected) + len(groups)
    before = b"["
    for _, slots in sorted(components.items()):
        for piece, filled in slots:
            text.append(_literally(before + piece) + b"%b")
            before = b""
            if isinstance(filled, int):
                order.append(filled)
                continue
            order.append(ranges)
            ranges += 1
            n = filled.columns.stop - filled.columns.start
            columns += [*range(filled.columns.start, filled.columns.stop), 0]
            steps += [STEPS * filled.sign] * n + [np.nan]
        before = b","
    text.append(b"]" if components else b"[]")
    return _Layout(
        b"".join(text),
        itemgetter(*order) if order else tuple,
        np.array(columns[:-1], dtype=np.intp),
        np.array(steps[:-1], dtype=np.float64),
    )


def _literally(text: bytes) -> bytes:
    """Let a text stand as it is where others are filled in."""
    return text.replace(b"%", b"%%")


class _Numbers(NamedTuple):
    """A range of the groups' rows, one behind the other, and −1 for minus what stands there."""

    columns: slice
    sign: int = 1


def _member_fields(
    member: Member, start: int, width: int, with_errors: Iterator[bool]
) -> list[tuple[bytes, _Numbers | int]]:
    """Lay out a component's fields: unchanging text, and the numbers that follow it.

    Parameters
    ----------
    start, width
        Where the group's errors begin, and how many there are: its standard errors follow.
    with_errors
        For each of the member's ranges of columns whether its standard errors are known.
    """
    component = member.component
    head = _head(component, member.positions_mm)
    fields = []
    for before, columns in (("", member.forward), ("backward_", member.backward)):
        if columns is None:
            continue
        errors = slice(start + columns.start, start + columns.stop)
        fields.append((before + component.error_field, _Numbers(errors)))
        if next(with_errors):
            columns_of_errors = slice(errors.start + width, errors.stop + width)
            fields.append((before + component.standard_error_field, _Numbers(columns_of_errors)))
        fields.append((before + component.compensation_field, _Numbers(errors, -1)))
    if component.iso:
        only = slice(start + member.forward.start, start + member.forward.stop)
        fields.append(("iso_error_urad", _Numbers(only, component.iso_sign)))
        head["iso"] = component.iso
    opening, closing = (b"[", b"]") if component.is_table else (b"", b"")
    text = orjson.dumps(head, option=OPTIONS)[:-1]
    slots: list[tuple[bytes, _Numbers | int]] = []
    for name, numbers in fields:
        slots.append((text + b',"' + name.encode() + b'":' + opening, numbers))
        text = closing
    return slots


def _basis_json(state: GroupState) -> bytes:
    """Write how a group's numbers came about, after its numbers."""
    group, scale, bracket = state.group, state.scale, state.bracket
    lower, upper = scale.rows[bracket.lower], scale.rows[bracket.lower + 1]
    stand_in_for = None if scale is group.scales[0] else state.stand_in_for
    text = _basis_text(
        scale.sensor, stand_in_for, group.labels[lower], group.labels[upper], bracket.status
    )
    weight = round(bracket.weight, WEIGHT_DECIMALS)
    return text % (orjson.dumps(state.temperature_c), orjson.dumps(weight))


@lru_cache(maxsize=BASES_REMEMBERED)
def _basis_text(
    sensor: str, stand_in_for: str | None, lower_map: str, upper_map: str, status: str
) -> bytes:
    """Lay out what is said of a group's origin: two numbers are filled in."""
    number = "\0"  # stands in no text of ours: JSON writes it as \\u0000
    basis = Basis(sensor, None, lower_map, upper_map, None, status, stand_in_for)
    fields = _basis_fields(basis) | {"temperature_c": number, "weight": number}
    text = _literally(orjson.dumps(fields)[1:])
    return text.replace(orjson.dumps(number), b"%b")


def _basis_fields(basis: Basis, effects: Sequence[str] = ()) -> dict[str, Any]:
    """Say how numbers came about; the last fields of each component."""
    stand_in = {"stand_in_for": basis.stand_in_for} if basis.stand_in_for else {}
    follows = basis.follows
    temperature_c = basis.temperature_c
    if follows and temperature_c is not None:
        temperature_c = to_digits(temperature_c)  # it may be one that an effect made
    return {
        "sensor": basis.sensor,
        **stand_in,
        **(
            {"follows": to_digits_in([followed._asdict() for followed in follows])}
            if follows
            else {}
        ),
        "temperature_c": temperature_c,
        "lower_map": basis.lower_map,
        "upper_map": basis.upper_map,
        "weight": None if basis.weight is None else round(basis.weight, WEIGHT_DECIMALS),
        "status": basis.status,
        "effects": effects,
    }
