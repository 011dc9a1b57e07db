"""Following an OPC UA server: what is not known to hold is told to nobody."""

import asyncio
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime, timedelta

import pytest

pytest.importorskip("asyncua", reason="the extra opcua is not installed")

from asyncua import ua

from app import supervision
from app.connections import opcua_client, opcua_session
from app.connections.connection import TemperatureTable
from app.connections.follower import Followed, NewValue
from app.connections.opcua_client import ServerFollower
from app.connections.opcua_observations import (
    Observed,
    node_of,
    observe,
    source_time,
    stated_unit,
)
from app.connections.opcua_session import Access
from app.supervision import keep_running
from app.units import TemperatureUnit
from tests.connections.opcua_server_example import URI, ExampleServer, free_port

pytestmark = pytest.mark.anyio


class Following:
    """What was handed on, in order; None where contact was lost."""

    def __init__(self):
        self.taken = []
        self.known = {}

    def take(self, found):
        self.taken += list(found) or [None]
        if not found:
            self.known.clear()
        for one in found:
            self.known[one.name] = one.value

    async def until(self, is_so):
        async with asyncio.timeout(60):
            while not is_so():
                await asyncio.sleep(0.02)


@asynccontextmanager
async def following(access, followed, repeated_s=3600.0):
    seen = Following()
    access = Access(access) if isinstance(access, str) else access
    seen.follower = ServerFollower(
        access,
        followed,
        seen.take,
        lambda: datetime.now(UTC),
        publishing_s=0.1,
        repeated_s=repeated_s,
    )
    follower = seen.follower
    running = asyncio.create_task(keep_running("server", follower.run, follower.lost))
    try:
        yield seen
        assert not running.done()
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running


@pytest.fixture(autouse=True)
def hurried(monkeypatch):
    monkeypatch.setattr(supervision, "FIRST_PAUSE_S", 0.1)
    monkeypatch.setattr(supervision, "LONGEST_PAUSE_S", 0.5)
    monkeypatch.setattr(opcua_client, "LOOK_EVERY_S", 0.3)
    monkeypatch.setattr(opcua_client, "KEEP_ALIVE_S", 0.5)


@pytest.fixture(scope="module")
def process():
    server = ExampleServer(free_port())
    yield server
    server.kill()


@pytest.fixture
def server(process):
    """A server with three nodes, running."""
    if process.process is None:
        process.start()
    process.go_on()
    process.say("clear")
    process.say("add", "X", 21.5)
    process.say("add", "Z", 68.0)
    process.say("add", "Speed", 8000, kind="Int32")
    return process


FOLLOWED = {
    "x-middle": Followed("ns=2;s=X"),
    "z-column": Followed(f"nsu={URI};s=Z", TemperatureTable(unit="FAHRENHEIT")),
    "spindle_rpm": Followed("ns=2;s=Speed", temperature=None),
}
BEGUN = {"x-middle": 21.5, "z-column": pytest.approx(20.0), "spindle_rpm": 8000.0}


def test_what_a_server_says_is_a_number_or_words():
    def said(value, kind="Double", status="Good"):
        code = ua.StatusCode(getattr(ua.StatusCodes, status))
        return observe(ua.DataValue(Value=ua.Variant(value, ua.VariantType[kind]), StatusCode=code))

    assert said(21.5) == Observed(21.5)
    assert said(7, "UInt64") == Observed(7.0)
    assert said(1.0, status="GoodClamped").value == 1.0
    for found, words in (
        (said(21.5, status="BadSensorFailure"), "got BadSensorFailure from the server"),
        (said(21.5, status="UncertainLastUsableValue"), "got UncertainLastUsableValue"),
        (said(float("nan")), "expected a finite number, got nan"),
        (said(float("-inf"), "Float"), "expected a finite number, got -inf"),
        (said(True, "Boolean"), "expected a number, got the Boolean True"),
        (said("21.5", "String"), "expected a number, got the String '21.5'"),
        (said([1.0, 2.0]), "expected one number, got an array of 2"),
        (observe(ua.DataValue()), "expected a number, got nothing"),
        (
            observe(ua.DataValue(StatusCode=ua.StatusCode(ua.UInt32(0x80FE0000)))),
            "got Bad (0x80FE0000) from the server",
        ),
    ):
        assert found.value is None
        assert words in found.words


