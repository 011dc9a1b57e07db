"""What happened to machines; alarms as they come and go."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from time import monotonic
from typing import Final, NamedTuple, TypeAlias

from sqlalchemy.orm import Session

from app.errors import StorageUnavailable
from app.events.event import PASSING, Event, EventKind, Events
from app.live.registry import LiveMachine
from app.services.background import Background
from app.services.context import Context
from app.services.status import Stored, status_of, stored_of_machines
from app.status.machine_status import MachineStatus, SensorNow, Verdict
from app.storage.events import (
    begin_passing,
    delete_old_alarms,
    end_passing,
    lasting_details,
    lasting_events,
    list_events,
    write_event,
)
from app.storage.machines import find_machine, list_machines
from app.thermal.sensor_health import Health

log = logging.getLogger("thermap")

LOOK_EVERY_S: Final = 1.0
JUDGED_AGAIN_S: Final = 10.0
"""A machine without a new reading is judged again after so long: readings grow old [s]."""

AT_MOST_S: Final = 0.1
"""Of each look, for the live table needs the rest; of very many machines some wait [s]."""

TIDY_EVERY_S: Final = 3600.0

ALARM_DUTY: Final = 7_483_622
"""PostgreSQL advisory lock: of several services one writes alarms."""


def show_events(
    context: Context,
    machine_id: str | None,
    *,
    since: datetime | None = None,
    until: datetime | None = None,
    kinds: Collection[EventKind] = (),
    before: int | None = None,
    limit: int = 100,
) -> Events:
    """List events, the newest first.

    Parameters
    ----------
    machine_id
        Of this machine; None for all, and what is about none.
    """
    with context.database.reading() as session:
        if machine_id is not None:
            find_machine(session, machine_id)
        found = list_events(
            session,
            machine_id,
            since=since,
            until=until,
            kinds=kinds,
            before=before,
            limit=limit + 1,
        )
    rest = len(found) > limit
    events = _with_words_now(context, found[:limit])
    return Events(tuple(events), str(found[limit - 1].id) if rest else None)


def _with_words_now(context: Context, events: Sequence[Event]) -> list[Event]:
    """Add what alarms that last say now: their figures are no longer those of their beginning."""
    lasting = {e.machine for e in events if e.until is None and e.kind in PASSING}
    machines = [live for name in lasting if name and (live := context.live.get(name)) is not None]
    stored = stored_of_machines(context) if machines else Stored()
    words: dict[str, list[_Matter]] = {}
    for live in machines:
        status = status_of(context, live, stored)
        now = _lasting(status)
        words[status.machine] = [*now.alarms.values(), *now.sensors.values()]

    def updated(event: Event) -> Event:
        matters = words.get(event.machine or "", ()) if event.until is None else ()
        text = next((text for text, details in matters if details == event.details), event.text)
        # Said now, it can be said in other languages.
        is_same = text == event.text
        return replace(event, text=text) if is_same else replace(event, text_now=text)

    return [updated(event) if event.kind in PASSING else event for event in events]


def show_alarms(context: Context) -> dict[str, list[Event]]:
    """List what lasts, by machine, the oldest first; every stored machine is there."""
    with context.database.reading() as session:
        alarms: dict[str, list[Event]] = {one.machine.id: [] for one in list_machines(session)}
        for event in lasting_events(session):
            if event.machine in alarms:
                alarms[event.machine].append(event)
    return alarms


def note_analysis(
    session: Session,
    machine_id: str | None,
    analysis_id: int,
    status: str,
    now: datetime,
    words: str | None = None,
) -> None:
    """Write into the log how an analysis goes on.

    Parameters
    ----------
    status
        One of `AnalysisStatus`, or `deleted`.
    words
        The same for a person; None: the status says it.
    """
    message = words or str(status)
    details = {"analysis": analysis_id, "status": str(status), "message": message}
    text = f"analysis {analysis_id} {message}"
    write_event(session, machine_id, EventKind.ANALYSIS, text, now, details)


class _Matter(NamedTuple):
    """One thing that is the matter, in words and in fields: other fields are another matter."""

    text: str
    details: dict[str, str]


@dataclass(frozen=True, slots=True)
class _Lasting:
    """What is the matter with a machine: alarms by their state, failures by their sensor."""

    alarms: dict[str, _Matter]
    sensors: dict[str, _Matter]

    @property
    def key(self) -> _Key:
        """What of it is compared: an alarm's words change all the time."""
        return _key_of(m.details for m in (*self.alarms.values(), *self.sensors.values()))


_Key: TypeAlias = frozenset[tuple[tuple[str, str], ...]]


def _key_of(details: Iterable[Mapping[str, str]]) -> _Key:
    return frozenset(tuple(sorted(one.items())) for one in details)


