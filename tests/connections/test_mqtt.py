"""Sensors over MQTT and tables back, with a broker that is killed, stopped and started again."""

import asyncio
import json
import logging
import re
import shutil
import signal
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager

import pytest

pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")

from app import supervision
from app.connections import intake
from app.connections.config import read_connections
from app.connections.sparkplug_payload import rebirth_command
from app.errors import InvalidContent, StorageUnavailable
from tests.connections.mosquitto_example import Mosquitto, expect_mosquitto
from tests.connections.mqtt_peer import Peer
from tests.connections.test_mqtt_messages import payload
from tests.service_examples import ROOM, client_of, furnish_database

pytestmark = [pytest.mark.anyio, pytest.mark.slow]

BROKER = '[[mqtt]]\nname = "b"\nhost = "h"\nclient_id = "thermap-1"\n'
TOPIC = '[[mqtt.topics]]\ntopic = "t"\nmachine = "m"\nsensor = "s"\n'
NODE = '[[mqtt.sparkplug]]\nmachine = "m"\ngroup = "g"\nnode = "n"\nsensors = { x = "X" }\n'


def file_of(tmp_path, text):
    path = tmp_path / "thermap.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BROKER, "mqtt.0: expected `topics`, `sparkplug` or `publish`"),
        (BROKER.replace('host = "h"\n', "") + TOPIC, "mqtt.0.host: field required"),
        (BROKER.replace('client_id = "thermap-1"\n', "") + TOPIC, "mqtt.0.client_id: field req"),
        (BROKER + "port = 0\n" + TOPIC, "mqtt.0.port"),
        (BROKER + 'tls = "yes"\n' + TOPIC, "mqtt.0.tls"),
        (BROKER + 'ca = "/nowhere.pem"\n' + TOPIC, "expected certificates as `ca`"),
        (BROKER + 'key = "/nowhere.pem"\n' + TOPIC, "expected `cert` with `key`"),
        (BROKER + 'cert = "/nowhere.pem"\n' + TOPIC, "without a passphrase"),
        (BROKER + 'publish = "a/#"\n', "mqtt.0.publish"),
        (
            BROKER + 'username = "u"\npassword_env = "NOT_SET"\n' + TOPIC,
            "'NOT_SET': it is unset",
        ),
        (BROKER + 'password = "p"\n' + TOPIC, "expected a `username` with the password"),
        (BROKER + TOPIC.replace('"t"', '"t/#/x"'), "mqtt.0.topics.0.topic: expected # as the last"),
        (BROKER + TOPIC.replace('machine = "m"\n', ""), "the machine either as `machine` or as"),
        (BROKER + TOPIC.replace('sensor = "s"\n', ""), "expected one of `sensor`, {sensor}"),
        (BROKER + TOPIC + 'unit = "C"\n', "expected one of CELSIUS, FAHRENHEIT, KELVIN, got 'C'"),
        (BROKER + TOPIC + 'value = "a..b"\n', "expected a path"),
        (BROKER + TOPIC + 'time = "ts"\n', "expected `value` or `sensors` with `time`"),
        (
            BROKER + TOPIC + 'value = "v"\ntime = "t"\ntime_form = "unix"\n',
            "expected one of iso8601",
        ),
        (BROKER + TOPIC + "silent_after_s = 0\n", "mqtt.0.topics.0.silent_after_s"),
        (
            BROKER + TOPIC.replace('"t"', '"$share/g/t"') + "silent_after_s = 60\n",
            "expected no silent_after_s with $share",
        ),
        (BROKER + NODE.replace('"g"', '"g/+"'), "mqtt.0.sparkplug.0.group"),
        (BROKER + NODE.replace('{ x = "X" }', "{ }"), "mqtt.0.sparkplug.0.sensors"),
        ((BROKER + TOPIC) * 2, "expected each name once, got 'b' again"),
    ],
)
def test_a_wrong_file_is_refused_by_its_key(tmp_path, text, words):
    with pytest.raises(InvalidContent, match=re.escape(words)):
        read_connections(file_of(tmp_path, text))


@pytest.mark.parametrize(
    "wrong",
    [
        'password = "s3cret"\npassword_env = "NOT_SET"\n',
        'password = "s3cret"\n',
        'pasword = "s3cret"\n',
        'username = "u"\npassword = "s3cret"\nport = 0\n',
        'username = "u"\npassword = ["s3cret"]\n',
    ],
)
def test_no_refusal_says_the_password(tmp_path, wrong):
    for text in (BROKER + wrong + TOPIC, BROKER.replace('host = "h"\n', wrong) + TOPIC):
        with pytest.raises(InvalidContent) as refused:
            read_connections(file_of(tmp_path, text))
        assert "s3cret" not in refused.value.detail + repr(refused.value.errors)


