"""What senders say of values that are none, in tenths, or without what tells old from new."""

import asyncio
import json

import pytest
from pydantic import ValidationError

pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")
pytest.importorskip("defusedxml", reason="the extra mtconnect is not installed")

from app.connections.config import read_connections
from app.connections.connection import TemperatureTable
from app.connections.mqtt_tables import SparkplugTable
from app.connections.sparkplug_follower import SparkplugFollower
from app.errors import InvalidContent
from tests.connections.mtconnect_agent_example import ExampleAgent, listening
from tests.connections.test_mqtt_limits import Messages, Taking, carry, connection_of
from tests.connections.test_mqtt_messages import payload
from tests.connections.test_mtconnect import following

pytestmark = pytest.mark.anyio

TWO = {"sensor": None, "sensors": {"x": '["DS18B20-1"].T', "y": '["DS18B20-2"].T'}}


def document(x, y):
    return json.dumps({"DS18B20-1": {"T": x}, "DS18B20-2": {"T": y}, "TempUnit": "C"}).encode()


async def told(payloads, **topic):
    """Give what is said after each message, with contact."""
    intake, said = Taking(), []
    connection = connection_of(intake, **topic)
    connection._link = type("Link", (), {"dropped": 0})
    for one in payloads:
        await connection._take_messages(Messages([one]))
        await asyncio.sleep(0)
        said.append(connection.now().trouble)
    return intake, said


async def test_null_is_named_at_once_and_until_there_is_a_number():
    given = [document(24.5, 23.5), document(None, 23.6), document(None, None), document(24.0, 23.7)]
    intake, said = await told(given, **TWO)
    x, y = (f"{name} of 'm': the sender says that it has no value (null)" for name in "xy")
    assert said == ["", x, f"{x}; {y}", ""]
    assert intake.offered == [{"x": 24.5, "y": 23.5}, {"y": 23.6}, {"x": 24.0, "y": 23.7}]
    assert intake.refused == []


async def test_null_of_one_sensor_is_named_and_what_is_not_there_is_refused():
    intake, said = await told([b'{"v": null}', b'{"w": 1}', b'{"v": 20}'], value="v")
    assert said[0] == said[1] == "x of 'm': the sender says that it has no value (null)"
    assert said[2] == ""
    assert intake.refused == ["expected a number at v, got nothing there"]


async def test_tenths_of_a_degree_have_a_factor():
    intake = await carry([b'{"t": 245}'], value="t", factor=0.1)
    assert intake.offered == [{"x": pytest.approx(24.5)}]
    intake = await carry([b"2931.5"], factor=0.1, unit="KELVIN")
    assert intake.offered == [{"x": pytest.approx(20.0)}]
    places = {"x": {"path": "t", "factor": 0.01, "unit": "FAHRENHEIT"}}
    intake = await carry([b'{"t": "6800"}'], sensor=None, sensors=places)
    assert intake.offered == [{"x": pytest.approx(20.0)}]


@pytest.mark.parametrize(
    ("stated", "raw", "expected"),
    [
        ({"factor": 0.1}, 243.0, 24.3),  # not 24.300000000000004
        ({"factor": 0.1, "unit": "FAHRENHEIT"}, 680.0, 20.0),
        ({"factor": 100.0 / 27648, "offset": -20.0}, 11059.2, 20.0),  # raw counts of a PLC
        ({"factor": -0.01, "offset": 120.0}, 9550.0, 24.5),  # a resistance that falls
        ({"offset": -0.35}, 20.85, 20.5),
        ({"offset": 250.0, "unit": "KELVIN"}, 43.15, 20.0),  # the offset is in the unit
    ],
)
async def test_raw_numbers_have_a_factor_and_an_offset(stated, raw, expected):
    assert TemperatureTable(**stated).to_c(raw) == expected
    intake = await carry([json.dumps({"t": raw}).encode()], value="t", **stated)
    assert intake.offered == [{"x": expected}]


@pytest.mark.parametrize("factor", [0.0, 1e7, float("nan"), float("inf")])
def test_a_factor_that_is_none_is_refused(factor):
    with pytest.raises(ValidationError, match="factor"):
        TemperatureTable(factor=factor)


@pytest.mark.parametrize(
    ("kind", "item"), [("mtconnect", 'item = "s"'), ("opcua", 'node = "ns=2;s=S"')]
)
def test_a_state_is_taken_as_it_is_and_no_factor_passed_over(tmp_path, kind, item):
    where = {"mtconnect": 'url = "http://h"', "opcua": 'endpoint = "opc.tcp://h"'}[kind]
    path = tmp_path / "thermap.toml"
    path.write_text(
        f'[[{kind}]]\nname = "a"\nmachine = "m"\n{where}\n[{kind}.sensors]\nx = {{ {item} }}\n'
        f"[{kind}.state]\nrpm = {{ {item}, factor = 0.1 }}\n"
    )
    with pytest.raises(InvalidContent, match=r"state\.rpm\.factor"):
        read_connections(path)


