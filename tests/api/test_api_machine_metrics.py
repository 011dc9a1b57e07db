"""Machines' values for Prometheus, and the dashboard and alerts that read them."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from app.api.machine_metrics import machine_metrics
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


@with_promtool
async def test_prometheus_reads_metrics_rules_and_settings(client, clock):
    await client.post(f"{ROOM}/readings", json=reading(clock(), 22.0))
    text = await scraped(client)
    for words, told in (
        (["metrics"], text),
        (["config", MONITORING / "prometheus.yml"], ""),
        (["rules", MONITORING / "alerts.yml"], ""),
    ):
        done = subprocess.run(
            [PROMTOOL, "check", *words], input=told, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
