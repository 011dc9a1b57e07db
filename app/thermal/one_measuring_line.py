"""Maps whose translations were measured along different lines, brought to one.

Between two lines translations differ by what the axis' rotations do on the way, and by
its nonrigid slopes (Y.-Y. Hsu 2011, 17–25; C. Wang, 8.2.3 and 8.1–8.18). Interpolating
between maps of different lines would take that for a change with temperature. What is read
on another line is linear in the errors of the map's own axis, and so their uncertainty
is carried along.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.errors import list_names
from app.geometry.chain import Chain
from app.geometry.components import LINEAR_LETTERS
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.measuring_line import MeasuringLine, MeasuringLines
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.resampling import covariance_of, interpolation_matrix
from app.thermal.uncertainty import MOST_CORRELATED, propagate

NO_SHARE: Final = 1e-12
"""Rounding of an arm [m] that is none, or of a product of two."""

PARTS_OF_A_CURVE: Final = 8
"""Of a parabola straight lines between so many parts leave 1/64."""


def on_one_line(
    chain: Chain, maps: Iterable[ErrorMap]
) -> tuple[list[ErrorMap], MeasuringLines, list[str]]:
    """Bring each axis' errors to the line of the map that stated one first.

    Parameters
    ----------
    maps
        The error maps, in any order: the result does not depend on it.

    Returns
    -------
    maps : list of ErrorMap
        In the same order; a map that is on that line already is the same object.
    lines
        Axis to the line that all maps now share.
    notes
        In sentences: what was brought where, and which maps lack rotations for it.
    """
    error_maps = list(maps)
    lines: dict[str, MeasuringLine] = {}
    notes: list[str] = []
    for axis in chain.axes:
        concerned = [m for m in error_maps if _depends_on_line(axis, m)]
        stating = [m for m in concerned if axis in m.measuring_lines]
        if not stating:
            continue
        first = min(stating, key=lambda m: (m.measured_at, m.label))
        lines[axis] = line = first.measuring_lines[axis]
        others = [m for m in concerned if m.measuring_lines.get(axis) != line]
        if others:
            brought = [_brought(chain, axis, m, line) for m in others]
            notes += _notes(axis, first, others, brought)
            error_maps = [brought[others.index(m)] if m in others else m for m in error_maps]
    return error_maps, lines, notes


def _notes(
    axis: str, first: ErrorMap, others: Sequence[ErrorMap], brought: Sequence[ErrorMap]
) -> list[str]:
    notes = [
        f"the errors of {axis} in maps {list_names(m.label for m in others)}, which were not "
        f"measured along the line of {first.label!r}, are brought there"
    ]
    lacking = [m.label for m in others if not any(map(_differs, _tables_of(axis, m)))]
    if lacking:
        notes.append(
            f"for that, maps {list_names(lacking)} lack the rotations of {axis}, which count as "
            "zero between the lines"
        )
    for before, after in zip(others, brought, strict=True):
        lost = [c for c, t in before.tables.items() if _knows_less(after.tables[c], t)]
        if lost:
            notes.append(
                f"the standard errors of {list_names(lost)} in map {before.label!r} end there: "
                f"they need those of the rotations and slopes of {axis}, and no more than "
                f"{MOST_CORRELATED} positions"
            )
    return notes


def _knows_less(after: ComponentTable, before: ComponentTable) -> bool:
    return any(
        covariance_of(before, backward=b) is not None and covariance_of(after, backward=b) is None
        for b in (False, True)
    )


def _brought(chain: Chain, axis: str, error_map: ErrorMap, line: MeasuringLine) -> ErrorMap:
    """Ask the map itself what an instrument would have read on another line."""
    axis_tables = _tables_of(axis, error_map)
    tables = dict(error_map.tables)
    lines = dict(error_map.measuring_lines)
    if any(map(_differs, axis_tables)):
        fields = [
            _field(chain, axis_tables, lines, backward=backward) for backward in (False, True)
        ]
        units = _unit_field(chain, axis_tables, lines)
        for table in axis_tables:
            # Slopes are the same everywhere.
            if table.component.times is None:
                positions = _nodes(
                    table, axis_tables, curved=axis in chain.acts_on(axis) - set(lines)
                )
                tables[table.component.code] = _on_line(
                    table, axis_tables, fields, units, positions, line
                )
    return replace(error_map, tables=tables, measuring_lines={**lines, axis: line})


def _tables_of(axis: str, error_map: ErrorMap) -> list[ComponentTable]:
    return [t for t in error_map.tables.values() if t.component.axis == axis]


def _depends_on_line(axis: str, error_map: ErrorMap) -> bool:
    """Whether it matters where a map's errors of an axis were measured.

    It does for translations, and for rotations that have nonrigid slopes.
    """
    components = [table.component for table in _tables_of(axis, error_map)]
    return any(c.times is not None or not c.is_rotation for c in components)


def _differs(table: ComponentTable) -> bool:
    """Whether a component makes its axis' errors differ from line to line."""
    return table.component.is_rotation or table.component.times is not None


