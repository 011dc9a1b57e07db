"""What the shapes of answers share.

What a use case answers is defined once, as a frozen dataclass where it is found: its fields say
what they mean, in which unit, and HTTP, storage, pages and terminal read that definition.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator, Mapping
from dataclasses import fields
from functools import cache, partial
from itertools import pairwise
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Final,
    TypeAlias,
    get_type_hints,
)

from pydantic import ConfigDict, Field, GetPydanticSchema, WithJsonSchema, computed_field
from pydantic.fields import FieldInfo
from pydantic_core import core_schema

IN_ITS_UNIT: Final = "[µm; angular components µrad, squareness µm/m]"

_RANGE: Final = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}

Range: TypeAlias = Annotated[tuple[float, float], WithJsonSchema(_RANGE)]
"""A smallest and a largest number."""

_VECTOR: Final = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}

Vector: TypeAlias = Annotated[tuple[float, float, float], WithJsonSchema(_VECTOR)]
"""Three coordinates x, y, z."""

Code: TypeAlias = Annotated[str, Field(examples=["EXX"])]
TemperaturesC: TypeAlias = Annotated[
    Mapping[str, float], Field(examples=[{"x-middle": 24.1, "z-column": 27.3}])
]
"""Sensor name to temperature [°C]."""

Codes: TypeAlias = Annotated[tuple[str, ...], Field(examples=[["EZZ"]])]
Sensors: TypeAlias = Annotated[tuple[str, ...], Field(examples=[["z-column"]])]
UnitSymbol: TypeAlias = Annotated[str, Field(examples=["µm"])]


AS_IT_IS: Final = GetPydanticSchema(lambda _kind, _handler: core_schema.any_schema())
"""Of what is not published, or by what writes it alone."""


class Answer:
    """Base of dataclasses that are answers.

    The text under a field describes it in the OpenAPI document, where the class stands as
    `published_as`. One is not `whole` where some routes leave its nulls out, or where it is
    `stated` too: then fields that it does not know are refused. Else what a newer version writes
    beside the fields is passed over when it is read. Numbers that are not finite are written as
    null.
    """

    __slots__ = ()
    published_as: ClassVar[str]
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict()

    def __init_subclass__(
        cls,
        published_as: str | None = None,
        *,
        whole: bool = True,
        stated: bool = False,
        example: Mapping[str, Any] | None = None,
        **more: Any,
    ) -> None:
        super().__init_subclass__(**more)
        # dataclass(slots=True) makes the class again, without what stood behind its name.
        if "published_as" not in vars(cls):
            cls.published_as = published_as or cls.__name__
            cls.__pydantic_config__ = ConfigDict(
                title=cls.published_as,
                serialize_by_alias=True,
                extra="forbid" if stated else "ignore",
                json_schema_serialization_defaults_required=whole and not stated,
                json_schema_extra=partial(_as_answer, example),
            )


def fields_of(answer: Any) -> dict[str, Any]:
    """Give an answer's fields by name, for a shape that has them and more."""
    return {field.name: getattr(answer, field.name) for field in fields(answer)}


def answers() -> list[type[Answer]]:
    """List the shapes that are defined, as far as they are imported."""
    # Of a class that was made again for its slots, the one before it may still be listed.
    return list({shape.__name__: shape for shape in _below(Answer)}.values())


def _below(shape: type[Answer]) -> Iterator[type[Answer]]:
    for subclass in shape.__subclasses__():
        yield subclass
        yield from _below(subclass)


def _as_answer(
    example: Mapping[str, Any] | None, schema: dict[str, Any], shape: type[Answer]
) -> None:
    """Say of an answer that it has no other fields, and what each of them is."""
    schema["additionalProperties"] = False
    if example is not None:
        schema["example"] = example
    properties = schema.get("properties", {})
    for name, field in properties.items():
        if name in schema.get("required", ()):
            field.pop("default", None)
        # A property's docstring is a sentence, what stands under a field is none.
        if field.pop("readOnly", False):
            field["description"] = " ".join(field["description"].removesuffix(".").split())
    hints = get_type_hints(shape, include_extras=True)
    for name, words in _words_under_fields(shape):
        published = FieldInfo.from_annotation(hints[name]).alias or name
        if published in properties:  # else it is excluded
            properties[published]["description"] = " ".join(words.split())


def _words_under_fields(shape: type[Answer]) -> Iterator[tuple[str, str]]:
    """Read the text under each field.

    pydantic's `use_attribute_docstrings` does the same for each class whenever a model is built:
    half a second of each start, for a document that is seldom asked for.
    """
    for base in reversed(shape.__mro__):
        written = (
            _classes_in(base.__module__).get(base.__name__)
            if "__dataclass_fields__" in vars(base)
            else None
        )
        for field, text in pairwise(written.body if written else ()):
            match field, text:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(words))),
                ):
                    yield name, words


@cache
def _classes_in(module: str) -> dict[str, ast.ClassDef]:
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


if TYPE_CHECKING:
    shown = property
else:

    def shown(read: Any) -> Any:
        """Make a property that is written with the fields, and not read."""
        return computed_field(property(read))