def test_a_password_is_taken_and_not_shown(tmp_path, monkeypatch):
    monkeypatch.setenv("BROKER_PASSWORD", "s3cret")
    for stated in ('password = "s3cret"', 'password_env = "BROKER_PASSWORD"'):
        text = f'{BROKER}username = "u"\n{stated}\n{TOPIC}'
        (found,) = read_connections(file_of(tmp_path, text)).mqtt
        assert found.secret == "s3cret"
        assert "s3cret" not in repr(found)


@pytest.fixture
def broker(tmp_path):
    expect_mosquitto()
    made = Mosquitto(tmp_path / "broker").start()
    yield made
    made.end(signal.SIGKILL)


@pytest.fixture
def url(databases):
    with ThreadPoolExecutor(1) as aside:
        made = aside.submit(databases.prepared, "sqlite", furnish_database).result()
    yield made
    databases.give_back(made)


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    """Wait shorter than in the shop."""
    monkeypatch.setattr(supervision, "FIRST_PAUSE_S", 0.1)
    monkeypatch.setattr(supervision, "LONGEST_PAUSE_S", 0.2)


PLAIN = '[[mqtt.topics]]\ntopic = "shop/{machine}/{sensor}"\n'


class Service:
    """A service beside a broker, asked over HTTP."""

    def __init__(self, client, service):
        self.client = client
        self.service = service

    async def connections(self):
        return (await self.client.get("/v1/connections")).json()

    async def now(self):
        return (await self.connections())["connections"][0]

    async def readings(self):
        answer = await self.client.get(f"{ROOM}/readings", params={"limit": 100_000})
        return answer.json()

    async def values(self, sensor="x-middle"):
        return [
            one["temperatures_c"][sensor]
            for one in await self.readings()
            if sensor in one["temperatures_c"]
        ]

    async def until(self, ask, is_so):
        found = None
        try:
            async with asyncio.timeout(60):
                while not is_so(found := await ask()):
                    await asyncio.sleep(0.02)
        except TimeoutError:
            pytest.fail(f"still {found!r:.2000}, connections {await self.connections()}")
        return found

    async def until_connected(self):
        return await self.until(self.now, lambda one: one["connected"])


@asynccontextmanager
async def connected(new_app, url, tmp_path, broker, rest, name="thermap-1", more=""):
    path = file_of(
        tmp_path,
        f'[intake]\ncollect_s = 0.05\n\n[[mqtt]]\nname = "shop"\nhost = "127.0.0.1"\n'
        f'port = {broker.port}\nclient_id = "{name}"\nkeepalive_s = 2\n{more}\n{rest}',
    )
    service = new_app(url, config=path)
    async with service.state.connections.running(), client_of(service) as client:
        yield Service(client, service)


async def aside(call, *asked):
    """Do what blocks beside the service, which runs in the same loop."""
    return await asyncio.to_thread(call, *asked)


async def test_numbers_and_documents_become_readings(new_app, url, tmp_path, broker):
    topics = f"""
[[mqtt.topics]]
topic = "plc/7"
machine = "mcfv5050"
sensors = {{ y-front = "temps[0]", z-column = {{ path = "temps[1]", unit = "KELVIN" }} }}
state = {{ spindle_rpm = "rpm" }}
time = "ts"
time_form = "epoch_s"

{PLAIN}unit = "FAHRENHEIT"
"""
    async with connected(new_app, url, tmp_path, broker, topics) as shop:
        one = await shop.until_connected()
        assert (one["kind"], one["machines"]) == ("mqtt", ["mcfv5050"])
        with Peer(broker.port) as peer:
            peer.say("shop/mcfv5050/x-middle", "77")
            said = {"temps": [23.5, 300.15], "rpm": 4000, "ts": 1772344795.25}
            peer.say("plc/7", json.dumps(said))
            await shop.until(shop.now, lambda one: one["known"] == 3)
        first, second = sorted(await shop.readings(), key=lambda one: one["time"])
        assert first["time"] == "2026-03-01T05:59:55.250000Z"
        assert first["temperatures_c"] == {"y-front": 23.5, "z-column": pytest.approx(27.0)}
        assert first["state"] == {"spindle_rpm": 4000.0}
        assert second["temperatures_c"] == {"x-middle": pytest.approx(25.0)}
        now = await shop.now()
        assert (now["known"], now["trouble"], now["lost"]) == (3, "", 0)
        assert now["last_value_at"] is not None


