"""Many at once: the service's own threads, and two services on one database."""

import asyncio
import random
from collections import Counter
from datetime import timedelta

import pytest

from app.access.keys import Role
from app.services.access_keys import create_key, show_keys
from tests.databases import KINDS, reachable
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    client_of,
    contents,
    error_map,
    furnish,
    iso,
    reading,
    temperatures,
)

pytestmark = pytest.mark.anyio

MAPS = f"{ROOM}/error-maps"
READINGS = f"{ROOM}/readings"


@pytest.fixture
def two_apps(new_app, request, databases):
    """On PostgreSQL, where transactions meet; on SQLite one waits for the other."""
    kind = getattr(request, "param", "postgresql")
    url = reachable(databases.migrated, kind)
    yield [new_app(url) for _ in range(2)]
    databases.give_back(url)


on_both = pytest.mark.parametrize("two_apps", KINDS, indirect=True)


@pytest.fixture
async def two(two_apps):
    """Clients of two services on one database, which has the machine and no maps."""
    async with client_of(two_apps[0]) as one, client_of(two_apps[1]) as other:
        await furnish(one, maps={})
        yield one, other


def statuses(answers):
    return Counter(answer.status_code for answer in answers)


async def versions(client):
    return (await client.get(f"{ROOM}/models")).json()


@pytest.mark.slow
async def test_eight_maps_at_once_make_eight_versions(two):
    stated = [error_map(f"Run #{i}", 20.0 + i) for i in range(8)]
    answers = await asyncio.gather(
        *(two[i % 2].post(MAPS, json=content) for i, content in enumerate(stated))
    )
    assert statuses(answers) == {201: 8}
    assert len({answer.json()["id"] for answer in answers}) == 8
    made = await versions(two[0])
    assert [v["version"] for v in made] == list(range(1, 9))
    assert [len(v["maps"]) for v in made] == list(range(1, 9))
    assert [v["active"] for v in made] == [False] * 7 + [True]
    assert sorted(m["label"] for m in made[-1]["maps"]) == [f"Run #{i}" for i in range(8)]
    listed = (await two[1].get(MAPS)).json()
    assert all(m["in_active_model"] for m in listed)
    assert all(len(m["components"]) == 4 for m in listed)


@pytest.mark.slow
async def test_one_map_posted_by_all_at_once_is_stored_once(two):
    content = error_map("Run #1", 20.0)
    answers = await asyncio.gather(*(two[i % 2].post(MAPS, json=content) for i in range(12)))
    assert statuses(answers) == {201: 1, 200: 11}
    assert len({answer.content for answer in answers}) == 1
    assert len(await versions(two[0])) == 1


@on_both
async def test_different_maps_under_one_label_at_once_leave_one(two):
    answers = await asyncio.gather(
        *(two[i % 2].post(MAPS, json=error_map("Run #1", 20.0 + i)) for i in range(8))
    )
    assert statuses(answers) == {201: 1, 409: 7}
    (stored,) = (await two[0].get(MAPS)).json()
    (won,) = [a.json() for a in answers if a.status_code == 201]
    assert stored == won


@on_both
async def test_of_many_who_name_an_operator_at_once_one_is_stored_and_the_others_are_told(two):
    observation = {"time": iso(START), "component": "EXX", "position_mm": 10.0, "measured_um": 1.0}
    check = {"label": "night shift", "observations": [observation]}
    path = f"{ROOM}/verifications"
    assert (await two[0].post(path, json=check)).status_code == 201
    answers = await asyncio.gather(
        *(two[i % 2].post(path, json=check | {"operator": f"shift {i}"}) for i in range(8))
    )
    assert statuses(answers) == {200: 1, 409: 7}
    (named,) = [a.json() for a in answers if a.status_code == 200]
    assert (await two[0].get(f"{path}/{named['id']}")).json()["operator"] == named["operator"]


@pytest.mark.slow
async def test_one_machine_made_by_all_at_once_is_made_once(two):
    bodies = [MACHINE | {"id": "new", "name": f"by {i}"} for i in range(10)]
    answers = await asyncio.gather(
        *(two[i % 2].post("/v1/machines", json=body) for i, body in enumerate(bodies))
    )
    assert statuses(answers) == {201: 1, 409: 9}
    (won,) = [a.json() for a in answers if a.status_code == 201]
    assert (await two[0].get("/v1/machines/new")).json() == won


@pytest.mark.slow
async def test_overlapping_readings_at_once_are_stored_once_each(two, two_apps):
    def batch(first):
        times = [START - timedelta(seconds=s) for s in range(first, first + 300)]
        return [reading(t, 20.0) for t in times]

    batches = [batch(50 * i) for i in range(8)]
    answers = await asyncio.gather(
        *(
            two[i % 2].post(READINGS, json=content[:: 1 if i % 3 else -1])
            for i, content in enumerate(batches)
        )
    )
    assert statuses(answers) == {201: 8}
    different = 300 + 7 * 50
    assert sum(a.json()["stored"] for a in answers) == different
    assert sum(a.json()["duplicates"] for a in answers) == 8 * 300 - different
    assert len(contents(two_apps[0])["reading"]) == different


