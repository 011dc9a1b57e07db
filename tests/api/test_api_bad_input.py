"""What is refused: how it is said, and that nothing of it is stored.

Every refusal is a problem with a sentence that says what was expected, what came and
the unit; and the database holds before and after the same.
"""

import gc
import json
import re
from copy import deepcopy
from datetime import timedelta
from weakref import ref

import pytest
from pydantic import TypeAdapter, ValidationError

from app.api.routes.readings import OneOrMoreReadings
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    client_of,
    contents,
    error_map,
    furnish_database,
    iso,
    problem,
    running,
)

pytestmark = pytest.mark.anyio

JSON = {"content-type": "application/json"}


@pytest.fixture(scope="module")
def app(databases):
    """One service for all: every test holds that it has changed nothing."""
    url = databases.prepared("sqlite", furnish_database)
    with running(url) as service:
        yield service
    databases.give_back(url)


@pytest.fixture
def fresh(new_app, databases):
    """A service that may change."""
    return new_app(databases.prepared("sqlite", furnish_database))


@pytest.fixture
async def client(app):
    async with client_of(app) as client:
        yield client


READING = {"time": iso(START), "temperatures_c": {"x-middle": 25.0, "z-column": 27.0}}
NEW_MACHINE = MACHINE | {"id": "another"}
BODIES = {
    "machine": ("POST", "/v1/machines", NEW_MACHINE),
    "patch": ("PATCH", ROOM, {"name": "Another", "extrapolation_margin_c": 1.0}),
    "map": ("POST", f"{ROOM}/error-maps", error_map("Run #9", 40.0)),
    "reading": ("POST", f"{ROOM}/readings", READING),
    "readings": (
        "POST",
        f"{ROOM}/readings",
        [READING | {"time": iso(START - timedelta(1))}, READING],
    ),
    "assignment": ("PUT", f"{ROOM}/sensor-assignment", {"EXX": "spindle"}),
    "compensation": (
        "POST",
        f"{ROOM}/compensation",
        {"temperatures_c": {"x-middle": 25.0, "z-column": 27.0}, "state": {"spindle_rpm": 8000}},
    ),
    "predictions": (
        "POST",
        f"{ROOM}/predictions",
        {"observations": [{"time": iso(START), "component": "EXX", "position_mm": 100.0}]},
    ),
}
"""Requests that are in order, until something in them is changed."""


class Raw(str):
    """Text that is put into the body as it is, though it is no JSON value in Python."""


def written(content):
    """Write JSON with the values that Python's own writer refuses or cannot know."""
    raw = {}

    def mark(value):
        if isinstance(value, Raw):
            raw[f"raw-{len(raw)}-"] = str(value)
            return list(raw)[-1]
        if isinstance(value, dict):
            return {k: mark(v) for k, v in value.items()}
        return [mark(v) for v in value] if isinstance(value, list) else value

    text = json.dumps(mark(content))
    for marker, value in raw.items():
        text = text.replace(f'"{marker}"', value)
    return text.encode()


def changed(name, path, value):
    """Set one place of a body that is in order; the last name of the path may be new."""
    method, url, body = deepcopy(BODIES[name])
    *way, last = path
    inner = body
    for step in way:
        inner = inner[step]
    inner[last] = value
    return method, url, written(body)


def shared_out(places, values):
    """Pair each place with two of the values, so that each value comes to some place."""
    values = list(values)
    return [
        (place, values[(2 * i + j) % len(values)]) for i, place in enumerate(places) for j in (0, 1)
    ]


async def refused(app, client, request, status=422, headers=JSON):
    """Send a request and check that it is refused whole; return the problem."""
    method, url, body = request
    before = contents(app)
    answer = await client.request(method, url, content=body, headers=headers)
    found = problem(answer, status)
    assert contents(app) == before
    return found


@pytest.mark.parametrize("name", BODIES)
async def test_the_bodies_are_in_order_until_they_are_changed(fresh, name):
    method, url, body = BODIES[name]
    async with client_of(fresh) as client:
        assert (await client.request(method, url, json=body)).is_success