def test_times_and_nodes_and_units_as_they_are_stated():
    stated = datetime(2026, 3, 1, 6, tzinfo=UTC)
    assert source_time(ua.DataValue(SourceTimestamp=stated)) == stated
    assert source_time(ua.DataValue()) is None
    # What stands for no time at all.
    assert source_time(ua.DataValue(SourceTimestamp=datetime(1601, 1, 1, tzinfo=UTC))) is None

    namespaces = ["http://opcfoundation.org/UA/", "urn:server", URI]
    assert node_of(f"nsu={URI};s=a;b=c", namespaces) == ua.NodeId("a;b=c", 2)
    assert node_of("ns=1;i=7", namespaces) == ua.NodeId(7, 1)
    assert "got 'urn:other'; it has: http://opcf" in node_of("nsu=urn:other;s=a", namespaces)
    assert "expected a node id" in node_of("g=7", namespaces)

    def unit(number, shown):
        return stated_unit(ua.EUInformation(UnitId=number, DisplayName=ua.LocalizedText(shown)))

    assert unit(4604232, "degF") == TemperatureUnit.FAHRENHEIT
    assert unit(-1, "°C") == TemperatureUnit.CELSIUS
    assert unit(5066068, "mm") == "mm"
    assert stated_unit(None) is None


@pytest.mark.slow
async def test_values_come_with_their_source_s_time_and_in_celsius(server):
    async with following(server.url, FOLLOWED) as seen:
        await seen.until(lambda: len(seen.known) == 3)
        assert seen.known == BEGUN
        # What held before is taken as of now: its source may have measured it long ago.
        assert {one.time for one in seen.taken} == {None}
        server.say("set", "X", 22.5, ago_s=2.0)
        await seen.until(lambda: seen.known["x-middle"] == 22.5)
        found = seen.taken[-1]
        assert timedelta(0) < datetime.now(UTC) - found.time - timedelta(seconds=2) < timedelta(60)
        # Its source's clock is ahead: that is said, and the value is taken as of now.
        server.say("set", "X", 23.5, ago_s=-3600)
        await seen.until(lambda: seen.known["x-middle"] == 23.5)
        assert seen.taken[-1] == NewValue("x-middle", 23.5)
        assert "x-middle: its source's clock is 35" in seen.follower.trouble
        server.say("set", "X", 24.5)
        await seen.until(lambda: seen.known["x-middle"] == 24.5)
        assert seen.follower.trouble == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"value": None, "status": "BadSensorFailure"}, "got BadSensorFailure"),
        ({"value": 99.0, "status": "UncertainSensorNotAccurate"}, "got UncertainSensorNotAccurate"),
        ({"value": [1.0, 2.0]}, "got an array of 2"),
        ({"value": float("nan")}, "got nan"),
    ],
)
async def test_what_is_no_good_number_takes_the_value_away(server, said, words):
    async with following(server.url, FOLLOWED) as seen:
        await seen.until(lambda: len(seen.known) == 3)
        server.say("set", "X", **said)
        await seen.until(lambda: seen.known["x-middle"] is None)
        assert "x-middle: expected" in seen.follower.trouble
        assert words in seen.follower.trouble
        server.say("set", "X", 22.0)
        await seen.until(lambda: seen.known["x-middle"] == 22.0)
        assert seen.follower.trouble == ""
        assert 99.0 not in [one.value for one in seen.taken]


@pytest.mark.slow
async def test_wrong_nodes_and_units_are_said_and_the_others_followed(server):
    server.say("add", "Stated", 300.0, unit=[4932940, "K"])
    server.say("add", "Length", 300.0, unit=[5066068, "mm"])
    server.say("add", "Text", "hot", kind="String")
    server.say("add", "Flag", True, kind="Boolean")
    followed = FOLLOWED | {
        "gone": Followed("ns=2;s=Nowhere"),
        "elsewhere": Followed("nsu=urn:other;s=X"),
        "folder": Followed("i=85"),
        "stated": Followed("ns=2;s=Stated"),
        "swapped": Followed("ns=2;s=Stated", TemperatureTable(unit="CELSIUS")),
        "length": Followed("ns=2;s=Length"),
        "text": Followed("ns=2;s=Text"),
        "flag": Followed("ns=2;s=Flag", temperature=None),
    }
    async with following(server.url, followed) as seen:
        await seen.until(lambda: len(seen.known) == 7)
        assert seen.known["stated"] == pytest.approx(26.85)
        assert seen.known["swapped"] == 300.0
        # Values may be published before the answer is read that refuses a node.
        await seen.until(lambda: "gone" in seen.follower._trouble.of)
        everything = {**seen.follower._trouble.of, **seen.follower._trouble.contradicted}
        for name, words in (
            ("gone", "got BadNodeIdUnknown for ns=2;s=Nowhere"),
            ("elsewhere", "expected a namespace of the server, got 'urn:other'"),
            ("folder", "got BadAttributeIdInvalid for i=85"),
            ("swapped", "expected CELSIUS as configured, got KELVIN from the server"),
            ("length", "expected a unit of temperature, got 'mm' from the server"),
            ("text", "expected a number, got the String 'hot'"),
            ("flag", "expected a number, got the Boolean True"),
        ):
            assert words in everything[name]
        # One that comes later is followed from then on.
        server.say("add", "Nowhere", 19.0)
        await seen.until(lambda: seen.known.get("gone") == 19.0)


