"""A wrong assignment over HTTP: proposed by an analysis, changed, and nothing proposed after."""

import asyncio
import time

import pytest

from app.simulation.undeclared import make_campaign
from tests.campaign_examples import LATER
from tests.service_examples import Clock, client_of, running

pytestmark = pytest.mark.anyio

ROOM = "/v1/machines/wrong"
VISITS = 16


async def post(client, path, body, status=201):
    answer = await client.post(path, json=body)
    assert answer.status_code == status, answer.text
    return answer.json()


async def furnish(client):
    """Store a machine without effects, whose EXX is mapped over the bed's sensor."""
    campaign = make_campaign(1, None, visits=VISITS, days=4, observations_per_visit=40)
    await post(client, "/v1/machines", campaign.machine | {"id": "wrong"})
    for body in campaign.error_maps:
        await post(client, f"{ROOM}/error-maps", body)
    for body in campaign.reading_bodies:
        await post(client, f"{ROOM}/readings", body)
    for body in campaign.verifications:
        await post(client, f"{ROOM}/verifications", body)


async def analysed(client):
    asked = {"verifications": list(range(1, VISITS + 1)), "effects": ["backlash", "other-sensor"]}
    number = (await post(client, f"{ROOM}/analyses", asked, 202))["id"]
    deadline = time.monotonic() + 120.0
    while True:
        found = (await client.get(f"{ROOM}/analyses/{number}")).json()
        if found["status"] not in ("queued", "running"):
            assert found["status"] == "done", found
            return found
        assert time.monotonic() < deadline, found
        await asyncio.sleep(0.1)


async def assign(client, sensor):
    answer = await client.put(f"{ROOM}/sensor-assignment", json={"EXX": sensor})
    assert answer.status_code == 200, answer.text
    machine = (await client.get(ROOM)).json()
    return machine["active_model"]


@pytest.mark.slow
async def test_a_wrong_assignment_is_proposed_changed_and_gone(tmp_path):
    with running(f"sqlite:///{tmp_path / 'one.db'}", Clock(LATER)) as service:
        async with client_of(service) as client:
            await furnish(client)
            wrong = await assign(client, "bed")
            first = await analysed(client)
            right = await assign(client, "x-middle")
            second = await analysed(client)
            page = await client.get(f"{ROOM}/analyses/{first['id']}/report")
    result = first["result"]
    proposal, *others = result["assignments"]
    assert (proposal["component"], proposal["present_sensor"]) == ("EXX", "bed")
    assert proposal["proposed_sensor"] == "x-middle"
    assert proposal["after_rms_um"] < 0.5 * proposal["before_rms_um"]
    assert not any(one["proposed_sensor"] for one in others)
    assert result["summary"].startswith(proposal["sentence"])
    assert "thermap sensors assign EXX=x-middle --machine wrong" in result["what_next"][0]
    assert "EXX with x-middle instead of bed" in page.text
    assert right == wrong + 1
    assert second["model_version"] == right
    assert second["result"]["verdict"] == "nothing-found"
    assert not any(one["proposed_sensor"] for one in second["result"]["assignments"])
