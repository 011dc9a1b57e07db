"""What one of pydantic's errors says in our words: what was expected, what came, the unit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from app.api.schemas.base import way_of
from app.errors import FieldError, counted
from app.units import unit_of_field

_WHERE = ("body", "query", "path", "header")
"""Where in a request a field was; the first part of a path, but of no field's name."""

_WAYS = ("[key]", *map(way_of, ("one", "more", "point", "line")))
"""Parts of pydantic's paths that are no fields."""

_LONGEST_SHOWN = 80
"""Characters of one value, or of one part of a field's name, that are repeated."""


def field_error(error: Mapping[str, Any]) -> FieldError:
    """Say of one of pydantic's errors what was expected, what came, and the unit."""
    path = [_cut(str(part)) for part in error["loc"] if part not in _WAYS]
    if path and path[0] in _WHERE:
        del path[0]
    if error["type"] == "json_invalid":
        return FieldError("body", f"expected JSON, got text that is none: {_reason(error)}")
    if error["type"] == "extra_forbidden":
        return FieldError(".".join(path), "unknown field; expected only the documented ones")
    field = ".".join(path) or "body"
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


_LENGTHS = {
    "too_short": ("at least", "min_length", "entry", "entries"),
    "too_long": ("at most", "max_length", "entry", "entries"),
    "string_too_short": ("text of at least", "min_length", "character", "characters"),
    "string_too_long": ("text of at most", "max_length", "character", "characters"),
}

_EXPECTED = {
    "string_type": "text",
    "string_pattern_mismatch": "text that matches {pattern}",
    "list_type": "a list",
    "dict_type": "an object with names and values",
    "model_attributes_type": "an object",
    "model_type": "an object",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "timezone_aware": "a time with its zone, such as 2026-03-01T06:00:00Z",
}


def _expected(error: Mapping[str, Any], context: Mapping[str, Any]) -> str:
    """Say in a few words what one of pydantic's errors expected."""
    if error["type"] in _LENGTHS:
        limit, length, one, more = _LENGTHS[error["type"]]
        return f"{limit} {counted(context[length], one, more)}"
    known = _EXPECTED.get(error["type"])
    if known is not None:
        return known.format(**context)
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