@pytest.mark.slow
async def test_the_same_readings_in_opposite_order_at_once_do_not_lock_each_other_out(two):
    """Whoever inserts in the order in which they came waits for the other, and it for him."""
    forwards = [reading(START - timedelta(seconds=s), 20.0) for s in range(1500)]
    answers = await asyncio.gather(
        *(two[i % 2].post(READINGS, json=forwards[:: 1 - i % 2 * 2]) for i in range(4))
    )
    assert statuses(answers) == {201: 4}
    assert sum(a.json()["stored"] for a in answers) == 1500


@pytest.mark.slow
async def test_readings_that_contradict_each_other_at_once_leave_one_whole_batch(two, two_apps):
    batches = [
        [reading(START - timedelta(seconds=s), 20.0 + i) for s in range(200)] for i in range(6)
    ]
    answers = await asyncio.gather(
        *(two[i % 2].post(READINGS, json=content) for i, content in enumerate(batches))
    )
    assert statuses(answers) == {201: 1, 409: 5}
    (won,) = [i for i, a in enumerate(answers) if a.status_code == 201]
    listed = (await two[0].get(READINGS)).json()
    assert listed == batches[won][::-1]


@pytest.mark.slow
async def test_everything_at_once_leaves_one_consistent_machine(two, two_apps):
    """Maps, assignments, activations, patches and deletions, from two services."""
    await two[0].post(MAPS, json=error_map("First", 18.0))
    await two[0].post(MAPS, json=error_map("Second", 19.0))
    requests = []
    for i in range(6):
        requests += [
            ("POST", MAPS, error_map(f"Run #{i}", 20.0 + i)),
            ("PUT", f"{ROOM}/sensor-assignment", {"EXX": ["spindle", "x-middle"][i % 2]}),
            ("POST", f"{ROOM}/models/{1 + i % 2}/activate", None),
            ("PATCH", ROOM, {"name": f"by {i}"}),
            ("DELETE", f"{MAPS}/{1 + i % 3}", None),
            ("POST", READINGS, reading(START - timedelta(seconds=i), 20.0)),
            ("GET", f"{ROOM}/models", None),
        ]
    answers = await asyncio.gather(
        *(two[n % 2].request(m, path, json=body) for n, (m, path, body) in enumerate(requests))
    )
    assert set(statuses(answers)) <= {200, 201, 204, 404, 409}
    assert all(
        a.status_code == 201
        for (m, p, _), a in zip(requests, answers, strict=True)
        if (m, p) == ("POST", MAPS)
    )
    made = await versions(two[0])
    assert [v["version"] for v in made] == list(range(1, len(made) + 1))
    assert sum(v["active"] for v in made) == 1
    stored = contents(two_apps[0])
    assert len(stored["reading"]) == 6
    assert len(stored["error_map"]) == 8
    assert len(stored["error_map_component"]) == 8 * 4


@pytest.mark.slow
@on_both
async def test_writers_of_every_kind_never_wait_for_each_other(two, two_apps, monkeypatch):
    """Whatever meets whatever is answered, and no transaction has to give way to another."""
    pauses = []
    monkeypatch.setattr("app.services.context.sleep", pauses.append)
    rng = random.Random(1)
    requests = iter([_any_request(rng) for _ in range(150)])
    answers = []

    async def work(client):
        for method, path, body in requests:
            answer = await client.request(method, path, json=body)
            answers.append((method, path, answer))

    await asyncio.gather(*(work(two[i % 2]) for i in range(16)))
    wrong = [
        (method, path, answer.text)
        for method, path, answer in answers
        if answer.status_code not in (200, 201, 202, 204, 404, 409)
    ]
    assert not wrong, wrong[:3]
    assert {200, 201, 204} <= {answer.status_code for *_, answer in answers}
    assert not pauses
    await two[0].post("/v1/machines", json=MACHINE)  # it may be gone
    made = await versions(two[0])
    assert made == await versions(two[1])
    assert [v["version"] for v in made] == list(range(1, len(made) + 1))
    assert sum(v["active"] for v in made) == bool(made)
    stored = contents(two_apps[0])
    assert len(stored["error_map_component"]) == 4 * len(stored["error_map"])
    times = [r["time"] for r in (await two[0].get(READINGS, params={"limit": 10_000})).json()]
    assert len(times) == len(set(times)) == len(stored["reading"])


