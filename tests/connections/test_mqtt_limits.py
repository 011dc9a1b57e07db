"""What a broker may send: counted while it comes, and no message is the end of a connection."""

import asyncio
from threading import Thread

import pytest

pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")

from paho.mqtt.client import MQTTMessage

from app.connections import mqtt_connection, mqtt_link
from app.connections.intake import Fate
from app.connections.mqtt_connection import MqttConnection
from app.connections.mqtt_link import Arrived, Link
from app.connections.mqtt_tables import MqttTable

pytestmark = pytest.mark.anyio


def message(content, qos=0, topic="t", mid=1):
    made = MQTTMessage(mid=mid, topic=topic.encode())
    made.payload, made.qos = content, qos
    return made


@pytest.fixture
async def link():
    made = Link(MqttTable(name="c", host="127.0.0.1", port=1, client_id="c", publish="t"))
    yield made
    made._wake.close()
    made._woken.close()


async def turns(number=5):
    for _ in range(number):
        await asyncio.sleep(0)


async def test_messages_that_nobody_reads_are_bounded_in_bytes(link):
    for _ in range(400):
        link._on_message(None, None, message(b"x" * 200_000))
        await turns(1)
    held = sum(len(one.payload) for one in link._loose)
    assert held == link._loose_bytes <= mqtt_link.MOST_LOOSE_BYTES
    assert link.dropped == 400 - len(link._loose) > 300


async def test_of_what_is_too_long_nothing_is_held(link):
    link._on_message(None, None, message(b"x" * 1_000_000, qos=1))
    link._on_message(None, None, message(b"21", qos=1, topic="a/" * 10_000))
    await turns()
    first, second = link._waiting
    assert (first.payload, len(second.topic)) == (b"", mqtt_link.LONGEST_TOPIC)
    assert first.refusal == "expected content of at most 256 kB, got 1000000 bytes"
    assert second.refusal == "expected a topic of at most 1000 bytes, got 20000"


async def test_content_goes_when_it_is_read_not_when_it_is_stored(link):
    for mid in range(100):
        link._on_message(None, None, message(b"21", qos=1, mid=mid))
    await turns()
    messages = link.messages()
    read = [await anext(messages) for _ in range(100)]
    assert [one.payload for one in read] == [b""] * 99 + [b"21"]
    assert len(link._unsettled) == 100
    await messages.aclose()


async def test_the_network_waits_for_a_loop_that_is_busy(link):
    sent = []

    def send():
        for mid in range(400):
            link._on_message(None, None, message(b"x" * 200_000, qos=1, mid=mid))
            sent.append(mid)

    network = Thread(target=send)
    network.start()
    network.join(2.0)
    assert network.is_alive()
    assert len(sent) * 200_000 <= mqtt_link.MOST_UNREAD_BYTES + 200_000
    messages = link.messages()
    async with asyncio.timeout(60):
        for _ in range(400):
            await anext(messages)
    network.join(60)
    assert link._unread_bytes == 0
    await messages.aclose()


class Taking:
    """An intake that remembers."""

    def __init__(self):
        self.refused, self.offered = [], []

    def tell_values(self, *_told):
        """Who has a value and who has none is judged elsewhere."""

    def offer(self, machine, temperatures_c, time=None, state=None):
        self.offered.append(temperatures_c)
        fate = asyncio.get_running_loop().create_future()
        fate.set_result(Fate.STORED)
        return fate

    def refuse(self, where, reason):
        self.refused.append(reason)


class Messages:
    """A link that has these messages."""

    def __init__(self, payloads, topic="t"):
        self._payloads, self._topic = payloads, topic
        self.settled, self.broken_off = [], []

    async def messages(self):
        for mid, payload in enumerate(self._payloads):
            yield Arrived(self._topic, payload, False, 1, mid)

    def settle(self, one):
        self.settled.append(one.mid)

    def break_off(self, why):
        self.broken_off.append(why)


class Clock:
    def now(self):
        return None


def connection_of(intake, **topic):
    stated = {"topic": "t", "machine": "m", "sensor": "x", **topic}
    table = MqttTable.model_validate(
        {"name": "b", "host": "h", "client_id": "c", "topics": [stated]}, context={}
    )
    return MqttConnection(table, intake, Clock)


async def carry(payloads, **topic):
    intake, link = Taking(), Messages(payloads)
    await connection_of(intake, **topic)._take_messages(link)
    await turns()
    assert sorted(link.settled) == list(range(len(payloads)))
    assert not link.broken_off
    return intake


NESTED = [b'{"v":' * depth + b"21" + b"}" * depth for depth in (1, 2, 200, 300, 1023, 5000)]
LISTS = [b'{"v":' + b"[" * depth + b"]" * depth + b"}" for depth in (200, 300, 1000, 100_000)]


async def test_nothing_nested_comes_for_ever():
    intake = await carry([*NESTED, *LISTS, b'{"v": 21.5}'], value="v")
    assert intake.offered == [{"x": 21.0}, {"x": 21.5}]
    assert len(intake.refused) == len(NESTED) + len(LISTS) - 1
    assert max(map(len, intake.refused)) < 600


@pytest.mark.parametrize("time", ["0001-01-01T00:00:00+01:00", "9999-12-31T23:59:59-01:00"])
async def test_times_beyond_the_calendar_are_refused(time):
    intake = await carry([b'{"v": 21, "ts": "%b"}' % time.encode()], value="v", time="ts")
    assert intake.offered == []
    assert "from the year 1900 to 2999" in intake.refused[0]


async def test_whatever_a_message_raises_refuses_it(monkeypatch):
    def read(*_asked):
        raise ZeroDivisionError("out of the blue")

    monkeypatch.setattr("app.connections.mqtt_connection.read_message", read)
    intake = await carry([b"21", b"22"])
    assert intake.refused == ["ZeroDivisionError: out of the blue"] * 2


async def test_long_messages_in_a_row_let_others_have_their_turn(monkeypatch):
    monkeypatch.setattr(mqtt_connection, "TURN_S", 0.0)
    connection, link, seen, turns_of_others = (
        connection_of(Taking()),
        Messages([b"21"] * 40),
        [],
        [],
    )
    monkeypatch.setattr(connection, "_take", lambda _: seen.append(len(turns_of_others)) or [])

    async def others():
        while len(seen) < 40:
            turns_of_others.append(None)
            await asyncio.sleep(0)

    await asyncio.gather(connection._take_messages(link), others())
    assert seen == sorted(set(seen))
