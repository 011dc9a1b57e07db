"""Analyses over HTTP: asked for, followed, adopted, refused."""

import asyncio
import json
import time
from dataclasses import replace

import pytest

from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.registry import explain, kind_of
from app.effects.shape import Everywhere
from app.effects.term import Term
from app.storage.analyses import begin_analysis, finish_analysis, insert_analysis
from app.storage.analysis_results import RESULTS
from app.storage.records import AnalysisTask
from tests.campaign_examples import LATER, ROOM, campaign_database
from tests.effect_examples import OUTDATED
from tests.pages.example_analyses import LAG as LAG_FOUND
from tests.pages.example_analyses import NOTHING
from tests.service_examples import ROOM as OTHER_ROOM
from tests.service_examples import START, Clock, client_of, contents, problem, reading, running

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/analyses"
ALL = list(range(1, 9))
QUICK = {"verifications": ALL, "effects": ["backlash"]}


@pytest.fixture
def campaign_app(databases):
    """On SQLite: on PostgreSQL workers run analyses (tests/services/test_workers.py)."""
    url = databases.prepared("sqlite", campaign_database)
    with running(url, Clock(LATER)) as service:
        yield service
    databases.give_back(url)


@pytest.fixture
async def campaign(campaign_app):
    async with client_of(campaign_app) as client:
        yield client


async def ended(client, number):
    """Wait until an analysis neither waits nor runs; give it and the progress that was seen."""
    deadline = time.monotonic() + 120.0
    seen = []
    while True:
        found = (await client.get(f"{PATH}/{number}")).json()
        seen.append(found["progress"])
        if found["status"] not in ("queued", "running"):
            return found, seen
        assert found["result"] is None
        assert time.monotonic() < deadline, found
        await asyncio.sleep(0.05)


@pytest.mark.slow
async def test_from_the_request_to_the_adopted_effect(campaign):
    answer = await campaign.post(PATH, json=QUICK)
    assert answer.status_code == 202, answer.text
    asked = answer.json()
    assert (asked["status"], asked["model_version"], asked["effects"]) == (
        "queued",
        3,
        ["backlash"],
    )
    assert answer.headers["Location"] == f"{PATH}/{asked['id']}"
    second = (await campaign.post(PATH, json=QUICK)).json()["id"]
    done, seen = await ended(campaign, asked["id"])
    assert (done["status"], done["progress"], done["message"]) == ("done", 1.0, "done")
    assert seen == sorted(seen)
    (effect,) = done["result"]["effects"]
    assert (effect["kind"], effect["components"]) == ("backlash", ["EZX"])
    # Planted: half the reversal value is -2.02 µm.
    assert effect["explanation"].startswith("EZX")
    assert all(visit["time"].endswith("Z") for visit in effect["strongest_visits"])
    sides = {c["component"]: set(c["direction"]) for c in done["result"]["plots"]["visits"]}
    # Both directions cancel in a mean: where an effect reverses they are apart.
    assert {-1.0, 1.0} <= sides["EZX"]
    assert all(found == {0.0} for name, found in sides.items() if name != "EZX")
    again, _ = await ended(campaign, second)
    assert again["result"] == done["result"]
    page = await campaign.get(f"{PATH}/{asked['id']}/report")
    assert page.headers["content-type"].startswith("text/html")
    assert effect["explanation"].split()[0] in page.text
    assert "visit 001" in page.text
    assert "<dd>nothing of this analysis</dd>" in page.text
    listed = (await campaign.get(PATH)).json()
    assert [a["id"] for a in listed] == [asked["id"], second]
    assert "result" not in listed[0]
    await adopted_once(campaign, asked["id"], second)


