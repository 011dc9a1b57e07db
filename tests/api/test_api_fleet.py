"""A fleet over HTTP: asked for once, followed, cancelled, and what was refused of it."""

import pytest

from tests.campaign_examples import LATER, ROOM, campaign_database, small_campaign
from tests.service_examples import Clock, client_of, problem, running

pytestmark = pytest.mark.anyio

PATH = "/v1/fleet"
ASKED = {"effects": ["backlash", "periodic"]}
QUERY = {"effects": ["periodic", "backlash"]}


@pytest.fixture
def database_url(databases):
    url = databases.prepared("sqlite", campaign_database)
    yield url
    databases.give_back(url)


async def furnish(client):
    """Store two sisters of the machine, of which one has a model and a check, one neither."""
    campaign = small_campaign()
    for name in ("sister", "empty"):
        machine = campaign.machine | {"id": name}
        assert (await client.post("/v1/machines", json=machine)).status_code == 201
    for path, bodies in (
        ("error-maps", campaign.error_maps),
        ("readings", campaign.reading_bodies),
        ("verifications", campaign.verifications[:1]),
    ):
        for body in bodies:
            answer = await client.post(f"/v1/machines/sister/{path}", json=body)
            assert answer.status_code == 201, answer.text


def by_machine(answer):
    return {one["machine"]: one for one in answer["machines"]}


async def test_what_is_missing_is_asked_once_and_cancelled(database_url):
    """Whoever asks for the same, in whatever order of kinds, is shown the same analyses."""
    with running(database_url, Clock(LATER), analyses=False) as service:
        async with client_of(service) as client:
            await furnish(client)
            before = (await client.get(PATH, params=QUERY)).json()
            assert not before["going_on"]
            assert before["judgement"]["summary"].startswith("0 machines of 3 judged")
            assert by_machine(before)["empty"]["why_not"] == "it has no model yet"
            assert not by_machine(before)["empty"]["to_be_asked"]
            assert by_machine(before)["sister"]["to_be_asked"]

            asked = await client.post(f"{PATH}/analyses", json=ASKED)
            assert asked.status_code == 202
            assert asked.json()["done"] == ["campaign", "sister"]
            again = (await client.post(f"{PATH}/analyses", json=QUERY)).json()
            assert again["done"] == []
            assert again["refused"] == {}

            found = (await client.get(PATH, params=QUERY)).json()
            assert found["going_on"]
            assert found["judgement"] is None
            job = by_machine(found)["campaign"]["analysis"]
            assert job == (await client.get(f"{ROOM}/analyses")).json()[0]
            other = (await client.get(PATH)).json()
            assert by_machine(other)["campaign"]["analysis"] is None

            cancelled = (await client.post(f"{PATH}/analyses/cancel", json=QUERY)).json()
            assert cancelled["done"] == ["campaign", "sister"]
            assert by_machine(cancelled)["sister"]["analysis"]["status"] == "cancelled"
            assert by_machine(cancelled)["sister"]["to_be_asked"]
            assert not cancelled["going_on"]
            nothing = (await client.post(f"{PATH}/analyses/cancel", json=QUERY)).json()
            assert (nothing["done"], nothing["refused"]) == ([], {})

            begun = (await client.post(f"{PATH}/analyses", json=ASKED)).json()
            assert begun["done"] == ["campaign", "sister"]
            assert by_machine(begun)["campaign"]["analysis"]["status"] == "queued"


async def test_a_full_queue_refuses_some_and_says_which(database_url):
    options = {"analyses": False, "waiting_analyses": 1}
    with running(database_url, Clock(LATER), **options) as service:
        async with client_of(service) as client:
            await furnish(client)
            asked = (await client.post(f"{PATH}/analyses")).json()
            assert asked["done"] == ["campaign"]
            assert asked["queue_full"]
            assert "at most 1 waiting analyses" in asked["refused"]["sister"]


async def test_what_nobody_can_ask_is_refused(database_url):
    with running(database_url, Clock(LATER), analyses=False) as service:
        async with client_of(service) as client:
            guess = {"effects": ["guess"]}
            problem(await client.get(PATH, params=guess), 422)
            problem(await client.post(f"{PATH}/analyses", json=guess), 422)
            problem(await client.post(f"{PATH}/analyses", json={"holdout_fraction": 0.9}), 422)
            twice = {"effects": ["backlash", "backlash"]}
            problem(await client.post(f"{PATH}/analyses/cancel", json=twice), 422)
            assert (await client.get(f"{ROOM}/analyses")).json() == []
