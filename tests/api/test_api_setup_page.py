"""The pages on which a machine is made and set up, and assignments by pattern."""

import re
import tomllib

import pytest

from app.connections.config import read_connections
from tests.api.test_api_access import key, with_key
from tests.api.test_api_dashboard import EVIL, feed, shown
from tests.service_examples import MACHINE, MAPS, ROOM, START, error_map, problem, reading

pytestmark = pytest.mark.anyio

ASSIGNMENT = f"{ROOM}/sensor-assignment"
OTHER_NAMES = {
    "x-middle": "Bed front",
    "y-front": "Hall",
    "z-column": "Column 1",
    "spindle": "Nose",
}


def renamed(body):
    temperatures = {OTHER_NAMES[name]: t for name, t in body["temperatures_c"].items()}
    return body | {"temperatures_c": temperatures}


async def own_machine(client):
    """A machine whose sensors have names that no component follows by itself, with its maps."""
    sensors = [{"name": name} for name in OTHER_NAMES.values()]
    answer = await client.post("/v1/machines", json=MACHINE | {"sensors": sensors})
    assert answer.status_code == 201, answer.text
    for label, t_c in MAPS.items():
        body = renamed(error_map(label, t_c))
        answer = await client.post(f"{ROOM}/error-maps", json=body)
        assert answer.status_code == 201, answer.text


async def test_each_step_says_what_it_needs_and_the_last_that_the_table_lives(empty):
    assert "New machine" in (await shown(empty, "/")).text
    assert "Create the machine" in (await shown(empty, "/new-machine")).text
    answer = await empty.post("/v1/machines", json=MACHINE | {"sensors": []})
    assert answer.status_code == 201
    page = (await shown(empty, f"/machines/{MACHINE['id']}/setup")).text
    assert "Next: Machine" in page
    assert "The machine has no sensors yet." in page
    assert "Name of sensor 1" in page
    await empty.delete(ROOM)
    await own_machine(empty)
    page = (await shown(empty, f"/machines/{MACHINE['id']}/setup")).text
    assert "Next: Sensors" in page
    assert "follow no sensor" in page
    assert "Assign one on the page Set-up" in page
    assigned = await empty.put(ASSIGNMENT, json={"*": "Bed front", "EZZ": "Column 1"})
    assert assigned.status_code == 200, assigned.text
    page = (await shown(empty, f"/machines/{MACHINE['id']}/setup")).text
    assert "Next: Readings" in page
    answer = await empty.post(f"{ROOM}/readings", json=renamed(reading(START, 25.0)))
    assert answer.status_code == 201, answer.text
    page = (await shown(empty, f"/machines/{MACHINE['id']}/setup")).text
    assert "in the live table" in page


async def test_a_pattern_stands_for_the_components_of_the_maps(client):
    before = (await client.get(ASSIGNMENT)).json()
    of_x = {code for code in before if re.fullmatch("E.X", code)}
    assert of_x, "the example has errors of motion along X"
    preview = await client.put(f"{ASSIGNMENT}?preview=true", json={"E*X": "y-front"})
    assert preview.status_code == 200, preview.text
    assert (await client.get(ASSIGNMENT)).json() == before
    answer = await client.put(ASSIGNMENT, json={"E*X": "y-front", "EXX": "spindle"})
    assert answer.status_code == 200, answer.text
    expected = before | dict.fromkeys(of_x, "y-front") | {"EXX": "spindle"}
    assert answer.json() == expected


@pytest.mark.parametrize(
    ("assignment", "field", "words"),
    [
        ({"E*A": "x-middle"}, "E*A", "fits components of the machine's maps"),
        ({"E*X": "nowhere"}, "E*X", "has no sensor 'nowhere'"),
        ({"E*X": "x-middle", "EX*": "y-front"}, None, "two patterns with two sensors"),
        ({"e*x!": "x-middle"}, "e*x!", "e*x!"),
    ],
)
async def test_a_pattern_that_says_nothing_certain_is_refused(client, assignment, field, words):
    before = (await client.get(ASSIGNMENT)).json()
    refused = problem(await client.put(ASSIGNMENT, json=assignment), 422)
    assert words in refused["detail"]
    assert field in (None, refused["errors"][0]["field"])
    assert (await client.get(ASSIGNMENT)).json() == before


async def test_what_is_to_be_copied_is_what_the_service_reads(empty, tmp_path):
    """Every way in, with names that have spaces: as lines of a file that is checked whole."""
    await own_machine(empty)
    page = await empty.get(f"/machines/{MACHINE['id']}/setup")
    texts = re.findall(r"<pre[^>]*>(.*?)</pre>", page.text, re.DOTALL)
    lines = [text.replace("&#34;", '"').replace("&#39;", "'") for text in texts]
    assert lines[0].startswith("curl ")
    assert '"Bed front": 20.0' in lines[0]
    assert len(lines) == 4
    for text in lines[1:]:
        file = tmp_path / "thermap.toml"
        file.write_text(text, encoding="utf-8")
        found = read_connections(file)
        assert len(found.connections) == 1
        assert all(repr(name)[1:-1] in text for name in OTHER_NAMES.values())
        assert tomllib.loads(text)


async def test_nothing_that_a_user_wrote_becomes_part_of_the_page(client):
    await client.patch(ROOM, json={"name": EVIL})
    await feed(client, reading(START, 25.0))
    page = await shown(client, "/machines/mcfv5050/setup")
    assert EVIL in page.text


async def test_who_only_reads_is_offered_nothing(new_app, furnished_url):
    service = new_app(furnished_url, require_keys=True, refresh_s=3600)
    offered = {}
    for role in ("viewer", "metrologist", "admin"):
        async with with_key(service, key(service, role)) as client:
            page = (await client.get("/machines/mcfv5050/setup")).text
            words = ("Show what it would change", "Store the changes")
            offered[role] = [text in page for text in words]
    assert offered == {
        "viewer": [False, False],
        "metrologist": [True, False],
        "admin": [True, True],
    }


async def test_a_machine_that_is_not_there_has_no_set_up(client):
    problem(await client.get("/machines/nobody/setup"), 404)
