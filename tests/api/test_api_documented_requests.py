"""What the OpenAPI document does not allow of a request is refused, and the field is named.

Of every documented request that has an example each field in it is left out, replaced by values of
other kinds, and given an unknown one beside it: which the document allows its own schema says.
"""

import copy

import jsonschema_rs
import pytest

from scripts.openapi_document import openapi_document
from tests.service_examples import client_of, contents, furnish_database, problem, running

pytestmark = pytest.mark.anyio

GONE, MORE = object(), object()
OTHERS = ("some text", None, True, -1.5, [], {}, GONE, MORE)
PATHS = {
    **{"machine": "mcfv5050", "controller": "linuxcnc", "name": "nobody"},
    **dict.fromkeys(("map_id", "verification_id", "analysis_id", "version", "number"), "2"),
}
QUERIES = {"export": "?controller=linuxcnc", "compare": "?controller=linuxcnc"}
DEEPEST = 4


def documented():
    """List method, route and schema of each request whose body has an example."""
    for route, operations in openapi_document()["paths"].items():
        for method, operation in operations.items():
            content = operation.get("requestBody", {}).get("content", {})
            if "application/json" in content:
                schema = content["application/json"]["schema"]
                if example_of(schema) is not None:
                    yield method, route, schema


def example_of(schema):
    if "$ref" in schema:
        schema = openapi_document()["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    found = [schema["example"]] if "example" in schema else schema.get("examples", [])
    found += [example_of(other) for other in schema.get("anyOf", ())]
    return next((one for one in found if one is not None), None)


def places(body, at=()):
    """Every place in a body, of lists the first entry's."""
    inner = body.items() if isinstance(body, dict) else enumerate(body[:1])
    for name, value in inner:
        yield (*at, name)
        if isinstance(value, dict | list) and len(at) < DEEPEST:
            yield from places(value, (*at, name))


def are_one_in_another(field, other):
    return f"{field}.".startswith(f"{other}.") or other.startswith(f"{field}.")


def changed(body, place, value):
    body = copy.deepcopy(body)
    inner = body
    for name in place[:-1]:
        inner = inner[name]
    if value is GONE:
        del inner[place[-1]]
    elif value is MORE:
        inner["unknown_field"] = 1.0
    else:
        inner[place[-1]] = value
    return body


@pytest.fixture(scope="module")
def app(databases):
    url = databases.prepared("sqlite", furnish_database)
    with running(url) as service:
        yield service
    databases.give_back(url)


@pytest.mark.parametrize(("method", "route", "schema"), [*documented()], ids=str)
async def test_what_the_document_does_not_allow_is_refused_and_named(app, method, route, schema):
    allowed = jsonschema_rs.Draft202012Validator(
        schema | {"components": openapi_document()["components"]}
    )
    url = route.format(**PATHS) + QUERIES.get(route.rpartition("/")[2], "")
    body = example_of(schema)
    assert allowed.is_valid(body)
    before, sent = contents(app), 0
    async with client_of(app) as client:
        for place in places(body):
            for value in OTHERS:
                if value is MORE and isinstance(place[-1], int):
                    continue
                other = changed(body, place, value)
                if allowed.is_valid(other):
                    continue
                sent += 1
                found = problem(await client.request(method, url, json=other), 422)
                if value is MORE:
                    place = (*place[:-1], "unknown_field")
                # Whether a list is one run or several, its first entry says.
                field = ".".join(map(str, place if isinstance(place[-1], str) else place[:-1]))
                named = [error["field"] for error in found["errors"]]
                assert any(are_one_in_another(field, other) for other in named), (place, value)
                for error in found["errors"]:
                    assert error["message"].startswith(("expected ", "unknown field"))
    assert sent > 0
    assert contents(app) == before
