"""Following an MTConnect agent: nothing twice, nothing lost without being counted and said."""

import asyncio
import logging
import threading
from contextlib import asynccontextmanager, suppress

import httpx
import pytest

pytest.importorskip("defusedxml", reason="the extra mtconnect is not installed")

from app.connections import mtconnect_agent
from app.connections.connection import TemperatureTable
from app.connections.follower import Followed
from app.connections.mtconnect import AgentFollower
from app.connections.mtconnect_agent import Agent, Parts
from app.connections.mtconnect_documents import (
    AgentRefused,
    NotMtconnect,
    read_probe,
    read_streams,
)
from app.supervision import keep_running
from tests.connections.mtconnect_agent_example import (
    BOMB,
    NEW_ERROR,
    OLD_ERROR,
    ExampleAgent,
    listening,
)

pytestmark = pytest.mark.anyio

FOLLOWED = {
    "spindle": Followed("t1"),
    "column": Followed("column_t"),
    "speed": Followed("Srpm", temperature=None),
}


@pytest.fixture
def agent():
    agent = ExampleAgent()
    agent.observe("t1", "21.5")
    agent.observe("t2", "68")
    agent.observe("s1", "8000")
    return agent


@pytest.fixture(autouse=True)
def hurried(monkeypatch):
    monkeypatch.setattr("app.supervision.FIRST_PAUSE_S", 0.02)
    monkeypatch.setattr("app.supervision.LONGEST_PAUSE_S", 0.05)


class Following:
    """What was taken, in order; None where contact was lost."""

    def __init__(self):
        self.taken = []

    def take(self, found):
        self.taken += [(one.name, one.value) for one in found] or [None]

    async def until(self, is_so):
        async with asyncio.timeout(30):
            while not is_so():
                await asyncio.sleep(0.01)


@asynccontextmanager
async def following(url, followed=FOLLOWED, **options):
    seen = Following()
    async with httpx.AsyncClient(trust_env=False, timeout=5) as http:
        seen.follower = AgentFollower(
            Agent(http, url), followed, seen.take, **{"every_s": 0.02, **options}
        )
        follower = seen.follower
        running = asyncio.create_task(keep_running("agent", follower.run, follower.lost))
        try:
            yield seen
            assert not running.done()
        finally:
            running.cancel()
            with suppress(asyncio.CancelledError):
                await running


@pytest.mark.parametrize("version", ["1.3", "1.8", "2.3"])
@pytest.mark.parametrize("is_streamed", [False, True])
async def test_values_come_once_in_order_and_in_celsius(agent, version, is_streamed):
    agent.version = version
    with listening(agent) as url:
        async with following(url, is_streamed=is_streamed) as seen:
            await seen.until(lambda: len(seen.taken) == 3)
            # 68 °F are 20 °C by definition.
            assert dict(seen.taken) == {
                "spindle": 21.5,
                "column": pytest.approx(20.0),
                "speed": 8000.0,
            }
            agent.observe("t1", "22.0")
            agent.observe("t1", "UNAVAILABLE")
            agent.observe("t1", "22.5")
            await seen.until(lambda: len(seen.taken) == 6)
            await asyncio.sleep(0.1)
            assert seen.taken[3:] == [("spindle", 22.0), ("spindle", None), ("spindle", 22.5)]
            assert seen.follower.trouble == ""


@pytest.mark.parametrize("error", [OLD_ERROR, NEW_ERROR], ids=["1.3", "2.6"])
async def test_a_gap_is_counted_and_said(agent, caplog, error):
    agent.error = error
    with listening(agent) as url, caplog.at_level(logging.WARNING, "thermap"):
        async with following(url) as seen:
            await seen.until(lambda: "sample" in agent.asked)
            # All at once, so that none of it is asked for in between: 20 of a buffer of 8.
            agent.all = agent.all + [(4 + i, "t1", f"{30 + i}") for i in range(20)]
            await seen.until(lambda: ("spindle", 49.0) in seen.taken)
            assert (seen.follower.place.gaps, seen.follower.place.lost) == (1, 20)
            assert "20 observations of the agent" in caplog.text


async def test_a_restart_is_noticed_and_its_values_are_taken(agent, caplog):
    with listening(agent) as url, caplog.at_level(logging.WARNING, "thermap"):
        async with following(url) as seen:
            await seen.until(lambda: len(seen.taken) == 3)
            other = [(1, "t1", "25.0"), (2, "s1", "0"), (3, "t2", "UNAVAILABLE")]
            # The new instance has as many observations: only its id tells it from the old one.
            agent.instance, agent.all = 2, other
            await seen.until(lambda: len(seen.taken) >= 6)
            assert seen.taken[3:6] == [("spindle", 25.0), ("speed", 0.0), ("column", None)]
            assert seen.follower.place.restarts == 1
            assert "the agent restarted (instanceId 1 became 2)" in caplog.text


