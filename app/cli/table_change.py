"""How the compensation table changed over a replay: at its ends, and at most."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from rich.table import Table

from app.arrays import FloatArray
from app.cli.table_view import evenly_chosen, signed
from app.geometry.components import COMPONENTS
from thermap import InvalidContentError, ThermapClient
from thermap.answers import CompensationAnswer

SAMPLES: Final = 60
"""Tables that are asked for over a replay; the temperatures change slowly."""


@dataclass(frozen=True, slots=True)
class ComponentChange:
    """One component's compensation at the position where first and last differ most.

    `largest` is the greatest magnitude of change against the first table at any
    position of any table; all numbers in the component's unit.
    """

    code: str
    chapter: str
    unit: str
    position_mm: float | None
    first: float
    last: float
    largest: float


def sampled_tables(
    thermap: ThermapClient, machine: str, temperatures_c: Sequence[Mapping[str, float]]
) -> list[CompensationAnswer]:
    """Ask for the tables at evenly chosen readings, both ends among them.

    Readings that have no table, because a sensor is missing, are passed over.
    """
    found = []
    for i in evenly_chosen(len(temperatures_c), SAMPLES):
        try:
            found.append(thermap.compensation(machine, temperatures_c[i]))
        except InvalidContentError:
            continue
    return found


def component_changes(tables: Sequence[CompensationAnswer]) -> list[ComponentChange]:
    """Compare the first table with the last one, and with all between."""
    values = [_compensation_by_code(table) for table in tables]
    changes = []
    for entry in tables[0].components:
        code = entry.component
        series = [v[code] for v in values if code in v and v[code].shape == values[0][code].shape]
        over_time = np.array(series)
        most = int(np.abs(over_time[-1] - over_time[0]).argmax())
        changes.append(
            ComponentChange(
                code=code,
                chapter=entry.chapter,
                unit=COMPONENTS[code].unit.symbol,
                position_mm=entry.positions_mm[most] if entry.positions_mm else None,
                first=float(over_time[0, most]),
                last=float(over_time[-1, most]),
                largest=float(np.abs(over_time - over_time[0]).max()),
            )
        )
    return changes


def change_view(changes: Iterable[ComponentChange]) -> Table:
    """Lay the changes out for a terminal."""
    table = Table(
        box=None,
        padding=(0, 2, 0, 0),
        pad_edge=False,
        header_style="dim",
        title="Compensation at the first and the last reading, where they differ most",
        title_justify="left",
        title_style="bold",
    )
    for heading in ("component", "", "unit"):
        table.add_column(heading)
    for heading in ("at mm", "first", "last", "change", "largest change"):
        table.add_column(heading, justify="right", no_wrap=True)
    for c in changes:
        position = "" if c.position_mm is None else f"{c.position_mm:g}"
        numbers = (signed(c.first), signed(c.last), signed(c.last - c.first), f"{c.largest:.2f}")
        table.add_row(c.code, c.chapter, c.unit, position, *numbers)
    return table


def _compensation_by_code(table: CompensationAnswer) -> dict[str, FloatArray]:
    """Every component's compensation, shape (n,), in its unit."""
    return {
        entry.component: np.atleast_1d(
            np.asarray(getattr(entry, COMPONENTS[entry.component].compensation_field), dtype=float)
        )
        for entry in table.components
    }