async def adopted_once(campaign, first, second):
    """Adopt the first; not twice, and not the second onto what is active then unasked."""
    for places in ([1], [-1], [0, 0]):
        found = problem(await campaign.post(f"{PATH}/{first}/adopt", json={"effects": places}), 422)
        assert "from 0 to 0" in found["detail"]
    both = await asyncio.gather(*(campaign.post(f"{PATH}/{first}/adopt") for _ in range(2)))
    won, lost = sorted(both, key=lambda answer: answer.status_code)
    assert (won.status_code, won.json()["version"], won.json()["active"]) == (200, 4, True)
    (kept,) = won.json()["effects"]
    assert (kept["kind"], kept["found_by"], kept["refitted_by"]) == ("backlash", first, [])
    assert "version 4" in problem(lost, 409)["detail"]
    assert (await campaign.get(f"{PATH}/{first}")).json()["adopted_version"] == 4
    said = (await campaign.get(f"{PATH}/{first}/report")).text
    assert "<dd>as model version 4: EZX has a reversal value of" in said
    assert "onto_active" in problem(await campaign.post(f"{PATH}/{second}/adopt"), 409)["detail"]
    # The same effect again is one that the active version has.
    forced = await campaign.post(f"{PATH}/{second}/adopt", json={"onto_active": True})
    assert "already has this effect" in problem(forced, 409)["detail"]
    assert len((await campaign.get(f"{ROOM}/models")).json()) == 4
    await campaign.post(f"{ROOM}/models/3/activate")
    third = await of_fewer_visits(campaign)
    onto = await campaign.post(f"{PATH}/{second}/adopt", json={"effects": [0]})
    assert onto.json()["version"] == 5
    forced = await campaign.post(f"{PATH}/{third}/adopt", json={"onto_active": True})
    assert "would count it twice" in problem(forced, 409)["detail"]
    worded = await campaign.post(f"{PATH}/{third}/adopt", json={"onto_active": "yes"})
    assert problem(worded, 422)["errors"][0]["field"] == "onto_active"
    assert (await campaign.delete(f"{PATH}/{first}")).status_code == 204
    problem(await campaign.get(f"{PATH}/{first}"), 404)
    assert len((await campaign.get(f"{ROOM}/models")).json()) == 5


async def of_fewer_visits(campaign):
    """The same effect in other figures."""
    ids = [v["id"] for v in (await campaign.get(f"{ROOM}/verifications")).json()]
    asked = {"verifications": ids[:-3], "effects": ["backlash"]}
    number = (await campaign.post(PATH, json=asked)).json()["id"]
    done, _ = await ended(campaign, number)
    assert [e["kind"] for e in done["result"]["effects"]] == ["backlash"]
    return number


@pytest.mark.slow
async def test_one_observation_without_a_stated_repeatability_is_not_judged(campaign):
    """It was taken for its own scatter, so that 9.8 µm were “nothing found”."""
    first = (await campaign.get(f"{ROOM}/verifications/1")).json()
    at = first["observations"][0]["time"]
    place = {"time": at, "component": "EXX", "position_mm": 200.0, "measured_um": 0.0}
    stated = {"label": "one", "datum": "absolute", "observations": [place]}
    before = (await campaign.post(f"{ROOM}/verifications", json=stated)).json()["id"]
    shown = await campaign.get(f"{ROOM}/verifications/{before}/residuals", params={"rows": 1})
    (residual,) = shown.json()["rows"]
    moved = place | {"measured_um": residual["predicted"] + 9.8}
    body = stated | {"label": "one more", "observations": [moved]}
    number = (await campaign.post(f"{ROOM}/verifications", json=body)).json()["id"]
    asked = {"verifications": [number], "effects": ["backlash"]}
    done, _ = await ended(campaign, (await campaign.post(PATH, json=asked)).json()["id"])
    answer = done["result"]
    assert (answer["verdict"], answer["noise_um"]) == ("not-judged", None)
    assert "one observation says nothing of its own scatter" in answer["summary"]
    assert "the only observation of EXX is 9.8 µm from what the model" in answer["summary"]
    assert any("each place twice" in words for words in answer["what_next"])