class AlarmLog(Background):
    """Looks at every machine, and writes into the log what comes and goes.

    A state has to be there at two looks in a row; how long it stays after its cause is gone, the
    verdict itself says. Of several services on one PostgreSQL one writes, and when it is gone
    another; on SQLite what one has written no other writes again.
    """

    def __init__(self, context: Context) -> None:
        super().__init__("alarm-log", context.database.duty(ALARM_DUTY))
        self._context = context
        self._written: dict[str, _Key] = {}
        self._seen: dict[str, _Key] = {}
        self._judged: dict[str, tuple[object, float]] = {}
        self._waiting: deque[str] = deque()
        self._tidied_s: float | None = None

    def _run(self) -> None:
        while not self._stop.wait(LOOK_EVERY_S):
            try:
                self.look_if_ours()
            except StorageUnavailable:
                continue  # what changed is seen again at the next look
            except Exception:
                log.exception("could not write alarms into the log")

    def look_if_ours(self) -> None:
        """Look once where it is for this process to write; later it begins with what is written."""
        if self._is_ours():
            self.look()
        else:
            self._written.clear()
            self._seen.clear()
            self._judged.clear()

    def look(self) -> None:
        """Look once at the machines that may have changed: at all, or as many as there is time for.

        The next look goes on with those that have waited longest. Even to see that nothing is new
        of ten thousand machines takes a while, in which the live table waits for its turns.
        """
        context = self._context
        if context.live.database.trouble is not None:
            return
        self._tidy()
        stored = stored_of_machines(context)
        began_s = monotonic()
        for _ in range(self._list_waiting()):
            machine_id = self._waiting.popleft()
            live = context.live.get(machine_id)
            if live is None:
                continue
            mark = _mark(live, stored)
            if self._is_due(machine_id, mark, began_s):
                self._judged[machine_id] = (mark, began_s)
                self._compare(machine_id, _lasting(status_of(context, live, stored)))
            self._waiting.append(machine_id)
            if self._stop.is_set() or monotonic() - began_s >= AT_MOST_S:
                return

    def _list_waiting(self) -> int:
        """Bring the list of those that wait up to date; say how many they are."""
        ids = self._context.live.ids()
        known = set(self._waiting)
        if ids != known:
            self._waiting = deque([*sorted(ids - known), *(m for m in self._waiting if m in ids)])
            for known_of in (self._written, self._seen, self._judged):
                for machine_id in known_of.keys() - ids:
                    del known_of[machine_id]
        return len(self._waiting)

    def _is_due(self, machine_id: str, mark: object, now_s: float) -> bool:
        known, judged_s = self._judged.get(machine_id, (None, -math.inf))
        settled = self._seen.get(machine_id) == self._written.get(machine_id)
        return known != mark or now_s - judged_s >= JUDGED_AGAIN_S or not settled

    def _compare(self, machine_id: str, lasting: _Lasting) -> None:
        key = lasting.key
        before, self._seen[machine_id] = self._seen.get(machine_id), key
        if machine_id not in self._written:
            with self._context.database.reading() as session:
                open_ones = lasting_details(session)
            self._written[machine_id] = _key_of(
                details
                for kind in (EventKind.ALARM, EventKind.SENSOR)
                for details in open_ones.get((machine_id, kind), {}).values()
            )
        if key != before or key == self._written[machine_id]:
            return
        now = self._context.now()
        with self._context.database.writing() as session:
            for kind, subjects in (
                (EventKind.ALARM, lasting.alarms),
                (EventKind.SENSOR, lasting.sensors),
            ):
                end_passing(session, machine_id, kind, subjects, now)
                for subject, (text, details) in subjects.items():
                    begin_passing(session, machine_id, kind, subject, text, now, details)
        self._written[machine_id] = key

    def _tidy(self) -> None:
        now_s = monotonic()
        if self._tidied_s is not None and now_s - self._tidied_s < TIDY_EVERY_S:
            return
        with self._context.database.writing() as session:
            delete_old_alarms(session, self._context.now())
        self._tidied_s = now_s


def _mark(live: LiveMachine, stored: Stored) -> object:
    """Give what changes whenever something is new of a machine."""
    machine_id, latest = live.current.model.machine.id, live.readings.latest
    read_at = None if latest is None else latest.time
    beside = (stored.watches.get(machine_id), stored.not_adopted.get(machine_id))
    return (live.current.version, live.current.revision, read_at, *beside)


def _words(sensor: SensorNow) -> str:
    """Say what is the matter with a sensor; how old its value is now will not be so for long."""
    if sensor.health is Health.STALE or not sensor.detail:
        return f"{sensor.sensor} is {sensor.health}"
    return sensor.detail


def _lasting(status: MachineStatus) -> _Lasting:
    """Say what is the matter; a machine that was never set up has no alarm."""
    alarms = {}
    if status.verdict is not Verdict.TRUSTED and status.model_version is not None:
        state = str(status.state)
        words = status.sentences[0] if status.sentences else state
        alarms[state] = _Matter(words, {"state": state, "about": ", ".join(sorted(status.about))})
    sensors = {
        sensor.sensor: _Matter(
            _words(sensor), {"sensor": sensor.sensor, "health": str(sensor.health)}
        )
        for sensor in status.sensors
        if sensor.health is not Health.OK and sensor.age_s is not None
    }
    return _Lasting(alarms, sensors)
