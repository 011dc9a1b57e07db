"""Machines' values for Prometheus, and the dashboard and alerts that read them."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from app.api.connection_metrics import connection_metrics
from app.api.machine_metrics import machine_metrics
from app.connections.connection import Connection
from app.connections.running import ConnectionsNow
from app.errors import StorageUnavailable
from app.live.database_watch import TroubleKind
from app.services.watching_values import shop_values
from tests.service_examples import MACHINE, ROOM, reading

pytestmark = pytest.mark.anyio

MONITORING = Path(__file__).parents[2] / "monitoring"
PROMTOOL = shutil.which("promtool")
with_promtool = pytest.mark.skipif(
    PROMTOOL is None and not os.environ.get("THERMAP_REQUIRE_SERVICES"),
    reason="promtool is not installed (Debian: prometheus)",
)


def samples(text):
    return {
        (s.name, *sorted(s.labels.items())): s.value
        for family in text_string_to_metric_families(text)
        for s in family.samples
    }


async def scraped(client):
    return (await client.get("/metrics")).text


async def test_a_machines_values_have_base_units(client, clock):
    await client.post(f"{ROOM}/readings", json=reading(clock(), 22.0))
    clock.advance(5)
    found = samples(await scraped(client))
    machine = ("machine", "mcfv5050")
    x_middle = (machine, ("sensor", "x-middle"))
    assert found["thermap_sensor_temperature_celsius", *x_middle] == 22.0
    assert found["thermap_sensor_age_seconds", *x_middle] == 5.0
    assert found["thermap_sensor_health", ("health", "ok"), *x_middle] == 1.0
    assert found["thermap_machine_verdict", machine] == 0.0
    assert found["thermap_machine_state", machine, ("state", "fresh")] == 1.0
    assert found["thermap_machine_table_complete", machine] == 1.0
    # EZZ is (t − 20)·z/50 µm: 20 µm at 500 mm, and its compensation the opposite.
    assert found["thermap_largest_compensation_meters", machine] == pytest.approx(-20e-6)
    assert found["thermap_reading_age_seconds", machine] == 5.0
    assert found["thermap_analyses", ("status", "queued")] == 0.0
    assert ("thermap_machine_watch_beyond", machine) not in found
    clock.advance(86400)
    found = samples(await scraped(client))
    assert found["thermap_machine_verdict", machine] == 2.0
    assert found["thermap_machine_table_complete", machine] == 0.0


async def test_what_is_not_known_has_no_sample(app, client):
    await client.get(f"{ROOM}/compensation")
    app.state.context.live.database.note_trouble(*away(app))
    found = samples(await scraped(client))
    names = {name for name, *_ in found}
    assert not names & {"thermap_analyses", "thermap_sensor_temperature_celsius"}
    assert "thermap_machine_verdict" in names
    assert samples(machine_metrics(None).decode()) == {("thermap_machine_values_missing",): 1.0}


def away(app):
    return TroubleKind.AWAY, app.state.context.now()


async def test_machines_beyond_the_most_are_counted(app, client):
    await client.post("/v1/machines", json=MACHINE | {"id": "another"})
    for machine in ("another", "mcfv5050"):
        await client.get(f"/v1/machines/{machine}/compensation")
    values = shop_values(app.state.context, most=1)
    assert ([m.machine for m in values.machines], values.left_out) == (["another"], 1)


async def test_the_dashboard_and_alerts_ask_for_what_there_is(client, clock):
    await client.post(f"{ROOM}/readings", json=reading(clock(), 22.0))
    text = await scraped(client)
    # A family without a sample yet has its name in TYPE.
    known = {name for name, *_ in samples(text)} | set(re.findall(r"# TYPE (\S+)", text))
    dashboard = json.loads((MONITORING / "grafana-thermap.json").read_text("utf-8"))
    asked = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    asked += [v["query"]["query"] for v in dashboard["templating"]["list"] if v["type"] == "query"]
    asked += re.findall(r"expr: (.+)", (MONITORING / "alerts.yml").read_text("utf-8"))
    for expression in asked:
        names = re.findall(r"\bthermap_\w+", expression)
        assert names or "up{" in expression
        assert set(names) <= known, expression


def connection(name, **more):
    return Connection(
        **{
            "name": name,
            "kind": "mqtt",
            "machines": ("mcfv5050",),
            "endpoint": "mqtt://broker",
            "connected": True,
            "last_value_at": None,
            "known": 2,
            "trouble": "",
            "lost": 0,
            "taken": 5,
            "dropped": 1,
            "refused": 2,
        }
        | more
    )


def connection_samples(clock, *connections, clocks=()):
    now = ConnectionsNow(connections, 0, 0, 0, "", len(clocks), clocks)
    return samples(connection_metrics(lambda: now, clock()).decode())


async def test_connections_are_told_and_those_of_one_name_together(clock):
    earlier = clock()
    clock.advance(7)
    found = connection_samples(
        clock,
        connection("shop", last_value_at=earlier),
        connection("shop", connected=False, trouble="no answer in time"),
        connection("mill", kind="mtconnect"),
        clocks=("mcfv5050",),
    )
    shop = ("connection", "shop"), ("kind", "mqtt")
    mill = ("connection", "mill"), ("kind", "mtconnect")
    assert found["thermap_connection_up", *shop] == 0.0
    assert found["thermap_connection_up", *mill] == 1.0
    assert found["thermap_connection_trouble", *shop] == 1.0
    assert found["thermap_connection_last_value_age_seconds", *shop] == 7.0
    assert ("thermap_connection_last_value_age_seconds", *mill) not in found
    assert found["thermap_connection_known_values", *shop] == 4.0
    assert found["thermap_connection_taken_total", *shop] == 10.0
    assert found["thermap_connection_dropped_total", *shop] == 2.0
    assert found["thermap_connection_refused_total", *mill] == 2.0
    assert found["thermap_machines_with_wrong_clocks",] == 1.0


async def test_of_very_many_connections_the_first_are_told(clock):
    found = connection_samples(clock, *(connection(f"c{k:05}") for k in range(1200)))
    assert len([1 for name, *_ in found if name == "thermap_connection_up"]) == 1000


async def test_metrics_go_on_where_nobody_says_how_connections_fare(clock):
    def away():
        raise StorageUnavailable("the database is away")

    assert connection_metrics(away, clock()) == b""


@with_promtool
def test_alerts_go_off_when_they_should():
    done = subprocess.run(
        [PROMTOOL, "test", "rules", MONITORING / "alerts.test.yml"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@with_promtool
async def test_prometheus_reads_metrics_rules_and_settings(client, clock):
    await client.post(f"{ROOM}/readings", json=reading(clock(), 22.0))
    text = await scraped(client)
    # Those of the service that has no connections have no samples.
    now = ConnectionsNow((connection("shop", last_value_at=clock()),), 0, 0, 0, "")
    shown = connection_metrics(lambda: now, clock()).decode()
    for words, told in (
        (["metrics"], shown),
        (["metrics"], text),
        (["config", MONITORING / "prometheus.yml"], ""),
        (["rules", MONITORING / "alerts.yml"], ""),
    ):
        done = subprocess.run(
            [PROMTOOL, "check", *words], input=told, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