@pytest.mark.slow
async def test_a_failed_analysis_says_why_and_has_nothing_to_adopt(campaign):
    """All observations lie before the machine's first reading."""
    body = {
        "label": "too early",
        "observations": [
            {"time": "2020-01-01T00:00:00Z", "component": "SXY", "measured_um": float(i)}
            for i in range(3)
        ],
    }
    made = (await campaign.post(f"{ROOM}/verifications", json=body)).json()["id"]
    asked = (await campaign.post(PATH, json={"verifications": [made]})).json()["id"]
    failed, _ = await ended(campaign, asked)
    assert failed["status"] == "failed"
    assert "got none" in failed["message"]
    assert "it is failed" in problem(await campaign.post(f"{PATH}/{asked}/adopt"), 409)["detail"]
    assert "it is failed" in problem(await campaign.get(f"{PATH}/{asked}/report"), 409)["detail"]
    assert "it is failed" in problem(await campaign.post(f"{PATH}/{asked}/cancel"), 409)["detail"]


@pytest.mark.parametrize(
    ("stated", "status", "words"),
    [
        ({"verifications": []}, 422, "at least 1"),
        ({"verifications": [1, 1]}, 422, "each once"),
        ({"verifications": ["1"]}, 422, "a whole number"),
        ({"verifications": [99]}, 404, "no verification 99"),
        ({"verifications": [1], "holdout_fraction": 0.0}, 422, "more than 0"),
        ({"verifications": [1], "holdout_fraction": 0.9}, 422, "less than 0.9"),
        ({"verifications": [1], "effects": ["gremlins"]}, 422, "thermal-lag"),
        ({"verifications": [1], "effects": []}, 422, "at least 1"),
        ({"verifications": [1], "effects": ["backlash"] * 2}, 422, "effects: expected each once"),
        ({"verifications": [1], "seed": -1}, 422, "seed"),
        ({"verifications": [1], "seed": 2**31}, 422, "seed"),
    ],
)
async def test_what_cannot_be_asked_is_refused(campaign, campaign_app, stated, status, words):
    before = contents(campaign_app)
    found = problem(await campaign.post(PATH, json=stated), status)
    assert words in found["detail"]
    assert contents(campaign_app) == before


async def test_an_analysis_that_names_no_verification_is_of_all_that_are_stored(campaign):
    answer = await campaign.post(PATH, json={"effects": ["backlash"]})
    assert answer.status_code == 202, answer.text
    assert answer.json()["verifications"] == ALL
    assert (await campaign.post(f"{PATH}/{answer.json()['id']}/cancel")).status_code == 200


async def test_all_verifications_of_a_machine_without_any_are_refused(client):
    for path, asked in (
        ("analyses", {}),
        ("residuals", {}),
        ("models/compare", {"versions": [2, 3]}),
    ):
        found = problem(await client.post(f"{OTHER_ROOM}/{path}", json=asked), 422)
        assert [error["field"] for error in found["errors"]] == ["verifications"]
        assert "all that are stored, and there is none yet" in found["detail"]


async def test_unknown_analyses_and_machines_without_a_model(client):
    path = f"{OTHER_ROOM}/analyses"
    for number in (1, 0, 10**12):
        problem(await client.get(f"{path}/{number}"), 404)
        problem(await client.post(f"{path}/{number}/cancel"), 404)
        problem(await client.post(f"{path}/{number}/adopt"), 404)
        problem(await client.delete(f"{path}/{number}"), 404)
    problem(await client.get("/v1/machines/nope/analyses"), 404)
    bare = {"id": "bare", "name": "bare", "configuration": "XYFZ", "sensors": [{"name": "a"}]}
    bare["axes"] = {axis: {"min_mm": 0, "max_mm": 500} for axis in "xyz"}
    assert (await client.post("/v1/machines", json=bare)).status_code == 201
    found = problem(
        await client.post("/v1/machines/bare/analyses", json={"verifications": [1]}), 409
    )
    assert "store error maps first" in found["detail"]


EXCHANGED = Effect(
    "exchanged-sensors",
    ("EXX",),
    ("x-middle", "y-front"),
    parameters={"share": 1.0},
    terms=(Term("EXX", Always(), Everywhere(), 1.0),),
)


def found(effect, *, helps):
    """An effect as an analysis tells of it; a mistake never helps."""
    why_not = None if helps else kind_of(effect.kind).not_adopted or "nobody confirmed it"
    told = {"effect": effect.to_json(), "helps": helps, "why_not": why_not}
    return LAG_FOUND | told | {"alternatives": [], "explanation": explain(effect)}


