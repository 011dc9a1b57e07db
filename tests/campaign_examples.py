"""A small simulated campaign with one undeclared effect, stored in a service."""

import asyncio
from datetime import datetime
from functools import cache

from app.simulation.undeclared import make_campaign
from tests.service_examples import Clock, client_of, running

LATER = datetime.fromisoformat("2026-06-01T00:00:00+00:00")
"""After everything that was measured."""

MACHINE_ID = "campaign"
ROOM = f"/v1/machines/{MACHINE_ID}"


@cache
def small_campaign():
    """Eight visits of 40 observations in two days; EZX has an undeclared reversal value."""
    return make_campaign(1, "backlash", 2.0, visits=8, days=2)


async def furnish_campaign(client):
    """Store the campaign's machine, maps, readings and verifications."""
    campaign = small_campaign()
    machine = campaign.machine | {"id": MACHINE_ID}
    await _post(client, "/v1/machines", machine)
    for body in campaign.error_maps:
        await _post(client, f"{ROOM}/error-maps", body)
    for body in campaign.reading_bodies:
        await _post(client, f"{ROOM}/readings", body)
    for body in campaign.verifications:
        await _post(client, f"{ROOM}/verifications", body)


async def _post(client, path, body):
    answer = await client.post(path, json=body)
    assert answer.status_code == 201, answer.text


def campaign_database(url):
    """Prepare an empty database with the campaign."""

    async def store():
        async with client_of(service) as client:
            await furnish_campaign(client)

    with running(url, Clock(LATER)) as service:
        asyncio.run(store())


def store_sister(client, machine_id, checks=None):
    """Store a sister of the campaign's machine, measured alike; of the first `checks` only."""
    campaign = small_campaign()
    room = f"/v1/machines/{machine_id}"
    bodies = [("/v1/machines", campaign.machine | {"id": machine_id})]
    bodies += [(f"{room}/error-maps", body) for body in campaign.error_maps]
    bodies += [(f"{room}/readings", body) for body in campaign.reading_bodies]
    bodies += [(f"{room}/verifications", body) for body in campaign.verifications[:checks]]
    for path, body in bodies:
        answer = client.post(path, json=body)
        assert answer.status_code == 201, answer.text