NUMBERS = [
    (("machine", ("axes", "x", "min_mm")), "mm"),
    (("machine", ("sensors", 0, "max_c")), "°C"),
    (("machine", ("sensors", 0, "max_age_s")), "s"),
    (("machine", ("extrapolation_margin_c",)), "°C"),
    (("patch", ("extrapolation_margin_c",)), "°C"),
    (("map", ("temperatures_c", "x-middle")), "°C"),
    (("map", ("components", 0, "errors_um", 1)), "µm"),
    (("map", ("components", 0, "positions_mm", 1)), "mm"),
    (("map", ("components", 1, "errors_urad", 1)), "µrad"),
    (("map", ("components", 3, "value_um_per_m")), "µm/m"),
    (("map", ("repeatability_um",)), "µm"),
    (("map", ("measuring_lines_mm",)), "mm"),
    (("reading", ("temperatures_c", "x-middle")), "°C"),
    (("readings", (1, "temperatures_c", "x-middle")), "°C"),
    (("reading", ("state",)), ""),
    (("compensation", ("temperatures_c", "x-middle")), "°C"),
    (("compensation", ("state", "spindle_rpm")), "1/min"),
    (("predictions", ("observations", 0, "position_mm")), "mm"),
]
NO_NUMBERS = {
    "NaN": Raw("NaN"),
    "Infinity": Raw("Infinity"),
    "-Infinity": Raw("-Infinity"),
    "1e400": Raw("1e400"),
    "-1e400": Raw("-1e400"),
    "10**400": Raw("1" + "0" * 400),
    "true": True,
    "text": "25.0",
    "list": [25.0],
    "object": {"value": 25.0},
}
INSIDE = {"measuring_lines_mm": lambda v: {"x": [0, v, 0]}, "state": lambda v: {"rpm": v}}


@pytest.mark.parametrize(("number", "value"), shared_out(NUMBERS, NO_NUMBERS.values()), ids=str)
async def test_what_is_no_finite_number_is_refused_everywhere(app, client, number, value):
    (name, path), unit = number
    put = INSIDE.get(path[-1], lambda v: v)
    found = await refused(app, client, changed(name, path, put(value)))
    error = found["errors"][0]
    last = {"measuring_lines_mm": "measuring_lines_mm.x.1", "state": "state.rpm"}
    assert error["field"].endswith(str(last.get(path[-1], path[-1])))
    assert error["message"].startswith("expected ")
    assert ", got " in error["message"]
    assert unit in error["message"]


@pytest.mark.parametrize("place", [("model_version",)], ids=str)
@pytest.mark.parametrize("value", [True, "1", 1.5, [1], Raw("1e400")], ids=str)
async def test_a_version_is_an_integer(app, client, place, value):
    found = await refused(app, client, changed("predictions", place, value))
    assert found["errors"][0]["field"] == "model_version"


TIMES = {
    "no zone": "2026-03-01T06:00:00",
    "no time": "2026-03-01",
    "a number": 1772344800,
    "a fraction": 1772344800.5,
    "a number as text": "1772344800",
    "milliseconds as text": "1772344800000",
    "true": True,
    "a word": "now",
    "no such day": "2026-02-30T06:00:00Z",
    "no such hour": "2026-03-01T25:00:00Z",
    "no such zone": "2026-03-01T06:00:00+25:00",
    "before the first year in UTC": "0001-01-01T00:00:00+14:00",
    "after the last year in UTC": "9999-12-31T23:59:59-12:00",
    "the first year": "0001-01-01T00:00:00Z",
    "empty": "",
    "nul": "2026-03-01T06:00:00Z\0",
}


TIMES_OF = [
    (("map", ("measured_at",)), "measured_at"),
    (("reading", ("time",)), "time"),
    (("readings", (1, "time")), "1.time"),
    (("predictions", ("observations", 0, "time")), "observations.0.time"),
]