@pytest.mark.parametrize(
    ("instead", "words"),
    [
        ("<html>Login</html>", "expected MTConnect"),
        (BOMB, "document type"),
        (b"\xff\xfe\x00garbage", "expected MTConnect"),
        ("", "and nothing"),
        ("<MTConnectStreams><Header instanceId='x'/></MTConnectStreams>", "expected MTConnect"),
    ],
)
async def test_nonsense_is_said_contact_lost_and_found_again(agent, instead, words):
    with listening(agent) as url:
        async with following(url) as seen:
            await seen.until(lambda: len(seen.taken) == 3)
            agent.instead = instead
            await seen.until(lambda: None in seen.taken)
            await seen.until(lambda: words in seen.follower.trouble)
            agent.instead = None
            await seen.until(lambda: len(seen.taken) == 7)
            assert seen.follower.trouble == ""


async def test_a_huge_answer_is_not_read_to_its_end(agent, monkeypatch):
    monkeypatch.setattr(mtconnect_agent, "LARGEST_DOCUMENT", 1 << 20)
    agent.instead = b"<MTConnectDevices>" + b" " * (8 << 20)
    with listening(agent) as url:
        async with following(url) as seen:
            await seen.until(lambda: "at most 1 MiB" in seen.follower.trouble)
    with pytest.raises(NotMtconnect, match="at most 1 MiB"):
        list(Parts("abc").feed(b"--abc\r\nContent-length: 9999999\r\n\r\n"))


async def test_a_long_document_is_read_beside_the_event_loop(agent, monkeypatch):
    where = []

    def read(content):
        where.append((len(content) > mtconnect_agent.SHORT_DOCUMENT, threading.get_ident()))
        return read_probe(content)

    monkeypatch.setattr(mtconnect_agent, "read_probe", read)
    agent.instead = b"<a>" * 100_000
    with listening(agent) as url:
        async with following(url) as seen:
            await seen.until(lambda: "expected MTConnectDevices" in seen.follower.trouble)
            assert where[0][0] is True
            assert where[0][1] != threading.get_ident()
            agent.instead = None
            await seen.until(lambda: len(seen.taken) >= 3)
            assert where[-1] == (False, threading.get_ident())


async def test_an_agent_that_goes_and_comes_back(agent):
    with listening(agent) as url:
        async with following(url) as seen:
            await seen.until(lambda: len(seen.taken) == 3)
    port = int(url.rpartition(":")[2])
    async with following(url) as seen:
        await seen.until(lambda: seen.follower.trouble != "")
        assert seen.taken == []
        with listening(agent, port):
            await seen.until(lambda: len(seen.taken) == 3)


async def test_what_cannot_be_followed_is_said(agent):
    followed = {
        "spindle": Followed("nonesuch"),
        "load": Followed("twice", temperature=None),
        "speed": Followed("s1"),
        "column": Followed("t2", TemperatureTable(unit="CELSIUS")),
    }
    with listening(agent) as url:
        async with following(url, followed) as seen:
            await seen.until(lambda: len(seen.taken) == 1)
            for words in (
                "spindle: expected the id or name of one, got 'nonesuch': no data item has that",
                "load: expected the id or name of one, got 'twice': 2 data items have it",
                "speed: expected a unit of temperature, got 'REVOLUTION/MINUTE'",
                "column: expected CELSIUS as configured, got FAHRENHEIT from the agent",
            ):
                assert words in seen.follower.trouble
            assert seen.taken == [("column", 68.0)]


async def test_a_value_that_is_no_number_is_missing(agent):
    with listening(agent) as url:
        async with following(url) as seen:
            await seen.until(lambda: len(seen.taken) == 3)
            for text in ("21,5", "NaN", "1 2 3"):
                agent.observe("t1", text)
            await seen.until(lambda: len(seen.taken) == 6)
            assert seen.taken[3:] == [("spindle", None)] * 3
            assert seen.follower.unreadable == 3


def test_parts_come_out_however_they_are_cut():
    documents = [b"<a>1</a>", b"<b/>", b"<c>--</c>"]
    body = b"".join(
        b"--abc\r\nContent-type: text/xml\r\nContent-length: %d\r\n\r\n%b\r\n" % (len(one), one)
        for one in documents
    )
    for size in range(1, len(body)):
        parts = Parts("abc")
        found = [one for at in range(0, len(body), size) for one in parts.feed(body[at:][:size])]
        assert found == documents
    without_length = b"".join(b"--abc\r\nA: b\r\n\r\n%b\r\n" % one for one in documents[:2])
    assert list(Parts("abc").feed(without_length + b"--abc")) == documents[:2]


