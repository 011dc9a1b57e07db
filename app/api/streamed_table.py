"""A machine's table and verdict as streams send them: written once, and kept for comparison."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import orjson
from pydantic import TypeAdapter

from app.api.table_json import OPTIONS, current_table_json
from app.arrays import FloatArray
from app.errors import ThermapError
from app.live.registry import LiveMachine
from app.services.context import Context
from app.services.live_table import CurrentState, current_table
from app.services.status import Stored, status_of
from app.status.machine_status import MachineStatus

REMEMBERED: Final = 64
"""Tables of each machine that are remembered, for followers that come back."""

REMEMBERED_BYTES: Final = 4 * 2**20
"""Room for the numbers of those of one machine [bytes]: 64 of 8,000 numbers, fewer of more."""

_STATUS: Final = TypeAdapter(MachineStatus)


@dataclass(frozen=True, slots=True)
class Table:
    """A table as it is sent, or why there is none.

    Parameters
    ----------
    number
        Later tables of this service have larger ones.
    content
        The JSON of `GET …/compensation`; empty in those that are remembered.
    layout
        Which numbers `values` are: tables of other positions or components cannot be compared.
    values
        All errors and compensations, in their order; empty without a table.
    facts
        Completeness, model version and the sensors' health.
    """

    number: int
    content: bytes
    layout: bytes
    values: FloatArray
    facts: tuple[Any, ...]

    @property
    def has_values(self) -> bool:
        """Whether there is a table."""
        return bool(self.layout)


@dataclass(slots=True)
class Feed:
    """What is known of one machine, for all who follow it."""

    machine_id: str
    table: Table | None = None
    status: bytes = b""
    status_key: tuple[Any, ...] = ()
    tag: str = ""
    judged_at_s: float = 0.0
    tables: OrderedDict[int, Table] = field(default_factory=OrderedDict)
    steps: OrderedDict[int, Table] = field(default_factory=OrderedDict)

    def known(self, number: int | None) -> Table | None:
        """Find the table that held when an event of this number was sent; None if unknown.

        The event may have been another machine's: then it is the last one before it. Before the
        first that is remembered there may have been others.
        """
        if number is None:
            return None
        if number in self.steps:
            return self.steps[number]
        until = [one for one in self.tables if one <= number]
        return self.tables[until[-1]] if until else None


def remember(tables: OrderedDict[int, Table], table: Table) -> None:
    """Keep what a later table is compared with, for those who come back."""
    layout = table.layout
    if tables and (last := tables[next(reversed(tables))]).layout == layout:
        layout = last.layout  # most often the same: all share one
    tables[table.number] = replace(table, content=b"", layout=layout)
    taken = sum(one.values.nbytes for one in tables.values())
    while len(tables) > REMEMBERED or taken > REMEMBERED_BYTES:
        _, oldest = tables.popitem(last=False)
        taken -= oldest.values.nbytes


def write_table(
    context: Context, machine_id: str, state: CurrentState | ThermapError, number: int
) -> Table:
    """Write the table of a state, or why there is none."""
    if isinstance(state, CurrentState):
        try:
            current = current_table(context, state)
        except ThermapError as why:
            state = why
        else:
            content = current_table_json(current)
            values, layout = _values_of(orjson.loads(content))
            facts = (
                current.table.complete,
                current.table.model_version,
                *((s.sensor, s.health) for s in current.state.sensors),
            )
            return Table(number, content, layout, values, facts)
    content = orjson.dumps(
        {
            "machine": machine_id,
            "computed_at": context.now(),
            "complete": False,
            "detail": state.detail,
            "components": [],
        },
        option=OPTIONS,
    )
    return Table(number, content, b"", np.empty(0), (False, state.detail))


def judge_anew(context: Context, live: LiveMachine, feed: Feed, stored: Stored) -> bool:
    """Judge a machine; True where the verdict or its words are other ones."""
    status = status_of(context, live, stored)
    key = (
        *(status.verdict, status.state, status.since, status.sentences, status.watch),
        *(status.model_version, status.analysis),
    )
    if key == feed.status_key:
        return False
    feed.status_key = key
    feed.status = _STATUS.dump_json(status)
    return True


def _is_value(name: str) -> bool:
    """Whether a field of a component changes with the errors, in proportion."""
    return "standard" not in name and any(
        part in name for part in ("error", "slope", "compensation")
    )


def _values_of(document: dict[str, Any]) -> tuple[FloatArray, bytes]:
    """Set all errors and compensations of a table in a row, and say which they are."""
    values: list[float] = []
    layout = []
    for component in document["components"]:
        names = [name for name in component if _is_value(name)]
        layout.append([component["component"], component.get("positions_mm"), names])
        for name in names:
            own = component[name]
            values += own if isinstance(own, list) else [own]
    return np.array(values), orjson.dumps(layout)


def with_values(content: bytes, values: FloatArray, *, is_stepping: bool) -> bytes:
    """Write other values into a table, and whether more of them are on the way."""
    document = orjson.loads(content)
    document["stepping"] = is_stepping
    at = 0
    for component in document["components"]:
        for name in component:
            if not _is_value(name):
                continue
            if isinstance(component[name], list):
                n = len(component[name])
                component[name] = values[at : at + n].tolist()
            else:
                n = 1
                component[name] = float(values[at])
            at += n
    return orjson.dumps(document, option=OPTIONS)
