"""A broker at work: messages become readings, and are acknowledged when these are stored."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from datetime import datetime
from time import monotonic
from typing import Final

from app.connections.connection import Connection, TellsTables
from app.connections.follower import Trouble
from app.connections.intake import Fate, TakesValues
from app.connections.known_values import REPEATED_S
from app.connections.mqtt_link import Arrived, BrokerRefused, Link, LinkLost
from app.connections.mqtt_payloads import Unusable
from app.connections.mqtt_publisher import TablePublisher
from app.connections.mqtt_readers import MessageValues, read_message
from app.connections.mqtt_tables import MqttTable, TopicTable
from app.connections.sparing_log import SparingLog
from app.connections.sparkplug_follower import SparkplugFollower
from app.connections.sparkplug_nodes import NAMESPACE
from app.connections.sparkplug_payload import rebirth_command
from app.errors import counted, list_names
from app.services.context import Context
from app.supervision import keep_running, words_of

log = logging.getLogger("thermap")

LOOK_EVERY_S: Final = 0.5
"""How often it is seen who is silent, and whether births are missing [s]."""

TURN_S: Final = 0.02
"""How long messages are read before others have a turn [s]: a birth of 10,000 metrics takes longer
than a thousand temperatures."""

NAMED: Final = 5
"""Sensors that are named where many are silent."""

NO_VALUE: Final = "the sender says that it has no value (null)"

MOST_HEARD: Final = 10_000
"""Sensors whose silence is noticed: topics may name any number."""


class MqttConnection(TellsTables):
    """One broker."""

    def __init__(
        self, table: MqttTable, intake: TakesValues, context: Callable[[], Context]
    ) -> None:
        self._table = table
        self._intake = intake
        self._context = context
        self._sparkplug = SparkplugFollower(table.sparkplug, intake)
        self._link: Link | None = None
        self._publisher: TablePublisher | None = None
        self._trouble = Trouble(f"MQTT {table.name!r}")
        self._refused: Sequence[str] = ()
        self._last_value_at: datetime | None = None
        self._machines = {topic.machine for topic in table.topics if topic.machine is not None}
        self._machines |= {sparkplug_table.machine for sparkplug_table in table.sparkplug}
        self._heard_s: dict[tuple[str, str], float] = {}
        self._limit_s: dict[tuple[str, str], float] = {}
        self._since_s: dict[tuple[str, str], float] = {}
        self._silent: set[tuple[str, str]] = set()
        self._absent: dict[tuple[str, str], None] = {}
        self._dropped = 0
        self._log = SparingLog()

    async def run(self) -> None:
        """Follow the broker until contact is lost."""
        try:
            async with Link.opened(self._table) as link:
                await self._attend(link)
        finally:
            self._leave()

    def now(self) -> Connection:
        """Say how it fares."""
        link = self._link
        return Connection(
            name=self._table.name,
            kind="mqtt",
            machines=tuple(sorted(self._machines)),
            endpoint=self._table.endpoint,
            connected=link is not None,
            last_value_at=self._last_value_at,
            known=len(self._heard_s.keys() - self._silent) + len(self._sparkplug),
            trouble="; ".join(self._troubles()),
            lost=self._dropped + (0 if link is None else link.dropped) + self._sparkplug.lost,
        )

    def _troubles(self) -> list[str]:
        troubles = [str(self._trouble), *self._refused]
        if self._publisher is not None:
            troubles.append(self._publisher.trouble)
        if self._link is not None:
            absent = sorted({*self._absent, *self._sparkplug.absent})
            troubles += [
                f"{sensor} of {machine!r}: {NO_VALUE}" for machine, sensor in absent[:NAMED]
            ]
            troubles += [self._silence(*silence) for silence in sorted(self._silent)[:NAMED]]
            if unsure := self._sparkplug.unsure():
                troubles.append(f"messages of {list_names(unsure, 5)} are missing: no birth since")
        return [words for words in troubles if words]

    def _silence(self, machine: str, sensor: str) -> str:
        limit_s = self._limit_s[machine, sensor]
        return f"{sensor} of {machine!r} has said nothing usable for more than {limit_s:g} s"

    async def _attend(self, link: Link) -> None:
        """Do all that a contact is for, until it ends."""
        self._link, self._refused = link, ()
        self._trouble.say("")
        self._begin_to_listen()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._take_messages(link))
            if self._table.publish is not None:
                self._publisher = publisher = TablePublisher(
                    link,
                    self._table.publish,
                    self.follow_tables,
                    (self._table.min_change_um, self._table.max_step_um),
                    self._context,
                )
                tasks.create_task(self._while_contact("tables", publisher.run, publisher.ended))
            filters = dict.fromkeys(topic.topic.filter for topic in self._table.topics)
            self._refused = await link.subscribe([*filters, *self._sparkplug.filters])
            for words in self._refused:
                log.warning("MQTT %r: %s", self._table.name, words)
            tasks.create_task(self._while_contact("silence and births", lambda: self._look(link)))
            tasks.create_task(self._while_contact("what holds", self._repeat))

    async def _while_contact(
        self,
        what: str,
        run: Callable[[], Awaitable[None]],
        ended: Callable[[str], None] | None = None,
    ) -> None:
        """Keep running what belongs to a contact: what ends of it does not end the others."""
        name = f"MQTT {self._table.name!r}: {what}"
        await keep_running(name, run, ended, lets_through=(LinkLost,))

    def _leave(self) -> None:
        """Without contact nothing is known of nodes, and nobody can be silent."""
        if self._link is not None:
            self._dropped += self._link.dropped
        self._link = self._publisher = None
        self._silent.clear()
        self._absent.clear()
        self._sparkplug.forget()

    async def _take_messages(self, link: Link) -> None:
        began_s = monotonic()
        async for message in link.messages():
            try:
                fates = self._take(message)
            except Exception as why:
                # Whatever a message raises refuses that message: it would come for ever.
                self._intake.refuse(f"topic {message.topic!r:.200}", words_of(why))
                fates = []
            _settle_when_told(link, message, fates)
            if monotonic() - began_s > TURN_S:
                await asyncio.sleep(0)
                began_s = monotonic()

    def _take(self, message: Arrived) -> list[asyncio.Future[Fate]]:
        """Read a message, and hand over what it says."""
        topic = message.topic
        if message.refusal:
            raise Unusable(message.refusal)
        if self._publisher is not None and self._publisher.owns(topic):
            if message.is_retained and message.payload:
                self._publisher.note(topic)
            return []
        if self._table.sparkplug and topic.startswith(f"{NAMESPACE}/"):
            # A birth or a value that somebody retained is of a session that nobody knows.
            fates = [] if message.is_retained else self._sparkplug.take(topic, message.payload)
            if fates:
                self._last_value_at = self._context().now()
            return fates
        for table in self._table.topics:
            names = table.topic.match(topic)
            if names is not None:
                # Retained, it was published at any time before: no news, unless it says when.
                if message.is_retained and table.time is None:
                    return []
                return self._offer(table, read_message(table, names, message.payload), topic)
        raise Unusable(
            "expected one of the topics of the file, got another: the session is of an earlier "
            "file, and another client_id begins a new one"
        )

    def _offer(
        self, table: TopicTable, message_values: MessageValues, topic: str
    ) -> list[asyncio.Future[Fate]]:
        for words in message_values.wrong:
            self._intake.refuse(f"topic {topic!r:.200}", words)
        self._note_absent(message_values)
        if not message_values.temperatures_c and not message_values.state:
            return []
        self._last_value_at = self._context().now()
        for sensor in message_values.temperatures_c:
            if (message_values.machine, sensor) in self._heard_s:
                self._heard_s[message_values.machine, sensor] = monotonic()
        told = self._intake.offer(
            message_values.machine,
            message_values.temperatures_c,
            message_values.time,
            message_values.state,
        )
        told.add_done_callback(lambda fate: self._hear(fate, table, message_values))
        return [told]

    def _note_absent(self, message_values: MessageValues) -> None:
        """Note whose senders say that they have no value, and whose have one again."""
        self._intake.tell_values(
            message_values.machine, message_values.temperatures_c, message_values.without
        )
        for sensor in message_values.temperatures_c:
            self._absent.pop((message_values.machine, sensor), None)
        for sensor in message_values.without:
            if (
                len(self._absent) < MOST_HEARD
                and (message_values.machine, sensor) not in self._absent
            ):
                self._absent[message_values.machine, sensor] = None
                words = f"{sensor} of {message_values.machine!r}: {NO_VALUE}"
                self._log.warn("absent", f"MQTT {self._table.name!r}: {words}")

    def _hear(
        self, settled: asyncio.Future[Fate], table: TopicTable, message_values: MessageValues
    ) -> None:
        """Note who was heard: only of machines and sensors that there are."""
        if settled.cancelled() or settled.result() is not Fate.STORED:
            return
        if len(self._machines) < MOST_HEARD:
            self._machines.add(message_values.machine)
        for sensor in message_values.temperatures_c:
            who = message_values.machine, sensor
            if who not in self._heard_s and len(self._heard_s) >= MOST_HEARD:
                continue
            self._heard_s[who] = monotonic()
            if table.silent_after_s is not None:
                self._limit_s[who] = table.silent_after_s

    def _begin_to_listen(self) -> None:
        """Count silence from now on, also that of sensors that were never heard."""
        now_s = monotonic()
        for table in self._table.topics:
            if table.silent_after_s is not None and table.machine is not None:
                for sensor in (table.sensor,) if table.sensor else table.sensors:
                    self._limit_s[table.machine, sensor] = table.silent_after_s
        self._since_s = dict.fromkeys(self._limit_s, now_s)

    async def _look(self, link: Link) -> None:
        """See who is silent, and ask for births that are missing."""
        while True:
            self._notice_silence()
            for topic in self._sparkplug.rebirths_due():
                try:
                    await link.publish(topic, rebirth_command())
                except BrokerRefused as why:
                    log.warning("MQTT %r: %s", self._table.name, why.detail)
            await asyncio.sleep(LOOK_EVERY_S)

    def _notice_silence(self) -> None:
        now_s = monotonic()
        silent = {
            who
            for who, limit_s in self._limit_s.items()
            if now_s - max(self._heard_s.get(who, -limit_s), self._since_s.setdefault(who, now_s))
            > limit_s
        }
        # Together, and each but once in a while: thousands fall silent at once where a part of the
        # network goes, and some come and go all day. `trouble` says who is silent now.
        if new := silent - self._silent:
            words = [self._silence(*who) for who in sorted(new)[:NAMED]]
            self._warn_of("silence", words, len(new))
        if heard := self._silent - silent:
            words = [f"{sensor} of {machine!r} speaks again" for machine, sensor in sorted(heard)]
            self._warn_of("speech", words[:NAMED], len(heard))
        self._silent = silent

    def _warn_of(self, about: str, words: Sequence[str], count: int) -> None:
        more = f"; and {counted(count - len(words), 'other')}" if count > len(words) else ""
        self._log.warn(about, f"MQTT {self._table.name!r}: {'; '.join(words)}{more}")

    async def _repeat(self) -> None:
        while True:
            await asyncio.sleep(REPEATED_S)
            self._sparkplug.repeat()

    def lost(self, words: str) -> None:
        """Take note of why there is no contact."""
        self._trouble.say(words)


def _settle_when_told(link: Link, message: Arrived, fates: Sequence[asyncio.Future[Fate]]) -> None:
    """Acknowledge a message when all that it said is stored, or refused for good."""
    # A message may say many things, and each becomes part of another reading: it is acknowledged
    # with the last of them. Where one is dropped the message may not be acknowledged at all, and so
    # none that came after it: contact is broken off, and the broker begins again from the oldest.
    waiting = set(fates)
    if not waiting:
        link.settle(message)
        return

    def hear(settled: asyncio.Future[Fate]) -> None:
        waiting.discard(settled)
        if settled.cancelled() or (settled.result() is Fate.DROPPED and message.qos > 0):
            # The broker has it still, and sends it again to the next contact.
            link.break_off("readings were dropped, as too many waited for the database")
        elif not waiting:
            link.settle(message)

    for fate in fates:
        fate.add_done_callback(hear)
