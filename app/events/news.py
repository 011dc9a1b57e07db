"""What streams tell of watches and analyses, and of what they can tell no more."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from app.answer import Answer


@dataclass(frozen=True, slots=True)
class WatchChange(Answer):
    """The watch of a machine says something else than before."""

    machine: str
    """Id of the machine"""
    time: datetime
    """When it was judged, or another version became active"""
    watch: Literal["within", "beyond", "not-judged"]
    """What it says of the active version now; `beyond`: the machine drifts from its model"""
    before: Literal["within", "beyond", "not-judged"]
    """What it said before"""
    model_version: int | None
    """The active version, null where there is none"""
    drifting_since: datetime | None
    """Since when it drifts, null where it does not"""
    who: str
    """Who stored or deleted a verification, or activated a version"""


@dataclass(frozen=True, slots=True)
class AnalysisNews(Answer):
    """How far an analysis is."""

    machine: str
    """Id of the machine"""
    analysis: int
    """Number of the analysis"""
    status: Literal["queued", "running", "done", "failed", "cancelled", "deleted"]
    """How far it is; `queued` comes again where the process that ran it is gone"""
    progress: float
    """Share that is done, 0 to 1"""
    message: str
    """What is being done, or why it failed"""
    time: datetime
    """When it was so"""
    who: str
    """Who asked for it, cancelled or deleted it; `service` for the rest"""


@dataclass(frozen=True, slots=True)
class MissedEntries(Answer):
    """Entries of the log that a stream can tell no more: there were too many."""

    count: int | None
    """How many that it would have told, null where that is not known"""
    detail: str
    """The same in words, and where to find them"""
