"""What each option of a format takes, as a form or another program asks for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

from app.answer import Answer
from app.controllers.format import Format
from app.geometry.components import LINEAR_LETTERS
from app.units import unit_of_field

Takes = Literal["choice", "number", "whole-number", "text", "components"]


@dataclass(frozen=True, slots=True)
class OptionField(Answer, published_as="OptionAnswer"):
    """One option of a format."""

    name: Annotated[str, Field(examples=["spacing_mm"])]
    """Name"""
    description: str
    """What it says"""
    required: bool
    """Whether it has to be stated"""
    default: Any
    """What holds where it is not stated; null where nothing does"""
    takes: Takes
    """What its value is; with `axes` what each axis' value is"""
    axes: tuple[str, ...] = ()
    """Axes of which it has one value each, as an object; empty where it has one"""
    unit: str | None = None
    """Unit of its value; null where it has none"""
    choices: tuple[Any, ...] = ()
    """What it may be; of `components` any number of them, empty where it is free"""
    minimum: float | None = None
    """Least value that it may have, in `unit`"""
    above: float | None = None
    """Its value is larger than this, in `unit`"""
    maximum: float | None = None
    """Greatest value that it may have, in `unit`"""


def option_fields(controller: Format) -> Iterator[OptionField]:
    """List a format's options by the definition that `options_of` holds what is stated to.

    >>> from app.controllers.registry import format_named
    >>> sign, *_, decimals = option_fields(format_named("siemens-cec"))
    >>> decimals.takes, decimals.minimum, decimals.maximum, decimals.default
    ('whole-number', 3, 7, 4)
    """
    schemas = controller.options.model_json_schema()["properties"]
    for name, field in controller.options.model_fields.items():
        schema = _not_null(schemas[name])
        axes: tuple[str, ...] = ()
        if schema.get("type") == "object":
            axes, schema = tuple(LINEAR_LETTERS), _of_each(schema)
        takes, choices = _takes(schema, controller)
        default = None
        if not field.is_required():
            default = field.get_default(call_default_factory=True, validated_data={})
        yield OptionField(
            name,
            field.description or "",
            field.is_required(),
            default,
            takes,
            axes,
            unit_of_field(name),
            choices,
            schema.get("minimum"),
            schema.get("exclusiveMinimum"),
            schema.get("maximum"),
        )


def _not_null(schema: Mapping[str, Any]) -> Mapping[str, Any]:
    """Give what an option may be beside null, which is the same as leaving it out."""
    kinds = [kind for kind in schema.get("anyOf", ()) if kind.get("type") != "null"]
    return kinds[0] if kinds else schema


def _of_each(schema: Mapping[str, Any]) -> Mapping[str, Any]:
    """Give what an option with a value for each axis takes of each."""
    value_schema: Mapping[str, Any]
    (value_schema,) = schema.get("patternProperties", {}).values() or [
        schema["additionalProperties"]
    ]
    return value_schema


def _takes(schema: Mapping[str, Any], controller: Format) -> tuple[Takes, tuple[Any, ...]]:
    if "enum" in schema:
        return "choice", tuple(schema["enum"])
    if schema["type"] == "array":
        return "components", tuple(controller.holds)
    kinds: dict[str, Takes] = {"number": "number", "integer": "whole-number", "string": "text"}
    return kinds[schema["type"]], ()
