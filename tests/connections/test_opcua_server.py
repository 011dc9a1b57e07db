"""The tables as a PLC reads them: over OPC UA, with quality, and never to be written."""

import asyncio
import socket
from contextlib import asynccontextmanager, suppress
from datetime import timedelta

import pytest

from tests.connections.opcua_server_example import free_port
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    client_of,
    furnish_database,
    iso,
    reading,
    temperatures,
)

pytest.importorskip("asyncua", reason="the extra opcua is not installed")

from asyncua import Client, Server, ua

from app.connections.opcua_nodes import Nodes
from app.connections.opcua_server import NAMESPACE, TableServer
from app.connections.opcua_values import NodeValue, seen_of, snapshot_of, values_of
from app.connections.serving_tables import expect_servable
from app.errors import InvalidContent
from app.main import create_app
from app.services.status import Stored
from app.settings import Settings
from app.storage.watches import Watched
from app.supervision import keep_running

pytestmark = pytest.mark.anyio

EXX = "mcfv5050/Components/EXX"


@asynccontextmanager
async def table_server(service, security=None):
    url = f"opc.tcp://127.0.0.1:{free_port()}/thermap"
    server = TableServer(lambda: service.state.context, url, security)
    running = asyncio.create_task(keep_running("server", server.run, server.ended))
    try:
        async with asyncio.timeout(120):
            while not server.is_listening:
                assert not running.done()
                await asyncio.sleep(0.02)
        yield url
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running


class Plc:
    """A client that reads by path."""

    def __init__(self, client, index):
        self.client, self.index = client, index

    def node(self, path):
        return self.client.get_node(ua.NodeId(path, self.index))

    async def read(self, path):
        return await self.node(path).read_data_value(raise_on_bad_status=False)

    async def until(self, path, is_so):
        """Wait until a node's value is so; the test's own limit is a minute."""
        async with asyncio.timeout(120):
            while not is_so(found := await self.read(path)):
                await asyncio.sleep(0.05)
        return found


@asynccontextmanager
async def plc_at(url):
    async with Client(url) as client:
        yield Plc(client, await client.get_namespace_index(NAMESPACE))


def value_of(data):
    return None if data.Value is None else data.Value.Value


def code_of(data):
    return data.StatusCode.name


@pytest.fixture
def service(new_app, databases):
    """The service with the example machine."""
    url = databases.prepared("sqlite", furnish_database)
    yield new_app(url)
    databases.give_back(url)


@pytest.fixture
async def machine(service):
    """The service with the example machine, and a client of its HTTP."""
    async with client_of(service) as client:
        await client.get(f"{ROOM}/status")  # brings it to memory
        yield service, client


@pytest.mark.slow
async def test_nodes_are_what_asyncua_would_have_made_and_go_without_a_trace():
    server = Server()
    await server.init()
    index = await server.register_namespace(NAMESPACE)
    nodes, space = Nodes(server, index), server.iserver.aspace
    before = set(space.keys())
    await nodes.begin("Machines")
    asked = {
        "Text": NodeValue(ua.VariantType.String, "µm"),
        "Texts": NodeValue(ua.VariantType.String, ["a", "b"], is_array=True),
        "Number": NodeValue(ua.VariantType.Double, 1.5),
        "Numbers": NodeValue(ua.VariantType.Double, [1.5], is_array=True),
        "Count": NodeValue(ua.VariantType.UInt32, 7),
        "Flag": NodeValue(ua.VariantType.Boolean, True),
        "Time": NodeValue(ua.VariantType.DateTime, START),
    }
    folder = server.get_node(ua.NodeId("Machines", index))
    for machine in ("first", "second"):  # the first of a name is made otherwise than the next
        top = await nodes.add(machine, machine, now=START)
        below = [
            await nodes.add(f"{machine}/{name}", name, top, said, now=START)
            for name, said in asked.items()
        ]
        theirs = await folder.add_object(ua.NodeId(f"~{machine}", index), f"{index}:{machine}")
        pairs = [(top, theirs.nodeid)]
        for node, (name, said) in zip(below, asked.items(), strict=True):
            one = await theirs.add_variable(
                ua.NodeId(f"~{machine}/{name}", index), f"{index}:{name}", said.value, said.kind
            )
            pairs.append((node, one.nodeid))
        for own, other in pairs:
            assert own in space
            assert attributes_of(space, own) == attributes_of(space, other)
            assert references_of(space, own) == references_of(space, other)
        assert len(space[top].references) == 2 + len(asked)
        with pytest.raises(ua.UaError, match="expected an id that no node has, got 'first'"):
            await nodes.add("first", "first", now=START)

    first = [ua.NodeId(f"first/{name}", index) for name in asked]
    nodes.remove(ua.NodeId("first", index), first)
    left = set(space.keys()) - before
    assert not [one for one in left if one.Identifier.startswith("first")]
    shown = [one.BrowseName.Name for one in space[folder.nodeid].references if one.IsForward]
    assert sorted(shown) == ["FolderType", "first", "second", "second"]  # theirs is left of one
    top = await nodes.add("first", "first", now=START)
    assert await server.get_node(top).read_browse_name() == ua.QualifiedName("first", index)


