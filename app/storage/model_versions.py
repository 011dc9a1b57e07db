"""Model versions in the database: written once, never changed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.errors import UnknownThing, existing_names
from app.storage.error_maps import stored_map
from app.storage.records import LARGEST_INTEGER, ModelVersion, StoredMap
from app.storage.tables import MachineRow, ModelVersionMapRow, ModelVersionRow


def insert_version(
    session: Session,
    machine: MachineRow,
    map_ids: Iterable[int],
    assignment: Mapping[str, str],
    effects: Iterable[Mapping[str, Any]],
    reason: str,
    now: datetime,
) -> ModelVersion:
    """Add the next version of a locked machine; tables go on with the active one."""
    version = (newest_number(session, machine.id) or 0) + 1
    session.add(
        ModelVersionRow(
            machine_id=machine.id,
            version=version,
            created_at=now,
            reason=reason,
            assignment=dict(assignment),
            effects=[dict(effect) for effect in effects],
        )
    )
    session.flush()
    session.add_all(
        ModelVersionMapRow(machine_id=machine.id, version=version, error_map_id=map_id)
        for map_id in map_ids
    )
    session.flush()
    return find_version(session, machine.id, version)


def newest_number(session: Session, machine_id: str) -> int | None:
    """Give the number of the newest version, None before the first."""
    return session.scalar(
        select(func.max(ModelVersionRow.version)).where(ModelVersionRow.machine_id == machine_id)
    )


def activate_version(machine: MachineRow, version: int) -> None:
    """Make a version the active one; live tables follow, and none waits any more."""
    machine.active_version = version
    machine.waiting_version = None
    machine.revision += 1


def set_waiting(machine: MachineRow, version: int | None) -> None:
    """Let a version wait for its activation, or none; live tables stay as they are."""
    machine.waiting_version = version


def find_version(session: Session, machine_id: str, version: int) -> ModelVersion:
    """Find a version with its maps."""
    can_be = 0 < version <= LARGEST_INTEGER
    row = session.get(ModelVersionRow, (machine_id, version)) if can_be else None
    if row is None:
        existing = session.scalars(
            select(ModelVersionRow.version)
            .where(ModelVersionRow.machine_id == machine_id)
            .order_by(ModelVersionRow.version)
        )
        raise UnknownThing(
            f"machine {machine_id!r} has no model version {version}; "
            f"{existing_names(str(v) for v in existing)}"
        )
    return _model_version(row, {})


def active_version(session: Session, machine: MachineRow) -> ModelVersion | None:
    """Read the active version, None before the first map."""
    if machine.active_version is None:
        return None
    return find_version(session, machine.id, machine.active_version)


def waiting_version(session: Session, machine: MachineRow) -> ModelVersion | None:
    """Read the version that waits for its activation, None where none does."""
    if machine.waiting_version is None:
        return None
    return find_version(session, machine.id, machine.waiting_version)


def waiting_versions(session: Session) -> dict[str, int]:
    """Give the number of the version that waits of each machine where one does."""
    query = select(MachineRow.id, MachineRow.waiting_version)
    return {m: version for m, version in session.execute(query) if version is not None}


def list_versions(session: Session, machine_id: str) -> list[ModelVersion]:
    """List all versions, oldest first."""
    query = (
        select(ModelVersionRow)
        .where(ModelVersionRow.machine_id == machine_id)
        .order_by(ModelVersionRow.version)
    )
    maps: dict[int, StoredMap] = {}
    return [_model_version(row, maps) for row in session.scalars(query)]


def _model_version(row: ModelVersionRow, maps: dict[int, StoredMap]) -> ModelVersion:
    """Read a row; `maps` keeps the maps that versions share from being made again."""
    for map_row in row.maps:
        if map_row.id not in maps:
            maps[map_row.id] = stored_map(map_row)
    return ModelVersion(
        version=row.version,
        created_at=row.created_at,
        reason=row.reason,
        assignment=row.assignment,
        effects=row.effects,
        maps=[maps[map_row.id] for map_row in row.maps],
    )
