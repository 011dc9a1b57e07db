"""What topics match and payloads say, without a broker."""

import math
from datetime import UTC, datetime

import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")

from app.connections.mqtt_payloads import (
    JsonPath,
    TimeForm,
    Unusable,
    number_at,
    read_text,
    time_at,
)
from app.connections.mqtt_readers import read_message
from app.connections.mqtt_tables import TopicTable
from app.connections.mqtt_topics import TopicPattern
from app.connections.sparkplug_nodes import Nodes, Place
from app.connections.sparkplug_payload import _PAYLOAD, read_payload, rebirth_command, signed


@pytest.mark.parametrize(
    ("pattern", "topic", "found"),
    [
        ("a/b", "a/b", {}),
        ("a/b", "a/b/c", None),
        ("a/b", "a", None),
        ("a/+", "a/", {}),
        ("a/+", "a", None),
        ("a/#", "a", {}),
        ("a/#", "a/b/c", {}),
        ("#", "a/b", {}),
        ("#", "$SYS/uptime", None),
        ("+/uptime", "$SYS/uptime", None),
        ("$SYS/#", "$SYS/uptime", {}),
        ("shop/{machine}/+/{sensor}", "shop/vmc/t/x", {"machine": "vmc", "sensor": "x"}),
        ("$share/g/{machine}/#", "vmc/x", {"machine": "vmc"}),
    ],
)
def test_topics_match_as_the_protocol_says(pattern, topic, found):
    assert TopicPattern.parse(pattern).match(topic) == found


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        ("", "expected a topic"),
        ("a/b+", "as whole levels"),
        ("a/#/b", "as the last level"),
        ("a/{m}", "expected {machine} or {sensor}"),
        ("a/x{machine}", "as a whole level"),
        ("{machine}/{machine}", "expected {machine} once"),
        ("$share/g", "expected a topic"),
        ("$share//a", "expected $share/GROUP/TOPIC"),
        ("$share/+/a", "expected $share/GROUP/TOPIC"),
        ("a\0b", "at most"),
    ],
)
def test_a_filter_that_is_none_is_refused(pattern, words):
    with pytest.raises(ValueError) as refused:
        TopicPattern.parse(pattern)
    assert words in str(refused.value)


def test_what_the_broker_is_asked_for():
    assert TopicPattern.parse("$share/g/shop/{machine}/#").filter == "$share/g/shop/+/#"
    assert TopicPattern.parse("shop/+/{sensor}").filter == "shop/+/+"


@pytest.mark.parametrize(("text", "value"), [(b"21.5", 21.5), (b" -3e1\n", -30.0), (b".5", 0.5)])
def test_a_plain_number(text, value):
    assert read_text(text) == value


@pytest.mark.parametrize(
    "text", [b"", b"21,5", b"NaN", b"inf", b"1_0", b"0x10", b"21.5 C", b"\xff\xfe", b"1" * 300]
)
def test_what_is_no_number_is_refused(text):
    with pytest.raises(Unusable, match="expected a number"):
        read_text(text)


def table(**keys):
    return TopicTable.model_validate({"topic": "t", "machine": "vmc", **keys})


def test_one_number_of_a_document_and_its_time():
    asked = table(sensor="x", value="d.t[1]", unit="FAHRENHEIT", time="d.ts", time_form="epoch_ms")
    said = read_message(asked, {}, b'{"d": {"t": [0, 212.0], "ts": 1772344800000}}')
    assert said.temperatures_c == {"x": pytest.approx(100.0)}
    assert said.time == datetime(2026, 3, 1, 6, tzinfo=UTC)


def test_many_numbers_of_a_document_of_which_one_is_wrong():
    asked = table(
        sensors={"x": "x", "y": {"path": 'temps["y.1"]', "unit": "KELVIN"}, "z": "z", "w": "w"},
        state={"spindle_rpm": "rpm"},
    )
    said = read_message(
        asked, {}, b'{"x": "21.5", "temps": {"y.1": 300.15}, "z": true, "rpm": 8000, "w": null}'
    )
    assert said.temperatures_c == {"x": 21.5, "y": pytest.approx(27.0)}
    assert said.state == {"spindle_rpm": 8000.0}
    assert said.wrong == ("z: expected a number at z, got true",)


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"{", "expected JSON"),
        (b"[1]", "expected a number at v, got nothing"),
        (b'{"v": [1]}', "expected a number at v, got a list of 1"),
        (b'{"v": 21, "ts": "2026-03-01T06:00:00"}', "with its zone at ts"),
        (b'{"v": 21, "ts": 5}', "ISO 8601"),
        (b'{"v": 21}', "ISO 8601"),
        (b'{"v": "21,5"}', "expected a number"),
    ],
)
def test_a_document_that_cannot_be_used_says_why(payload, words):
    with pytest.raises(Unusable) as refused:
        read_message(table(sensor="x", value="v", time="ts"), {}, payload)
    assert words in refused.value.detail


@pytest.mark.parametrize("path", ["", "a..b", ".a", "a[", "a[x]", "a b]"])
def test_a_path_that_is_none_is_refused(path):
    with pytest.raises(ValueError, match="expected a path"):
        JsonPath.parse(path)


@pytest.mark.slow
@given(st.recursive(st.none() | st.booleans() | st.floats() | st.text(), st.lists))
def test_any_document_gives_a_number_a_refusal_or_nothing(value):
    document = orjson.loads(orjson.dumps({"v": value, "t": value}))
    for read in (
        lambda: number_at(document, JsonPath.parse("v")),
        *(lambda form=form: time_at(document, JsonPath.parse("t"), form) for form in TimeForm),
    ):
        try:
            found = read()
        except Unusable:
            continue
        assert found is None or isinstance(found, float | datetime)


