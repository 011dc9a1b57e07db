"""What one of pydantic's errors says in our words: what was expected, what came, the unit."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from app.errors import FieldError, counted, list_names
from app.stated import REFUSED
from app.units import unit_of_field


def way_of(name: str) -> str:
    """Mark one way of stating something, which the path of a wrong field leaves out."""
    return f"({name})"


_WHERE = ("body", "query", "path", "header")
"""Where in a request a field was; the first part of a path, but of no field's name."""

_WAYS = ("[key]", *map(way_of, ("one", "more", "point", "line")))
"""Parts of pydantic's paths that are no fields."""

UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
"""Kinds of errors that say that there is no such field."""

_MOST_NAMES = 12
"""Fields that are listed where an unknown one came."""

_LONGEST_SHOWN = 80
"""Characters of one value, or of one part of a field's name, that are repeated."""


def field_error(error: Mapping[str, Any]) -> FieldError:
    """Say of one of pydantic's errors what was expected, what came, and the unit."""
    path = [_cut(str(part)) for part in error["loc"] if part not in _WAYS]
    if path and path[0] in _WHERE:
        del path[0]
    if error["type"] == "json_invalid":
        return FieldError("body", f"expected JSON, got text that is not JSON: {_reason(error)}")
    if error["type"] in UNKNOWN:
        return FieldError(".".join(path), f"unknown field; expected {_known_names(error)}")
    field = ".".join(path) or "body"
    if error["type"] == REFUSED:
        return FieldError(field, str(error["msg"]))
    if isinstance(error.get("input"), bytes):
        return FieldError(field, "expected JSON with the header Content-Type: application/json")
    unit = next((u for u in map(unit_of_field, reversed(path)) if u), None)
    in_unit = f" in {unit}" if unit else ""
    if error["type"] == "missing":
        return FieldError(field, f"expected a value{in_unit}, got nothing")
    context = error.get("ctx", {})
    if error["type"] in ("too_short", "too_long"):
        got = counted(context["actual_length"], "entry", "entries")
    else:
        got = _shorten(error.get("input"))
    return FieldError(field, f"expected {_expected(error, context)}{in_unit}, got {got}")


def with_known_fields(
    errors: Sequence[Mapping[str, Any]], schema: Mapping[str, Any]
) -> list[Mapping[str, Any]]:
    """Add to what is wrong which fields there are where an unknown one came.

    Parameters
    ----------
    errors
        Pydantic's errors, their places within what `schema` describes.
    schema
        The JSON schema of the whole, with its `$defs`.
    """
    return [
        {**error, "ctx": {"known": _fields_at(schema, error["loc"][:-1])}}
        if error["type"] in UNKNOWN
        else error
        for error in errors
    ]


def _fields_at(schema: Mapping[str, Any], way: Sequence[str | int]) -> list[str]:
    """List the fields of the object at a place; those of each kind of object that may be there."""
    nodes = list(_kinds(schema, schema))
    for part in way:
        inner = [inner_node for node in nodes for inner_node in _inside(schema, node, part)]
        nodes = inner or nodes  # a kind's name is no step further in
    return list(dict.fromkeys(name for node in nodes for name in node.get("properties", ())))


def _inside(
    schema: Mapping[str, Any], node: Mapping[str, Any], part: str | int
) -> Iterator[Mapping[str, Any]]:
    field_schema = (
        node.get("items")
        if isinstance(part, int)
        else node.get("properties", {}).get(part, node.get("additionalProperties"))
    )
    if isinstance(field_schema, Mapping):
        yield from _kinds(schema, field_schema)


def _kinds(schema: Mapping[str, Any], node: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Follow references and alternatives to what describes something itself."""
    if "$ref" in node:
        name = str(node["$ref"]).rpartition("/")[2]
        yield from _kinds(schema, schema["$defs"][name])
        return
    yield node
    for other in (*node.get("anyOf", ()), *node.get("oneOf", ()), *node.get("allOf", ())):
        yield from _kinds(schema, other)


def _known_names(error: Mapping[str, Any]) -> str:
    """Name the fields that an unknown one was not, those nearest to it where there are many."""
    allowed: Sequence[str] = error.get("ctx", {}).get("known", ())
    if not allowed:
        return "only the documented ones"
    if len(allowed) <= _MOST_NAMES:
        return f"one of {list_names(allowed)}"
    near = get_close_matches(str(error["loc"][-1])[:_LONGEST_SHOWN], allowed)
    return f"only the documented ones; near it: {list_names(near or allowed, _MOST_NAMES)}"


_LENGTHS = {
    "too_short": ("at least", "min_length", "entry", "entries"),
    "too_long": ("at most", "max_length", "entry", "entries"),
    "string_too_short": ("text of at least", "min_length", "character", "characters"),
    "string_too_long": ("text of at most", "max_length", "character", "characters"),
}

_TIME = "a time that a calendar and a clock have, as ISO 8601 text such as 2026-03-01T06:00:00Z"

_EXPECTED = {
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "string_type": "text",
    "string_pattern_mismatch": "text that matches {pattern}",
    "list_type": "a list",
    "dict_type": "an object with names and values",
    "model_attributes_type": "an object",
    "model_type": "an object",
    "dataclass_type": "an object",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "datetime_parsing": _TIME,
    "datetime_from_date_parsing": _TIME,
    "timezone_aware": "a time with its zone, such as 2026-03-01T06:00:00Z",
}


def _expected(error: Mapping[str, Any], context: Mapping[str, Any]) -> str:
    """Say in a few words what one of pydantic's errors expected."""
    if error["type"] in _LENGTHS:
        limit, length, singular_word, more = _LENGTHS[error["type"]]
        return f"{limit} {counted(context[length], singular_word, more)}"
    template = _EXPECTED.get(error["type"])
    if template is not None:
        return template.format(**context)
    return str(error["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")


def _reason(error: Mapping[str, Any]) -> str:
    return str(error.get("ctx", {}).get("error", error["msg"]))


def _shorten(value: object) -> str:
    """Write a value as JSON has it, so that who sent it recognises it; text in quotes."""
    if isinstance(value, str):
        return _cut(repr(value))
    return _cut(json.dumps(value, ensure_ascii=False, default=repr))


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}…"
