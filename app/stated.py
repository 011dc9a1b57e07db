"""What everything that is stated shares: no unknown fields, no NaN, times with a zone.

What a use case is asked is defined once, where it is answered: HTTP checks a body against it and
hands it on as it is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, TypeAlias

from pydantic import (
    AfterValidator,
    AliasChoices,
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    StringConstraints,
    ValidationError,
    WithJsonSchema,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from app.errors import FieldError, InvalidContent
from app.units import expect_usable_time

REFUSED: Final = "refused"
"""Kind of error of what was refused in our own words, which are its message."""


class Schema(BaseModel):
    """What is asked: fields that it does not know are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    def __init_subclass__(cls, example: dict[str, Any] | None = None, **more: Any) -> None:
        super().__init_subclass__(**more)
        if example is not None:
            cls.model_config["json_schema_extra"] = {"example": example}


def made(make: Callable[[Any], Any], field: str = "", kind: Any = AfterValidator) -> Any:
    """Make of what was checked what it stands for; with `BeforeValidator` of what came.

    What is refused of it then, with InvalidContent, is named by its place, beside all else that is
    wrong; `field` is the name under which `make` refuses what it is given.
    """

    def check(stated: Any) -> Any:
        try:
            return make(stated)
        except InvalidContent as refused:
            wrong = refused.errors or [FieldError("", refused.detail)]
            places = [_in_utf_8(e.field.removeprefix(field).strip(".")) for e in wrong]
            lines: list[InitErrorDetails] = [
                {
                    "type": PydanticCustomError(REFUSED, "{said}", {"said": _in_utf_8(e.message)}),
                    "loc": tuple(place.split(".")) if place else (),
                    "input": None,
                }
                for place, e in zip(places, wrong, strict=True)
            ]
        raise ValidationError.from_exception_data(REFUSED, lines)

    return kind(check)


def _in_utf_8(text: str) -> str:
    """Write half characters as what they are: pydantic has no others in its errors."""
    return text.encode("utf-8", "backslashreplace").decode()


_DATE_AND_HOUR = re.compile(r"\d{4}-\d\d-\d\d[Tt ]\d\d")
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")


def _only_text(value: Any) -> Any:
    """Refuse numbers, also those in text, which pydantic reads as seconds since 1970."""
    if isinstance(value, datetime) or (isinstance(value, str) and _DATE_AND_HOUR.match(value)):
        return value
    raise ValueError("a time as ISO 8601 text, such as 2026-03-01T06:00:00Z")


def _to_utc(value: datetime) -> datetime:
    return expect_usable_time(value).astimezone(UTC)


def _no_control_characters(text: str) -> str:
    if _CONTROL.search(text):
        raise ValueError("text without control characters such as nul")
    return text


def _fits_in_a_database(value: int) -> int:
    if not -(2**63) <= value < 2**63:
        raise ValueError("a whole number of at most 64 bits")
    return value


def also(name: str, answered: str) -> AliasChoices:
    """Let a field be stated under the name that answers have for it; both at once are refused."""
    return AliasChoices(name, answered)


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number: no text, no booleans, no NaN."""

Millimetres = Annotated[Number, Field(ge=-1e6, le=1e6)]
"""A length or a position, within a kilometre [mm]."""

StoredInteger = Annotated[int, AfterValidator(_fits_in_a_database)]
"""A whole number with which a database can compare its own; in a query it comes as text."""

Integer = Annotated[int, Field(strict=True)]
"""A whole number: no text, no booleans."""

YesOrNo = Annotated[bool, Field(strict=True)]
"""True or false: no text, no numbers."""

Numbers = Annotated[list[Number], Field(min_length=1, max_length=100_000)]
"""One or more finite numbers."""

Positions = Annotated[list[Millimetres], Field(min_length=1, max_length=100_000)]
"""One or more positions [mm]."""

Coordinates = Annotated[list[Millimetres], Field(min_length=3, max_length=3)]
"""The same as a point, where it is one of very many that become an array."""

if TYPE_CHECKING:
    Point: TypeAlias = tuple[float, float, float]
else:
    Point = Annotated[
        Coordinates, AfterValidator(tuple), PlainSerializer(list, return_type=Coordinates)
    ]
    """A point or an offset x, y, z [mm]."""

UtcTime = Annotated[AwareDatetime, BeforeValidator(_only_text), AfterValidator(_to_utc)]
"""A time with a zone, kept as UTC."""

Name = Annotated[
    str,
    StringConstraints(strip_whitespace=True, min_length=1, max_length=200),
    AfterValidator(_no_control_characters),
]
"""A name of 1 to 200 characters."""

_StateName = Annotated[
    str, StringConstraints(min_length=1, max_length=200), AfterValidator(_no_control_characters)
]

_SIGNS = {"+": 1, "-": -1, None: 0}


def _for_each_axis(signs: Any) -> Any:
    """Let one direction stand for every axis."""
    if isinstance(signs, str):
        if signs not in _SIGNS:
            raise ValueError("`+`, `-`, or one of them for each axis")
        return dict.fromkeys("xyz", signs)
    return signs


_SIGN = {"enum": ["+", "-"], "type": "string"}
_SIGN_OF_EACH = {
    "type": "object",
    "propertyNames": {"enum": ["x", "y", "z"]},
    "additionalProperties": _SIGN,
}

Direction = Annotated[
    dict[Literal["x", "y", "z"], Literal["+", "-"]] | None,
    BeforeValidator(_for_each_axis),
    WithJsonSchema({"anyOf": [_SIGN, _SIGN_OF_EACH, {"type": "null"}]}),
]
"""Direction of approach, `+` or `-`, of all axes or of each; the mean where none is stated."""


def signs_of(direction: Mapping[Any, str] | None) -> tuple[int, int, int]:
    """Give +1, −1 or 0 (not stated) for x, y and z.

    >>> signs_of({"x": "+", "z": "-"})
    (1, 0, -1)
    """
    x, y, z = (_SIGNS[(direction or {}).get(axis)] for axis in "xyz")
    return (x, y, z)


Temperatures = Annotated[
    dict[str, Number],
    Field(max_length=1000),
    Field(examples=[{"x-middle": 24.1, "z-column": 27.3}]),
]
"""Sensor name to temperature [°C]."""

StatedTemperatures = Annotated[
    dict[str, Number | None],
    Field(max_length=1000),
    Field(examples=[{"x-middle": 24.1, "z-column": None}]),
]
"""Sensor name to temperature [°C], None where it has no value."""

MissingComponents = Annotated[
    Literal["refuse", "zero"],
    Field(
        default="refuse",
        description="What happens where the answer needs a component that no two maps have: "
        "`refuse` names it, `zero` lets it count as zero",
    ),
]
"""Whether components that are missing may count as zero."""

MachineState = Annotated[
    dict[_StateName, Number],
    Field(
        default_factory=dict,
        description="Any numbers that the shop knows of the machine's state",
        examples=[{"spindle_rpm": 8000}],
    ),
]
"""The machine's state."""
