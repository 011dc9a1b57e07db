"""A small simulated campaign with one undeclared effect, stored in a service."""

import asyncio
from contextlib import closing
from datetime import datetime
from functools import cache

from app.services.analyse_stored import analyse_stored
from app.simulation.undeclared import make_campaign
from app.storage.analyses import begin_analysis, finish_analysis, insert_analysis
from app.storage.database import Database
from app.storage.records import AnalysisTask
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


def analysed_database(url):
    """Prepare an empty database with the campaign, in which reversals were looked for."""
    campaign_database(url)
    task = AnalysisTask(3, list(range(1, 9)), 0.3, ["backlash"], 0)
    with closing(Database(url)) as database:
        with database.writing() as session:
            number = insert_analysis(session, MACHINE_ID, task, LATER).id
            assert begin_analysis(session, number, "tests", LATER)
        text = analyse_stored(url, number, lambda *_progress: None)
        with database.writing() as session:
            assert finish_analysis(session, number, "tests", text, LATER)


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
