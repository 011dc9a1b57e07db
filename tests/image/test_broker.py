"""The broker beside the service, as docker-compose.yml and its files in compose/ name it.

It runs here as the user and by the command that are named there; its files have other places, and
it listens on a free port.
"""

import asyncio
import os
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")

from app.connections.config import read_connections
from tests.connections.mosquitto_example import PROGRAM, expect_mosquitto, free_port
from tests.connections.mqtt_peer import Peer
from tests.service_examples import ROOM, client_of

pytestmark = pytest.mark.anyio

ROOT = Path(__file__).parents[2]
SERVICES = yaml.safe_load((ROOT / "docker-compose.yml").read_text(encoding="utf-8"))["services"]
BROKER = SERVICES["mosquitto"]
SECRETS = {"thermap": "of the service", "sensors": "of the shop floor"}


class Broker:
    """Mosquitto with the files that are named, each in a folder of the test."""

    def __init__(self, folder):
        self.port = free_port()
        folder.mkdir()
        places = {}
        for volume in BROKER["volumes"]:
            source, target = volume.split(":")[:2]
            places[target] = folder / Path(target).name
            if source.endswith(".passwd"):  # made by who starts it
                places[target].touch()
                for user, secret in SECRETS.items():
                    subprocess.run(
                        ["mosquitto_passwd", "-b", places[target], user, secret], check=True
                    )
            elif source.startswith("./"):
                shutil.copy(ROOT / source, places[target])
            else:
                places[target].mkdir()
        (settings,) = [place for place in places.values() if place.suffix == ".conf"]
        text = settings.read_text(encoding="utf-8")
        for target, place in places.items():
            text = text.replace(target, str(place))
        assert text.count("\nlistener 1883\n") == 1
        settings.write_text(text.replace("\nlistener 1883\n", f"\nlistener {self.port}\n"))
        program, *words = BROKER["command"]
        assert program == Path(PROGRAM).name
        uid, gid = map(int, BROKER["user"].split(":"))
        rights = {}
        if os.geteuid() == 0:
            rights = {"user": uid, "group": gid, "extra_groups": []}
            for one in (folder, *folder.rglob("*")):
                os.chown(one, uid, gid)
            for parent in folder.parents[:4]:  # what pytest makes is closed to others
                parent.chmod(parent.stat().st_mode | 0o011)
        self.process = subprocess.Popen(
            [PROGRAM, *(str(places.get(word, word)) for word in words)], **rights
        )

    def is_well(self, secret):
        """Ask as the health command does."""
        first, *words = BROKER["healthcheck"]["test"]
        assert first == "CMD"
        words = [word.replace("${THERMAP_MQTT_PASSWORD:-}", secret) for word in words]
        asked = [word.replace("$$", "$") for word in words]
        return not subprocess.run(
            [*asked, "-p", str(self.port)], capture_output=True, timeout=60
        ).returncode

    def peer(self, user=None):
        options = {} if user is None else {"username_pw_set": (user, SECRETS[user])}
        return Peer(self.port, **options)

    def end(self):
        self.process.kill()
        self.process.wait()


@pytest.fixture
def broker(tmp_path):
    expect_mosquitto()
    for program in ("mosquitto_passwd", "mosquitto_sub"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")
    made = Broker(tmp_path / "broker")
    yield made
    made.end()


async def until(is_so):
    async with asyncio.timeout(60):
        while not await is_so():
            await asyncio.sleep(0.05)


async def is_refused(broker, user, secret):
    """Whether a client that states this is told that it may not come in."""
    stated = [] if user is None else ["-u", user, "-P", secret]
    asked = await asyncio.to_thread(
        subprocess.run,
        ["mosquitto_sub", "-p", str(broker.port), *stated, "-t", "#", "-C", "1", "-W", "2"],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    return "not authorised" in asked.stderr.lower()


@pytest.mark.slow
async def test_the_broker_lets_in_whom_its_files_name_and_the_service_hears_the_sensors(
    broker, new_app, furnished_url, tmp_path, monkeypatch
):
    async def is_well():
        return await asyncio.to_thread(broker.is_well, SECRETS["thermap"])

    await until(is_well)
    assert not await asyncio.to_thread(broker.is_well, "a guess")
    assert await is_refused(broker, None, None)
    assert await is_refused(broker, "sensors", "a guess")
    variables = SERVICES["thermap"]["environment"]
    assert variables["THERMAP_MQTT_PASSWORD"] == "${THERMAP_MQTT_PASSWORD:-}"
    monkeypatch.setenv("THERMAP_MQTT_PASSWORD", SECRETS["thermap"])
    (stated,) = [v for v in SERVICES["thermap"]["volumes"] if v.startswith("./compose/mqtt.toml:")]
    assert stated.split(":")[1] in (ROOT / "docker-compose.yml").read_text().partition("\nx-")[0]
    text = (ROOT / "compose/mqtt.toml").read_text(encoding="utf-8")
    assert text.count('host = "mosquitto"\n') == 1
    here = tmp_path / "mqtt.toml"
    here.write_text(text.replace('host = "mosquitto"', f'host = "127.0.0.1"\nport = {broker.port}'))
    service = new_app(furnished_url, config=here)
    async with service.state.connections.running(), client_of(service) as client:

        async def is_connected():
            found = (await client.get("/v1/connections")).json()["connections"]
            return found[0]["connected"]

        async def is_read():
            found = (await client.get(f"{ROOM}/readings")).json()
            return [one["temperatures_c"] for one in found] == [{"x-middle": 24.5}]

        await until(is_connected)
        with broker.peer("sensors") as sensor, broker.peer("thermap") as other:
            for topic in ("thermap/#", "sensors/#", "#"):
                sensor.listen(topic)
            other.listen("thermap/#")
            # Neither may a sensor say what the service alone says.
            await asyncio.to_thread(sensor.say, "thermap/state", "offline", retain=True)
            await asyncio.to_thread(sensor.say, "sensors/mcfv5050/x-middle", "24.5")
            await until(is_read)
            await asyncio.to_thread(other.until, lambda o: "thermap/mcfv5050/table" in o.retained)
            assert other.retained["thermap/state"] == b"online"
            assert sensor.heard == []


def test_the_service_reads_the_brokers_file_as_it_stands(monkeypatch):
    monkeypatch.setenv("THERMAP_MQTT_PASSWORD", "secret")
    (found,) = read_connections(ROOT / "compose/mqtt.toml").mqtt
    assert found.host in SERVICES
    assert (found.username, found.secret) == ("thermap", "secret")