async def test_garbage_is_refused_once_and_holds_nobody_up(new_app, url, tmp_path, broker, caplog):
    caplog.set_level(logging.WARNING, "thermap")
    async with connected(new_app, url, tmp_path, broker, PLAIN) as shop:
        await shop.until_connected()
        with Peer(broker.port) as peer:
            garbage = [b"", b"21,5", b"NaN", b"\xff\x00", b"{}", b"295.15", b"9" * 100_000]
            peer.say_many([("shop/mcfv5050/x-middle", one) for one in garbage * 10])
            peer.say_many([("shop/lathe/x-middle", b"21"), ("shop/mcfv5050/nowhere", b"21")])
            peer.say_many([("shop//x-middle", b"21")])
            peer.say("shop/mcfv5050/x-middle", b"22.5")
            await shop.until(shop.values, lambda values: values == [22.5])
        now = await shop.until(shop.connections, lambda now: now["refused"] >= 63)
        assert now["last_refusal"]
        await shop.until(shop.now, lambda one: one["machines"] == ["mcfv5050"])
    assert caplog.text.count("refused from a connection") <= 2
    # Acknowledged, none of it comes again.
    async with connected(new_app, url, tmp_path, broker, PLAIN) as shop:
        await shop.until_connected()
        with Peer(broker.port) as peer:
            peer.say("shop/mcfv5050/x-middle", b"23.5")
        await shop.until(shop.values, lambda values: 23.5 in values)
        assert (await shop.connections())["refused"] == 0


async def test_what_was_retained_before_is_no_news(new_app, url, tmp_path, broker):
    timed = '[[mqtt.topics]]\ntopic = "t/y"\nmachine = "mcfv5050"\nsensor = "y-front"\n'
    timed += 'value = "v"\ntime = "ts"\n'
    with Peer(broker.port) as peer:
        peer.say("shop/mcfv5050/x-middle", "21", retain=True)
        peer.say("t/y", '{"v": 22.5, "ts": "2026-03-01T06:59:00+01:00"}', retain=True)
        async with connected(new_app, url, tmp_path, broker, PLAIN + timed) as shop:
            await shop.until(shop.readings, len)
            peer.say("shop/mcfv5050/x-middle", "23", retain=True)
            await shop.until(shop.readings, lambda readings: len(readings) == 2)
            readings = sorted(await shop.readings(), key=lambda one: one["time"])
            assert [one["temperatures_c"] for one in readings] == [
                {"y-front": 22.5},
                {"x-middle": 23.0},
            ]
            assert readings[0]["time"].startswith("2026-03-01T05:59:00")


@pytest.mark.slow
async def test_a_flood_is_bounded_and_all_of_it_stored(new_app, url, tmp_path, broker, monkeypatch):
    store, away = intake.store_readings, [True]

    def store_or_not(*asked):
        if away:
            raise StorageUnavailable("the database is away")
        return store(*asked)

    monkeypatch.setattr(intake, "store_readings", store_or_not)
    more = "receive_maximum = 20"
    async with connected(new_app, url, tmp_path, broker, PLAIN, more=more) as shop:
        await shop.until_connected()
        ((_, running),) = shop.service.state.connections._connections
        values = [round(20.0 + i / 100, 2) for i in range(300)]
        with Peer(broker.port) as peer:
            await aside(peer.say_many, [("shop/mcfv5050/x-middle", str(v)) for v in values])

            async def taken():
                return len(running._link._unsettled) + len(running._link._waiting)

            # The broker keeps the others: none of these is acknowledged.
            await shop.until(taken, lambda found: found == 20)
            peer.say("shop/mcfv5050/y-front", "21")
            assert await taken() == 20
            away.clear()
            found = await shop.until(shop.values, lambda found: len(found) >= len(values))
        assert sorted(found) == values
        await shop.until(taken, lambda found: found == 0)


