"""From an agent to the table over HTTP, by the file of connections."""

import asyncio
import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

pytest.importorskip("defusedxml", reason="the extra mtconnect is not installed")
pytest.importorskip("paho.mqtt", reason="the extra mqtt is not installed")

from app.connections.config import read_connections
from app.connections.mtconnect_connection import AgentConnection, MtconnectTable
from app.errors import InvalidContent
from app.main import create_app
from app.settings import Settings
from tests.connections.certificates import write_application, write_certificates
from tests.connections.mtconnect_agent_example import ExampleAgent, listening
from tests.connections.opcua_server_example import example_server, free_port
from tests.service_examples import ROOM, client_of, furnish_database

pytestmark = pytest.mark.anyio

EXAMPLE = Path(__file__).parents[2] / "examples" / "thermap.toml"


def file_of(tmp_path, text):
    path = tmp_path / "thermap.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_example_is_a_file_of_connections(tmp_path, monkeypatch):
    write_application(tmp_path, "thermap", "urn:thermap")
    write_application(tmp_path, "press", "urn:press")
    (tmp_path / "trusted").mkdir()
    monkeypatch.setenv("THERMAP_PLC_PASSWORD", "secret")
    monkeypatch.setenv("THERMAP_PRESS_PASSWORD", "secret")
    monkeypatch.setenv("THERMAP_MQTT_PASSWORD", "secret")
    monkeypatch.setenv("THERMAP_NOTIFY_URL", "jsons://chat.example.org/token")
    write_certificates(tmp_path)
    for name, given in (("server.pem", "thermap-1.pem"), ("server.key", "thermap-1.key")):
        (tmp_path / name).rename(tmp_path / given)
    found = read_connections(file_of(tmp_path, EXAMPLE.read_text(encoding="utf-8")))
    (agent,) = found.mtconnect
    assert agent.sensors["x-middle"].source == "Xtemp"
    assert agent.sensors["z-column"].unit == "FAHRENHEIT"
    assert agent.state["spindle_rpm"].source == "Srpm"
    (server,) = found.opcua
    assert server.sensors["ram"].source == "ns=2;s=Temperatures.Ram"
    assert server.sensors["bed"].unit == "KELVIN"
    assert server.access.password == "secret"
    assert server.access.security.server_certificate == tmp_path / "press.der"
    assert found.opcua_server.modes == ("Sign", "SignAndEncrypt")
    assert found.opcua_server.users[0].password == "secret"
    (broker,) = found.mqtt
    assert broker.endpoint == "mqtts://192.168.10.5:8883"
    assert broker.topics[2].topic.filter == "$share/thermap/plc/8/#"
    assert broker.sparkplug[0].sensors["bed"].unit == "FAHRENHEIT"


AGENT = '[[mtconnect]]\nname = "a"\nmachine = "vmc"\nurl = "http://h:5000"\n'
SENSORS = '[mtconnect.sensors]\nx = "X"\n'
SERVER = '[[opcua]]\nname = "s"\nmachine = "vmc"\nendpoint = "opc.tcp://h:4840"\n'
NODES = '[opcua.sensors]\nx = "ns=2;s=X"\n'
FILES = '[opcua.security]\nmode = "Sign"\n' + "".join(
    f'{name} = "none.der"\n' for name in ("certificate", "private_key", "server_certificate")
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[modbus]\n", "modbus: extra inputs are not permitted"),
        ("name = \n", "expected TOML in UTF-8"),
        (AGENT, "mtconnect.0.sensors: field required"),
        (AGENT + 'every_s = "1"\n' + SENSORS, "mtconnect.0.every_s: input should be a valid num"),
        (AGENT + "every_s = 0\n" + SENSORS, "mtconnect.0.every_s: input should be greater"),
        (AGENT.replace("http:", "ftp:") + SENSORS, "mtconnect.0.url"),
        (
            AGENT + '[mtconnect.sensors]\nx = {item = "X", unit = "C"}\n',
            "expected one of CELSIUS, FAHRENHEIT, KELVIN",
        ),
        ((AGENT + SENSORS) * 2, "expected each name once, got 'a' again"),
        (SERVER, "opcua.0.sensors: field required"),
        (SERVER + NODES.replace("ns=2;s=X", "X"), "opcua.0.sensors.x.node"),
        (SERVER + NODES.replace("ns=2;s=X", "nsu=urn:x"), "opcua.0.sensors.x.node"),
        (SERVER.replace("opc.tcp", "http") + NODES, "opcua.0.endpoint"),
        (SERVER.replace("h:", "u:p@h:") + NODES, "opcua.0.endpoint"),
        (SERVER + "publishing_s = 0.01\n" + NODES, "opcua.0.publishing_s"),
        (SERVER + '[opcua.state]\nx = {node = "i=1", unit = "KELVIN"}\n' + NODES, "state.x.unit"),
        (SERVER + NODES + FILES, "expected a file, got"),
        (
            SERVER + NODES + '[opcua.user]\nname = "u"\npassword_env = "THERMAP_NONE"\n',
            "expected a variable of the environment, got 'THERMAP_NONE': it is unset",
        ),
        (AGENT + SENSORS + SERVER.replace('"s"', '"a"') + NODES, "expected each name once"),
    ],
)
def test_a_wrong_file_is_refused_by_its_key(tmp_path, text, words):
    path = file_of(tmp_path, text)
    with pytest.raises(InvalidContent, match=re.escape(words)) as refused:
        read_connections(path)
    assert str(path) in refused.value.detail


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InvalidContent, match="cannot be read"):
        read_connections(tmp_path / "none.toml")


