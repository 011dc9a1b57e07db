"""Messages of a broker and documents of an agent, mutated: refused, and nothing else is raised."""

import random

import pytest

pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")
pytest.importorskip("defusedxml", reason="the extra mtconnect is not installed")

from app.connections.mqtt_payloads import Unusable
from app.connections.mqtt_readers import read_message
from app.connections.mqtt_tables import TopicTable
from app.connections.mtconnect_agent import Parts
from app.connections.mtconnect_documents import AgentRefused, NotMtconnect, read_probe, read_streams
from app.connections.sparkplug_nodes import Nodes, Place
from app.connections.sparkplug_payload import _PAYLOAD
from tests.connections.mtconnect_agent_example import BOMB, NEW_ERROR, OLD_ERROR, PROBE, STREAMS
from tests.hostile.mutations import mutated

PIECES = [
    *(b"0001-01-01T00:00:00+01:00", b"9999-12-31T23:59:59-01:00", b"null", b"NaN", b"1e999"),
    *(b"-0", b"1" * 400, b"[" * 300, b'{"a":' * 300, b"\\ud800", b"\xff\xfe", b"\0", b"\x9b"),
    *(b"\r\n", b"\n\r\n", b"--", b"&a;", b"<!DOCTYPE x>", b"<Header/>", b"<?x?>", b"<!-- -->"),
    *(b"9" * 30, b"UNAVAILABLE", b'"', b"true", b"1.5e-5", b"Content-length: -1"),
]


def expect_short(refusals):
    assert refusals
    assert max(map(len, refusals)) < 2000


def topic_of(**stated):
    return TopicTable.model_validate({"topic": "t", "machine": "m", **stated})


TOPICS = [
    topic_of(sensor="x"),
    topic_of(sensor="x", value="v", unit="KELVIN"),
    topic_of(sensor="x", value="v[0].t", time="ts"),
    topic_of(sensor="x", value="v", time="ts", time_form="epoch_s"),
    topic_of(sensors={"x": "v", "y": {"path": '["a.b"].t', "unit": "FAHRENHEIT"}}, time="ts"),
    topic_of(sensors={"x": "v"}, state={"rpm": "rpm"}, time="ts", time_form="epoch_ms"),
]
DOCUMENTS = [
    b"21.5",
    b'{"v": 21.5, "ts": "2026-03-01T06:00:00+01:00", "rpm": 4000, "a.b": {"t": "70"}}',
    b'{"v": 21, "ts": 1772344795.25, "rpm": "4e3", "a.b": {"t": null}}',
    b'{"v": [{"t": -5.5}], "ts": "2026-03-01T06:00:00Z"}',
    b'{"v": null, "ts": 1772344795250}',
]


def test_payloads_of_ordinary_topics(hostile_inputs):
    random_, refusals, read = random.Random(28), [], 0
    for _ in range(hostile_inputs):
        table = random_.choice(TOPICS)
        try:
            stated = read_message(table, {}, mutated(random_, DOCUMENTS, PIECES))
        except Unusable as why:
            refusals.append(why.detail)
        else:
            read += 1
            assert stated.temperatures_c or stated.state or stated.without
    assert 0 < read < hostile_inputs
    expect_short(refusals)


def sparkplug():
    samples = []
    for seq in range(3):
        made = _PAYLOAD()
        made.seq = seq
        made.timestamp = 1772344795250
        made.metrics.add(name="T", alias=3, datatype=3, int_value=2**32 - 2)
        made.metrics.add(name="bdSeq", long_value=2**64 - 1, timestamp=2**64 - 1)
        made.metrics.add(alias=3, double_value=float("nan"), is_historical=True)
        made.metrics.add(alias=4, float_value=float("inf"), datatype=1, is_null=True)
        samples.append(made.SerializeToString())
    return samples


def test_payloads_of_sparkplug(hostile_inputs):
    random_, samples, refusals, heard = random.Random(28), sparkplug(), [], 0
    nodes = Nodes({Place("g", "n", None), Place("g", "n", "d")})
    kinds = ["NBIRTH/n", "NDATA/n", "NDEATH/n", "DBIRTH/n/d", "DDATA/n/d", "DDEATH/n/d", "NCMD/n"]
    for _ in range(hostile_inputs):
        kind = random_.choice([*kinds, "", "X/n", "NDATA/n/d/e", "STATE/n"])
        try:
            heard += len(list(nodes.hear(f"spBv1.0/g/{kind}", mutated(random_, samples, PIECES))))
        except Unusable as why:
            refusals.append(why.detail)
    assert heard > 0
    assert len(nodes._nodes) == 1
    expect_short(refusals)


AGENT = [
    PROBE.format(version="1.3", instance=1).encode(),
    *(
        STREAMS.format(
            version=version, instance=1, first=1, last=3, next=4, observations=observations
        ).encode()
        for version in ("1.3", "2.5")
        for observations in (
            '<Temperature dataItemId="t1" sequence="1" timestamp="0001-01-01T00:00:00+01:00">21.5'
            "</Temperature>",
            '<TemperatureDataSet dataItemId="t1" sequence="2" count="1"><Entry key="a">1</Entry>'
            "</TemperatureDataSet><Temperature dataItemId='t2'>UNAVAILABLE</Temperature>",
        )
    ),
    OLD_ERROR.encode(),
    NEW_ERROR.encode(),
    BOMB.encode(),
]


def test_documents_of_an_agent(hostile_inputs):
    random_, refusals, read = random.Random(28), [], 0
    for _ in range(hostile_inputs):
        content = mutated(random_, AGENT, PIECES)
        for reader in (read_streams, read_probe):
            try:
                reader(content)
            except (NotMtconnect, AgentRefused) as why:
                refusals.append(why.detail)
            else:
                read += 1
    assert read > 0
    expect_short(refusals)


HEADS = [
    b"--b\r\nContent-type: text/xml\r\nContent-length: 5\r\n\r\n<a/>\n",
    b"--b\nContent-Length:5\n\n<a/>\n",
    b"--b\r\nContent-type: text/xml\n\r\n<a/>\r\n",
    b"\r\n\r\n--b\r\n\r\n<a/>\n",
    b"--b--\r\n",
]


def test_parts_of_a_stream(hostile_inputs):
    random_, refusals, documents = random.Random(28), [], 0
    for _ in range(hostile_inputs):
        parts = Parts("b")
        content = b"".join(mutated(random_, HEADS, PIECES) for _ in range(random_.randint(1, 6)))
        try:
            while content:
                length = random_.randint(1, len(content))
                documents += len(list(parts.feed(content[:length])))
                content = content[length:]
        except NotMtconnect as why:
            refusals.append(why.detail)
    assert documents > 0
    expect_short(refusals)


@pytest.mark.parametrize("end", [b"\r\n\r\n", b"\n\n", b"\n\r\n"])
def test_however_a_header_ends_its_document_is_read(end):
    given = b"--b\r\nContent-length: 4" + end + b"<a/>"
    assert list(Parts("b").feed(given)) == [b"<a/>"]
