"""What a stream of the service tells: server-sent events, read line by line."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias, get_args

import httpx

from thermap.answers import (
    AnalysisNews,
    CurrentCompensationAnswer,
    Event,
    MachineStatus,
    MissedEntries,
    WatchChange,
)
from thermap.call import parsed
from thermap.errors import UnexpectedAnswerError

Followed: TypeAlias = Literal["table", "status", "event", "watch", "analysis"]
"""What can be followed: tables (`state` comes with them), verdicts, and what is new in the log."""

TABLES: Final[tuple[Followed, ...]] = ("table", "status")
"""What is told to who does not say what to follow."""

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
        model version. `status`: the verdict or its words. `event`: an alarm has come or gone, or
        something was changed. `watch`: the watch says something else than before. `analysis`: how
        far one is. `missed`: so many entries of the log came meanwhile that some are not told.
        `lost`: the service is not heard any more, and what was told before may be old; it is asked
        again by itself.
    machine
        Id of the machine; empty for what is about none or about all that is followed.
    table
        With `table` and `state`, None where there is no table.
    status
        With `status`.
    event
        With `event`.
    watch
        With `watch`.
    analysis
        With `analysis`.
    missed
        With `missed`: how many, None where that is not known.
    detail
        Why there is no table, what was lost or missed; else empty.
    stepping
        Whether more tables follow, up to what the machine needs now (`max_step_um`).
    """

    kind: Literal["table", "state", "status", "event", "watch", "analysis", "missed", "lost"]
    machine: str
    table: CurrentCompensationAnswer | None = None
    status: MachineStatus | None = None
    event: Event | None = None
    watch: WatchChange | None = None
    analysis: AnalysisNews | None = None
    missed: int | None = None
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
            return _event(name, data) if data else None
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


def query_of(
    min_change_um: float, max_step_um: float | None, kinds: Collection[Followed]
) -> dict[str, float | list[str]]:
    """Write what a follower wants; what all are told an older service is not asked for by name.

    Raises
    ------
    ValueError
        If it wants nothing.
    """
    if not kinds:
        raise ValueError(f"kinds: expected one at least of {', '.join(get_args(Followed))}")
    query: dict[str, float | list[str]] = {
        "min_change_um": min_change_um,
        "heartbeat_s": HEARTBEAT_S,
    }
    if max_step_um is not None:
        query["max_step_um"] = max_step_um
    return query if set(kinds) == {*TABLES} else query | {"kind": [*kinds]}


def timeout_of(timeout_s: float) -> httpx.Timeout:
    """Give how long each part of following may take; `timeout_s` is the client's limit."""
    return httpx.Timeout(timeout_s, read=SILENT_S)


def _event(name: str, data: str) -> Told | None:
    """Read an event; what a newer service tells beside is passed over."""
    if name == "status":
        status = parsed(MachineStatus, data)
        return Told("status", status.machine, status=status)
    if name == "event":
        event = parsed(Event, data)
        return Told("event", event.machine or "", event=event)
    if name == "watch":
        watch = parsed(WatchChange, data)
        return Told("watch", watch.machine, watch=watch)
    if name == "analysis":
        analysis = parsed(AnalysisNews, data)
        return Told("analysis", analysis.machine, analysis=analysis)
    if name == "missed":
        missed = parsed(MissedEntries, data)
        return Told("missed", "", missed=missed.count, detail=missed.detail)
    if name not in ("table", "state"):
        return None
    kind: Literal["table", "state"] = "table" if name == "table" else "state"
    fields: dict[str, Any] = json.loads(data)
    if not fields.get("components"):
        return Told(kind, fields["machine"], detail=fields.get("detail", ""))
    table = parsed(CurrentCompensationAnswer, data)
    return Told(kind, table.machine, table, stepping=fields.get("stepping", False))