def attributes_of(space, node):
    """What a node says of itself, but for its own id and when it said it."""
    found = {
        one: space.read_attribute_value(node, one).Value
        for one in space[node].attributes
        if one is not ua.AttributeIds.NodeId
    }
    assert space.read_attribute_value(node, ua.AttributeIds.NodeId).Value.Value == node
    return found


def references_of(space, node):
    """What a node refers to, without the ids by which theirs and ours differ."""
    return {
        (
            one.ReferenceTypeId.Identifier,
            bool(one.IsForward),
            str(one.NodeId.Identifier).lstrip("~"),
            one.BrowseName.Name,
            one.DisplayName.Text,
            int(one.NodeClass),
            one.TypeDefinition.Identifier,
        )
        for one in space[node].references
    }


@pytest.mark.slow
async def test_a_plc_reads_what_http_answers(machine):
    service, client = machine
    await client.post(f"{ROOM}/readings", json=reading(START, 25.0))
    table = (await client.get(f"{ROOM}/compensation")).json()
    by_code = {one["component"]: one for one in table["components"]}
    async with table_server(service) as url, plc_at(url) as plc:
        compensation = await plc.until(
            f"{EXX}/Compensation", lambda data: value_of(data) is not None
        )
        # EXX is (25 − 20)·x/100 µm.
        assert value_of(compensation) == pytest.approx([0.0, -5.0, -25.0])
        assert value_of(compensation) == pytest.approx(by_code["EXX"]["compensation_um"])
        assert code_of(compensation) == "Good"
        assert value_of(await plc.read(f"{EXX}/Positions")) == [0.0, 100.0, 500.0]
        assert value_of(await plc.read(f"{EXX}/Unit")) == "µm"
        assert value_of(await plc.read("mcfv5050/Components/EBX/Unit")) == "µrad"
        assert value_of(await plc.read("mcfv5050/Components/SXY/Compensation")) == [25.0]
        assert value_of(await plc.read("mcfv5050/Temperatures/x-middle")) == 25.0
        assert value_of(await plc.read("mcfv5050/Verdict")) == "trusted"
        assert value_of(await plc.read("mcfv5050/State")) == "fresh"
        assert value_of(await plc.read("mcfv5050/Usable")) is True
        assert value_of(await plc.read("mcfv5050/ModelVersion")) == table["model_version"]
        assert value_of(await plc.read("mcfv5050/ReadingAge")) == 0.0
        status = (await client.get(f"{ROOM}/status")).json()
        assert value_of(await plc.read("mcfv5050/Sentences")) == status["sentences"]


