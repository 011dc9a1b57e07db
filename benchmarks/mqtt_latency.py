"""How soon a sensor's change, published over MQTT, is in the table of whoever follows it.

Each sensor has a topic of its own and speaks for itself. A client publishes a change of one sensor
with QoS 1, and waits for the table with that temperature: over MQTT, from the retained topic that
the service publishes, and over HTTP, from the machine's stream. A broker has to listen at
127.0.0.1:1883.

    python -m benchmarks.mqtt_latency [--changes 60] [--collect-s 0.2]
"""

from __future__ import annotations

import argparse
import random
import re
import statistics
import tempfile
import threading
import time
from pathlib import Path

import httpx
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from benchmarks.example import TEMPERATURES_C, database_url, prepare_database
from benchmarks.replicas import ROOM, service

PATIENCE_S = 30.0

FILE = """
[intake]
collect_s = {collect_s}

[[mqtt]]
name = "broker"
host = "127.0.0.1"
port = 1883
client_id = "{prefix}"
session_expiry_s = 60
publish = "{prefix}"

[[mqtt.topics]]
topic = "{prefix}/in/{{machine}}/{{sensor}}"
"""


class Followers:
    """When each temperature of a sensor was first seen in a table, by the way it came."""

    def __init__(self, sensor: str) -> None:
        self._needle = re.compile(rb'"sensor":"%b","temperature_c":([-0-9.e]+)' % sensor.encode())
        self.seen: dict[tuple[str, float], float] = {}
        self.changed = threading.Condition()

    def look(self, way: str, content: bytes) -> None:
        """Note the temperature that a document has."""
        found = self._needle.search(content)
        if found:
            value = float(found[1])
            with self.changed:
                self.seen.setdefault((way, value), time.perf_counter())
                self.changed.notify_all()

    def wait(self, way: str, value: float) -> float:
        """Wait until a temperature was seen; when."""
        with self.changed:
            if not self.changed.wait_for(lambda: (way, value) in self.seen, PATIENCE_S):
                raise RuntimeError(f"{value} °C never came over {way}")
            return self.seen[way, value]


def follow_stream(base: str, followers: Followers) -> None:
    """Read the machine's stream in a thread, until the service ends."""

    def read() -> None:
        try:
            url = f"{base}{ROOM}/compensation/stream"
            with httpx.stream("GET", url, timeout=None, trust_env=False) as answer:
                for line in answer.iter_lines():
                    followers.look("HTTP", line.encode())
        except httpx.TransportError:
            return

    threading.Thread(target=read, daemon=True).start()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--changes", type=int, default=60)
    parser.add_argument("--collect-s", type=float, default=0.2)
    asked = parser.parse_args()
    sensor = "x-middle"
    prefix = f"thermap-latency-{random.randrange(10**9)}"
    followers = Followers(sensor)
    client = Client(CallbackAPIVersion.VERSION2, protocol=MQTTProtocolVersion.MQTTv5)
    client.on_message = lambda _c, _u, message: followers.look("MQTT", message.payload)
    client.connect("127.0.0.1", 1883)
    client.loop_start()
    with tempfile.TemporaryDirectory() as folder:
        url = database_url(Path(folder))
        prepare_database(url)
        file = Path(folder) / "thermap.toml"
        file.write_text(FILE.format(prefix=prefix, collect_s=asked.collect_s), encoding="utf-8")
        with service(url, "--config", str(file)) as base:
            client.subscribe(f"{prefix}/mcfv5050/table", qos=1)
            follow_stream(base, followers)
            time.sleep(3.0)
            took = {"MQTT": [], "HTTP": []}
            for change in range(asked.changes):
                for other, t_c in TEMPERATURES_C.items():
                    if other != sensor and change % 10 == 0:
                        client.publish(f"{prefix}/in/mcfv5050/{other}", f"{t_c}", qos=1)
                time.sleep(random.uniform(1.0, 2.0))
                # Up and down by 0.1 K: more at once is no change that a sensor makes.
                steps = 20 - abs(change % 40 - 20) + 1e-3 * change
                value = round(TEMPERATURES_C[sensor] + 0.1 * (steps + 1.0), 4)
                began = time.perf_counter()
                client.publish(f"{prefix}/in/mcfv5050/{sensor}", f"{value}", qos=1)
                for way, taken in took.items():
                    taken.append(followers.wait(way, value) - began)
            for topic in ("table", "status", "alarms"):
                client.publish(f"{prefix}/mcfv5050/{topic}", b"", retain=True).wait_for_publish()
    client.publish(f"{prefix}/state", b"", retain=True).wait_for_publish()
    client.loop_stop()
    for way, taken in took.items():
        print(
            f"publish to a table over {way}: {statistics.median(taken):.3f} s in the median, 95 of "
            f"100 within {sorted(taken)[int(0.95 * len(taken))]:.3f} s, longest {max(taken):.3f} s"
        )


if __name__ == "__main__":
    main()
