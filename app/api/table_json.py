"""Writing the compensation table as JSON, fast.

The bytes are those that `CompensationAnswer` and `CurrentCompensationAnswer`
document, without a model being made of them: controllers wait for this answer.
All text that does not change with the temperature is written once for each group
of components; the numbers, errors, compensations and standard errors, are written in
one go and cut apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np
import orjson

from app.arrays import FloatArray
from app.compensation.table import CompensationTable, ComponentCompensation, EffectInTable
from app.geometry.components import ORDER
from app.services.live_table import CurrentTable, is_stale
from app.thermal.compiled_model import Group, GroupState, Member

OPTIONS = orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_UTC_Z

_NO_MAP = {
    **dict.fromkeys(("sensor", "temperature_c", "lower_map", "upper_map", "weight")),
    "status": "effects-only",
}
"""What is said of a component that no two maps have, where adopted effects give it an error."""

FORMS_REMEMBERED = 20_000
"""Groups whose unchanging text is kept, over all machines: some 2 kB each."""


def table_json(table: CompensationTable) -> bytes:
    """Write a table as `CompensationAnswer`."""
    return orjson.dumps(_table_fields(table), option=OPTIONS)


def current_table_json(current: CurrentTable) -> bytes:
    """Write the table at the latest reading as `CurrentCompensationAnswer`."""
    state = current.state
    fields = _table_fields(current.table) | {
        "reading_time": state.reading.time,
        "reading_age_s": state.age_s,
        "stale": is_stale(state),
        "sensors": [sensor._asdict() for sensor in state.sensors],
    }
    return orjson.dumps(fields, option=OPTIONS)


def _table_fields(table: CompensationTable) -> dict[str, Any]:
    written = list(chain.from_iterable(map(_group_json, table.states)))
    if table.corrected:
        own = {ORDER[entry.component.code]: _corrected_json(entry) for entry in table.corrected}
        written = list((dict(written) | own).items())
    return {
        "machine": table.machine_id,
        "model_version": table.model_version,
        "computed_at": table.computed_at,
        "complete": table.complete,
        "warnings": table.warnings,
        "effects": [_effect_fields(effect) for effect in table.effects],
        "components": orjson.Fragment(
            b"[" + b",".join([text for _, text in sorted(written)]) + b"]"
        ),
    }


@dataclass(frozen=True, slots=True)
class _Slot:
    """Unchanging text, and which of the group's texts of numbers follows it."""

    before: bytes
    numbers: int


@dataclass(frozen=True, slots=True)
class _Form:
    """A group's unchanging text: for each member its place in the table and its slots."""

    columns: Sequence[slice]
    members: Sequence[tuple[int, Sequence[_Slot], bytes]]


def _group_json(state: GroupState) -> list[tuple[int, bytes]]:
    """Write each of a group's components, with its place in the table."""
    rows = [state.values, 0.0 - state.values]
    if state.variances is None:
        form = _form(state.group)
    else:
        form = _form(state.group, _known(state.variances, _columns(state.group)))
        rows.append(np.sqrt(state.variances))
    numbers = _texts(rows, form.columns)
    origin = orjson.dumps(_origin_fields(state))[1:]
    written = []
    for place, slots, after in form.members:
        pieces = [piece for slot in slots for piece in (slot.before, numbers[slot.numbers])]
        written.append((place, b"".join([*pieces, after, origin])))
    return written


def _effect_fields(effect: EffectInTable) -> dict[str, Any]:
    return {
        "kind": effect.kind,
        "components": effect.components,
        "sensors": effect.sensors,
        "explanation": effect.explanation,
        "in_table": not effect.missing,
        "missing": effect.missing,
    }


def _corrected_json(entry: ComponentCompensation) -> bytes:
    """Write a component with effects: it has positions of its own, so nothing is remembered."""
    component = entry.component
    fields: dict[str, Any] = {
        "component": component.code,
        "chapter": component.chapter,
        "axis": component.axis,
    }
    if component.is_table:
        fields["positions_mm"] = entry.positions_mm
    if component.iso:
        fields["iso"] = component.iso
        fields["iso_error_urad"] = component.iso_sign * float(entry.errors[0])
    fields |= _direction_fields(entry, "", entry.errors, entry.standard_errors)
    if entry.backward_errors is not None:
        fields |= _direction_fields(
            entry, "backward_", entry.backward_errors, entry.backward_standard_errors
        )
    return orjson.dumps(fields | _origin_fields(entry.origin, entry.effects), option=OPTIONS)