def test_an_error_document_names_its_codes():
    for error in (OLD_ERROR, NEW_ERROR):
        with pytest.raises(AgentRefused, match="OUT_OF_RANGE: 'from' must be greater") as caught:
            read_streams(error.encode())
        assert caught.value.is_out_of_range
        assert "http" not in str(caught.value)
        about_count = error.replace("'from' must be greater", "'count' must be less")
        with pytest.raises(AgentRefused) as caught:
            read_streams(about_count.encode())
        # Taken for a gap it would be asked for again and again, and observations counted as lost.
        assert not caught.value.is_out_of_range


# What cppagent writes, in its order of elements and attributes: a stylesheet, the namespace twice,
# the agent as a device of its own, sequences from 2^48 on, and values of every representation.
BEGIN = 2**48 + 1
SAMPLES = """<?xml version="1.0" encoding="UTF-8"?>
<?xml-stylesheet type="text/xsl" href="/styles/styles.xsl"?>
<MTConnectStreams xmlns:m="urn:mtconnect.org:MTConnectStreams:{version}"
 xmlns="urn:mtconnect.org:MTConnectStreams:{version}" xmlns:x="urn:example.org:Streams:{version}"
 xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
 xsi:schemaLocation="urn:mtconnect.org:MTConnectStreams:{version} /schemas/Streams.xsd">
<Header creationTime="2026-03-01T06:00:10Z" sender="host" instanceId="1772344800"
 version="{version}" deviceModelChangeTime="2026-03-01T05:00:00Z" bufferSize="131072"
 nextSequence="{next}" firstSequence="{first}" lastSequence="{last}"/>
<Streams>
<DeviceStream name="Agent" uuid="a1"><ComponentStream component="Agent" componentId="a"><Events>
<AgentAvail dataItemId="av" timestamp="2026-03-01T06:00:00.5Z" sequence="{first}">AVAILABLE
</AgentAvail></Events></ComponentStream></DeviceStream>
<DeviceStream name="VMC" uuid="d1"><ComponentStream component="Linear" name="X" componentId="x">
<Samples>
<Temperature dataItemId="t1" timestamp="2026-03-01T06:00:01.123456Z" name="Xtemp" sequence="{s1}"
 compositionId="m">2.15e1</Temperature>
<Temperature dataItemId="t2" timestamp="2026-03-01T06:00:02Z@60.0" sequence="{s2}"
 statistic="AVERAGE" duration="60.0">20.25</Temperature>
<TemperatureTimeSeries dataItemId="t3" timestamp="2026-03-01T06:00:03Z" sequence="{s3}"
 sampleCount="2" sampleRate="10">21.5 21.6</TemperatureTimeSeries>
<x:Heat dataItemId="t4" timestamp="2026-03-01T06:00:04Z" sequence="{s4}">4</x:Heat>
<Temperature dataItemId="t5" timestamp="2026-03-01T06:00:05Z" sequence="{s5}">UNAVAILABLE
</Temperature></Samples>
<Events><VariableDataSet dataItemId="v" timestamp="2026-03-01T06:00:06Z" sequence="{s6}" count="1"
 resetTriggered="NEW"><Entry key="a1">7</Entry></VariableDataSet></Events>
<Condition><Fault dataItemId="c" timestamp="2026-03-01T06:00:07Z" sequence="{s7}" type="TEMPERATURE"
 nativeCode="500" qualifier="HIGH">hot &amp; &lt;dry&gt;</Fault></Condition>
</ComponentStream></DeviceStream></Streams></MTConnectStreams>"""


@pytest.mark.parametrize("version", ["1.3", "1.5", "1.7", "2.0", "2.3", "2.7"])
def test_documents_as_cppagent_writes_them(version):
    numbers = {f"s{i}": BEGIN + i for i in range(1, 8)}
    document = SAMPLES.format(
        version=version, first=BEGIN, last=BEGIN + 7, next=BEGIN + 8, **numbers
    )
    streams = read_streams(document.encode())
    assert (streams.instance_id, streams.buffer_size) == (1772344800, 131072)
    assert (streams.first_sequence, streams.next_sequence) == (BEGIN, BEGIN + 8)
    assert [one.sequence for one in streams.observations] == list(range(BEGIN, BEGIN + 8))
    by_item = {one.item: one for one in streams.observations}
    values = {item: one.value for item, one in by_item.items()}
    # A series, a set and a condition are no one number; the last temperature is not available.
    assert values == dict.fromkeys(("av", "t3", "t5", "v", "c")) | {
        "t1": 21.5,
        "t2": 20.25,
        "t4": 4.0,
    }
    assert [item for item, one in by_item.items() if one.is_unavailable] == ["t5"]


async def test_no_more_is_asked_for_than_an_agent_keeps(agent):
    with listening(agent) as url:
        async with following(url) as seen:
            await seen.until(lambda: agent.asked.count("sample") > 2)
            assert seen.follower.agent.most_at_once == agent.size
            # All that comes is read in the sequence: nothing is asked for anew.
            assert agent.asked.count("current") == 1
            assert seen.follower.place.lost == 0
