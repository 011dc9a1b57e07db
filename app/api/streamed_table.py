"""A machine's table and verdict as streams send them: written once, and kept for comparison."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from typing import Any, Final

import orjson
from pydantic import TypeAdapter

from app.api.table_json import OPTIONS, current_table_json
from app.compensation.table_steps import Curves, curves_of
from app.errors import ThermapError
from app.live.registry import LiveMachine
from app.rounding import DECIMALS
from app.services.context import Context
from app.services.live_table import CurrentState, CurrentTable, current_table
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
    curves
        All errors as they are written; None without a table.
    facts
        Completeness, model version and the sensors' health.
    content
        The JSON of `GET …/compensation`; empty in those that are remembered.
    current
        The table that it is written from; None in those that are remembered, too.
    """

    number: int
    curves: Curves | None
    facts: tuple[Any, ...]
    content: bytes = b""
    current: CurrentTable | None = None

    @property
    def bytes(self) -> int:
        """What its numbers take."""
        return sum(
            entry.errors.nbytes * (1 if entry.backward_errors is None else 2)
            + entry.positions_mm.nbytes
            for entry in (self.curves or {}).values()
        )


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
        until = [number_ for number_ in self.tables if number_ <= number]
        return self.tables[until[-1]] if until else None


def remember(tables: OrderedDict[int, Table], table: Table) -> None:
    """Keep what a later table is compared with, for those who come back."""
    tables[table.number] = replace(table, content=b"", current=None)
    taken = sum(sent_table.bytes for sent_table in tables.values())
    while len(tables) > REMEMBERED or taken > REMEMBERED_BYTES:
        _, oldest = tables.popitem(last=False)
        taken -= oldest.bytes


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
            facts = (
                current.table.complete,
                current.table.model_version,
                *((s.sensor, s.health) for s in current.state.sensors),
            )
            curves = curves_of(current.table.components, DECIMALS)
            return Table(number, curves, facts, current_table_json(current), current)
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
    return Table(number, None, (False, state.detail), content)


def write_step(current: CurrentTable, curves: Curves) -> bytes:
    """Write a table with the errors of a step on the way to its own."""
    table = current.table._replace(corrected=tuple(curves.values()))
    return current_table_json(replace(current, table=table), stepping=True)


def judge_anew(context: Context, live: LiveMachine, feed: Feed, stored: Stored) -> bool:
    """Judge a machine; True where the verdict or its words are other ones."""
    status = status_of(context, live, stored)
    key = (
        *(status.verdict, status.state, status.since, status.sentences, status.watch),
        *(status.last_check, status.not_adopted, status.model_version, status.analysis),
    )
    if key == feed.status_key:
        return False
    feed.status_key = key
    feed.status = _STATUS.dump_json(status)
    return True