@pytest.mark.slow
async def test_without_trust_no_compensation_is_good(machine, clock):
    service, client = machine
    async with table_server(service) as url, plc_at(url) as plc:
        # No reading yet: the nodes are there, their values are not.
        data = await plc.read(f"{EXX}/Compensation")
        assert (value_of(data), code_of(data)) == (None, "BadNoData")
        assert value_of(await plc.read("mcfv5050/Verdict")) == "not-trusted"
        assert value_of(await plc.read("mcfv5050/Usable")) is False

        await client.post(f"{ROOM}/readings", json=reading(START, 25.0))
        data = await plc.until(f"{EXX}/Compensation", lambda data: code_of(data) == "Good")

        clock.advance(600)  # sensors are stale after 120 s
        data = await plc.until(f"{EXX}/Compensation", lambda data: code_of(data) != "Good")
        assert code_of(data) == "UncertainLastUsableValue"
        assert value_of(data) == pytest.approx([0.0, -5.0, -25.0])
        temperature = await plc.read("mcfv5050/Temperatures/x-middle")
        assert code_of(temperature) == "UncertainLastUsableValue"
        assert value_of(await plc.read("mcfv5050/ReadingAge")) == 600.0

        # Their ranges end at 80 °C, and nothing else stands in for them.
        failed = temperatures(25.0) | {"x-middle": 200.0, "y-front": 200.0}
        body = {"time": iso(clock()), "temperatures_c": failed, "state": {}}
        assert (await client.post(f"{ROOM}/readings", json=body)).status_code == 201
        data = await plc.until(f"{EXX}/Compensation", lambda data: value_of(data) is None)
        assert code_of(data) == "BadNoData"
        assert value_of(await plc.read("mcfv5050/State")) == "sensor-fault"
        temperature = await plc.read("mcfv5050/Temperatures/x-middle")
        assert (value_of(temperature), code_of(temperature)) == (None, "BadSensorFailure")


@pytest.mark.slow
async def test_nobody_writes(machine):
    service, client = machine
    await client.post(f"{ROOM}/readings", json=reading(START, 25.0))
    async with table_server(service) as url, plc_at(url) as plc:
        await plc.until(f"{EXX}/Compensation", lambda data: code_of(data) == "Good")
        zeros = ua.DataValue(ua.Variant([0.0, 0.0, 0.0], ua.VariantType.Double))
        with pytest.raises(ua.UaStatusCodeError, match="BadUserAccessDenied"):
            await plc.node(f"{EXX}/Compensation").write_value(zeros)
        for refused in (
            plc.node("mcfv5050").add_variable(ua.NodeId("x", plc.index), "x", 0.0),
            plc.client.delete_nodes([plc.node("mcfv5050")], recursive=True),
        ):
            with suppress(ua.UaError):
                await refused
        assert value_of(await plc.read(f"{EXX}/Compensation")) == pytest.approx([0, -5, -25])
        assert code_of(await plc.read("x")).startswith("Bad")

        admin = Client(url)
        admin.set_user("admin")
        with pytest.raises((ua.UaError, ConnectionError, TimeoutError)):
            async with admin:
                await admin.get_node(plc.node(f"{EXX}/Compensation").nodeid).write_value(zeros)
        assert value_of(await plc.read(f"{EXX}/Compensation")) == pytest.approx([0, -5, -25])


@pytest.mark.slow
async def test_machines_come_and_go(machine):
    service, client = machine
    async with table_server(service) as url, plc_at(url) as plc:
        await plc.until("mcfv5050/Verdict", lambda data: value_of(data) is not None)
        assert (await client.delete(ROOM)).status_code == 204
        await plc.until("mcfv5050/Verdict", lambda data: code_of(data).startswith("Bad"))
        assert (await client.post("/v1/machines", json=MACHINE | {"id": "other"})).is_success
        data = await plc.until("other/State", lambda data: value_of(data) is not None)
        assert value_of(data) in ("no-model", "no-reading")
        assert value_of(await plc.read("other/Usable")) is False


@pytest.mark.slow
async def test_a_taken_port_is_said_and_tried_again(machine, monkeypatch):
    monkeypatch.setattr("app.supervision.FIRST_PAUSE_S", 0.2)
    service, _ = machine
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        url = f"opc.tcp://127.0.0.1:{taken.getsockname()[1]}/thermap"
        server = TableServer(lambda: service.state.context, url)
        running = asyncio.create_task(keep_running("server", server.run, server.ended))
        async with asyncio.timeout(120):
            while not server.trouble:
                await asyncio.sleep(0.05)
        assert url in server.trouble
    async with asyncio.timeout(120):
        while not server.is_listening:
            await asyncio.sleep(0.05)
    assert server.trouble == ""
    running.cancel()
    with suppress(asyncio.CancelledError):
        await running


