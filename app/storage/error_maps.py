"""Error maps in the database."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.arrays import FloatArray
from app.errors import UnknownThing, existing_names
from app.geometry.components import COMPONENTS
from app.geometry.measuring_line import MeasuringLine
from app.storage.records import StoredMap
from app.storage.tables import ComponentRow, ErrorMapRow
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.uncertainty import standard_errors_of, without_zeros


def insert_error_map(
    session: Session, machine_id: str, error_map: ErrorMap, now: datetime
) -> StoredMap:
    """Add a map and give it its number."""
    row = ErrorMapRow(
        machine_id=machine_id,
        label=error_map.label,
        measured_at=error_map.measured_at,
        temperatures_c=dict(error_map.temperatures_c),
        measuring_lines_mm={a: _written(line) for a, line in error_map.measuring_lines.items()},
        repeatability_um=error_map.repeatability_um,
        instrument=error_map.instrument,
        stored_at=now,
        components=[
            ComponentRow(
                component=code,
                place=place,
                positions_mm=table.positions_mm,
                errors=table.errors,
                backward_errors=table.backward_errors,
                covariance=_flat(table.covariance),
                backward_covariance=_flat(table.backward_covariance),
            )
            for place, (code, table) in enumerate(error_map.tables.items())
        ],
    )
    session.add(row)
    session.flush()
    return StoredMap(row.id, error_map, now)


def find_error_map(session: Session, machine_id: str, map_id: int) -> ErrorMapRow:
    """Find a map in use by its number."""
    rows = {row.id: row for row in _in_use(session, machine_id)}
    if map_id not in rows:
        existing = existing_names(f"{row.id} ({row.label})" for row in rows.values())
        raise UnknownThing(f"machine {machine_id!r} has no error map {map_id}; {existing}")
    return rows[map_id]


def find_error_map_by_label(session: Session, machine_id: str, label: str) -> StoredMap | None:
    """Find a map in use by its label."""
    row = next((row for row in _in_use(session, machine_id) if row.label == label), None)
    return None if row is None else stored_map(row)


def list_error_maps(session: Session, machine_id: str) -> list[StoredMap]:
    """List a machine's maps in the order in which they were stored."""
    return [stored_map(row) for row in _in_use(session, machine_id)]


def withdraw_error_map(row: ErrorMapRow, now: datetime) -> None:
    """Take a map out of use; model versions made of it keep it."""
    row.withdrawn_at = now


def stored_map(row: ErrorMapRow) -> StoredMap:
    """Read a row."""
    error_map = ErrorMap(
        label=row.label,
        measured_at=row.measured_at,
        temperatures_c=row.temperatures_c,
        tables={c.component: _table(c) for c in row.components},
        measuring_lines={axis: _read(axis, w) for axis, w in row.measuring_lines_mm.items()},
        repeatability_um=row.repeatability_um,
        instrument=row.instrument,
    )
    return StoredMap(row.id, error_map, row.stored_at)


def same_content(first: ErrorMap, other: ErrorMap) -> bool:
    """Whether two maps say the same, bit for bit; the order of components does not count."""
    return _facts(first) == _facts(other) and _bits(first.tables.values()) == _bits(
        other.tables.values()
    )


def _in_use(session: Session, machine_id: str) -> list[ErrorMapRow]:
    query = (
        select(ErrorMapRow)
        .where(ErrorMapRow.machine_id == machine_id, ErrorMapRow.withdrawn_at.is_(None))
        .order_by(ErrorMapRow.id)
    )
    return list(session.scalars(query))


def _table(row: ComponentRow) -> ComponentTable:
    return ComponentTable(
        COMPONENTS[row.component],
        row.positions_mm,
        row.errors,
        row.backward_errors,
        _square(row.covariance, row.errors.size),
        _square(row.backward_covariance, row.errors.size),
    )


def _flat(covariance: FloatArray | None) -> FloatArray | None:
    return None if covariance is None else without_zeros(covariance).ravel()


def _square(flat: FloatArray | None, n: int) -> FloatArray | None:
    return flat if flat is None or flat.size == n else flat.reshape(n, n)


def _written(line: MeasuringLine) -> list[float]:
    """Write a line as its point and, where it is not zero, its tool offset."""
    tool = line.tool_offset_mm if any(line.tool_offset_mm) else ()
    return [*line.point_mm, *tool]


def _read(axis: str, written: list[float]) -> MeasuringLine:
    return MeasuringLine.make(axis, written[:3], written[3:] or (0.0, 0.0, 0.0))


def _facts(error_map: ErrorMap) -> tuple[object, ...]:
    return (
        error_map.label,
        error_map.measured_at,
        dict(error_map.temperatures_c),
        dict(error_map.measuring_lines),
        error_map.repeatability_um,
        error_map.instrument,
    )


def _bits(tables: Iterable[ComponentTable]) -> set[tuple[str | bytes, ...]]:
    return {
        (
            table.component.code,
            table.positions_mm.tobytes(),
            table.errors.tobytes(),
            b"" if table.backward_errors is None else np.asarray(table.backward_errors).tobytes(),
            _bits_of_uncertainty(table.covariance),
            _bits_of_uncertainty(table.backward_covariance),
        )
        for table in tables
    }


def _bits_of_uncertainty(covariance: FloatArray | None) -> bytes:
    """Compare what answers show: the root of a variance, squared, is not always the variance."""
    if covariance is None:
        return b""
    uncertainty = without_zeros(covariance)
    return (standard_errors_of(uncertainty) if uncertainty.ndim == 1 else uncertainty).tobytes()


def measured_times(session: Session, machine_id: str) -> list[datetime]:
    """Give when each of a machine's maps was measured, withdrawn ones too."""
    query = select(ErrorMapRow.measured_at).where(ErrorMapRow.machine_id == machine_id)
    return list(session.scalars(query))
