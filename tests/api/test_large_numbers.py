"""Numbers that no database takes are refused wherever a request may state one."""

import json
import re
import typing

import pytest
from fastapi.routing import iter_route_contexts

from scripts.openapi_document import openapi_document

pytestmark = pytest.mark.anyio

TOO_LARGE = [2**63, -(2**63) - 1, 10**30, 10**4000]
JSON = {"content-type": "application/json"}


def parameters(dependant, kind):
    yield from getattr(dependant, f"{kind}_params")
    for further in dependant.dependencies:
        yield from parameters(further, kind)


def is_whole(field):
    annotation = field.field_info.annotation
    return int in (annotation, *typing.get_args(annotation))


def whole_numbers(service):
    """Every whole number of a path or a query, those of pages too: method, path and query."""
    for context in iter_route_contexts(service.routes):
        route = getattr(context, "route", context)
        dependant = getattr(route, "dependant", None)
        if dependant is None:
            continue
        in_path = list(parameters(dependant, "path"))
        in_query = list(parameters(dependant, "query"))
        for field in filter(is_whole, [*in_path, *in_query]):
            path = route.path.replace("{machine}", "mcfv5050")
            for other in in_path:
                path = path.replace(f"{{{other.name}}}", "NUMBER" if other is field else "1")
            needed = {f.alias: "1" for f in in_query if f.field_info.is_required()}
            query = needed | ({field.alias: "NUMBER"} if field in in_query else {})
            for method in route.methods - {"HEAD"}:
                yield method, path, query


async def test_of_paths_and_queries(client, app):
    asked = list(whole_numbers(app))
    assert len(asked) > 20
    for method, path, query in asked:
        for number in map(str, TOO_LARGE):
            stated = {k: v.replace("NUMBER", number) for k, v in query.items()}
            answer = await client.request(method, path.replace("NUMBER", number), params=stated)
            assert 400 <= answer.status_code < 500, (method, path, query, number)


async def test_the_refusal_says_what_was_expected(client):
    answer = await client.get("/v1/events", params={"before": str(2**63)})
    assert answer.status_code == 422
    assert answer.json()["errors"] == [
        {
            "field": "before",
            "message": f"expected a whole number of at most 64 bits, got '{2**63}'",
        }
    ]


def example_of(schema):
    """Make an example of what a schema describes, with every field that has one."""
    document = openapi_document()
    if "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    for name in ("example", "default"):
        if schema.get(name) is not None:
            return schema[name]
    if schema.get("examples"):
        return schema["examples"][0]
    for ways in ("anyOf", "oneOf", "allOf"):
        if schema.get(ways):
            return example_of(schema[ways][0])
    if schema.get("type") == "array":
        return [example_of(schema["items"])]
    if schema.get("type") == "object":
        return {name: example_of(field) for name, field in schema.get("properties", {}).items()}
    return {"integer": 1, "number": 1.0, "boolean": True}.get(schema.get("type"), "x")


def with_each_number(content, number):
    """Give copies of a JSON value in which one number is another."""
    if isinstance(content, dict):
        for name, value in content.items():
            for changed in with_each_number(value, number):
                yield {**content, name: changed}
    elif isinstance(content, list):
        for i, value in enumerate(content):
            for changed in with_each_number(value, number):
                yield [*content[:i], changed, *content[i + 1 :]]
    elif isinstance(content, (int, float)) and not isinstance(content, bool):
        yield number


def bodies():
    """Every route with a JSON body: method, path and schema."""
    for path, item in openapi_document()["paths"].items():
        for method, operation in item.items():
            stated = operation.get("requestBody", {}).get("content", {}).get("application/json")
            if stated is not None:
                yield method.upper(), path, stated["schema"]


@pytest.mark.slow
async def test_of_bodies(client):
    named = {"{machine}": "mcfv5050", "{controller}": "linuxcnc"}
    routes = list(bodies())
    assert len(routes) > 20
    for method, path, schema in routes:
        there = re.sub(r"\{\w+\}", lambda part: named.get(part[0], "1"), path)
        for number in TOO_LARGE:
            for changed in with_each_number(example_of(schema), number):
                body = json.dumps(changed)
                answer = await client.request(method, there, content=body, headers=JSON)
                assert answer.status_code < 500, (method, path, body[:500], answer.text)
