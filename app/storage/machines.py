"""Machines in the database."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import asdict
from datetime import datetime
from enum import Enum
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.errors import UnknownThing, list_names
from app.geometry.chain import Chain
from app.storage.news import NewsKind, tell
from app.storage.records import StoredMachine
from app.storage.tables import EventRow, MachineRow
from app.thermal.machine import Machine, OutOfRange, SameTemperature, Sensor, Travel


class RowLock(Enum):
    """How a transaction holds a machine's row, on PostgreSQL.

    Whoever writes holds the machine first, and everything else after: thus no two wait for
    each other. What is inserted for a machine holds it anyway (its foreign key), but only then,
    and behind those who wait to change it.
    """

    KEPT = "key share"
    """It cannot be deleted meanwhile; any number may hold it so, and one may change it."""
    CHANGED = "no key update"
    """Nobody else changes it meanwhile."""
    DELETED = "update"
    """Nobody else holds it in any way."""

    @property
    def clause(self) -> dict[str, bool]:
        """SQLAlchemy's words for it."""
        return {"read": self is RowLock.KEPT, "key_share": self is not RowLock.DELETED}


def insert_machine(session: Session, machine: Machine, now: datetime) -> StoredMachine:
    """Add a machine; one of the same id is an IntegrityError."""
    row = MachineRow(
        id=machine.id,
        created_at=now,
        revision=1,
        active_version=None,
        entries_after=session.scalar(select(func.max(EventRow.number))) or 0,
    )
    _write(row, machine)
    session.add(row)
    session.flush()
    tell(session, NewsKind.MACHINE, row.id)
    return stored_machine(row)


def find_machine(session: Session, machine_id: str, row_lock: RowLock | None = None) -> MachineRow:
    """Find a machine's row, and hold it until the transaction ends."""
    can_be = "\0" not in machine_id  # PostgreSQL cannot even be asked for it
    lock: Any = None if row_lock is None else row_lock.clause
    row = session.get(MachineRow, machine_id, with_for_update=lock) if can_be else None
    if row is None:
        existing = session.scalars(select(MachineRow.id).order_by(MachineRow.id).limit(20)).all()
        raise UnknownThing(f"there is no machine {machine_id!r}; there are: {list_names(existing)}")
    return row


def hold_machines(session: Session, machine_ids: Collection[str]) -> dict[str, MachineRow]:
    """Keep machines from being deleted until the transaction ends; wait for none of them.

    Those are left out that are not there, or that somebody is deleting.
    """
    can_be = [machine_id for machine_id in machine_ids if "\0" not in machine_id]
    query = (
        select(MachineRow)
        .where(MachineRow.id.in_(can_be))
        .order_by(MachineRow.id)
        .with_for_update(read=True, key_share=True, skip_locked=True)
    )
    return {row.id: row for row in session.scalars(query)}


def list_machines(session: Session) -> list[StoredMachine]:
    """List all machines by id."""
    return [stored_machine(r) for r in session.scalars(select(MachineRow).order_by(MachineRow.id))]


def update_machine(row: MachineRow, machine: Machine) -> None:
    """Write a machine's settings; live tables follow."""
    _write(row, machine)
    row.revision += 1


def machine_ids(session: Session) -> list[str]:
    """List the ids of all machines."""
    return list(session.scalars(select(MachineRow.id).order_by(MachineRow.id)))


def count_machines(session: Session) -> int:
    """Count all machines."""
    return session.scalar(select(func.count(MachineRow.id))) or 0


def sum_of_machines(session: Session) -> tuple[int, int, datetime | None]:
    """Sum machines up into what changes whenever any of them does, goes or comes.

    Number, sum of the revisions and withdrawals, latest birth: the last because a machine
    that is deleted and made again counts for as much as before.
    """
    count, total, latest = session.execute(
        select(
            func.count(MachineRow.id),
            func.coalesce(func.sum(MachineRow.revision + MachineRow.withdrawals), 0),
            func.max(MachineRow.created_at),
        )
    ).one()
    return int(count), int(total), latest


def revisions(
    session: Session, of: Collection[str] | None = None
) -> dict[str, tuple[datetime, int, int]]:
    """Give machines' birth, revision and withdrawals: they identify their present shape.

    Parameters
    ----------
    of
        Ids, of machines that may be gone; None for all machines.
    """
    query = select(
        MachineRow.id, MachineRow.created_at, MachineRow.revision, MachineRow.withdrawals
    )
    rows = session.execute(query if of is None else query.where(MachineRow.id.in_(of)))
    return {machine_id: (born, revised, withdrawn) for machine_id, born, revised, withdrawn in rows}


def stored_machine(row: MachineRow) -> StoredMachine:
    """Read a row."""
    machine = Machine(
        id=row.id,
        name=row.name,
        chain=Chain.parse(row.configuration),
        axes={axis: Travel(**travel) for axis, travel in row.axes.items()},
        sensors={sensor["name"]: Sensor(**sensor) for sensor in row.sensors},
        out_of_range=OutOfRange(row.out_of_range),
        extrapolation_margin_c=row.extrapolation_margin_c,
        extrapolation_error_ratio=row.extrapolation_error_ratio,
        same_temperature=SameTemperature(row.same_temperature),
        serial_number=row.serial_number,
    )
    return StoredMachine(
        machine,
        row.created_at,
        row.active_version,
        row.revision,
        waiting_version=row.waiting_version,
    )


def _write(row: MachineRow, machine: Machine) -> None:
    row.name = machine.name
    row.configuration = machine.chain.text
    row.axes = {axis: asdict(travel) for axis, travel in machine.axes.items()}
    row.sensors = [asdict(sensor) for sensor in machine.sensors.values()]
    row.out_of_range = machine.out_of_range.value
    row.extrapolation_margin_c = machine.extrapolation_margin_c
    row.extrapolation_error_ratio = machine.extrapolation_error_ratio
    row.same_temperature = machine.same_temperature.value
    row.serial_number = machine.serial_number
