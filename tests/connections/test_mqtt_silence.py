"""Sensors that fall silent over MQTT: logged together, and once in a while."""

import logging

import pytest

pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")

from app.connections import mqtt_connection, sparing_log
from app.connections.mqtt_connection import MqttConnection
from app.connections.mqtt_publisher import TablePublisher
from app.connections.mqtt_tables import MqttTable


def test_many_that_fall_silent_and_speak_again_are_few_lines(caplog, monkeypatch):
    caplog.set_level(logging.WARNING, "thermap")
    now_s = 0.0
    monkeypatch.setattr(mqtt_connection, "monotonic", lambda: now_s)
    monkeypatch.setattr(sparing_log, "monotonic", lambda: now_s)
    table = MqttTable.model_validate(
        {
            "name": "shop",
            "host": "h",
            "client_id": "c",
            "topics": [
                {"topic": f"t/{k}", "machine": "vmc", "sensor": f"s{k}", "silent_after_s": 60}
                for k in range(100)
            ],
        }
    )
    connection = MqttConnection(table, None, None)
    connection._begin_to_listen()
    for cycle in range(10):  # each a minute of silence, and a word of everybody
        now_s = 61.0 * (2 * cycle + 1)
        connection._notice_silence()
        assert len(connection._silent) == 100
        now_s += 1.0
        connection._heard_s = {("vmc", f"s{k}"): now_s for k in range(100)}
        connection._notice_silence()
        assert connection._silent == set()
    first = caplog.messages[:2]
    assert first[0].startswith(
        "MQTT 'shop': s0 of 'vmc' has said nothing usable for more than 60 s"
    )
    assert first[0].endswith("; and 95 others")
    assert first[1].startswith("MQTT 'shop': s0 of 'vmc' speaks again; ")
    assert len(caplog.messages) <= 20

    caplog.clear()
    for _ in range(50):  # one that comes and goes within moments
        now_s += 0.5
        connection._heard_s["vmc", "s7"] = now_s - 100.0
        connection._notice_silence()
        now_s += 0.5
        connection._heard_s["vmc", "s7"] = now_s
        connection._notice_silence()
    assert len(caplog.messages) <= 2


@pytest.mark.parametrize(
    ("topic", "is_own"),
    [
        ("thermap/state", True),
        ("thermap/vmc/table", True),
        ("thermap/vmc/status", True),
        ("thermap/vmc/alarms", True),
        ("thermap/in/vmc/x-middle", False),  # a sensor's, below the prefix: it was passed over
        ("thermap/table", False),
        ("shop/thermap/vmc/table", False),
        ("thermapx/vmc/table", False),
    ],
)
def test_sensors_may_speak_below_the_prefix_of_what_is_published(topic, is_own):
    assert TablePublisher(None, "thermap", None, (0.1, None), None).owns(topic) is is_own