async def test_a_broker_that_is_started_again_keeps_the_subscription(
    new_app, url, tmp_path, broker
):
    async with connected(new_app, url, tmp_path, broker, PLAIN) as shop:
        await shop.until_connected()
        for value, how in ((21.0, signal.SIGTERM), (22.0, signal.SIGTERM)):
            with Peer(broker.port) as peer:
                peer.say("shop/mcfv5050/x-middle", str(value))
            await shop.until(shop.values, lambda values, value=value: value in values)
            await aside(broker.end, how)
            await shop.until(shop.now, lambda one: not one["connected"])
            assert "broker" in (await shop.now())["trouble"]
            await aside(broker.start)
            with Peer(broker.port) as peer:  # before it is back, perhaps: the session keeps it
                peer.say("shop/mcfv5050/x-middle", str(value + 0.5))
            await shop.until(shop.values, lambda values, value=value: value + 0.5 in values)
        assert (await shop.until_connected())["trouble"] == ""


async def test_a_broker_that_lost_the_session_is_subscribed_to_again(
    new_app, url, tmp_path, broker
):
    async with connected(new_app, url, tmp_path, broker, PLAIN) as shop:
        await shop.until_connected()
        await aside(broker.end, signal.SIGKILL)
        for kept in (tmp_path / "broker").glob("*.db"):
            kept.unlink()
        await shop.until(shop.now, lambda one: not one["connected"])
        await aside(broker.start)
        await shop.until_connected()
        with Peer(broker.port) as peer:

            async def say():
                peer.say("shop/mcfv5050/x-middle", "21")
                return await shop.values()

            await shop.until(say, len)


async def test_a_broker_that_is_gone_keeps_nobody_from_starting(new_app, url, tmp_path, broker):
    await aside(broker.end)
    async with connected(new_app, url, tmp_path, broker, PLAIN) as shop:
        one = await shop.until(shop.now, lambda one: one["trouble"])
        assert f"no broker at 127.0.0.1:{broker.port}" in one["trouble"]
        assert (await shop.client.get(f"{ROOM}/status")).status_code == 200
        await aside(broker.start)
        assert (await shop.until_connected())["trouble"] == ""


@pytest.mark.slow
async def test_a_broker_that_hangs_is_noticed(new_app, url, tmp_path, broker):
    async with connected(new_app, url, tmp_path, broker, PLAIN) as shop:
        await shop.until_connected()
        broker.pause()
        await shop.until(shop.now, lambda one: not one["connected"])
        broker.go_on()
        await shop.until_connected()
        with Peer(broker.port) as peer:
            peer.say("shop/mcfv5050/x-middle", "21")
        await shop.until(shop.values, lambda values: values == [21.0])


async def test_two_instances_share_what_comes(new_app, url, tmp_path, broker):
    shared = PLAIN.replace('"shop/', '"$share/thermap/shop/')
    first = connected(new_app, url, tmp_path, broker, shared)
    async with first as one:
        second = connected(new_app, url, tmp_path, broker, shared, name="thermap-2")
        async with second as other:
            await one.until_connected()
            await other.until_connected()
            values = [20.0 + i / 10 for i in range(40)]
            with Peer(broker.port) as peer:
                await aside(peer.say_many, [("shop/mcfv5050/x-middle", str(v)) for v in values])
            found = await one.until(one.values, lambda found: len(found) >= len(values))
            assert sorted(found) == pytest.approx(values)
            shares = [(await each.connections())["stored"] for each in (one, other)]
            assert min(shares) > 0
            assert sum(shares) == len(values)


@pytest.mark.slow
async def test_who_is_silent_is_said_and_who_speaks_again(new_app, url, tmp_path, broker, caplog):
    caplog.set_level(logging.WARNING, "thermap")
    topic = '[[mqtt.topics]]\ntopic = "t/x"\nmachine = "mcfv5050"\nsensor = "x-middle"\n'
    topic += "silent_after_s = 1\n"
    async with connected(new_app, url, tmp_path, broker, topic) as shop:
        one = await shop.until(shop.now, lambda one: "said nothing usable" in one["trouble"])
        assert one["trouble"] == "x-middle of 'mcfv5050' has said nothing usable for more than 1 s"
        with Peer(broker.port) as peer:

            async def say():
                peer.say("t/x", "21")
                return await shop.now()

            await shop.until(say, lambda one: one["trouble"] == "" and one["known"] == 1)
    assert "x-middle of 'mcfv5050' speaks again" in caplog.text


SPARKPLUG = """
[[mqtt.sparkplug]]
machine = "mcfv5050"
group = "g"
node = "edge"
device = "mill"
sensors = { x-middle = "Temps/X", z-column = { metric = "Temps/Z", unit = "FAHRENHEIT" } }
state = { spindle_rpm = "Srpm" }
rebirth = true
"""