def store_done(service, *effects):
    """Store an analysis of the active version that has found these effects; its number."""
    result = RESULTS.read_text(json.dumps(NOTHING | {"effects": list(effects)}))
    with service.state.context.database.writing() as session:
        number = insert_analysis(session, "mcfv5050", AnalysisTask(3, [1], 0.3, None, 0), LATER).id
        assert begin_analysis(session, number, "somebody", LATER)
        assert finish_analysis(session, number, "somebody", RESULTS.text(result), LATER)
    return number


async def test_a_mistake_is_never_adopted_by_whatever_way_it_is_asked(app, client):
    path = f"{OTHER_ROOM}/analyses"
    alone = store_done(app, found(EXCHANGED, helps=False))
    beside = store_done(app, found(EXCHANGED, helps=False), found(OUTDATED, helps=True))
    before = contents(app)
    unasked = problem(await client.post(f"{path}/{alone}/adopt"), 409)["detail"]
    assert "it is a mistake in the wiring" in unasked
    assert "all the same" not in unasked  # no number would adopt it
    for number, places in ((alone, [0]), (beside, [0]), (beside, [0, 1]), (beside, [1, 0])):
        for query in ("", "?accept_losses=true", "?preview=true"):
            asked = {"effects": places, "onto_active": True}
            answer = await client.post(f"{path}/{number}/adopt{query}", json=asked)
            said = problem(answer, 409)["detail"]
            assert f"effect 0 of analysis {number}, exchanged-sensors, cannot be adopted" in said
            assert "it is a mistake in the wiring" in said
    assert contents(app) == before
    adopted = await client.post(f"{path}/{beside}/adopt")
    assert adopted.status_code == 200, adopted.text
    assert [one["kind"] for one in adopted.json()["effects"]] == ["outdated-map"]


async def test_a_refusal_names_a_number_that_could_be_adopted(app, client):
    effects = (found(EXCHANGED, helps=False), found(OUTDATED, helps=False))
    number = store_done(app, *effects)
    refused = problem(await client.post(f"{OTHER_ROOM}/analyses/{number}/adopt"), 409)["detail"]
    assert "such as [1], to adopt one all the same" in refused
    answer = await client.post(f"{OTHER_ROOM}/analyses/{number}/adopt", json={"effects": [1]})
    assert [one["kind"] for one in answer.json()["effects"]] == ["outdated-map"]


@pytest.mark.slow
async def test_a_plan_says_what_could_be_seen_and_stores_nothing(campaign, campaign_app):
    """The same visits again a month later, without values: nobody looks at those."""
    before = contents(campaign_app)
    stored = [(await campaign.get(f"{ROOM}/verifications/{i}")).json() for i in ALL[:2]]
    planned = [{"observations": [_to_come(o) for o in v["observations"]]} for v in stored]
    answer = await campaign.post(f"{PATH}/plan", json={"planned": planned})
    assert answer.status_code == 200, answer.text
    plan = answer.json()
    assert (plan["model_version"], plan["visits"]) == (3, 2)
    assert any("recorded days" in note for note in plan["notes"])
    backlash = [e for e in plan["effects"] if e["kind"] == "backlash"]
    assert backlash
    assert all(0 < e["smallest_rms"] < 100 for e in backlash)
    assert contents(campaign_app) == before


def _to_come(observation):
    kept = {k: v for k, v in observation.items() if not k.startswith("measured")}
    return kept | {"time": observation["time"].replace("2026-02", "2026-07")}


@pytest.mark.parametrize(
    ("stated", "status", "words"),
    [
        ({}, 422, "got 0"),
        ({"verifications": [77]}, 404, "no verification 77"),
        ({"planned": [{"observations": []}]}, 422, "at least 1"),
        ({"planned": [{"observations": [{"time": "2026-07-01T00:00:00Z"}]}]}, 422, "planned.0.obs"),
    ],
)
async def test_plans_that_are_none(campaign, stated, status, words):
    found = problem(await campaign.post(f"{PATH}/plan", json=stated), status)
    assert words in found["detail"]