def _any_request(rng):
    """A request of one of the kinds that write, about one of a few things."""
    i = rng.randrange(6)
    since = rng.randrange(2000)
    seconds = range(since, since + rng.choice([1, 30, 1200]))
    readings = [reading(START - timedelta(seconds=s), 20.0) for s in seconds]
    until, begin = (iso(START - timedelta(seconds=s)) for s in (since, since + 300))
    verification = {
        "label": f"visit {i}",
        "datum": "absolute",
        "repeatability_um": 0.5,
        "observations": [
            {
                "time": iso(START - timedelta(seconds=10 * k)),
                "component": "EXX",
                "position_mm": 50.0 * k,
                "measured_um": rng.gauss(0, 1),
            }
            for k in range(10)
        ],
    }
    stored = rng.randrange(1, 12)
    return rng.choice(
        [
            ("POST", READINGS, rng.sample(readings, len(readings))),
            ("POST", READINGS, readings),
            ("DELETE", f"{READINGS}?from={begin}&to={until}", None),
            ("POST", MAPS, error_map(f"Run #{i}", 20.0 + 3 * i)),
            ("POST", MAPS, error_map(f"Run #{i}", 20.0 + 3 * i)),
            ("DELETE", f"{MAPS}/{stored}", None),
            ("PUT", f"{ROOM}/sensor-assignment", {"EXX": rng.choice(["spindle", "x-middle"])}),
            ("POST", f"{ROOM}/models/{stored}/activate", None),
            ("PATCH", ROOM, {"name": f"by {i}"}),
            ("POST", f"{ROOM}/verifications", verification),
            ("DELETE", f"{ROOM}/verifications/{stored}", None),
            ("POST", f"{ROOM}/analyses", {"verifications": [stored]}),
            ("DELETE", f"{ROOM}/analyses/{stored}", None),
            ("POST", "/v1/machines", MACHINE),
            *([("DELETE", ROOM, None)] if rng.random() < 0.3 else []),
        ]
    )


@pytest.mark.slow
async def test_a_deletion_among_writers_leaves_nothing_behind(two, two_apps):
    for _ in range(3):
        requests = [
            ("POST", MAPS, error_map("Run #1", 20.0)),
            ("POST", READINGS, [reading(START - timedelta(seconds=s), 20.0) for s in range(50)]),
            ("DELETE", ROOM, None),
            ("POST", MAPS, error_map("Run #2", 25.0)),
            ("POST", READINGS, reading(START, 20.0)),
            ("POST", f"{ROOM}/compensation", {"temperatures_c": temperatures(20.0)}),
        ]
        answers = await asyncio.gather(
            *(two[n % 2].request(m, path, json=body) for n, (m, path, body) in enumerate(requests))
        )
        assert set(statuses(answers)) <= {200, 201, 204, 404, 409, 422}
        assert answers[2].status_code == 204
        left = contents(two_apps[0])
        assert left.pop("event")  # what happened to a machine is told when it is gone
        assert all(not rows for rows in left.values())
        await furnish(two[0], maps={})


@pytest.mark.slow
async def test_the_live_table_is_always_of_one_version(two):
    """While maps are stored, every table is whole: its numbers are those of its version."""
    one, _ = two
    await one.post(MAPS, json=error_map("Run #0", 20.0))
    await one.post(MAPS, json=error_map("Run #1", 60.0))
    expected = {}

    async def store():
        for i in range(12):
            content = error_map(f"Between #{i}", 30.0 + i)
            content["components"][0]["errors_um"] = [float(i)] * 3
            assert (await one.post(MAPS, json=content)).status_code == 201

    storing = asyncio.create_task(store())
    seen = []
    while not storing.done():
        answer = await one.post(f"{ROOM}/compensation", json={"temperatures_c": temperatures(30.0)})
        seen.append(answer.json())
        await asyncio.sleep(0)
    await storing
    assert len(seen) > 12
    numbers = [document["model_version"] for document in seen]
    assert numbers == sorted(numbers)
    for document in seen:
        expected.setdefault(document["model_version"], document["components"])
        assert document["components"] == expected[document["model_version"]]
        assert document["warnings"] == []


async def test_two_admins_who_revoke_each_other_at_once_leave_one(new_app, database_url):
    services = [new_app(database_url, require_keys=True) for _ in range(2)]
    database = services[0].state.context.database
    secrets = [create_key(database, name, Role.ADMIN).secret for name in ("one", "other")]
    asks = [{"Authorization": f"Bearer {secret}"} for secret in secrets]
    async with client_of(services[0]) as one, client_of(services[1]) as other:
        answers = await asyncio.gather(
            one.delete("/v1/keys/other", headers=asks[0]),
            other.delete("/v1/keys/one", headers=asks[1]),
        )
    # 401: the second was asked after the first was answered, and is no admin any more.
    assert sum(answer.status_code == 204 for answer in answers) == 1
    assert {answer.status_code for answer in answers} <= {204, 409, 401}
    assert len(show_keys(database)) == 1
