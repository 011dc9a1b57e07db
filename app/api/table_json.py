"""Writing the compensation table as JSON, fast.

The bytes are those that `CompensationAnswer` and `CurrentCompensationAnswer`
document, without a model being made of them: controllers wait for this answer.
All text that does not change with the temperature is written once for each group
of components; of the numbers, all errors are written in one go, and all
compensations in another, and cut apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any

import orjson

from app.arrays import FloatArray
from app.compensation.table import CompensationTable
from app.geometry.components import ORDER
from app.services.live_table import CurrentTable, is_stale
from app.thermal.compiled_model import Group, GroupState, Member

OPTIONS = orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_UTC_Z

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
    written = sorted(chain.from_iterable(map(_group_json, table.states)))
    return {
        "machine": table.machine_id,
        "model_version": table.model_version,
        "computed_at": table.computed_at,
        "complete": table.complete,
        "warnings": table.warnings,
        "components": orjson.Fragment(b"[" + b",".join([text for _, text in written]) + b"]"),
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
    form = _form(state.group)
    numbers = _texts(state.values, form.columns) + _texts(0.0 - state.values, form.columns)
    origin = orjson.dumps(_origin_fields(state))[1:]
    written = []
    for place, slots, after in form.members:
        pieces = [piece for slot in slots for piece in (slot.before, numbers[slot.numbers])]
        written.append((place, b"".join([*pieces, after, origin])))
    return written


def _texts(values: FloatArray, columns: Sequence[slice]) -> list[bytes]:
    """Write the numbers of each range of columns, without brackets."""
    numbers = values.tolist()
    return orjson.dumps([numbers[c] for c in columns])[2:-2].split(b"],[")


@lru_cache(maxsize=FORMS_REMEMBERED)
def _form(group: Group) -> _Form:
    """Write what does not change with the temperature."""
    columns = [
        c for member in group.members for c in (member.forward, member.backward) if c is not None
    ]
    at = {(c.start, c.stop): i for i, c in enumerate(columns)}
    members = [
        (ORDER[m.component.code], *_slots(m, at, negated=len(columns))) for m in group.members
    ]
    return _Form(columns, members)


def _slots(
    member: Member, at: dict[tuple[int, int], int], negated: int
) -> tuple[list[_Slot], bytes]:
    """Lay out one component's fields: compensations stand `negated` places after errors."""
    component = member.component
    head: dict[str, Any] = {
        "component": component.code,
        "chapter": component.chapter,
        "axis": component.axis,
    }
    if component.is_table:
        head["positions_mm"] = member.positions_mm
    forward = at[member.forward.start, member.forward.stop]
    fields = [
        (component.error_field, forward),
        (component.compensation_field, negated + forward),
    ]
    if member.backward is not None:
        backward = at[member.backward.start, member.backward.stop]
        fields.append((f"backward_{component.error_field}", backward))
        fields.append((f"backward_{component.compensation_field}", negated + backward))
    if component.iso:
        fields.append(("iso_error_urad", forward + (negated if component.iso_sign < 0 else 0)))
        head["iso"] = component.iso
    opening, closing = (b"[", b"]") if component.is_table else (b"", b"")
    text = orjson.dumps(head, option=OPTIONS)[:-1]
    slots = []
    for name, numbers in fields:
        slots.append(_Slot(text + b',"' + name.encode() + b'":' + opening, numbers))
        text = closing
    return slots, closing + b","


def _origin_fields(state: GroupState) -> dict[str, Any]:
    """Say how a group's numbers came about; the last fields of each component."""
    stand_in = {"stand_in_for": state.group.sensor} if state.is_stand_in else {}
    return {
        "sensor": state.sensor,
        **stand_in,
        "temperature_c": state.temperature_c,
        "lower_map": state.lower_map,
        "upper_map": state.upper_map,
        "weight": state.weight,
        "status": state.status,
        "effects": [],
    }