@pytest.mark.parametrize(
    ("of", "time"),
    [*shared_out(TIMES_OF, TIMES.values()), *((TIMES_OF[1], time) for time in TIMES.values())],
    ids=str,
)
async def test_a_time_is_iso_8601_with_a_zone(app, client, of, time):
    place, field = of
    found = await refused(app, client, changed(*place, time))
    assert [e["field"] for e in found["errors"]] == [field]
    assert found["errors"][0]["message"].startswith("expected ")


@pytest.mark.parametrize("time", ["2026-02-30T06:00:00Z", "2026-03-01T25:00:00Z"])
async def test_a_time_that_there_never_is_is_told_how_times_are_written(app, client, time):
    found = await refused(app, client, changed("reading", ("time",), time))
    assert found["errors"][0]["message"] == (
        "expected a time that a calendar and a clock have, as ISO 8601 text such as "
        f"2026-03-01T06:00:00Z, got '{time}'"
    )


async def test_a_time_in_a_query_is_iso_8601_with_a_zone(client):
    for time in filter(None, TIMES.values()):
        for name in ("from", "to"):
            found = problem(await client.get(f"{ROOM}/readings", params={name: str(time)}), 422)
            assert [e["field"] for e in found["errors"]] == [name], time


@pytest.mark.parametrize(
    ("query", "field"),
    [
        ({"limit": -1}, "limit"),
        ({"limit": 0}, "limit"),
        ({"limit": 100_001}, "limit"),
        ({"limit": 10**40}, "limit"),
        ({"limit": "many"}, "limit"),
        ({"limit": 1.5}, "limit"),
        ({"every_s": -1}, "every_s"),
        ({"every_s": "inf"}, "every_s"),
        ({"every_s": "nan"}, "every_s"),
        ({"every_s": "1e400"}, "every_s"),
        ({"every_s": "a minute"}, "every_s"),
    ],
)
async def test_a_query_that_makes_no_sense_is_refused(client, query, field):
    found = problem(await client.get(f"{ROOM}/readings", params=query), 422)
    (error,) = found["errors"]
    assert error["field"] == field
    assert error["message"].startswith("expected ")


TEXTS = {
    "empty": ("", "1 character"),
    "blank": (" \t ", "1 character"),
    "201 characters": ("x" * 201, "200 characters"),
    "201 emoji": ("🌡" * 201, "200 characters"),
    "nul": ("Run\0 #9", "nul"),
    "only nul": ("\0", "nul"),
    "lone surrogate": ("Run \ud800", "json"),
    "a number": (9, "expected text"),
    "true": (True, "expected text"),
}


NAMES_OF = [
    *(("machine", ("name",)), ("patch", ("name",))),
    *(("map", ("label",)), ("map", ("instrument",))),
]


@pytest.mark.parametrize(
    ("place", "wrong"),
    [*shared_out(NAMES_OF, TEXTS.values()), *((NAMES_OF[2], wrong) for wrong in TEXTS.values())],
    ids=ascii,
)
async def test_a_name_is_text_of_1_to_200_characters(app, client, place, wrong):
    text, said = wrong
    found = await refused(app, client, changed(*place, text))
    (error,) = found["errors"]
    # Half a character is no JSON of any field.
    assert error["field"] == ("body" if "\ud800" in str(text) else place[1][0])
    assert error["message"].startswith("expected ")
    assert said in error["message"].lower()


@pytest.mark.parametrize(
    "machine_id",
    [
        "",
        "a/b",
        "../etc",
        ".hidden",
        "-x",
        "a b",
        "a\nb",
        "a\n",
        "naïve",
        "x" * 65,
        "x" * 300,
        "a\0",
        "a%2Fb",
        "a\ud800",
        7,
        None,
        True,
    ],
    ids=repr,
)
async def test_a_machines_id_is_fit_for_a_url(app, client, machine_id):
    found = await refused(app, client, changed("machine", ("id",), machine_id))
    field = "body" if "\ud800" in str(machine_id) else "id"
    assert [e["field"] for e in found["errors"]] == [field]