def _direction_fields(
    entry: ComponentCompensation,
    before: str,
    errors: FloatArray,
    standard_errors: FloatArray | None,
) -> dict[str, Any]:
    component = entry.component
    known = {component.error_field: errors, component.compensation_field: 0.0 - errors}
    if standard_errors is not None:
        known[component.standard_error_field] = standard_errors
    return {
        before + name: np.ascontiguousarray(values) if component.is_table else float(values[0])
        for name, values in known.items()
    }


def _texts(rows: Sequence[FloatArray], columns: Sequence[slice]) -> list[bytes]:
    """Write the numbers of each range of columns, row after row, without brackets."""
    lists = [numbers[c] for numbers in [row.tolist() for row in rows] for c in columns]
    return orjson.dumps(lists)[2:-2].split(b"],[")


def _columns(group: Group) -> list[slice]:
    """List the columns of each member's tables."""
    return [
        c for member in group.members for c in (member.forward, member.backward) if c is not None
    ]


def _known(variances: FloatArray, columns: Sequence[slice]) -> tuple[bool, ...]:
    """Say of each range of columns whether its standard errors are known: all or none are."""
    return tuple((~np.isnan(variances[[c.start for c in columns]])).tolist())


@lru_cache(maxsize=FORMS_REMEMBERED)
def _form(group: Group, known: tuple[bool, ...] | None = None) -> _Form:
    """Write what does not change with the temperature.

    `known` says of each range of columns whether it has standard errors; None: none has.
    """
    columns = _columns(group)
    at = {(c.start, c.stop): i for i, c in enumerate(columns)}
    known = known or (False,) * len(columns)
    members = [(ORDER[m.component.code], *_slots(m, at, known)) for m in group.members]
    return _Form(columns, members)


def _slots(
    member: Member, at: dict[tuple[int, int], int], known: Sequence[bool]
) -> tuple[list[_Slot], bytes]:
    """Lay out one component's fields.

    Of n ranges of columns the errors' texts stand first, n places after them the
    compensations', after those the standard errors'.
    """
    component = member.component
    head: dict[str, Any] = {
        "component": component.code,
        "chapter": component.chapter,
        "axis": component.axis,
    }
    if component.is_table:
        head["positions_mm"] = member.positions_mm
    fields = []
    for before, columns in (("", member.forward), ("backward_", member.backward)):
        if columns is None:
            continue
        i = at[columns.start, columns.stop]
        fields.append((f"{before}{component.error_field}", i))
        if known[i]:
            fields.append((f"{before}{component.standard_error_field}", i + 2 * len(at)))
        fields.append((f"{before}{component.compensation_field}", i + len(at)))
    if component.iso:
        minus = len(at) if component.iso_sign < 0 else 0
        forward = at[member.forward.start, member.forward.stop]
        fields.append(("iso_error_urad", forward + minus))
        head["iso"] = component.iso
    opening, closing = (b"[", b"]") if component.is_table else (b"", b"")
    text = orjson.dumps(head, option=OPTIONS)[:-1]
    slots = []
    for name, numbers in fields:
        slots.append(_Slot(text + b',"' + name.encode() + b'":' + opening, numbers))
        text = closing
    return slots, closing + b","


def _origin_fields(state: GroupState | None, effects: Sequence[str] = ()) -> dict[str, Any]:
    """Say how a group's numbers came about; the last fields of each component."""
    if state is None:
        return _NO_MAP | {"effects": effects}
    stand_in = {"stand_in_for": state.group.sensor} if state.is_stand_in else {}
    return {
        "sensor": state.sensor,
        **stand_in,
        "temperature_c": state.temperature_c,
        "lower_map": state.lower_map,
        "upper_map": state.upper_map,
        "weight": state.weight,
        "status": state.status,
        "effects": effects,
    }
