"""What follows a sender that tells changes only: the nodes of a server, the data items of an agent.

A protocol finds what it follows and hands on what it reads. What they have in common stands here:
units, what is the matter, and how the connection fares. Contact is made anew by `keep_running`.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, ClassVar, Final

from app.connections.connection import (
    PLAIN,
    Connection,
    ConnectionTable,
    ShortName,
    TemperatureTable,
)
from app.connections.intake import TakesValues
from app.connections.known_values import KnownValues
from app.connections.sparing_log import SparingLog
from app.errors import counted
from app.services.context import Context
from app.units import TemperatureUnit

log = logging.getLogger("thermap")

SHOWN: Final = 5
"""Sensors whose trouble is put in words; of the others only how many they are."""


@dataclass(frozen=True, slots=True)
class Followed:
    """What a sensor or a state is read from.

    Parameters
    ----------
    source
        `ns=2;s=NAME` or `nsu=URI;s=NAME` of a node; a data item's id, or its name where only one
        item has it.
    temperature
        How a temperature is written; None: a state, which is taken as it is.
    """

    source: str
    temperature: TemperatureTable | None = PLAIN


@dataclass(frozen=True, slots=True)
class NewValue:
    """What a sender says of one that is followed.

    Parameters
    ----------
    value
        [°C] or the state's unit; None if there is none any more.
    time
        When its source measured it; None: it holds now.
    """

    name: str
    value: float | None
    time: datetime | None = None


@dataclass(slots=True)
class Trouble:
    """What is the matter: with the sender, then with each that is read from it.

    Parameters
    ----------
    whose
        Names the sender in the log.
    """

    whose: str
    of: dict[str, str] = field(default_factory=dict)
    contradicted: dict[str, str] = field(default_factory=dict)
    """What lasts until contact is made anew"""
    _of_sender: str = ""
    _log: SparingLog = field(default_factory=SparingLog)

    def __str__(self) -> str:
        """Say it in words; empty where nothing is the matter."""
        matters = [*self.of.items(), *self.contradicted.items()]
        words = [f"{name}: {words}" if name else words for name, words in matters]
        more = len(words) - SHOWN
        shown = words[:SHOWN] + ([f"and {counted(more, 'other')}"] if more > 0 else [])
        return "; ".join(([self._of_sender] if self._of_sender else []) + shown)

    def forget(self) -> None:
        """Begin anew with what is read from the sender."""
        self.of.clear()
        self.contradicted.clear()

    def say(self, words: str) -> None:
        """Say what is the matter with the sender; nothing, if empty."""
        if words and words != self._of_sender:
            log.warning("%s: %s", self.whose, words)
        self._of_sender = words

    def say_of(self, name: str, words: str) -> None:
        """Say what is the matter with one that is read from it."""
        if self.of.get(name) != words:
            self._log.warn(name, ": ".join(filter(None, [self.whose, name, words])))
        self.of[name] = words


class Follower(ABC):
    """Follows one sender, and hands on what it finds.

    Parameters
    ----------
    whose
        Names the sender in the log.
    followed
        Name of the sensor or state to what it is read from.
    take
        Takes what was found. An empty list says that contact was lost: what was known is not
        known any more.
    """

    sender: ClassVar[str]
    """What it is called in sentences"""

    def __init__(
        self,
        whose: str,
        followed: Mapping[str, Followed],
        take: Callable[[Sequence[NewValue]], None],
    ) -> None:
        self.is_connected = False
        self._followed = followed
        self._take = take
        self._trouble = Trouble(whose)
        self._units: dict[str, TemperatureUnit] = {}

    @property
    def trouble(self) -> str:
        """What is the matter; empty where nothing."""
        return str(self._trouble)

    @property
    def gone(self) -> int:
        """How many observations were gone before they could be read, as far as one is told."""
        return 0

    async def run(self) -> None:
        """Follow until contact is lost, which is raised."""
        try:
            await self._follow()
        finally:
            if self.is_connected:
                self.is_connected = False
                self._take([])

    def lost(self, words: str) -> None:
        """Take note of why there is no contact."""
        self._trouble.say(words)

    @abstractmethod
    async def _follow(self) -> None:
        """Make contact, say so in `is_connected`, and hand on what is found until it is lost."""

    def _choose_unit(self, name: str, stated: str | None) -> bool:
        """Take the unit as the file has it, or as the sender states it; False if it is none."""
        temperature = self._followed[name].temperature
        configured = None if temperature is None else temperature.unit
        if configured is None and stated is not None and stated not in list(TemperatureUnit):
            self._trouble.say_of(
                name,
                f"expected a unit of temperature, got {stated!r} from the {self.sender}: state "
                "`unit`",
            )
            return False
        if configured is not None and stated not in (None, configured):
            self._trouble.contradicted[name] = (
                f"expected {configured} as configured, got {stated} from the {self.sender}; taken "
                "as configured"
            )
        self._units[name] = configured or TemperatureUnit(stated or TemperatureUnit.CELSIUS)
        return True

    def _converted(self, name: str, raw: float) -> float:
        """Give the value of what was read: [°C] or the state's unit."""
        self._trouble.of.pop(name, None)
        temperature = self._followed[name].temperature
        return raw if temperature is None else temperature.to_c(raw, self._units[name])


class FollowedTable(ConnectionTable):
    """A sender that is followed for one machine: what its sensors and states are read from."""

    machine: ShortName
    sensors: dict[str, Any]
    state: dict[str, Any]

    @property
    def followed(self) -> dict[str, Followed]:
        """The source of each; states are taken as they are."""
        sources = {name: Followed(table.source, table) for name, table in self.sensors.items()}
        return sources | {name: Followed(table.source, None) for name, table in self.state.items()}


class FollowingConnection:
    """One sender, whose values become readings of one machine; `_follower` once it runs."""

    kind: ClassVar[str]
    _follower: Follower | None = None

    def __init__(
        self,
        table: FollowedTable,
        endpoint: str,
        intake: TakesValues,
        context: Callable[[], Context],
    ) -> None:
        self._name = table.name
        self._machine = table.machine
        self._endpoint = endpoint
        self._known = KnownValues(intake, table.machine, table.sensors, table.state)
        self._context = context
        self._last_value_at: datetime | None = None

    def lost(self, words: str) -> None:
        """Take note of why there is no contact."""
        if self._follower is not None:
            self._follower.lost(words)

    def now(self) -> Connection:
        """Say how it fares."""
        follower = self._follower
        return Connection(
            name=self._name,
            kind=self.kind,
            machines=(self._machine,),
            endpoint=self._endpoint,
            connected=follower is not None and follower.is_connected,
            last_value_at=self._last_value_at,
            known=len(self._known),
            trouble="" if follower is None else follower.trouble,
            lost=0 if follower is None else follower.gone,
        )

    def _take(self, found: Sequence[NewValue]) -> None:
        """Remember what holds from now on; without contact nothing is known any more."""
        if not found:
            self._known.forget()
            return
        if any(one.value is not None for one in found):
            self._last_value_at = self._context().now()
        # What has one time is one reading. Without a time it holds now: after all that were
        # measured.
        for time in sorted({one.time for one in found}, key=lambda time: (time is None, time)):
            self._known.take({one.name: one.value for one in found if one.time == time}, time)