async def test_what_an_id_may_be_is_said_in_words(app, client):
    (error,) = (await refused(app, client, changed("machine", ("id",), "VMC 3")))["errors"]
    assert error["message"] == (
        "expected 1 to 64 letters from a to z or A to Z, digits, dots, hyphens or underscores, "
        "the first of them a letter or digit, got 'VMC 3'"
    )


ODD_IDS = {
    "300 characters": "x" * 300,
    "nul": "a%00b",
    "slashes": "a%2Fb",
    "dots": "%2E%2E",
    "emoji": "%F0%9F%8C%A1",
    "invalid UTF-8": "%FF%FE",
    "surrogate": "%ED%A0%80",
    "quote": "a'--",
}


@pytest.mark.parametrize("machine_id", ODD_IDS.values(), ids=ODD_IDS)
async def test_an_id_in_a_url_that_no_machine_can_have_is_unknown(app, client, machine_id):
    before = contents(app)
    room = f"/v1/machines/{machine_id}"
    for method, path, body in (
        ("GET", "", None),
        ("DELETE", "", None),
        ("PATCH", "", {"name": "x"}),
        ("GET", "/error-maps", None),
        ("POST", "/error-maps", BODIES["map"][2]),
        ("GET", "/error-maps/1", None),
        ("DELETE", "/error-maps/1", None),
        ("GET", "/sensor-assignment", None),
        ("PUT", "/sensor-assignment", {"EXX": "spindle"}),
        ("POST", "/sensor-assignment/correlate", None),
        ("GET", "/models", None),
        ("GET", "/models/1", None),
        ("POST", "/models/1/activate", None),
        ("GET", "/readings", None),
        ("POST", "/readings", READING),
        ("GET", "/compensation", None),
        ("POST", "/compensation", BODIES["compensation"][2]),
        ("POST", "/predictions", BODIES["predictions"][2]),
    ):
        answer = await client.request(method, room + path, json=body)
        if answer.status_code == 307:  # two dots lead elsewhere before the service sees them
            continue
        problem(answer, 404)
    assert contents(app) == before


@pytest.mark.parametrize("number", [0, -1, 4, 2**31, 2**63, 2**64, 10**40])
async def test_an_unknown_map_is_told_with_those_that_exist(app, client, number):
    before = contents(app)
    for method in ("GET", "DELETE"):
        found = problem(await client.request(method, f"{ROOM}/error-maps/{number}"), 404)
        assert "1 (Run #1), 2 (Run #3), 3 (Run #6)" in found["detail"]
    assert contents(app) == before


@pytest.mark.parametrize("number", ["one", "1.5", "0x1", "1e3", "%00", "True", "9" * 5000])
@pytest.mark.parametrize("path", ["error-maps", "models"])
async def test_a_number_in_a_url_is_an_integer(client, path, number):
    found = problem(await client.get(f"{ROOM}/{path}/{number}"), 422)
    assert found["errors"][0]["message"].startswith("expected ")


def component(**fields):
    return [{"component": "EXX", "positions_mm": [0, 100], "errors_um": [0.0, 1.0]} | fields]


