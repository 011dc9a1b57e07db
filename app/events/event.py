"""The shape of an event: one line of a machine's log."""

from __future__ import annotations

from collections.abc import Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Any, Final

from app.answer import Answer

SERVICE: Final = "service"
"""Who does what nobody asked for."""

LONGEST_NAME: Final = 128
"""Letters of who does something, as they are stored."""

acting: ContextVar[object] = ContextVar("acting", default=SERVICE)
"""Who asks, as its text: the name of a key, or an address and the program that it comes from."""


class EventKind(StrEnum):
    """What an event is about."""

    MACHINE = "machine"
    MODEL = "model"
    READINGS = "readings"
    VERIFICATION = "verification"
    WATCH = "watch"
    ANALYSIS = "analysis"
    ALARM = "alarm"
    SENSOR = "sensor"
    KEY = "key"


PASSING: Final = frozenset({EventKind.ALARM, EventKind.SENSOR})
"""Kinds that come and go: what comes again soon is counted in its row."""


@dataclass(frozen=True, slots=True)
class Event(Answer):
    """One event."""

    id: int
    """Number of the event"""
    time: datetime
    """When it happened; of an alarm, when it came first"""
    kind: EventKind
    """`machine`, `model`, `readings`, `verification`, `watch`, `analysis` and `key` are changes;
    `alarm` is a verdict other than trusted, `sensor` a sensor that has failed"""
    who: str
    """Who asked for it: the name of a key, or an address and its program; `service` where nobody
    did"""
    machine: str | None
    """Id of the machine, null where it is about none"""
    text: str
    """What happened, in words"""
    details: Mapping[str, Any]
    """The same in fields: `version`, `from` and `to`, `state`, `sensor` with `health`, …"""
    until: datetime | None
    """When an alarm or a sensor's failure went, null while it lasts, and for changes"""
    count: int
    """How often it came within ten minutes of going; 1 for changes"""
    text_now: str | None = None
    """What an alarm or a sensor's failure says now, where it began in other words: figures change
    while it lasts. Null once it went, for changes, and in streams"""


@dataclass(frozen=True, slots=True)
class Events(Answer):
    """Events, the newest first."""

    events: tuple[Event, ...]
    """The events"""
    next: str | None
    """What to state as `before` for those before them, null where there are none"""