def birth_of_device(x):
    return payload(
        1,
        {"name": "Temps/X", "alias": 1, "datatype": 10, "double_value": x},
        {"name": "Temps/Z", "alias": 2, "datatype": 9, "float_value": 77.0},
        {"name": "Srpm", "alias": 3, "datatype": 3, "int_value": 4000},
    )


async def test_sparkplug_from_birth_to_death(new_app, url, tmp_path, broker):
    async with connected(new_app, url, tmp_path, broker, SPARKPLUG) as shop:
        with Peer(broker.port) as peer:
            peer.listen("spBv1.0/g/NCMD/#")
            # Nothing is known of the node, which is asked for a birth.
            await shop.until_connected()

            async def commands():
                return peer.retained

            await shop.until(commands, lambda found: "spBv1.0/g/NCMD/edge" in found)
            assert peer.retained["spBv1.0/g/NCMD/edge"] == rebirth_command()
            peer.say("spBv1.0/g/NBIRTH/edge", payload(0, {"name": "bdSeq", "long_value": 1}))
            peer.say("spBv1.0/g/DBIRTH/edge/mill", birth_of_device(21.0))
            await shop.until(shop.values, lambda values: values == [21.0])
            (reading,) = await shop.readings()
            assert reading["temperatures_c"]["z-column"] == pytest.approx(25.0)
            assert reading["state"] == {"spindle_rpm": 4000.0}
            peer.say("spBv1.0/g/DDATA/edge/mill", payload(2, {"alias": 1, "double_value": 22.0}))
            await shop.until(shop.values, lambda values: 22.0 in values)
            old = {"alias": 1, "double_value": 19.0, "is_historical": True}
            old["timestamp"] = 1772344200000
            peer.say("spBv1.0/g/DDATA/edge/mill", payload(3, old))
            await shop.until(shop.values, lambda values: 19.0 in values)
            last = min(await shop.readings(), key=lambda one: one["time"])
            assert last["time"].startswith("2026-03-01T05:50:00")
            assert (await shop.now())["known"] == 3
            # Number 4 is missing: what it said is not known, and so nothing is.
            peer.say("spBv1.0/g/DDATA/edge/mill", payload(5, {"alias": 1, "double_value": 23.0}))
            one = await shop.until(shop.now, lambda one: one["known"] == 0)
            assert one["lost"] == 1
            assert "messages of g/edge are missing" in one["trouble"]
            peer.say("spBv1.0/g/NBIRTH/edge", payload(0, {"name": "bdSeq", "long_value": 2}))
            peer.say("spBv1.0/g/DBIRTH/edge/mill", birth_of_device(24.0))
            await shop.until(shop.now, lambda one: one["known"] == 3 and not one["trouble"])
            peer.say("spBv1.0/g/NDEATH/edge", payload(None, {"name": "bdSeq", "long_value": 2}))
            await shop.until(shop.now, lambda one: one["known"] == 0)
            assert 23.0 not in await shop.values()
            peer.say("spBv1.0/g/NDATA/edge", b"\xff\xff")
            await shop.until(shop.connections, lambda now: "Sparkplug B" in now["last_refusal"])


async def test_tables_verdicts_and_alarms_are_retained(new_app, url, tmp_path, broker, clock):
    more = 'publish = "thermap"\nmin_change_um = 0.5'
    with Peer(broker.port) as before:
        # Of a machine that was deleted while the service was away.
        before.say("thermap/lathe/table", "{}", retain=True)
    opened = connected(new_app, url, tmp_path, broker, PLAIN, more=more)
    async with opened as shop:
        await shop.until_connected()
        await shop.client.get(f"{ROOM}/status")  # the machine is in memory from here on
        with Peer(broker.port) as peer:
            peer.listen("thermap/#")

            async def seen():
                return peer.retained

            def table(found):
                return json.loads(found.get("thermap/mcfv5050/table") or b"{}")

            names = {"thermap/state", *(f"thermap/mcfv5050/{w}" for w in ("table", "status"))}
            await shop.until(seen, lambda found: found.keys() >= names)
            assert peer.retained["thermap/state"] == b"online"
            assert "detail" in table(peer.retained)
            assert json.loads(peer.retained["thermap/mcfv5050/status"])["state"] == "no-reading"
            for sensor, value in (("x-middle", 25), ("y-front", 24), ("z-column", 27)):
                peer.say(f"shop/mcfv5050/{sensor}", str(value))
            await shop.until(seen, lambda found: table(found).get("complete"))
            live = (await shop.client.get(f"{ROOM}/compensation")).json()
            assert table(peer.retained)["components"] == live["components"]
            # Within the dead band: nothing is told.
            told = len([one for one in peer.heard if one[0].endswith("/table")])
            peer.say("shop/mcfv5050/x-middle", "25.001")
            await shop.until(shop.values, lambda values: 25.001 in values)
            peer.say("shop/mcfv5050/x-middle", "26")
            await shop.until(seen, lambda found: table(found)["components"] != live["components"])
            assert len([one for one in peer.heard if one[0].endswith("/table")]) <= told + 2
            assert json.loads(peer.retained["thermap/mcfv5050/alarms"]) == {
                "machine": "mcfv5050",
                "alarms": [],
            }
            deleted = await shop.client.delete(ROOM)
            assert deleted.status_code == 204, deleted.text
            await shop.until(seen, lambda found: found["thermap/mcfv5050/table"] == b"")
            await shop.until(seen, lambda found: found["thermap/mcfv5050/alarms"] == b"")
    with Peer(broker.port) as after:
        after.listen("thermap/#")
        await aside(after.until, lambda peer: peer.retained)
        assert after.retained == {"thermap/state": b"offline"}