COMPONENTS = {
    "unsorted": (component(positions_mm=[100, 0]), "0.positions_mm", "100 then 0"),
    "twice": (component(positions_mm=[5, 5]), "0.positions_mm", "twice"),
    "lengths": (component(errors_um=[0, 1, 2]), "0.errors_um", "expected 2 values of EXX in µm"),
    "empty positions": (component(positions_mm=[]), "0.positions_mm", "mm"),
    "empty errors": (component(errors_um=[]), "0.errors_um", "µm"),
    "positions missing": (component(positions_mm=None), "0.positions_mm", "mm, got none"),
    "errors missing": (component(errors_um=None), "0.errors_um", "µm, got none"),
    "wrong unit": (
        [{"component": "EBX", "positions_mm": [0, 100], "errors_um": [0.0, 1.0]}],
        "0.errors_um",
        "expected errors_urad [µrad] for EBX",
    ),
    "two units": (component(errors_urad=[0.0, 1.0]), "0.errors_urad", "errors_um [µm]"),
    "a value for a table": (component(value_um_per_m=1.0), "0.value_um_per_m", "errors_um [µm]"),
    "a table for a value": (
        [{"component": "SXY", "positions_mm": [0, 1], "errors_um": [0.0, 1.0]}],
        "0.errors_um",
        "value_um_per_m [µm/m]",
    ),
    "backward length": (
        component(backward_errors_um=[0.0]),
        "0.backward_errors_um",
        "expected 2 values of EXX in µm",
    ),
    "backward unit": (
        component(backward_errors_urad=[0.0, 0.0]),
        "0.backward_errors_urad",
        "errors_um [µm]",
    ),
    "backward of a value": (
        [{"component": "SXY", "value_um_per_m": 1.0, "backward_errors_um": [1.0]}],
        "0.backward_errors_um",
        "value_um_per_m",
    ),
    "unknown": (component(component="EXQ"), "0.component", "near it: "),
    "empty name": (component(component=""), "0.component", "EXX"),
    "nul in the name": (component(component="EXX\0"), "0.component", "EXX"),
    "unknown field": (component(errors_mm=[0, 1]), "0.errors_mm", "unknown field"),
    "no components": ([], "", "at least 1 entry"),
    "twice the same": (component() + component(component="D_x(x)"), "1.component", "EXX again"),
    "a metre of error": (component(errors_um=[0.0, 1.1e6]), "0.errors_um", "±1e+06 µm"),
    "not a list": ({"EXX": [0, 1]}, "", "list"),
}


@pytest.mark.parametrize(("components", "field", "said"), COMPONENTS.values(), ids=COMPONENTS)
async def test_a_wrong_component_is_named(app, client, components, field, said):
    found = await refused(app, client, changed("map", ("components",), components))
    (error,) = found["errors"]
    assert error["field"] == f"components.{field}".rstrip(".")
    assert said in error["message"]


@pytest.mark.parametrize(
    ("temperatures_c", "field", "said"),
    [
        ({}, "temperatures_c", "at least 1 entry"),
        ({"nose": 20.0}, "temperatures_c.nose", "x-middle, y-front, z-column, spindle"),
        ({"x-middle": 293.15}, "temperatures_c.x-middle", "20.00 °C if it was meant in kelvin"),
        ({"\0": 20.0}, "temperatures_c.\0", "x-middle"),
        ({"": 20.0}, "temperatures_c.", "x-middle"),
        ({"x" * 1000: 20.0}, "temperatures_c." + "x" * 1000, "x-middle"),
        ([20.0], "temperatures_c", "°C"),
        ("20 °C", "temperatures_c", "°C"),
    ],
    ids=["empty", "unknown", "kelvin", "nul", "no name", "long name", "list", "text"],
)
@pytest.mark.parametrize("name", ["map", "reading", "readings", "compensation"])
async def test_wrong_temperatures_are_named(app, client, name, temperatures_c, field, said):
    inside = (1, "temperatures_c") if name == "readings" else ("temperatures_c",)
    if name == "compensation" and temperatures_c == {}:
        said = "°C"
        field = "temperatures_c.x-middle"
    found = await refused(app, client, changed(name, inside, temperatures_c))
    field = f"1.{field}" if name == "readings" else field
    errors = {e["field"]: e["message"] for e in found["errors"]}
    assert said in errors[field]
    assert "0.temperatures_c" not in found["detail"]


@pytest.mark.parametrize(
    "key", ["", "a\0b", "x" * 201, "\ud800"], ids=["empty", "nul", "long", "surrogate"]
)
@pytest.mark.parametrize("name", ["reading", "readings", "compensation"])
async def test_the_state_has_names(app, client, name, key):
    inside = (1, "state") if name == "readings" else ("state",)
    found = await refused(app, client, changed(name, inside, {key: 1.0}))
    assert found["errors"][0]["message"].startswith("expected ")