def _field(
    chain: Chain, tables: Sequence[ComponentTable], lines: MeasuringLines, *, backward: bool
) -> ErrorField:
    """One axis' errors in one direction of approach, and no other axis'."""
    chosen = {
        t.component.code: Table(
            t.positions_mm,
            t.backward_errors if backward and t.backward_errors is not None else t.errors,
        )
        for t in tables
    }
    return ErrorField.make(chain, chosen, lines)


def _unit_field(
    chain: Chain, tables: Sequence[ComponentTable], lines: MeasuringLines
) -> ErrorField:
    """A state for each component, in which it alone is there, and 1 in its unit everywhere."""
    alone = np.eye(len(tables))[:, :, None]
    units = {t.component.code: Table((), ones) for t, ones in zip(tables, alone, strict=True)}
    return ErrorField.make(chain, units, lines)


def _on_line(
    table: ComponentTable,
    axis_tables: Sequence[ComponentTable],
    fields: Sequence[ErrorField],
    units: ErrorField,
    positions: FloatArray,
    line: MeasuringLine,
) -> ComponentTable:
    """Read one component on the line, forward and, where it or a rotation has them, backward."""
    ways = [t for t in axis_tables if t is table or _differs(t)]
    both = (False, True) if any(t.backward_errors is not None for t in ways) else (False,)
    read = [_read(table, fields[backward], positions, line) for backward in both]
    covariances = [
        _covariance(table, axis_tables, units, positions, line, backward=b) for b in both
    ]
    backward, of_backward = (read[1], covariances[1]) if len(both) > 1 else (None, None)
    return ComponentTable.make(
        table.component, read[0], positions, backward, covariances[0], of_backward
    )


def _read(
    table: ComponentTable, field: ErrorField, positions_mm: FloatArray, line: MeasuringLine
) -> FloatArray:
    """Read one component of a field on the line, as an instrument would: (n,) or (s, n)."""
    points = np.tile(line.point_mm, (positions_mm.size, 1))
    points[:, LINEAR_LETTERS.index(str(table.component.axis))] = positions_mm
    errors_um, _ = field.at(points, line.tool_offset_mm)
    turned_urad = field.rotation_at(points)
    return np.concatenate([errors_um, turned_urad], axis=-1)[..., table.component.row]


def _covariance(
    table: ComponentTable,
    axis_tables: Sequence[ComponentTable],
    units: ErrorField,
    positions_mm: FloatArray,
    line: MeasuringLine,
    *,
    backward: bool,
) -> FloatArray | None:
    """Sum (c A) C (c A)ᵀ over the axis' tables, which are measured independently: (n, n).

    A interpolates a table to the positions, and its share c is what one unit of it adds to
    the reading: 1 of the component itself, of a rotation the arm from line to line. None
    where a table that enters has no covariance.
    """
    n = positions_mm.size
    if covariance_of(table, backward=backward) is None or n > MOST_CORRELATED:
        return None
    total = np.zeros((n, n))
    for entering, share in zip(axis_tables, _read(table, units, positions_mm, line), strict=True):
        if np.abs(share).max() <= NO_SHARE:
            continue
        covariance = covariance_of(entering, backward=backward)
        if covariance is None:
            return None
        jacobian = share[:, None] * interpolation_matrix(entering, positions_mm)
        total += propagate(jacobian, covariance)
    return total


def _nodes(
    table: ComponentTable, axis_tables: Sequence[ComponentTable], *, curved: bool
) -> FloatArray:
    """The table's positions and, inside its range, those of rotations and slopes.

    Where an axis turns its own offset, and no line stated has taken that out, what is
    read on the line is curved between these: there finer positions follow it.
    """
    united = np.unique(np.concatenate([t.positions_mm for t in axis_tables if _differs(t)]))
    if not table.depends_on_position:
        united = united if united.size > 1 else table.positions_mm
    else:
        low, high = table.positions_mm[[0, -1]]
        inside = united[(united >= low) & (united <= high)]
        united = np.union1d(table.positions_mm, inside)
    if not curved or united.size < 2:
        return united
    places = np.linspace(0.0, united.size - 1.0, (united.size - 1) * PARTS_OF_A_CURVE + 1)
    return np.interp(places, np.arange(united.size), united)
