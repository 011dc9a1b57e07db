"""Tell people of alarms: each receiver once, in few messages, and later where it was away.

The event log says what alarms there are, and makes one of what comes again within ten minutes. Of
each receiver it is stored which of them it knows. So a message is due as long as the two differ,
whether the receiver, the service or the database was away meanwhile, and it says how things are
when it is sent. A message may be sent twice where the process dies just after it was sent.
"""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta, tzinfo
from time import monotonic
from typing import Final, Protocol

from app.answer import Answer
from app.errors import UnknownThing, existing_names
from app.events.event import Event
from app.services.background import Background
from app.services.context import Context, repeated
from app.services.status import Stored, machine_in_memory, status_of, stored_of_machines
from app.status.alarm_message import MachineNews, Message, News, alarm_message, trial_message
from app.status.machine_status import MachineStatus, State, Verdict
from app.storage.events import COMES_AGAIN_WITHIN, NumberedAlarm, alarms_since, newest_number
from app.storage.receivers import (
    Announced,
    StoredReceiver,
    ask_for_test,
    forget_receivers,
    stored_receivers,
    write_receiver,
)

log = logging.getLogger("thermap")

LOOK_EVERY_S: Final = 1.0

AT_MOST_EVERY: Final = timedelta(minutes=5)
"""One message to a receiver: what comes meanwhile is in the next."""

TEST_AT_MOST_EVERY: Final = timedelta(seconds=10)

FIRST_PAUSE_S: Final = 10.0
"""After a message that could not be sent [s]; twice as long each time."""

LONGEST_PAUSE_S: Final = 300.0

SAID_EVERY: Final = timedelta(seconds=10)
"""How often it is stored that somebody looks after a receiver."""

SILENT_AFTER: Final = timedelta(seconds=60)
"""Who has looked after no receiver for so long does not run."""

FORGOTTEN_AFTER: Final = timedelta(hours=1)
"""A receiver that is in no file any more."""

MOST_SENTENCES: Final = 3

TELLING_DUTY: Final = 7_483_626
"""PostgreSQL advisory lock: of several services one sends."""


@dataclass(frozen=True, slots=True)
class Rules:
    """What a receiver is told of.

    Parameters
    ----------
    machines
        Ids; empty for all.
    after
        How long an alarm has to last first.
    repeat_after
        When what lasts is told again.
    zone
        Of the times in messages; None: that of this computer.
    link
        Address of the service, without a slash at its end; empty where it has none.
    """

    machines: tuple[str, ...]
    verdicts: frozenset[Verdict]
    after: timedelta
    repeat_after: timedelta
    zone: tzinfo | None
    link: str


class Receives(Protocol):
    """One who is told."""

    @property
    def name(self) -> str:
        """By which people know it."""

    @property
    def service(self) -> str:
        """What carries the messages: e-mail, a chat …."""

    @property
    def rules(self) -> Rules:
        """What it is told of."""

    def send(self, message: Message) -> str:
        """Send a message; say why it could not be sent, "" where it was."""


@dataclass(frozen=True, slots=True)
class Receiver(Answer):
    """Somebody who is told of alarms, and how that went."""

    name: str
    """Its name in the file"""
    service: str
    """What carries the messages, such as E-Mail"""
    machines: tuple[str, ...]
    """Ids of the machines that it is told of; empty for all"""
    trouble: str
    """Why it is not told what it should be told, empty where nothing is the matter"""
    trouble_since: datetime | None
    """Since when, null without trouble"""
    waiting: tuple[str, ...]
    """Ids of machines of which the next message will tell"""
    sent_at: datetime | None
    """When the last message was sent, null before the first"""
    sent: str
    """Its title"""
    test_asked_at: datetime | None
    """When somebody last asked for a test message, null where nobody did"""
    tested_at: datetime | None
    """When the last test message was tried"""
    test_failure: str
    """Why that could not be sent, empty where it was"""


@dataclass(frozen=True, slots=True)
class Receivers(Answer):
    """Everybody who is told of alarms."""

    receivers: tuple[Receiver, ...]
    """By name"""


