"""What a broker has taken is stored, however often the service or the broker is killed."""

import json
import signal
import threading
import time

import httpx
import pytest

pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")

from tests.connections.mosquitto_example import Mosquitto, expect_mosquitto
from tests.connections.mqtt_peer import Peer
from tests.faults.service import Service
from tests.service_examples import ROOM, furnish_database

pytestmark = pytest.mark.slow

PATIENCE_S = 300.0
"""Where seventeen processes share two cores, a service takes more than a minute to start."""

CONFIG = """
[intake]
collect_s = 0.1

[[mqtt]]
name = "shop"
host = "127.0.0.1"
port = {port}
client_id = "{name}"
keepalive_s = 5
publish = "{name}"

[[mqtt.topics]]
topic = "{share}plain/{{machine}}/{{sensor}}"

[[mqtt.topics]]
topic = "{share}timed/{{machine}}/{{sensor}}"
value = "v"
time = "ms"
time_form = "epoch_ms"
"""


class Shop:
    """The service with a file of connections, begun again at its address."""

    def __init__(self, url, port, folder, name="thermap-1", share=""):
        file = folder / f"{name}.toml"
        file.write_text(CONFIG.format(port=port, name=name, share=share))
        self._url, self._file = url, file
        self._port = 0
        self._service = None

    def start(self):
        self._service = Service(self._url, port=self._port, THERMAP_CONFIG=str(self._file))
        self.url = self._service.url
        self._port = int(self.url.rpartition(":")[2])
        return self

    def kill(self):
        """Kill it without a warning."""
        self._service.end(signal.SIGKILL)

    def get(self, path, **params):
        return httpx.get(self.url + path, params=params, timeout=PATIENCE_S, trust_env=False).json()

    def until(self, path, is_so, **params):
        deadline = time.monotonic() + PATIENCE_S
        while not is_so(found := self.get(path, **params)):
            assert time.monotonic() < deadline, str(found)[:2000]
            time.sleep(0.1)
        return found


class Sender(threading.Thread):
    """Sends one value after the other, and remembers those that the broker has taken."""

    def __init__(self, port, most):
        super().__init__()
        self._port = port
        self._most = most
        self.taken = []
        self.wrong = None

    def run(self):
        try:
            self._send()
        except BaseException as why:
            self.wrong = why

    def _send(self):
        begin_ms = round(time.time() * 1000)
        with Peer(self._port) as peer:
            for i in range(self._most):
                value = round(20.0 + i / 1000, 3)
                peer.say("plain/mcfv5050/x-middle", str(value))
                self.taken.append(("x-middle", value))
                # Two sensors of one time, in messages of their own.
                for sensor in ("y-front", "z-column"):
                    said = {"v": value, "ms": begin_ms - 100_000 + i}
                    peer.say(f"timed/mcfv5050/{sensor}", json.dumps(said))
                    self.taken.append((sensor, value))
                time.sleep(0.002)


@pytest.fixture
def broker(tmp_path):
    expect_mosquitto()
    made = Mosquitto(tmp_path / "broker").start()
    yield made
    made.end(signal.SIGKILL)


@pytest.fixture
def url(databases):
    made = databases.prepared("sqlite", furnish_database)
    yield made
    databases.give_back(made)


@pytest.fixture
def started():
    services = []
    yield lambda service: services.append(service) or service.start()
    for service in services:
        service.kill()


def is_connected(found):
    return found["connections"][0]["connected"]


def stored(service):
    return [
        (sensor, value)
        for one in service.get(f"{ROOM}/readings", limit=100_000)
        for sensor, value in one["temperatures_c"].items()
    ]


def expect_all(service, taken):
    """Wait until everything is stored that the broker had taken."""
    deadline = time.monotonic() + 120
    while lost := set(taken) - set(stored(service)):
        assert time.monotonic() < deadline, f"{len(lost)} of {len(taken)} lost: {sorted(lost)[:9]}"
        time.sleep(0.2)


def test_nothing_is_lost_when_the_service_is_killed(url, broker, tmp_path, started):
    service = started(Shop(url, broker.port, tmp_path))
    service.until("/v1/connections", is_connected)
    sender = Sender(broker.port, most=250)
    with Peer(broker.port) as watcher:
        watcher.listen("thermap-1/state")
        sender.start()
        for number in range(2):
            wanted = len(sender.taken) + 150
            while len(sender.taken) < wanted and sender.is_alive():
                time.sleep(0.001)
            service.kill()
            watcher.until(lambda peer: peer.retained.get("thermap-1/state") == b"offline")
            time.sleep(0.3 * number)
            service.start()
            service.until("/v1/connections", is_connected)
            watcher.until(lambda peer: peer.retained.get("thermap-1/state") == b"online")
        sender.join()
    assert sender.wrong is None, sender.wrong
    expect_all(service, sender.taken)
    # With a time of their own messages that come twice are stored once.
    timed = [one for one in stored(service) if one[0] == "y-front"]
    assert len(timed) == len(set(timed))
    found = service.get("/v1/connections")
    assert (found["refused"], found["last_refusal"]) == (0, "")


def test_nothing_is_lost_when_one_of_two_that_share_is_killed(url, broker, tmp_path, started):
    both = [
        started(Shop(url, broker.port, tmp_path, name, "$share/shop/"))
        for name in ("thermap-1", "thermap-2")
    ]
    for service in both:
        service.until("/v1/connections", is_connected)
    sender = Sender(broker.port, most=250)
    sender.start()
    while len(sender.taken) < 200 and sender.is_alive():
        time.sleep(0.001)
    both[0].kill()
    both[0].start()
    both[0].until("/v1/connections", is_connected)
    sender.join()
    assert sender.wrong is None, sender.wrong
    expect_all(both[0], sender.taken)


def test_nothing_is_lost_when_the_broker_is_started_again(url, broker, tmp_path, started):
    service = started(Shop(url, broker.port, tmp_path))
    service.until("/v1/connections", is_connected)
    taken = []
    for number in range(2):
        with Peer(broker.port) as peer:
            values = [round(20.0 + number + i / 1000, 3) for i in range(300)]
            peer.say_many([("plain/mcfv5050/x-middle", str(value)) for value in values])
            taken += [("x-middle", value) for value in values]
        broker.end(signal.SIGTERM)
        if number % 2:
            service.kill()
            service.start()
        broker.start()
    service.until("/v1/connections", is_connected)
    expect_all(service, taken)
