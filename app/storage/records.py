"""What the storage hands out: the field's own objects with the numbers it gave them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from app.thermal.error_map import ErrorMap
from app.thermal.machine import Machine


@dataclass(frozen=True, slots=True)
class StoredMachine:
    """A machine, which model version is active, and how often it has changed."""

    machine: Machine
    created_at: datetime
    active_version: int | None
    revision: int


@dataclass(frozen=True, slots=True, eq=False)
class StoredMap:
    """An error map with its number."""

    id: int
    error_map: ErrorMap
    stored_at: datetime


@dataclass(frozen=True, slots=True, eq=False)
class ModelVersion:
    """One immutable version of a machine's model: maps, assignment, adopted effects."""

    version: int
    created_at: datetime
    reason: str
    assignment: Mapping[str, str]
    effects: Sequence[object]
    maps: Sequence[StoredMap]