def payload(seq=None, *metrics):
    message = _PAYLOAD()
    if seq is not None:
        message.seq = seq
    for one in metrics:
        message.metrics.add(**one)
    return message.SerializeToString()


WANTED = {Place("g", "n", None), Place("g", "n", "d")}


def heard(nodes, topic, content):
    return [
        (one.place.device, one.is_gone, {m.name: m.value for m in one.metrics})
        for one in nodes.hear(f"spBv1.0/{topic}", content)
    ]


def test_aliases_of_a_birth_name_what_comes_later():
    nodes = Nodes(WANTED)
    birth = payload(0, {"name": "bdSeq", "long_value": 7}, {"name": "T", "alias": 3, "datatype": 3})
    assert heard(nodes, "g/NBIRTH/n", birth)[1][2]["T"] is None
    born = payload(1, {"name": "X", "alias": 4, "datatype": 1, "int_value": 251})
    assert heard(nodes, "g/DBIRTH/n/d", born) == [("d", True, {}), ("d", False, {"X": -5})]
    news = payload(2, {"alias": 3, "int_value": 2**32 - 2})
    assert heard(nodes, "g/NDATA/n", news) == [(None, False, {"T": -2})]
    news = payload(3, {"alias": 4, "int_value": 20})
    assert heard(nodes, "g/DDATA/n/d", news) == [("d", False, {"X": 20})]
    assert heard(nodes, "g/DDEATH/n/d", payload(4)) == [("d", True, {})]
    assert nodes.born == {("g", "n")}
    assert heard(nodes, "g/NDEATH/n", payload(None, {"name": "bdSeq", "long_value": 6})) == []
    assert heard(nodes, "g/NDEATH/n", payload(None, {"name": "bdSeq", "long_value": 7})) == [
        (None, True, {})
    ]
    assert (nodes.lost, nodes.born) == (0, set())


def test_numbers_go_round_and_a_gap_takes_everything_away():
    nodes = Nodes(WANTED)
    heard(nodes, "g/NBIRTH/n", payload(0, {"name": "T", "alias": 3, "datatype": 9}))
    for seq in [*range(1, 256), 0]:
        news = payload(seq, {"alias": 3, "float_value": 21.5})
        assert heard(nodes, "g/NDATA/n", news) == [(None, False, {"T": 21.5})]
    late = payload(3, {"alias": 3, "float_value": 22.5}, {"name": "U", "float_value": 1.5})
    assert heard(nodes, "g/NDATA/n", late) == [(None, True, {}), (None, False, {"U": 1.5})]
    assert (nodes.lost, nodes.unsure) == (2, {("g", "n")})
    heard(nodes, "g/NBIRTH/n", payload(0, {"name": "T", "alias": 3, "datatype": 9}))
    assert nodes.unsure == set()


def test_of_what_is_not_followed_nothing_is_remembered():
    nodes = Nodes({Place("g", "n", None)})
    heard(nodes, "g/NBIRTH/n", payload(0, {"name": "T", "alias": 3, "datatype": 9}))
    for i in range(20):
        heard(nodes, f"g/DBIRTH/n/d{i}", payload(i + 1, {"name": f"X{i}", "alias": i}))
        assert heard(nodes, f"g/NBIRTH/other{i}", payload(0, {"name": "T", "alias": 3})) == []
    (node,) = nodes._nodes.values()
    assert len(node.aliases) == len(node.datatypes) == 1
    assert heard(nodes, "g/NDATA/n", payload(21, {"alias": 3, "float_value": 2.0})) == [
        (None, False, {"T": 2.0})
    ]


def test_more_metrics_than_any_node_has_are_refused():
    with pytest.raises(Unusable, match="expected at most 10000 metrics, got 10001"):
        read_payload(payload(0, *[{"alias": 1}] * 10_001))


def test_signed_numbers_and_the_command_for_a_birth():
    assert [signed(255, 1), signed(2**64 - 1, 4), signed(200, 5), signed(1.5, 9)] == [
        -1,
        -1,
        200,
        1.5,
    ]
    (metric,) = read_payload(rebirth_command()).metrics
    assert (metric.name, metric.datatype) == ("Node Control/Rebirth", 11)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_payload_or_refused(content):
    try:
        found = read_payload(content)
    except Unusable:
        return
    assert all(one.value is None or math.isfinite(one.value) for one in found.metrics)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(
                ["NBIRTH/n", "NDATA/n", "NDEATH/n", "DBIRTH/n/d", "DDATA/n/d", "X/n", "n"]
            ),
            st.none() | st.integers(0, 300),
            st.lists(
                st.fixed_dictionaries(
                    {},
                    optional={
                        "name": st.sampled_from(["T", "bdSeq", ""]),
                        "alias": st.integers(0, 2),
                        "datatype": st.integers(0, 40),
                        "int_value": st.integers(0, 2**32 - 1),
                        "timestamp": st.integers(0, 2**64 - 1),
                    },
                ),
                max_size=3,
            ),
        )
    )
)
def test_any_sequence_of_messages_is_heard_or_refused(messages):
    nodes = Nodes(WANTED)
    for topic, seq, metrics in messages:
        try:
            heard(nodes, f"g/{topic}", payload(seq, *metrics))
        except Unusable:
            continue
    assert nodes.lost >= 0
