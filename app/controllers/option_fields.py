"""What each option of a format takes, as a form or another program asks for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from app.controllers.format import Format
from app.geometry.components import LINEAR_LETTERS
from app.units import unit_of_field


class Takes(StrEnum):
    """What an option's value is."""

    CHOICE = "choice"
    NUMBER = "number"
    WHOLE_NUMBER = "whole-number"
    TEXT = "text"
    COMPONENTS = "components"


@dataclass(frozen=True, slots=True)
class OptionField:
    """One option of a format.

    Parameters
    ----------
    takes
        What its value is; with `axes`, what each axis' value is.
    axes
        Axes of which it has one value each; empty where it has one value.
    choices
        What it may be; of `components` any number of them.
    minimum, above, maximum
        From where to where, in `unit`: `minimum` belongs to it, `above` does not.
    default
        What holds where it is not stated; None where nothing does.
    """

    name: str
    description: str
    is_required: bool
    default: Any
    takes: Takes
    axes: tuple[str, ...] = ()
    unit: str | None = None
    choices: tuple[Any, ...] = ()
    minimum: float | None = None
    above: float | None = None
    maximum: float | None = None


def option_fields(controller: Format) -> Iterator[OptionField]:
    """List a format's options by the definition that `options_of` holds what is stated to.

    >>> from app.controllers.registry import format_named
    >>> sign, *_, decimals = option_fields(format_named("siemens-cec"))
    >>> decimals.takes.value, decimals.minimum, decimals.maximum, decimals.default
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
        return Takes.CHOICE, tuple(schema["enum"])
    if schema["type"] == "array":
        return Takes.COMPONENTS, tuple(controller.holds)
    kinds = {
        "number": Takes.NUMBER,
        "integer": Takes.WHOLE_NUMBER,
        "string": Takes.TEXT,
    }
    return kinds[schema["type"]], ()