@pytest.mark.parametrize(
    ("endpoint", "words"),
    [
        ("127.0.0.1:4840", "opc.tcp://ADDRESS:PORT/NAME"),
        ("opc.tcp://127.0.0.1/thermap", "opc.tcp://ADDRESS:PORT/NAME"),
        ("opc.tcp://127.0.0.1:99999/thermap", "opc.tcp://ADDRESS:PORT/NAME"),
    ],
)
def test_endpoints_that_are_refused(endpoint, words):
    with pytest.raises(ValueError, match=words):
        Settings(opcua_endpoint=endpoint)


def test_other_computers_read_where_no_keys_are_asked_for():
    for endpoint in ("opc.tcp://0.0.0.0:4840/thermap", "opc.tcp://plc.example.org:4840/thermap"):
        with pytest.raises(InvalidContent, match="expected this computer's own address"):
            create_app(Settings(opcua_endpoint=endpoint))
        expect_servable(endpoint, insecure=True)


def test_an_endpoint_without_the_library_is_refused(monkeypatch):
    monkeypatch.setattr("app.connections.serving_tables.find_spec", lambda _: None)
    expect_servable("")
    with pytest.raises(InvalidContent, match="expected the extra opcua installed"):
        expect_servable("opc.tcp://127.0.0.1:4840/thermap")


def codes_of(service):
    """Say the status code of each component's compensation."""
    context = service.state.context
    snapshot = snapshot_of(context, context.live.get("mcfv5050"), Stored())
    return {
        path.split("/")[1]: ua.StatusCode(ua.UInt32(said.code)).name
        for path, said in values_of(snapshot)
        if path.endswith("/Compensation")
    }


async def test_each_component_is_as_good_as_what_it_rests_on(machine, clock):
    service, client = machine
    posted = await client.post(f"{ROOM}/readings", json=reading(START, 29.0))
    assert posted.status_code == 201
    assert codes_of(service) == dict.fromkeys(("EXX", "EBX", "EZZ", "SXY"), "Good")

    # EZZ follows z-column, whose hottest map is at 32 °C: it is clamped there.
    clock.advance(60)
    hot = temperatures(29.0) | {"z-column": 33.0}
    body = {"time": iso(clock()), "temperatures_c": hot, "state": {}}
    assert (await client.post(f"{ROOM}/readings", json=body)).status_code == 201
    codes = codes_of(service)
    assert codes["EZZ"] == "UncertainEngineeringUnitsExceeded"
    assert codes["EXX"] == "UncertainSubNormal"

    # Nobody tells z-column any more: it is old after 120 s, the others are not.
    for _ in range(2):
        clock.advance(80)
        some = {k: v for k, v in temperatures(29.0).items() if k != "z-column"}
        body = {"time": iso(clock()), "temperatures_c": some, "state": {}}
        assert (await client.post(f"{ROOM}/readings", json=body)).status_code == 201
    codes = codes_of(service)
    assert codes["EZZ"] == "UncertainLastUsableValue"
    assert codes["EXX"] == "UncertainSubNormal"


async def test_what_did_not_change_is_not_judged_again(machine, clock):
    service, client = machine
    await client.post(f"{ROOM}/readings", json=reading(START, 25.0))
    context = service.state.context
    live, stored = context.live.get("mcfv5050"), Stored()
    seen, age_s = seen_of(context, live, stored)
    assert age_s == 0.0
    clock.advance(100)
    assert seen_of(context, live, stored) == (seen, 100.0)
    clock.advance(21)  # the sensors are old by now
    old, _ = seen_of(context, live, stored)
    assert old != seen
    await client.post(f"{ROOM}/readings", json=reading(START + timedelta(seconds=121), 25.0))
    new, _ = seen_of(context, live, stored)
    assert new not in (seen, old)
    watched = Stored(watches={"mcfv5050": Watched("beyond", START)})
    assert seen_of(context, live, watched)[0] != new