@pytest.mark.slow
async def test_what_does_not_change_is_repeated_only_while_it_is_known_to_hold(server, monkeypatch):
    monkeypatch.setattr(opcua_session, "ANSWER_S", 1.0)
    monkeypatch.setattr(opcua_session, "GOODBYE_S", 0.2)
    async with following(server.url, FOLLOWED, repeated_s=0.5) as seen:
        await seen.until(lambda: len(seen.taken) >= 12)
        assert [one for one in seen.taken if one is None] == []
        assert {one.time for one in seen.taken} == {None}
        server.hang()
        await seen.until(lambda: not seen.follower.is_connected)
        assert seen.known == {}
        begun = len(seen.taken)
        await asyncio.sleep(1.0)
        assert len(seen.taken) == begun
        server.go_on()
        await seen.until(lambda: seen.known == BEGUN)


@pytest.mark.slow
async def test_a_server_killed_and_started_again_with_other_nodes(server):
    async with following(server.url, FOLLOWED) as seen:
        await seen.until(lambda: len(seen.known) == 3)
        server.kill()
        await seen.until(lambda: None in seen.taken)
        assert seen.known == {}
        await seen.until(lambda: "contact was lost" not in seen.follower.trouble)
        assert seen.follower.trouble
        server.start()
        server.say("add", "Y", 30.0)
        await seen.until(lambda: "BadNodeIdUnknown for ns=2;s=X" in seen.follower.trouble)
        assert seen.known == {}
        server.say("add", "X", 31.0)
        await seen.until(lambda: seen.known == {"x-middle": 31.0})


@pytest.mark.slow
async def test_a_server_that_is_not_there_at_first(server):
    server.kill()
    async with following(server.url, FOLLOWED) as seen:
        await seen.until(lambda: "Connect call failed" in seen.follower.trouble)
        server.start()
        server.say("add", "X", 21.5)
        await seen.until(lambda: seen.known.get("x-middle") == 21.5)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["delete_subscriptions", "deafen"])
async def test_a_subscription_that_dies_unnoticed_is_replaced(server, monkeypatch, command):
    monkeypatch.setattr(opcua_client, "ANSWER_S", 0.5)
    async with following(server.url, FOLLOWED) as seen:
        await seen.until(lambda: len(seen.known) == 3)
        server.say(command)
        server.say("set", "X", 25.0)
        await seen.until(lambda: seen.known.get("x-middle") == 25.0)
        assert seen.follower.died == 1
        server.say("set", "X", 26.0)
        await seen.until(lambda: seen.known.get("x-middle") == 26.0)
        assert seen.follower.died == 1
        assert seen.follower.trouble == ""


@pytest.mark.slow
async def test_a_node_that_goes_and_comes_back(server):
    async with following(server.url, FOLLOWED) as seen:
        await seen.until(lambda: len(seen.known) == 3)
        server.say("delete", "X")
        await seen.until(lambda: "BadNodeIdUnknown for ns=2;s=X" in seen.follower.trouble)
        assert "x-middle" not in seen.known
        server.say("add", "X", 27.0)
        await seen.until(lambda: seen.known.get("x-middle") == 27.0)


async def test_nonsense_instead_of_a_server():
    async def answer(reader, writer):
        writer.write(b"HTTP/1.1 400 Bad Request\r\n\r\n" * 100)
        await writer.drain()
        writer.close()

    listening = await asyncio.start_server(answer, "127.0.0.1", 0)
    port = listening.sockets[0].getsockname()[1]
    async with listening, following(f"opc.tcp://127.0.0.1:{port}", FOLLOWED) as seen:
        await seen.until(lambda: seen.follower.trouble != "")
        assert seen.taken == []