@asynccontextmanager
async def connected(new_app, url, tmp_path, agent_url):
    path = file_of(
        tmp_path,
        f"""
[intake]
collect_s = 0.05

[[mtconnect]]
name = "mill"
machine = "mcfv5050"
url = "{agent_url}"
every_s = 0.1

[mtconnect.sensors]
x-middle = "t1"
z-column = "column_t"

[mtconnect.state]
spindle_rpm = "Srpm"
""",
    )
    service = new_app(url, config=path)
    async with service.state.connections.running(), client_of(service) as client:
        yield client


async def until(ask, is_so):
    async with asyncio.timeout(60):
        while not is_so(found := await ask()):
            await asyncio.sleep(0.05)
    return found


async def test_what_an_agent_says_becomes_readings(new_app, databases, tmp_path):
    with ThreadPoolExecutor(1) as aside:
        url = aside.submit(databases.prepared, "sqlite", furnish_database).result()
    agent = ExampleAgent()
    agent.observe("t1", "25.0")
    agent.observe("t2", "80.6")
    agent.observe("s1", "8000")
    with listening(agent) as agent_url:
        await follow_agent(agent, connected(new_app, url, tmp_path, agent_url))
    databases.give_back(url)


async def test_what_an_agent_has_no_more_is_not_told_again_as_fresh():
    told = []

    class Agent:
        readable = frozenset({"x-middle"})

    class Taker:
        def tell_values(self, *_told):
            """Who has a value and who has none is judged elsewhere."""

        def offer(self, machine, temperatures_c, time, state):
            told.append(temperatures_c)

    table = MtconnectTable(
        name="mill", machine="vmc", url="http://h:5000", sensors={"x-middle": "t1", "spindle": "t2"}
    )
    connection = AgentConnection(table, Taker(), None)
    connection._follower = Agent()
    connection._known.take({"x-middle": 25.0, "spindle": 31.0})
    told.clear()
    connection._repeat_known()
    assert told == [{"x-middle": 25.0}]


async def follow_agent(agent, opened):
    async with opened as client:

        async def connections():
            return (await client.get("/v1/connections")).json()

        await until(connections, lambda found: found["stored"] >= 1)
        (one,) = (await connections())["connections"]
        assert (one["connected"], one["known"], one["trouble"]) == (True, 3, "")
        (reading,) = (await client.get(f"{ROOM}/readings")).json()
        assert reading["temperatures_c"] == {"x-middle": 25.0, "z-column": pytest.approx(27.0)}
        assert reading["state"] == {"spindle_rpm": 8000.0}
        table = (await client.get(f"{ROOM}/compensation")).json()
        (exx,) = (c for c in table["components"] if c["component"] == "EXX")
        assert exx["compensation_um"] == [0.0, -5.0, -25.0]
        agent.observe("t1", "UNAVAILABLE")
        await until(connections, lambda found: found["connections"][0]["known"] == 2)


def test_the_service_does_not_start_with_a_wrong_file(tmp_path):
    path = file_of(tmp_path, "[modbus]\n")
    with pytest.raises(InvalidContent, match="modbus: extra inputs"):
        create_app(Settings(database_url=f"sqlite:///{tmp_path}/new.db", config=path))
    assert not (tmp_path / "new.db").exists()


@pytest.mark.slow
async def test_what_an_opcua_server_says_becomes_readings(new_app, databases, tmp_path, clock):
    pytest.importorskip("asyncua", reason="the extra opcua is not installed")
    url = await asyncio.to_thread(databases.prepared, "sqlite", furnish_database)
    with example_server(free_port()) as server:
        server.say("add", "X", 25.0)
        server.say("add", "Speed", 8000, kind="Int32")
        path = file_of(
            tmp_path,
            f"""
[intake]
collect_s = 0.05

[[opcua]]
name = "press"
machine = "mcfv5050"
endpoint = "{server.url}"
publishing_s = 0.1
sensors = {{ x-middle = "ns=2;s=X", z-column = "ns=2;s=None" }}
state = {{ spindle_rpm = "ns=2;s=Speed" }}
""",
        )
        service = new_app(url, config=path)
        async with service.state.connections.running(), client_of(service) as client:

            async def connections():
                return (await client.get("/v1/connections")).json()

            await until(connections, lambda found: found["stored"] >= 1)
            (one,) = (await connections())["connections"]
            assert (one["kind"], one["connected"], one["known"]) == ("opcua", True, 2)
            assert "z-column: expected a node" in one["trouble"]
            (reading,) = (await client.get(f"{ROOM}/readings")).json()
            assert reading["temperatures_c"] == {"x-middle": 25.0}
            assert reading["state"] == {"spindle_rpm": 8000.0}
            server.say("set", "X", None, status="BadSensorFailure")
            await until(connections, lambda found: found["connections"][0]["known"] == 1)
            server.kill()
            await until(connections, lambda found: not found["connections"][0]["connected"])
    databases.give_back(url)