def show_receivers(context: Context, machine_id: str | None = None) -> Receivers:
    """List who is told of alarms; of one machine, or of any."""
    with context.database.reading() as session:
        stored = stored_receivers(session).values()
    receivers = [
        _as_shown(receiver, context.now())
        for receiver in stored
        if machine_id is None or not receiver.machines or machine_id in receiver.machines
    ]
    return Receivers(tuple(receivers))


@repeated
def ask_for_test_message(context: Context, name: str, seen: Collection[str]) -> Receiver:
    """Ask for a test message; whoever sends sends it within seconds.

    Parameters
    ----------
    seen
        Names of the receivers of which the one who asks may know.
    """
    now = context.now()
    with context.database.writing() as session:
        stored = stored_receivers(session)
        if name not in stored or name not in seen:
            raise UnknownThing(
                f"there is no receiver {name[:80]!r}; {existing_names(seen)}: receivers are "
                "[[notify]] in the file of `thermap serve --config`"
            )
        ask_for_test(session, name, now)
    return _as_shown(replace(stored[name], test_asked_at=now), now)


def _as_shown(stored: StoredReceiver, now: datetime) -> Receiver:
    trouble, since = stored.failure, stored.failing_since
    if now - stored.looked_at > SILENT_AFTER:
        trouble, since = "no service runs that has it in its file", stored.looked_at
    return Receiver(
        stored.name,
        stored.service,
        stored.machines,
        trouble,
        since,
        stored.waiting,
        stored.sent_at,
        stored.sent,
        stored.test_asked_at,
        stored.tested_at,
        stored.test_failure,
    )


@dataclass(frozen=True, slots=True)
class Due:
    """What is to be said of a machine, and what its receiver then knows of it."""

    news: News
    alarms: tuple[Event, ...]
    known: Announced | None


def due_news(
    alarms: Sequence[NumberedAlarm],
    announced: Mapping[str, Announced],
    now: datetime,
    rules: Rules,
) -> tuple[dict[str, Due], int | None]:
    """Say what a receiver does not know yet, by machine.

    Parameters
    ----------
    alarms
        Those that last, that went since it was told, and that it knows of.

    Returns
    -------
    dict, int
        The second is the smallest number of an entry that cannot be dealt with yet although its
        alarm went, as it may come again; None where there is none.
    """
    # What a receiver is told of a machine, by the alarms that it is told of at all:
    #
    #     one lasts long enough that it does not know           CAME, with all that last
    #     it knows all that last, told repeat_after ago         LASTS
    #     none lasts, and none may come again:
    #         it knows of one                                   OVER
    #         it knows of none, one lasted long enough          PASSED
    #     else                                                  nothing yet
    #
    # One that went but may come again, or was not told beside one that lasts, is looked at again:
    # `settled` stays below its number. What lasts is read whatever its number.
    of_machines: dict[str, list[NumberedAlarm]] = defaultdict(list)
    for alarm in alarms:
        if _concerns(alarm.event, rules):
            of_machines[str(alarm.event.machine)].append(alarm)
    due: dict[str, Due] = {}
    undecided: list[int] = []
    for machine_id, alarms_of_machine in of_machines.items():
        announced_before = announced.get(machine_id)
        ids = () if announced_before is None else announced_before.alarms
        lasting = [one.event for one in alarms_of_machine if one.event.until is None]
        gone = [one for one in alarms_of_machine if one.event.until is not None]
        fading = [one for one in gone if now - _end(one.event) < COMES_AGAIN_WITHIN]
        unknown = [
            one
            for one in gone
            if one.event.id not in ids and _lasted(one.event, now) >= rules.after
        ]
        old = [e for e in lasting if e.id in ids or _lasted(e, now) >= rules.after]
        if any(event.id not in ids for event in old):
            due[machine_id] = Due(News.CAME, tuple(old), _announced(old, announced_before, now))
        elif (
            old and announced_before is not None and now - announced_before.at >= rules.repeat_after
        ):
            due[machine_id] = Due(News.LASTS, tuple(old), _announced(old, announced_before, now))
        elif not lasting and not fading:
            over = tuple(one.event for one in gone if one.event.id in ids)
            passed = tuple(one.event for one in unknown)
            if announced_before is not None:
                due[machine_id] = Due(News.OVER, over, None)
            elif passed:
                due[machine_id] = Due(News.PASSED, passed, None)
        else:
            undecided += [one.number for one in (*fading, *unknown)]
    for machine_id in announced:
        if machine_id not in of_machines:  # the log has nothing of it any more
            due[machine_id] = Due(News.OVER, (), None)
    return due, min(undecided, default=None)