@pytest.mark.parametrize("text", ["２０", "２０．５", "٢٠", "2０.5"])
async def test_digits_of_other_scripts_are_refused(text):
    intake = await carry([text.encode(), json.dumps({"v": text}).encode()])
    intake_of_json = await carry([json.dumps({"v": text}).encode()], value="v")
    assert intake.offered == intake_of_json.offered == []
    assert "expected a number, got" in intake_of_json.refused[0]


def test_tenths_of_a_degree_by_sparkplug():
    intake = Taking()
    intake.offer = lambda _machine, temperatures_c, *_rest: intake.offered.append(temperatures_c)
    metric = {"metric": "T", "factor": 0.1}
    table = SparkplugTable(machine="m", group="g", node="n", sensors={"x": metric})
    birth = payload(0, {"name": "T", "datatype": 3, "int_value": 245})
    SparkplugFollower([table], intake).take("spBv1.0/g/NBIRTH/n", birth)
    assert intake.offered == [{"x": pytest.approx(24.5)}]


def test_what_a_node_says_that_is_no_value_is_named():
    follower = SparkplugFollower(
        [SparkplugTable(machine="m", group="g", node="n", sensors={"x": {"metric": "T"}})], Taking()
    )
    follower._followed[0][1]._intake.offer = lambda *_asked: None
    birth = payload(0, {"name": "T", "datatype": 10, "is_null": True})
    follower.take("spBv1.0/g/NBIRTH/n", birth)
    assert follower.absent == {("m", "x")}
    follower.take("spBv1.0/g/NDATA/n", payload(1, {"name": "T", "double_value": 21.0}))
    assert follower.absent == set()


def test_tenths_of_a_degree_by_opcua():
    pytest.importorskip("asyncua")
    from app.connections.follower import Followed
    from app.connections.opcua_client import ServerFollower
    from app.connections.opcua_observations import Observed
    from app.connections.opcua_session import Access

    follower = ServerFollower(
        Access("opc.tcp://h"),
        {"x": Followed("ns=2;s=X", TemperatureTable(factor=0.1))},
        lambda _found: None,
        lambda: None,
        publishing_s=1.0,
        repeated_s=10.0,
    )
    follower._choose_unit("x", None)
    assert follower._found("x", Observed(245.0), None).value == pytest.approx(24.5)


class Written(ExampleAgent):
    """An agent whose observations are written as it is told to."""

    element = ""

    def streams(self, rows):
        whole = super().streams(rows)
        begin, end = whole.index("<Samples>") + len("<Samples>"), whole.index("</Samples>")
        return whole if not self.element else whole[:begin] + self.element + whole[end:]


@pytest.mark.parametrize(
    ("element", "words"),
    [
        (
            '<Temperature dataItemId="t1" sequence="1">２０</Temperature>',
            "spindle: expected a number, got '２０'",
        ),
        (
            '<TemperatureDataSet dataItemId="t1" sequence="1" count="2"><Entry key="front">24.5'
            '</Entry><Entry key="rear">25.5</Entry></TemperatureDataSet>',
            "spindle: expected a number, got a data set or table with the keys front, rear",
        ),
        (
            '<Temperature dataItemId="t1" sequence="1">UNAVAILABLE</Temperature>',
            "spindle: the agent says that it has no value (UNAVAILABLE)",
        ),
        (
            '<Temperature dataItemId="t1">24.5</Temperature>',
            "1 observation of the agent had no sequence number",
        ),
    ],
)
async def test_what_an_agent_says_that_is_no_value_is_named(element, words):
    agent = Written()
    agent.element = element
    with listening(agent) as url:
        async with following(url) as seen:
            await seen.until(lambda: words in seen.follower.trouble)
            assert all(one is None or one[1] is None for one in seen.taken)
            agent.element = ""
            agent.observe("t1", "21.0")
            agent.observe("t2", "68")
            agent.observe("s1", "1")
            agent.restart()
            for item, text in (("t1", "21.5"), ("t2", "68"), ("s1", "1")):
                agent.observe(item, text)
            await seen.until(lambda: ("spindle", 21.5) in seen.taken)
            assert seen.follower.trouble == ""


def test_a_file_that_begins_with_a_byte_order_mark_is_read(tmp_path):
    path = tmp_path / "thermap.toml"
    text = '[[mtconnect]]\nname = "a"\nmachine = "m"\nurl = "http://127.0.0.1:1"\n'
    text += '[mtconnect.sensors]\nx = { item = "t", factor = 0.1 }\n'
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    (agent,) = read_connections(path).mtconnect
    assert agent.sensors["x"].factor == 0.1
