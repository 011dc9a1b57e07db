"""One contact with a broker: messages, their acknowledgement, subscriptions, what is published.

The network is waited for in a thread of its own; all that is told is told to the event loop that
the contact was made in, and all methods are to be called there. The library's own loop is not
used: it cannot wait for descriptors above 1023, which a service with many followers has. A
contact is not made again: another one is made.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from selectors import EVENT_READ, EVENT_WRITE, DefaultSelector
from socket import socketpair
from threading import Condition, Event, Thread
from time import monotonic
from typing import Any, Final

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from app.connections.mqtt_tables import MqttTable
from app.errors import ThermapError

ANSWER_S: Final = 10.0
"""How long a broker may take to answer [s]."""

LOOK_EVERY_S: Final = 1.0
"""How often it is seen whether the broker is alive [s]."""

LAST_S: Final = 1.0
"""How long what was said last has to get out [s]."""

LARGEST_MESSAGE: Final = 1024 * 1024
"""That a broker may send [bytes]: it is told so, and keeps larger ones to itself."""

LARGEST_PAYLOAD: Final = 256 * 1024
"""That is read [bytes]: the birth of an edge node with some thousand metrics fits."""

LONGEST_TOPIC: Final = 1000
"""That is read [bytes in UTF-8]."""

MOST_LOOSE: Final = 10_000
"""Messages of QoS 0 that wait: nothing bounds these but that the oldest are dropped."""

MOST_LOOSE_BYTES: Final = 16 * 1024 * 1024
"""Of all of those together [bytes]."""

MOST_UNREAD_BYTES: Final = 16 * 1024 * 1024
"""Of messages that the event loop has not taken up yet [bytes]: the network waits for it."""

ASSURED: Final = 1
"""The quality of service that is asked for: each message comes, some twice."""

_NEW_ONLY: Final = SubscribeOptions.RETAIN_SEND_IF_NEW_SUB


class LinkLost(ThermapError):
    """There is no contact with the broker; the sentence says why."""


class BrokerRefused(ThermapError):
    """The broker refuses what is published; the sentence says what and why."""


@dataclass(eq=False, slots=True)
class Arrived:
    """A message that came, until it is settled.

    `refusal` says why nothing of it is read: it was too long to be kept.
    """

    topic: str
    payload: bytes
    is_retained: bool
    qos: int
    mid: int
    refusal: str = ""
    is_settled: bool = False


# A message of QoS 1, from the broker until the broker may forget it:
#
#    network's thread           event loop
#    _on_message ──────> _waiting ──_next──> _unsettled ──settle──> PUBACK
#     waits while more            what it says is stored        in the order in which they came
#     than MOST_UNREAD_BYTES
#     are unread
#
# Nothing is acknowledged before it is stored. `receive_maximum` bounds what is under way: a slow
# database slows the broker down, which keeps the rest in its session. When contact is lost the
# broker sends again what was not acknowledged; what of that had been stored is found there already.
class Link:
    """A contact; `opened` makes one."""

    def __init__(self, broker: MqttTable) -> None:
        self._broker = broker
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[Arrived] = deque()
        self._loose: deque[Arrived] = deque()
        self._loose_bytes = 0
        self._loose_taken = 0
        self._unread_bytes = 0
        self._room = Condition()
        self._unsettled: deque[Arrived] = deque()
        self._something = asyncio.Event()
        self._answers: dict[int, asyncio.Future[Sequence[ReasonCode]]] = {}
        self._connected: asyncio.Future[bool] = self._loop.create_future()
        self._is_gone = ""
        self.dropped = 0
        self.session_present = False
        self._client = self._new_client()
        self._ends = Event()
        self._wake, self._woken = socketpair()
        self._wake.setblocking(False)
        self._woken.setblocking(False)
        self._thread = Thread(target=self._run, name="mqtt-network", daemon=True)

    @staticmethod
    @asynccontextmanager
    async def opened(broker: MqttTable) -> AsyncIterator[Link]:
        """Make contact for as long as the block lasts.

        Raises
        ------
        LinkLost
            If the broker is not there, or refuses.
        """
        link = Link(broker)
        try:
            await link._connect()
            yield link
        finally:
            await link._close()

    async def messages(self) -> AsyncIterator[Arrived]:
        """Give what comes, each once, to be settled; LinkLost where contact ends."""
        while True:
            while (message := self._next()) is not None:
                try:
                    yield message
                finally:
                    message.payload = b""  # it may wait for the database, its content does not
            # All who set it run in this event loop: none can between the look above and this.
            self._something.clear()
            if self._is_gone:
                raise LinkLost(self._is_gone)
            if not self._waiting:
                await self._something.wait()

    def settle(self, message: Arrived) -> None:
        """Acknowledge a message: the broker may forget it.

        Acknowledgements go out in the order in which messages came, as the protocol asks.
        """
        if message.qos == 0:
            self._loose_taken -= 1
            self._something.set()
            return
        message.is_settled = True
        while self._unsettled and self._unsettled[0].is_settled:
            oldest = self._unsettled.popleft()
            if not self._is_gone:
                self._client.ack(oldest.mid, oldest.qos)
                self._awake()

    def break_off(self, why: str) -> None:
        """End the contact: the broker sends again what was not settled."""
        self._lose(why)

    async def subscribe(self, filters: Iterable[str]) -> Sequence[str]:
        """Subscribe; what is retained comes only of topics that are new to the session.

        Returns
        -------
        Sequence of str
            Of each filter that the broker refused, which and why.
        """
        topic_filters = list(filters)
        # Shared subscriptions have nothing retained.
        options = [
            SubscribeOptions(
                qos=ASSURED,
                retainHandling=SubscribeOptions.RETAIN_DO_NOT_SEND
                if topic_filter.startswith("$share/")
                else _NEW_ONLY,
            )
            for topic_filter in topic_filters
        ]
        if not topic_filters:
            return ()
        rc, mid = self._client.subscribe(list(zip(topic_filters, options, strict=True)))
        answers = await self._answer(rc, mid)
        return [
            f"the broker refuses {topic_filter!r}: {answer}"
            for topic_filter, answer in zip(topic_filters, answers, strict=False)
            if answer.is_failure
        ]

    async def retained(self, pattern: str) -> None:
        """Let what is retained of a filter come once more, among the messages."""
        options = SubscribeOptions(qos=0, retainHandling=SubscribeOptions.RETAIN_SEND_ON_SUBSCRIBE)
        rc, mid = self._client.subscribe([(pattern, options)])
        await self._answer(rc, mid)
        # A broker sends what is retained with the answer, before that to what comes next.
        rc, mid = self._client.unsubscribe(pattern)
        await self._answer(rc, mid)

    async def publish(self, topic: str, payload: bytes, *, retain: bool = False) -> None:
        """Publish, and wait until the broker has it.

        Raises
        ------
        LinkLost
            If there is no contact.
        BrokerRefused
            If it does not want it.
        """
        info = self._client.publish(topic, payload, qos=ASSURED, retain=retain)
        (answer,) = await self._answer(info.rc, info.mid, within_s=None)
        if answer.is_failure:
            raise BrokerRefused(f"the broker refuses what is published to {topic!r}: {answer}")

    async def _answer(
        self, rc: MQTTErrorCode, mid: int | None, within_s: float | None = ANSWER_S
    ) -> Sequence[ReasonCode]:
        self._awake()
        if self._is_gone:
            raise LinkLost(self._is_gone)
        if rc != MQTTErrorCode.MQTT_ERR_SUCCESS or mid is None:
            raise LinkLost(f"contact is lost: {rc.name}")
        # In time, although the request is out: nothing was awaited since, and answers come through
        # this event loop.
        answer = self._answers[mid] = self._loop.create_future()
        try:
            async with asyncio.timeout(within_s):
                answers: Sequence[ReasonCode] = await answer
                return answers
        except TimeoutError:
            raise LinkLost(f"the broker did not answer within {within_s:.0f} s") from None
        finally:
            del self._answers[mid]

    def _new_client(self) -> Client:
        broker = self._broker
        client = Client(
            CallbackAPIVersion.VERSION2,
            broker.client_id,
            protocol=MQTTProtocolVersion.MQTTv5,
            reconnect_on_failure=False,
            manual_ack=True,
        )
        if broker.username is not None:
            client.username_pw_set(broker.username, broker.secret)
        if (tls := broker.encryption()) is not None:
            client.tls_set_context(tls)
        if broker.state_topic is not None:
            client.will_set(broker.state_topic, b"offline", qos=ASSURED, retain=True)
        client.connect_timeout = ANSWER_S
        client.on_connect = self._on_connect
        client.on_disconnect = self._on_disconnect
        client.on_message = self._on_message
        client.on_socket_register_write = self._awake
        client.on_subscribe = lambda _c, _u, mid, codes, _p: self._tell(self._settled, mid, codes)
        client.on_unsubscribe = lambda _c, _u, mid, codes, _p: self._tell(self._settled, mid, codes)
        client.on_publish = lambda _c, _u, mid, code, _p: self._tell(self._settled, mid, [code])
        return client

    async def _connect(self) -> None:
        self._thread.start()
        try:
            async with asyncio.timeout(2 * ANSWER_S):
                self.session_present = await self._connected
        except TimeoutError:
            raise LinkLost(
                f"the broker at {self._where} did not answer within {2 * ANSWER_S:.0f} s"
            ) from None

    async def _close(self) -> None:
        """End; the broker tells that nobody is there, as when contact is lost."""
        if not self._is_gone and self._connected.done():
            reason = ReasonCode(PacketTypes.DISCONNECT, "Disconnect with will message")
            self._client.disconnect(reason)
        self._lose("contact was ended")
        self._ends.set()
        # The network's thread may be waiting for room that nobody makes any more.
        with self._room:
            self._room.notify()
        self._awake()

    @property
    def _where(self) -> str:
        return f"{self._broker.host}:{self._broker.port_used}"

    def _awake(self, *_ignored: Any) -> None:
        """Let the network's thread look whether there is something to send."""
        with suppress(OSError):  # full: it looks in any case; or closed: it has ended
            self._wake.send(b"\0")

    def _next(self) -> Arrived | None:
        if self._waiting:
            message = self._waiting.popleft()
            self._note_read(message)
            self._unsettled.append(message)
            return message
        # Of QoS 0 the broker keeps nothing back, so the same bound is set here, and the oldest give
        # way.
        if self._loose and self._loose_taken < self._broker.receive_maximum:
            self._loose_taken += 1
            return self._take_loose()
        return None

    def _take_loose(self) -> Arrived:
        message = self._loose.popleft()
        self._loose_bytes -= len(message.payload)
        return message

    def _note_read(self, message: Arrived) -> None:
        """Let the network go on where it waits for this to be read."""
        with self._room:
            self._unread_bytes -= len(message.payload)
            self._room.notify()

    # What follows is called by the network's thread.

    def _run(self) -> None:
        try:
            self._open()
            # Said too late, it would take the place of the next contact.
            if not self._ends.is_set():
                self._serve()
        except (OSError, ValueError) as why:
            self._tell(self._lose, f"no broker at {self._where}: {why}")
        except Exception as why:  # what a broker sends may be anything
            self._tell(self._lose, f"the broker at {self._where} cannot be followed: {why!r}")
        finally:
            opened = self._client.socket()
            if opened is not None:
                opened.close()
            self._wake.close()
            self._woken.close()

    def _open(self) -> None:
        broker = self._broker
        properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
        properties.SessionExpiryInterval = broker.session_expiry_s
        properties.ReceiveMaximum = broker.receive_maximum
        properties.MaximumPacketSize = LARGEST_MESSAGE
        self._client.connect(
            broker.host,
            broker.port_used,
            broker.keepalive_s,
            clean_start=False,
            properties=properties,
        )

    def _serve(self) -> None:
        """Read and write until contact ends; at the end what is under way has a moment left."""
        client, until = self._client, math.inf
        with DefaultSelector() as selector:
            selector.register(self._woken, EVENT_READ)
            opened: Any = client.socket()
            if opened is None:
                return
            selector.register(opened, EVENT_READ)
            while self._is_open(opened) and monotonic() < until:
                wanted = EVENT_READ | (EVENT_WRITE if client.want_write() else 0)
                selector.modify(opened, wanted)
                # What TLS has decrypted already makes no socket readable.
                is_pending = hasattr(opened, "pending") and opened.pending() > 0
                ready = {
                    key.fileobj: events
                    for key, events in selector.select(0.0 if is_pending else LOOK_EVERY_S)
                }
                if self._woken in ready:
                    self._woken.recv(4096)
                if is_pending or ready.get(opened, 0) & EVENT_READ:
                    client.loop_read()
                    self._expect_asked_for(client)
                if self._is_open(opened) and client.want_write():
                    client.loop_write()
                client.loop_misc()
                if self._ends.is_set():
                    until = min(until, monotonic() + LAST_S)

    def _expect_asked_for(self, client: Client) -> None:
        """Take no more in than the broker was told: the library takes whatever comes."""
        if client._in_packet["remaining_length"] > LARGEST_MESSAGE:
            raise ValueError(f"expected messages of at most {LARGEST_MESSAGE} bytes, got more")
        if client._in_messages:
            raise ValueError("expected messages of QoS 0 or 1, got one of QoS 2")

    def _is_open(self, opened: Any) -> bool:
        return self._client.socket() is opened

    def _tell(self, what: Callable[..., None], *arguments: Any) -> None:
        with suppress(RuntimeError):  # the event loop has ended
            self._loop.call_soon_threadsafe(what, *arguments)

    def _on_connect(
        self, _client: Client, _userdata: Any, flags: Any, code: ReasonCode, _properties: Any
    ) -> None:
        if code.is_failure:
            self._tell(self._lose, f"the broker refuses: {code}")
        else:
            self._tell(self._have, flags.session_present)

    def _on_disconnect(
        self, _client: Client, _userdata: Any, _flags: Any, code: ReasonCode, _properties: Any
    ) -> None:
        self._tell(self._lose, f"contact with the broker is lost: {code}")

    def _on_message(self, _client: Client, _userdata: Any, message: MQTTMessage) -> None:
        try:
            topic = message.topic
        except UnicodeDecodeError:
            topic = "�"
        payload, refusal = bytes(message.payload), ""
        if len(payload) > LARGEST_PAYLOAD:
            refusal = f"content of at most {LARGEST_PAYLOAD >> 10} kB, got {len(payload)} bytes"
        elif len(topic.encode()) > LONGEST_TOPIC:
            refusal = f"a topic of at most {LONGEST_TOPIC} bytes, got {len(topic.encode())}"
        if refusal:
            topic, payload, refusal = topic[:LONGEST_TOPIC], b"", f"expected {refusal}"
        with self._room:
            self._room.wait_for(
                lambda: self._unread_bytes < MOST_UNREAD_BYTES or self._ends.is_set()
            )
            self._unread_bytes += len(payload)
        self._tell(
            self._take,
            Arrived(topic, payload, message.retain, message.qos, message.mid, refusal),
        )

    # And these by the event loop.

    def _have(self, session_present: bool) -> None:
        if not self._connected.done():
            self._connected.set_result(session_present)

    def _take(self, message: Arrived) -> None:
        if message.qos > 0:
            self._waiting.append(message)
        else:
            self._note_read(message)
            self._loose.append(message)
            self._loose_bytes += len(message.payload)
            while len(self._loose) > MOST_LOOSE or self._loose_bytes > MOST_LOOSE_BYTES:
                self._take_loose()
                self.dropped += 1
        self._something.set()

    def _settled(self, mid: int, codes: Sequence[ReasonCode]) -> None:
        answer = self._answers.get(mid)
        if answer is not None and not answer.done():
            answer.set_result(codes)

    def _lose(self, why: str) -> None:
        """Tell all who wait that there is no contact."""
        self._is_gone = self._is_gone or why
        lost = LinkLost(self._is_gone)
        waiting: list[asyncio.Future[Any]] = [self._connected, *self._answers.values()]
        for answer in waiting:
            if not answer.done():
                answer.set_exception(lost)
                answer.exception()  # nobody may be waiting for it
        self._something.set()