@pytest.mark.parametrize("key", ["\ud800", "\udfff\0", "\0"], ids=["high", "low", "nul"])
@pytest.mark.parametrize("name", ["map", "reading", "compensation", "assignment"])
async def test_a_name_that_is_no_text_is_refused(app, client, name, key):
    inside = (key,) if name == "assignment" else ("temperatures_c", key)
    value = "x-middle" if name == "assignment" else 20.0
    await refused(app, client, changed(name, inside, value))


async def test_an_assignment_with_a_name_around_it_is_told_of_the_name(app, client):
    body = written({"assignment": {"EXX": "spindle"}})
    found = await refused(app, client, ("PUT", f"{ROOM}/sensor-assignment", body))
    (error,) = found["errors"]
    assert error["field"] == "assignment"
    assert error["message"].startswith("expected an error component such as EXX")


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"configuration": "XYZ"}, "configuration"),
        ({"configuration": "X\0FZ"}, "configuration"),
        ({"axes": {"x": {"min_mm": 10, "max_mm": 10}}}, "axes.x"),
        ({"axes": {"q": {"min_mm": 0, "max_mm": 10}}}, "axes"),
        ({"axes": {"\ud800": {"min_mm": 0, "max_mm": 10}}}, "body"),
        ({"sensors": [{"name": "a", "stand_in": "a"}]}, "sensors.a.stand_in"),
        ({"sensors": [{"name": "a"}, {"name": "a"}]}, "sensors"),
        ({"sensors": [{"name": "a\0"}]}, "sensors"),
        ({"sensors": [{"name": "x" * 65}]}, "sensors"),
        ({"sensors": [{"name": "a", "min_c": 20, "max_c": 20}]}, "sensors.a"),
        ({"sensors": [{"name": "a", "resolution_c": 0}]}, "sensors.0.resolution_c"),
        ({"sensors": [{"name": "a", "max_age_s": 1e300}]}, "sensors.0.max_age_s"),
        ({"out_of_range": "guess"}, "out_of_range"),
        ({"extrapolation_margin_c": -0.1}, "extrapolation_margin_c"),
    ],
    ids=lambda v: str(v)[:40] if isinstance(v, dict) else "",
)
async def test_a_machine_that_cannot_be_is_refused(app, client, change, field):
    found = await refused(app, client, ("POST", "/v1/machines", written(NEW_MACHINE | change)))
    assert field in [e["field"] for e in found["errors"]]


async def test_all_that_is_wrong_with_a_machine_is_named_at_once(app, client):
    """The configuration is read to axes, which must not hide what else is wrong."""
    wrong = {"configuration": "XYZ", "sensors": [{"name": "a"}, {"name": "a"}], "name": 7}
    found = await refused(app, client, ("POST", "/v1/machines", written(NEW_MACHINE | wrong)))
    assert [e["field"] for e in found["errors"]] == ["name", "configuration", "sensors"]


async def test_all_components_that_are_wrong_are_named_at_once(app, client):
    components = [*component(errors_um=[0.0]), *component(component="EXQ"), *component()]
    found = await refused(app, client, changed("map", ("components",), components))
    fields = ["components.0.errors_um", "components.1.component"]
    assert [e["field"] for e in found["errors"]] == fields


NO_JSON = {
    "nothing": b"",
    "half": b'{"temperatures_c": {"x-middle": 25.0',
    "python": b"{'temperatures_c': {}}",
    "invalid UTF-8": b'{"temperatures_c": {"x-middle\xff": 25.0}}',
    "UTF-8 cut off": b'{"label": "\xf0\x9f"}',
    "binary": bytes(range(256)),
    "deep lists": b"[" * 100_000,
    "deep lists closed": b"[" * 100_000 + b"]" * 100_000,
    "deep objects": b'{"temperatures_c":' * 20_000 + b"1" + b"}" * 20_000,
    "5000 digits": b'{"temperatures_c": {"x-middle": ' + b"9" * 5000 + b"}}",
    "null": b"null",
    "a number": b"25.0",
    "text": b'"25.0"',
    "a list in a list": b"[[]]",
    "empty list": b"[]",
    "trailing": b'{"temperatures_c": {"x-middle": 25.0, "z-column": 25.0}} extra',
}


