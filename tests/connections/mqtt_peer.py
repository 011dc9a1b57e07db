"""Another client of the broker: publishes, and remembers what comes."""

import time
from threading import Event

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion


class Peer:
    """A client that keeps the latest of each topic, and everything in order."""

    def __init__(self, port, **options):
        self.retained = {}
        self.heard = []
        self._client = Client(
            CallbackAPIVersion.VERSION2,
            options.pop("name", ""),
            protocol=MQTTProtocolVersion.MQTTv5,
        )
        self._client.max_inflight_messages_set(1000)
        for name, asked in options.items():
            getattr(self._client, name)(*asked)
        there = Event()
        self._client.on_connect = lambda *_told: there.set()
        self._client.on_message = self._hear
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        assert there.wait(60)

    def __enter__(self):
        return self

    def __exit__(self, *_why):
        self._client.disconnect()
        self._client.loop_stop()

    def _hear(self, _client, _userdata, message):
        self.heard.append((message.topic, message.payload))
        self.retained[message.topic] = message.payload

    def listen(self, topic):
        self._client.subscribe(topic, qos=1)

    def say(self, topic, payload, qos=1, retain=False):
        """Publish; with QoS 1 the broker has it when this returns."""
        told = self._client.publish(topic, payload, qos=qos, retain=retain)
        if qos:
            told.wait_for_publish(60)
            assert told.is_published()

    def say_many(self, messages):
        """Publish many at once, and wait until the broker has all."""
        told = [self._client.publish(topic, payload, qos=1) for topic, payload in messages]
        for one in told:
            one.wait_for_publish(60)
            assert one.is_published()

    def until(self, is_so):
        deadline = time.monotonic() + 60
        while not is_so(self):
            assert time.monotonic() < deadline, self.retained
            time.sleep(0.02)