async def test_more_than_may_wait_is_refused_until_there_is_room(databases):
    url = databases.prepared("sqlite", campaign_database)
    limits = {"waiting_analyses_of_machine": 2, "waiting_analyses": 2}

    async def ask(status, **changed):
        with running(url, Clock(LATER), analyses=False, **limits | changed) as service:
            async with client_of(service) as client:
                answer = await client.post(PATH, json={"verifications": [1]})
        assert answer.status_code == status, answer.text
        if status != 202:
            assert int(answer.headers["Retry-After"]) > 0
            return problem(answer, status)["detail"]
        return ""

    await ask(202)
    await ask(202)
    assert "at most 2 waiting analyses of machine 'campaign'" in await ask(429)
    assert "at most 2 waiting analyses" in await ask(503, waiting_analyses_of_machine=20)
    with running(url, Clock(LATER), analyses=False) as service:
        async with client_of(service) as client:
            assert (await client.post(f"{PATH}/1/cancel")).status_code == 200
    await ask(202)
    databases.give_back(url)


async def test_what_was_confirmed_and_not_adopted_is_in_the_verdict(app, client):
    body = reading(START, 25.0)
    assert (await client.post(f"{OTHER_ROOM}/readings", json=body)).status_code == 201
    confirmed = found(OUTDATED, helps=True) | {"status": "confirmed"}
    store_done(app, found(OUTDATED, helps=True) | {"status": "suspected"})
    status = (await client.get(f"{OTHER_ROOM}/status")).json()
    assert (status["verdict"], status["not_adopted"]) == ("trusted", None)
    number = store_done(app, confirmed)
    status = (await client.get(f"{OTHER_ROOM}/status")).json()
    assert (status["verdict"], status["state"]) == ("limited", "effect-not-adopted")
    not_adopted = {"analysis": number, "effects": [confirmed["explanation"]]}
    assert status["not_adopted"] == not_adopted | {"needs_analysis": False}
    assert status["sentences"][0] == (
        f"Analysis {number} confirmed what the table does not have: "
        f"{confirmed['explanation'].removesuffix('.')}. Adopt it."
    )
    assert (await client.post(f"{OTHER_ROOM}/analyses/{number}/adopt")).status_code == 200
    status = (await client.get(f"{OTHER_ROOM}/status")).json()
    assert (status["model_version"], status["not_adopted"]) == (4, None)


async def test_what_was_confirmed_and_left_out_of_an_adoption_counts_as_not_adopted(app, client):
    body = reading(START, 25.0)
    assert (await client.post(f"{OTHER_ROOM}/readings", json=body)).status_code == 201
    adopted = found(OUTDATED, helps=True) | {"status": "confirmed"}
    other = replace(
        OUTDATED, components=("EZX",), terms=(Term("EZX", Always(), Everywhere(), 3.0),)
    )
    left = found(other, helps=True) | {"status": "confirmed"}
    unsure = found(EXCHANGED, helps=False) | {"status": "suspected"}
    number = store_done(app, adopted, left, unsure)
    path = f"{OTHER_ROOM}/analyses/{number}/adopt"
    assert (await client.post(path, json={"effects": [0]})).status_code == 200
    status = (await client.get(f"{OTHER_ROOM}/status")).json()
    assert (status["model_version"], status["verdict"]) == (4, "limited")
    assert status["not_adopted"] == {
        "analysis": number,
        "effects": [left["explanation"]],
        "needs_analysis": True,
    }
    assert status["sentences"][0].endswith("Analyse again and adopt it.")
    # A later analysis of the version that has the part says what is so now.
    result = RESULTS.read_text(json.dumps(NOTHING | {"effects": []}))
    with app.state.context.database.writing() as session:
        later = insert_analysis(session, "mcfv5050", AnalysisTask(4, [1], 0.3, None, 0), LATER).id
        assert begin_analysis(session, later, "somebody", LATER)
        assert finish_analysis(session, later, "somebody", RESULTS.text(result), LATER)
    assert (await client.get(f"{OTHER_ROOM}/status")).json()["not_adopted"] is None