async def test_an_alarm_is_retained_while_it_lasts(new_app, url, tmp_path, broker, clock):
    more = 'publish = "thermap"'
    async with connected(new_app, url, tmp_path, broker, PLAIN, more=more) as shop:
        await shop.until_connected()
        from app.services.events import AlarmLog

        alarms = AlarmLog(shop.service.state.context)
        with Peer(broker.port) as peer:
            peer.listen("thermap/+/alarms")
            for sensor, value in (("x-middle", 25), ("y-front", 24), ("z-column", 95)):
                peer.say(f"shop/mcfv5050/{sensor}", str(value))
            await shop.until(lambda: shop.values("z-column"), len)

            async def look():
                await aside(alarms.look)
                return json.loads(peer.retained.get("thermap/mcfv5050/alarms", b"{}"))

            found = await shop.until(look, lambda found: found.get("alarms"))
            assert found["alarms"][0]["kind"] in ("alarm", "sensor")
            assert found["alarms"][0]["until"] is None


@pytest.fixture
def locked_broker(tmp_path):
    """A broker that speaks TLS, and asks for a name and a password."""
    expect_mosquitto()
    from tests.connections.certificates import write_certificates

    folder = tmp_path / "broker"
    folder.mkdir()
    write_certificates(folder)
    # mosquitto_passwd writes the file as the broker wants it.
    import subprocess

    program = shutil.which("mosquitto_passwd")
    subprocess.run([program, "-b", "-c", folder / "names", "thermap", "s3cret"], check=True)
    (folder / "names").chmod(0o644)
    made = Mosquitto(
        folder,
        f"cafile {folder}/ca.pem\ncertfile {folder}/server.pem\nkeyfile {folder}/server.key\n"
        f"allow_anonymous false\npassword_file {folder}/names\n",
    ).start()
    yield made
    made.end(signal.SIGKILL)


# The library leaves a socket whose handshake failed to the collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
async def test_tls_with_a_name_and_a_password(
    new_app, url, tmp_path, locked_broker, monkeypatch, caplog
):
    caplog.set_level(logging.DEBUG)
    monkeypatch.setenv("BROKER_PASSWORD", "s3cret")
    folder = tmp_path / "broker"
    login = 'username = "thermap"\npassword_env = "BROKER_PASSWORD"\n'
    right = f'ca = "{folder}/ca.pem"\n{login}'
    opened = connected(new_app, url, tmp_path, locked_broker, PLAIN, more=right)
    async with opened as shop:
        one = await shop.until_connected()
        assert one["endpoint"] == f"mqtts://127.0.0.1:{locked_broker.port}"
        options = {"tls_set": [str(folder / "ca.pem")], "username_pw_set": ["thermap", "s3cret"]}
        with Peer(locked_broker.port, **options) as peer:
            peer.say("shop/mcfv5050/x-middle", "21")
        await shop.until(shop.values, lambda values: values == [21.0])
    for wrong, words in (
        (right.replace(login, 'username = "thermap"\npassword = "wr0ng"\n'), "Not authorized"),
        (f"tls = true\n{login}", "certificate verify failed"),
        (login, "broker"),
    ):
        async with connected(new_app, url, tmp_path, locked_broker, PLAIN, more=wrong) as shop:
            await shop.until(shop.now, lambda one, words=words: words in one["trouble"])
            assert not (await shop.now())["connected"]
    assert "s3cret" not in caplog.text
    assert "wr0ng" not in caplog.text
