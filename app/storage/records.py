"""What the storage hands out: the field's own objects with the numbers it gave them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Annotated, Any, Final

from pydantic import Field

from app.answer import Answer
from app.identification.watch.watching import Judgement
from app.search.rows import Datum
from app.thermal.error_map import ErrorMap
from app.thermal.machine import Machine

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


@dataclass(frozen=True, slots=True, kw_only=True)
class VerificationExtent(Answer):
    """What a verification says beside its observations, and how far these go."""

    label: Annotated[str, Field(examples=["night shift"])]
    """The verification's name on its machine"""
    datum: Datum
    """`absolute`; `first`: the instrument was zeroed at the first observation of each component;
    `free`: an unknown constant per component"""
    repeatability_um: Annotated[float | None, Field(examples=[0.5])]
    """Standard deviation of one length [µm], where it is known; of angles and squareness it says
    nothing"""
    instrument: Annotated[str | None, Field(examples=["XL-80, no. 4711"])] = None
    """What measured, for the certificate"""
    operator: Annotated[str | None, Field(examples=["M. Weber"])] = None
    """Who measured, for the certificate"""
    first_at: datetime
    """Time of its first observation, UTC"""
    last_at: datetime
    """Time of its last observation, UTC"""
    count: Annotated[int, Field(examples=[240])]
    """How many observations it has"""
    components: Annotated[Sequence[str], Field(examples=[["EXX", "points"]])]
    """What was observed: component codes, and `points`"""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredVerification(VerificationExtent, published_as="VerificationAnswer"):
    """A stored verification without its observations."""

    id: Annotated[int, Field(examples=[1])]
    """The verification's number"""
    stored_at: datetime
    """When it was stored, UTC"""
    judgement: Judgement | None
    """What it said of the active model when it came, or once its readings had"""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredAnalysis(Answer, published_as="AnalysisHead"):
    """An analysis as a job, without its result."""

    id: Annotated[int, Field(examples=[1])]
    """The analysis' number"""
    status: AnalysisStatus
    """`queued`, `running`, `done`, `failed` or `cancelled`"""
    progress: float
    """Share of the work that is done, from 0 to 1"""
    message: str
    """What is being done, or why it failed"""
    model_version: int
    """Version that is compared with the verifications"""
    verifications: Sequence[int]
    """Numbers of the verifications"""
    holdout_fraction: float
    """Share of the visits held out"""
    effects: Sequence[str] | None
    """Kinds that are looked for; null for all"""
    seed: int
    """Seed of all random draws"""
    created_at: datetime
    """When it was asked for, UTC"""
    started_at: datetime | None
    """When it began, UTC"""
    finished_at: datetime | None
    """When it ended, UTC"""
    adopted_version: int | None
    """Model version that was made from it; null as long as there is none"""
    machine_id: Annotated[str, Field(exclude=True)] = ""

    @property
    def task(self) -> AnalysisTask:
        """What was asked for."""
        return AnalysisTask(
            self.model_version, self.verifications, self.holdout_fraction, self.effects, self.seed
        )
