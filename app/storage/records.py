"""What the storage hands out: the field's own objects with the numbers it gave them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Final

from app.search.rows import Datum
from app.thermal.error_map import ErrorMap
from app.thermal.machine import Machine

if TYPE_CHECKING:
    from app.identification.watch.watching import Judgement

LARGEST_INTEGER: Final = 2**31 - 1
"""The largest number of a column of type Integer; databases refuse to be asked for more."""


@dataclass(frozen=True, slots=True)
class StoredMachine:
    """A machine, which model version is active, how often it has changed, and its watch.

    `waiting_version` is stored and not activated, because its tables would lose something;
    `watch` says `within` or `beyond`, None where no verification was judged.
    """

    machine: Machine
    created_at: datetime
    active_version: int | None
    revision: int
    watch: str | None = None
    waiting_version: int | None = None


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
    effects: Sequence[Mapping[str, Any]]
    maps: Sequence[StoredMap]


@dataclass(frozen=True, slots=True)
class StoredVerification:
    """What is known of a verification without its observations.

    `judgement` is what the watch said of it when it came, None where nothing could be said.
    """

    id: int
    label: str
    datum: Datum
    repeatability_um: float | None
    stored_at: datetime
    first_at: datetime
    last_at: datetime
    observations: int
    components: Sequence[str]
    judgement: Judgement | None
    instrument: str | None = None
    operator: str | None = None


class AnalysisStatus(StrEnum):
    """How far an analysis is."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class AnalysisTask:
    """What an analysis was asked for.

    Parameters
    ----------
    holdout_fraction
        Share of the visits that take no part in the search.
    kinds
        Kinds of effects that are tested; None: all.
    """

    model_version: int
    verification_ids: Sequence[int]
    holdout_fraction: float
    kinds: Sequence[str] | None
    seed: int


@dataclass(frozen=True, slots=True)
class StoredAnalysis:
    """An analysis as a job; its result is read apart, for it is long."""

    id: int
    machine_id: str
    task: AnalysisTask
    status: AnalysisStatus
    progress: float
    message: str
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    adopted_version: int | None