def _concerns(event: Event, rules: Rules) -> bool:
    is_of_it = not rules.machines or event.machine in rules.machines
    return is_of_it and _state(event).verdict in rules.verdicts


def _state(event: Event) -> State:
    try:
        return State(event.details.get("state", ""))
    except ValueError:  # of another version
        return State.INCOMPLETE


def _end(event: Event) -> datetime:
    return event.until or event.time


def _lasted(event: Event, now: datetime) -> timedelta:
    return (event.until or now) - event.time


def _announced(lasting: Sequence[Event], before: Announced | None, now: datetime) -> Announced:
    ids = {event.id for event in lasting} | set(() if before is None else before.alarms)
    since = min(event.time for event in lasting)
    return Announced(tuple(sorted(ids)), since if before is None else min(since, before.since), now)


class ReceiverTelling(Background):
    """Sends messages to the receivers of a file; of several services on one database, one does."""

    def __init__(self, context: Context, receivers: Sequence[Receives]) -> None:
        super().__init__("notify", context.database.duty(TELLING_DUTY) if receivers else None)
        self._context = context
        self._receivers = receivers
        self._pauses: dict[str, tuple[float, float]] = {}
        """Of those that could not be reached: when they are tried again, and the pause after
        that [s]."""

    def start(self) -> None:
        """Begin, where there is anybody to tell."""
        if self._receivers:
            super().start()

    def _run(self) -> None:
        self._repeat(self.look, LOOK_EVERY_S, "receivers could not be told of alarms")

    def look(self) -> None:
        """Look once at each receiver, and send what is due."""
        for receiver in self._receivers:
            if not self._stop.is_set():
                self._look_after(receiver)

    def _look_after(self, receiver: Receives) -> None:
        before, alarms, newest = self._read(receiver)
        now = self._context.now()
        due, undecided = due_news(alarms, before.announced, now, receiver.rules)
        settled = newest if undecided is None else undecided - 1
        after = replace(before, machines=receiver.rules.machines, service=receiver.service)
        if before.is_test_due and _may_test(before, now):
            after = self._tested(receiver, after, now)
        if not due:
            after = replace(after, settled=max(settled, before.settled), waiting=())
        elif self._may_send(receiver.name, before, now):
            after = self._sent(receiver, after, due, settled)
        else:
            after = replace(after, waiting=tuple(sorted(due)))
        is_new = replace(after, settled=before.settled, looked_at=before.looked_at) != before
        if is_new or now - before.looked_at >= SAID_EVERY:
            self._write(replace(after, looked_at=now))

    def _read(self, receiver: Receives) -> tuple[StoredReceiver, list[NumberedAlarm], int]:
        now = self._context.now()
        with self._context.database.reading() as session:
            newest = newest_number(session)  # what is committed after it is read next time
            stored = stored_receivers(session).get(receiver.name) or StoredReceiver(
                receiver.name, receiver.service, receiver.rules.machines, newest, now - SAID_EVERY
            )
            ids = [i for announced in stored.announced.values() for i in announced.alarms]
            return stored, alarms_since(session, stored.settled, ids), newest

    def _write(self, receiver: StoredReceiver) -> None:
        names = {configured.name for configured in self._receivers}
        with self._context.database.writing() as session:
            write_receiver(session, receiver)
            forget_receivers(session, names, receiver.looked_at, FORGOTTEN_AFTER)

    def _may_send(self, name: str, stored: StoredReceiver, now: datetime) -> bool:
        if name in self._pauses:
            return monotonic() >= self._pauses[name][0]
        # A message that seems to be of the future, as the clock was set back, holds up none.
        return stored.sent_at is None or not timedelta(0) <= now - stored.sent_at < AT_MOST_EVERY

    def _sent(
        self, receiver: Receives, stored: StoredReceiver, due: Mapping[str, Due], settled: int
    ) -> StoredReceiver:
        rules = receiver.rules
        pending_news = list(self._told(due, stored.announced))
        message = alarm_message(pending_news, rules.zone, rules.link)
        # Sent before it is noted as sent, and in no transaction, as it may take seconds: a service
        # that is killed in between tells it twice rather than never.
        failure = self._try(receiver, message)
        now = self._context.now()
        if failure:
            since = stored.failing_since or now
            waiting = tuple(sorted(due))
            return replace(stored, failing_since=since, failure=failure, waiting=waiting)
        announced = dict(stored.announced)
        for machine_id, due_of_machine in due.items():
            announced.pop(machine_id, None)
            if due_of_machine.known is not None:
                announced[machine_id] = due_of_machine.known
        return replace(
            stored,
            announced=announced,
            settled=max(settled, stored.settled),
            waiting=(),
            sent_at=now,
            sent=message.title,
            failing_since=None,
            failure="",
        )

    def _tested(self, receiver: Receives, stored: StoredReceiver, now: datetime) -> StoredReceiver:
        rules = receiver.rules
        failure = self._try(receiver, trial_message(receiver.name, now, rules.zone, rules.link))
        tested = replace(stored, tested_at=self._context.now(), test_failure=failure)
        return tested if failure else replace(tested, failing_since=None, failure="")

    def _try(self, receiver: Receives, message: Message) -> str:
        """Send; say why it could not be sent, and let some time pass before the next message."""
        try:
            failure = receiver.send(message)
        except Exception as error:
            log.exception("receiver %s: a message could not be sent", receiver.name)
            failure = f"unexpected error: {type(error).__name__}"
        if not failure:
            self._pauses.pop(receiver.name, None)
            return ""
        _, pause_s = self._pauses.get(receiver.name, (0.0, FIRST_PAUSE_S))
        if pause_s == FIRST_PAUSE_S:
            log.warning("receiver %s cannot be told: %s", receiver.name, failure)
        next_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
        self._pauses[receiver.name] = (monotonic() + pause_s, next_s)
        return failure

    def _told(
        self, due: Mapping[str, Due], announced: Mapping[str, Announced]
    ) -> Iterator[MachineNews]:
        stored = stored_of_machines(self._context)
        for machine_id, due_of_machine in due.items():
            then = [_counted(event) for event in due_of_machine.alarms][-MOST_SENTENCES:]
            states = [_state(event) for event in due_of_machine.alarms]
            announced_before = announced.get(machine_id)
            times = [event.time for event in due_of_machine.alarms] + (
                [] if announced_before is None else [announced_before.since]
            )
            is_over = due_of_machine.known is None
            until = (
                max(map(_end, due_of_machine.alarms), default=self._context.now())
                if is_over
                else None
            )
            status = self._status(machine_id, stored)
            lasts = status is not None and not is_over and status.verdict is not Verdict.TRUSTED
            yield MachineNews(
                machine_id,
                machine_id if status is None else status.name,
                due_of_machine.news,
                min(states, key=lambda state: state.gravity, default=State.INCOMPLETE),
                min(times),
                until,
                None if status is None else status.verdict,
                status.sentences[:MOST_SENTENCES] if status is not None and lasts else then,
            )

    def _status(self, machine_id: str, stored: Stored) -> MachineStatus | None:
        """Judge a machine; None where it is no longer stored."""
        try:
            return status_of(self._context, machine_in_memory(self._context, machine_id), stored)
        except UnknownThing:
            return None


def _may_test(stored: StoredReceiver, now: datetime) -> bool:
    tested = stored.tested_at
    return tested is None or not timedelta(0) <= now - tested < TEST_AT_MOST_EVERY


def _counted(event: Event) -> str:
    return event.text if event.count == 1 else f"{event.text} ({event.count} times)"
