"""What a stream of the service tells: server-sent events, read line by line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

import httpx

from thermap.answers import CurrentCompensationAnswer, MachineStatus
from thermap.call import parsed
from thermap.errors import UnexpectedAnswerError

HEARTBEAT_S: Final = 5.0
"""How often the service says that the stream lives where nothing else happens [s]."""

SILENT_S: Final = 4 * HEARTBEAT_S
"""A stream that is silent for so long is taken for lost [s]: no close is seen of a pulled cable."""

FIRST_PAUSE_S: Final = 0.5
LONGEST_PAUSE_S: Final = 30.0
"""Before the stream is asked for again [s]; twice as long each time."""


@dataclass(frozen=True, slots=True)
class Told:
    """One thing that a stream tells.

    Parameters
    ----------
    kind
        `table`: values have changed. `state`: none has, but completeness, a sensor's health or the
        model version. `status`: the verdict or its words. `lost`: the service is not heard any
        more, and what was told before may be old; it is asked again by itself.
    machine
        Id of the machine; empty for `lost`, which is about all that is followed.
    table
        With `table` and `state`, None where there is no table.
    status
        With `status`.
    detail
        Why there is no table, or what was lost; else empty.
    stepping
        Whether more tables follow, up to what the machine needs now (`max_step_um`).
    """

    kind: Literal["table", "state", "status", "lost"]
    machine: str
    table: CurrentCompensationAnswer | None = None
    status: MachineStatus | None = None
    detail: str = ""
    stepping: bool = False


class EventReader:
    """Puts lines together into what they tell, over all connections of one follower."""

    def __init__(self) -> None:
        self._name, self._id = "", ""
        self._data: list[str] = []
        self._last_id = ""
        self._pause_s = FIRST_PAUSE_S
        self._is_lost = False
        self.has_begun = False

    @property
    def headers(self) -> Mapping[str, str]:
        """Say where the stream is to go on."""
        return {"Last-Event-ID": self._last_id} if self._last_id else {}

    def begin(self) -> None:
        """Take note that the service answers: half an event of the connection before is none."""
        self.has_begun = True
        self._name, self._id, self._data = "", "", []

    def take(self, line: str) -> Told | None:
        """Take a line, without its end; give what it completes.

        Raises
        ------
        UnexpectedAnswerError
            If an event is not what this version reads.
        """
        if line:
            name, _, value = line.partition(":")
            value = value.removeprefix(" ")
            if name == "event":
                self._name = value
            elif name == "id":
                self._id = value
            elif name == "data":
                self._data.append(value)
            return None
        name, own_id, data = self._name, self._id, "\n".join(self._data)
        self._name, self._id, self._data = "", "", []
        self._pause_s, self._is_lost = FIRST_PAUSE_S, False
        if own_id:
            self._last_id = own_id
        try:
            return _told(name, data) if data else None
        except (ValueError, KeyError, AttributeError) as error:
            raise UnexpectedAnswerError(f"event {name!r}: {error}") from error

    def lost(self, why: str) -> Told | None:
        """Give what is to be told of a break: once, however often it is tried in vain."""
        was_lost, self._is_lost = self._is_lost, True
        return None if was_lost else Told("lost", "", detail=why)

    def pause_s(self) -> float:
        """Say how long to wait before the next try [s]."""
        pause_s, self._pause_s = self._pause_s, min(2.0 * self._pause_s, LONGEST_PAUSE_S)
        return pause_s


def query_of(min_change_um: float, max_step_um: float | None) -> dict[str, float]:
    """Write what a follower wants."""
    query = {"min_change_um": min_change_um, "heartbeat_s": HEARTBEAT_S}
    return query if max_step_um is None else query | {"max_step_um": max_step_um}


def timeout_of(timeout_s: float) -> httpx.Timeout:
    """Give how long each part of following may take; `timeout_s` is the client's limit."""
    return httpx.Timeout(timeout_s, read=SILENT_S)


def _told(name: str, data: str) -> Told | None:
    """Read an event; what a newer service tells beside is passed over."""
    if name == "status":
        status = parsed(MachineStatus, data)
        return Told("status", status.machine, status=status)
    if name not in ("table", "state"):
        return None
    kind: Literal["table", "state"] = "table" if name == "table" else "state"
    told: dict[str, Any] = json.loads(data)
    if not told.get("components"):
        return Told(kind, told["machine"], detail=told.get("detail", ""))
    table = parsed(CurrentCompensationAnswer, data)
    return Told(kind, table.machine, table, stepping=told.get("stepping", False))