@pytest.mark.parametrize(
    ("name", "kind"), [*shared_out(BODIES, NO_JSON), *(("map", kind) for kind in NO_JSON)]
)
async def test_what_is_no_json_of_the_documented_shape_is_refused(app, client, name, kind):
    method, url, _ = BODIES[name]
    await refused(app, client, (method, url, NO_JSON[kind]))


OTHER_CONTENT = [
    {},
    {"content-type": "text/plain"},
    {"content-type": "application/x-www-form-urlencoded"},
    {"content-type": "multipart/form-data; boundary=x"},
    {"content-type": ""},
    {"content-type": "application/xml"},
]


@pytest.mark.parametrize(("name", "header"), shared_out(BODIES, OTHER_CONTENT), ids=str)
async def test_another_content_type_is_refused(app, client, name, header):
    """A browser sends these across origins without asking first."""
    method, url, body = BODIES[name]
    found = await refused(app, client, (method, url, written(body)), 415, headers=header)
    assert "Content-Type: application/json" in found["detail"]


async def test_of_many_errors_the_first_are_listed_and_some_others_counted(app, client):
    many = [READING | {"temperatures_c": {"x-middle": "warm"}} for _ in range(10_000)]
    found = await refused(app, client, ("POST", f"{ROOM}/readings", written(many)))
    assert len(found["errors"]) == 20
    assert re.search(r"and at least \d+ more", found["detail"])


async def test_huge_values_are_not_repeated_in_the_answer(app, client):
    body = changed("map", ("label",), ["x" * 1_000_000])
    found = await refused(app, client, body)
    assert len(json.dumps(found)) < 2000


@pytest.mark.parametrize("name", ["readings", "data"])
async def test_a_list_of_readings_with_a_name_around_it_is_told_of_the_list(app, client, name):
    body = written({name: [READING]})
    found = await refused(app, client, ("POST", f"{ROOM}/readings", body))
    (error,) = found["errors"]
    assert error["field"] == "body"
    assert f'a list of them without the name "{name}" around it' in error["message"]


UNKNOWN_FIELDS = {
    "reading": ({**READING, "temperatures_f": {}}, "time, temperatures_c, state"),
    "readings": ([{**READING, "temperatures": {}}], "time, temperatures_c, state"),
    "machine": (NEW_MACHINE | {"axes": {"x": {"min_mm": 0, "max": 500}}}, "min_mm, max_mm"),
    "map": (
        error_map("Run #9", 40.0, components=[{"component": "EXX", "errors_mm": [1.0]}]),
        "only the documented ones; near it: errors_um",
    ),
}


@pytest.mark.parametrize("name", UNKNOWN_FIELDS)
async def test_where_a_field_is_unknown_those_that_there_are_are_named(app, client, name):
    method, url, _ = BODIES[name]
    body, expected = UNKNOWN_FIELDS[name]
    found = await refused(app, client, (method, url, written(body)))
    (said,) = [e["message"] for e in found["errors"] if "unknown" in e["message"]]
    assert expected in said


READINGS = TypeAdapter(OneOrMoreReadings)


class Stated(list):
    """A list that can be watched: of a plain one nobody can say whether it is still held."""


@pytest.mark.parametrize(
    "wrong",
    [{"time": "soon"}, {"temperatures_c": {"bed": "warm"}}, {"more": 1}],
    ids=["time", "number", "unknown"],
)
@pytest.mark.slow
def test_a_list_that_is_refused_is_not_held(wrong):
    reading = {"time": "2026-03-01T06:00:00Z", "temperatures_c": {"bed": 20.0}}
    stated = Stated([reading, reading | wrong])
    held = ref(stated)
    errors = 0
    try:  # not `pytest.raises`, which holds what was raised
        READINGS.validate_python(stated)
    except ValidationError as refused:
        errors = refused.error_count()
    del stated
    gc.collect()
    assert errors == 1
    assert held() is None
