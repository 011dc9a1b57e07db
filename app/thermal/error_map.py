"""An error map: all error components measured in one thermal state, as it is stated and shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Annotated, Any, Final, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from pydantic import (
    Discriminator,
    Field,
    PlainSerializer,
    Tag,
    TypeAdapter,
    create_model,
    model_serializer,
)

from app.answer import AS_IT_IS, Answer
from app.arrays import FloatArray, frozen
from app.errors import InvalidContent, UnknownComponent
from app.field_errors import way_of
from app.geometry.components import COMPONENTS, Component, Kind, parse_component
from app.geometry.measuring_line import MeasuringLine, MeasuringLines
from app.rounding import rounded, to_digits_in, to_digits_of
from app.stated import (
    Name,
    Number,
    Numbers,
    Point,
    Positions,
    Schema,
    Temperatures,
    UtcTime,
    also,
    made,
)
from app.thermal.uncertainty import (
    check_covariance,
    standard_errors_of,
    stated_covariance,
    without_zeros,
)
from app.units import UM_PER_MM, Unit

LARGEST_ERROR_UM: Final = 10 * UM_PER_MM
"""No machine tool is wrong by more than 10 mm [µm], 10 mrad [µrad] or 10 mm/m [µm/m].

Larger numbers are in another unit, or the nominal position is still in them.
"""

SHORTEST_WAY_MM: Final = 1.0
"""Over which an axis cannot stand still: backlash is shorter."""

SHORTEST_IN_MM: Final = 50.0
SAME_NUMBER: Final = 0.05
"""Readings that are the positions' numbers within it, over a longer way than that, are in mm: an
error of 1 mm/m scatters by more."""

VALUE_LIMIT: Final = 1e6
"""What a table can hold: a metre [µm], which is where a rotary axis may be instead of at zero."""


def largest_error(component: Component | None) -> float:
    """Give the largest number that is taken as an error [component.unit; µm at a point].

    What places a rotary axis may be its place in the machine's coordinates, which is no error.

    >>> from app.geometry.components import COMPONENTS
    >>> largest_error(COMPONENTS["EXX"]), largest_error(COMPONENTS["XOC"])
    (10000.0, 1000000.0)
    """
    is_place = component is not None and component.kind is Kind.ROTARY_LOCATION
    return VALUE_LIMIT if is_place else LARGEST_ERROR_UM


def impossible_error(component: Component | None, errors: ArrayLike) -> str:
    """Say that an error is larger than any machine's; empty if none is.

    Parameters
    ----------
    component
        Whose errors they are; None for components of an error at a point.
    errors : array-like [component.unit; µm at a point]
        Errors as they are stated, wherever they come from.

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> impossible_error(COMPONENTS["EBX"], [0.0, 12.5])
    ''
    >>> impossible_error(COMPONENTS["EBX"], [0.0, -12500.0])[:55]
    'expected errors within ±10000 µrad, got -12500 µrad: is'
    """
    values, largest = np.atleast_1d(np.asarray(errors, dtype=float)), largest_error(component)
    worst = float(values[np.abs(values).argmax()])
    if abs(worst) <= largest:
        return ""
    unit = (Unit.UM if component is None else component.unit).symbol
    return (
        f"expected errors within ±{largest:g} {unit}, got {worst:g} {unit}: is it in another unit, "
        "or is the nominal position still in it?"
    )


def positions_for_errors(positions_mm: ArrayLike, errors_um: ArrayLike) -> str:
    """Say that values are where an axis was, and not by how much it was wrong; empty if not.

    They follow the positions with a slope of 1, or −1 where an encoder counts the other way, or are
    the positions' own numbers, in mm. No axis is wrong by half of its way; a slope of 1 mm/m is.

    Parameters
    ----------
    positions_mm : array-like, shape (m,) [mm]
    errors_um : array-like, shape (m,) [µm]

    Examples
    --------
    >>> positions_for_errors([-4.88, 0.24, 5.36], [-4880.09, 239.93, 5359.9])[:59]
    'expected deviations in µm, actual less nominal, got a slope'
    >>> positions_for_errors([0.0, 500.0, 1000.0], [0.3, 499.8, 1000.4])
    ''
    """
    positions, errors = (np.asarray(values, dtype=float) for values in (positions_mm, errors_um))
    span = float(np.ptp(positions)) if positions.size else 0.0
    if span < SHORTEST_WAY_MM:
        return ""
    along, across = positions - positions.mean(), errors - errors.mean()
    slope = float(along @ across) / float(along @ along) / UM_PER_MM
    residual = across - slope * UM_PER_MM * along
    follows = abs(slope) > 0.5 and float(residual @ residual) < 0.01 * float(across @ across)
    is_in_mm = (
        span >= SHORTEST_IN_MM
        and positions.size > 2
        and min(np.abs(errors - positions).max(), np.abs(errors + positions).max()) < SAME_NUMBER
    )
    if not follows and not is_in_mm:
        return ""
    got = "the positions' own numbers" if is_in_mm else f"a slope of {slope:.3g} mm/mm over them"
    return (
        f"expected deviations in µm, actual less nominal, got {got}: these look like measured "
        f"positions{' in mm' if is_in_mm else ''}"
    )


@dataclass(frozen=True, eq=False)
class ComponentTable:
    """One component of one map: its errors over positions, or its single value.

    Parameters
    ----------
    component
        Which error it is; its unit is the unit of the values.
    positions_mm : ndarray, shape (n,) [mm]
        Strictly increasing; empty for a component that has no argument. One
        position means that the error does not depend on position.
    errors : ndarray, shape (n,), or (1,) without argument
        Actual minus nominal [component.unit]; approached in the positive direction, where
        that matters.
    backward_errors : ndarray, same shape, optional
        The errors when the position is approached in the negative direction.
    covariance, backward_covariance : ndarray, shape (n, n) or (n,), optional
        Covariance of the errors' own uncertainty (GUM), as the measurement left it
        [component.unit squared]; the variances alone where the errors are independent
        of each other, None where nobody stated it.

    Raises
    ------
    InvalidContent
        If something is not finite, not increasing, empty, or of unequal length.
    """

    component: Component
    positions_mm: FloatArray
    errors: FloatArray
    backward_errors: FloatArray | None = None
    covariance: FloatArray | None = None
    backward_covariance: FloatArray | None = None

    @classmethod
    def make(
        cls,
        component: Component,
        errors: ArrayLike,
        positions_mm: ArrayLike = (),
        backward_errors: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        backward_covariance: ArrayLike | None = None,
    ) -> ComponentTable:
        """Make a table from anything array-like, checked.

        >>> from app.geometry.components import COMPONENTS
        >>> ComponentTable.make(COMPONENTS["EXX"], [0.0, 1.2], [0.0, 50.0]).errors.tolist()
        [0.0, 1.2]
        """
        return cls(
            component,
            frozen(positions_mm),
            frozen(errors),
            *(
                None if values is None else frozen(values)
                for values in (backward_errors, covariance, backward_covariance)
            ),
        )

    def __post_init__(self) -> None:
        self._check_positions()
        self._check_values(self.component.input_field, self.errors)
        if self.backward_errors is not None:
            if not self.component.is_table:
                raise InvalidContent.of_field(
                    self.backward_field,
                    f"{self.component.code} is one value and has no direction of approach",
                )
            self._check_values(self.backward_field, self.backward_errors)
        if self.backward_covariance is not None and self.backward_errors is None:
            raise InvalidContent.of_field(
                "backward_covariance",
                f"expected {self.backward_field} of {self.component.code} beside it, got none",
            )
        for name in ("covariance", "backward_covariance"):
            covariance = getattr(self, name)
            if covariance is not None:
                check_covariance(self.component, name, covariance, self.errors.size)

    @property
    def standard_errors(self) -> FloatArray | None:
        """Standard error of each value [component.unit], where it is known."""
        return None if self.covariance is None else standard_errors_of(self.covariance)

    @property
    def backward_standard_errors(self) -> FloatArray | None:
        """The same of the backward errors."""
        of = self.backward_covariance
        return None if of is None else standard_errors_of(of)

    @property
    def backward_field(self) -> str:
        """Name of the field in which a map states the backward errors."""
        return f"backward_{self.component.input_field}"

    @property
    def depends_on_position(self) -> bool:
        """Whether there is more than one position."""
        return self.positions_mm.size > 1

    def _check_positions(self) -> None:
        positions = self.positions_mm
        if not self.component.is_table:
            if positions.size:
                raise InvalidContent.of_field(
                    "positions_mm", f"{self.component.code} has no positions: it is one value"
                )
            return
        if positions.ndim != 1 or positions.size == 0:
            raise InvalidContent.of_field(
                "positions_mm",
                f"expected at least one position of {self.component.code} in mm, got none",
            )
        if not np.isfinite(positions).all():
            raise InvalidContent.of_field(
                "positions_mm",
                f"expected finite positions of {self.component.code} in mm, got "
                f"{_first_not_finite(positions)}",
            )
        wrong = np.flatnonzero(np.diff(positions) <= 0)
        if wrong.size:
            i = int(wrong[0])
            what = "twice" if positions[i] == positions[i + 1] else "out of order"
            raise InvalidContent.of_field(
                "positions_mm",
                f"expected strictly increasing positions of {self.component.code} in mm, got "
                f"{positions[i]:g} then {positions[i + 1]:g} ({what}, at index {i + 1})",
            )

    def _check_values(self, name: str, values: FloatArray) -> None:
        table = self.component.is_table
        expected = self.positions_mm.size if table else 1
        count = f"{expected} values" if table else "one value"
        each = ", one for each position" if table else ""
        unit = self.component.unit.symbol
        if values.ndim != 1 or values.size != expected:
            raise InvalidContent.of_field(
                name,
                f"expected {count} of {self.component.code} in {unit}{each}, got {values.size}",
            )
        if not np.isfinite(values).all():
            raise InvalidContent.of_field(
                name,
                f"expected finite values of {self.component.code} in {unit}, got "
                f"{_first_not_finite(values)}",
            )
        if np.abs(values).max() > VALUE_LIMIT:
            raise InvalidContent.of_field(
                name,
                f"expected errors within ±{VALUE_LIMIT:g} {unit}, got "
                f"{values[np.abs(values).argmax()]:g}",
            )


def _first_not_finite(values: FloatArray) -> str:
    """Say which value is not finite, and where."""
    i = int(np.flatnonzero(~np.isfinite(values))[0])
    return f"{values[i]:g} (at index {i})"


def number_fields(
    name_of: Callable[[Component], str], words: str, of_tables: Any, of_values: Any = None
) -> dict[str, Any]:
    """Make the fields in which components' numbers stand: their units are in their names.

    Parameters
    ----------
    of_tables, of_values
        What stands in the field of a component with positions, and of a single value; None:
        those have none.

    Returns
    -------
    dict
        Field to its definition, as `create_model` takes it.
    """
    fields: dict[str, dict[Kind, Component]] = {}
    for component in COMPONENTS.values():
        if component.is_table or of_values is not None:
            fields.setdefault(name_of(component), {})[component.kind] = component
    return {
        name: _number_field(
            name, words, list(kinds), next(iter(kinds.values())), of_tables, of_values
        )
        for name, kinds in fields.items()
    }


def _number_field(
    name: str, words: str, kinds: Sequence[Kind], one: Component, of_table: Any, of_value: Any
) -> tuple[Any, Any]:
    # A single value may be stated under the name that answers have for it.
    alias = also(name, one.error_field) if name == one.input_field != one.error_field else None
    about = f"{words}: {', '.join(kinds)} [{one.unit.symbol}]"
    shape = of_table if one.is_table else of_value
    return shape | None, Field(None, description=about, validation_alias=alias)


def backward(name_of: Callable[[Component], str]) -> Callable[[Component], str]:
    """Name the field of what was approached in the negative direction."""
    return lambda component: f"backward_{name_of(component)}"


_StandardError = Annotated[Number, Field(ge=0)]
_StandardErrors = Annotated[list[_StandardError], Field(min_length=1, max_length=100_000)]
_Covariance = Annotated[list[list[Number]], Field(min_length=1, max_length=100_000)]

_ERROR = attrgetter("input_field")
_STANDARD_ERROR = attrgetter("standard_error_field")


class _Placed(Schema):
    component: str = Field(
        description="ISO 230-1 code (EXX, SXY, EYY^x) or the chapter's notation (D_x(x), S_xy)",
        examples=["EXX"],
    )
    positions_mm: Positions | None = Field(
        None,
        description="Positions on the component's axis [mm], strictly increasing",
        examples=[[0, 50, 100]],
    )


if TYPE_CHECKING:
    _Numbers = _Placed
else:
    _Numbers = create_model(
        "_Numbers",
        __base__=_Placed,
        **number_fields(_ERROR, "Actual minus nominal", Numbers, Number),
        **number_fields(backward(_ERROR), "Approached in the negative direction", Numbers),
        **number_fields(_STANDARD_ERROR, "One standard deviation", _StandardErrors, _StandardError),
        **number_fields(backward(_STANDARD_ERROR), "Of the backward errors", _StandardErrors),
    )


class ComponentSchema(_Numbers):
    """One component of a map: a table over positions, or one value.

    Which field carries the numbers follows from the component: linear errors
    `errors_um`, angular errors `errors_urad`, nonrigid slopes `slopes_um_per_m` or
    `slopes_urad_per_m`, squareness `value_um_per_m` (E_x = SXY·y), rotary-axis locations
    `value_um` or `value_urad`; a single value may also be called `error_…`, as tables
    have it. What is known of their uncertainty stands beside them
    as standard errors in the same unit, or as a covariance where the errors at different
    positions are not independent of each other.
    """

    covariance: _Covariance | None = Field(
        None,
        description="Covariance of the errors [square of the errors' unit]: instead of standard "
        "errors or beside them, where the errors are not independent of each other",
        examples=[[[0.04, 0.02], [0.02, 0.09]]],
    )
    backward_covariance: _Covariance | None = Field(
        None, description="Covariance of the backward errors [square of the errors' unit]"
    )

    def to_table(self) -> ComponentTable:
        """Make the table; InvalidContent where the fields do not fit the component."""
        try:
            component, sign = parse_component(self.component)
        except UnknownComponent as error:
            raise InvalidContent.of_field("component", error.detail) from None
        self._refuse_other_fields(component)
        values = getattr(self, component.input_field)
        if values is None:
            raise InvalidContent.of_field(
                component.input_field,
                f"expected the values of {component.code} in {component.unit.symbol}, got none",
            )
        if not component.is_table:
            return ComponentTable.make(
                component, [sign * values], covariance=self._uncertainty(component, 1)
            )
        n = len(self.positions_mm or values)
        return ComponentTable.make(
            component,
            values,
            self.positions_mm or (),
            getattr(self, f"backward_{component.input_field}"),
            self._uncertainty(component, n),
            self._uncertainty(component, n, "backward_"),
        )

    def _uncertainty(self, component: Component, n: int, before: str = "") -> FloatArray | None:
        """Take what is stated of the uncertainty of n errors, or of the `backward_` ones'."""
        names = (f"{before}{component.standard_error_field}", f"{before}covariance")
        errors, covariance = (getattr(self, name, None) for name in names)
        beside = f"{before}{component.input_field}"
        if getattr(self, beside, None) is None and (errors, covariance) != (None, None):
            raise InvalidContent.of_field(
                names[errors is None],
                f"expected {beside} of {component.code} beside it, got none",
            )
        stated = [errors] if isinstance(errors, float) else errors
        return stated_covariance(component, n, stated, covariance, before)

    def _refuse_other_fields(self, component: Component) -> None:
        ways = ("", "backward_") if component.is_table else ("",)
        names = (component.input_field, component.standard_error_field, "covariance")
        fitting = {"component", *(way + name for way in ways for name in names)}
        fitting |= {"positions_mm"} if component.is_table else set()
        other = sorted(f for f in self.model_fields_set - fitting if getattr(self, f) is not None)
        if other:
            raise InvalidContent.of_field(
                other[0],
                f"expected {component.input_field} [{component.unit.symbol}] for "
                f"{component.code} ({component.kind}), got {', '.join(other)}",
            )


_ROUNDED: Final[Mapping[str, Callable[[FloatArray], FloatArray]]] = {
    "errors": rounded,
    "backward_errors": rounded,
    "covariance": to_digits_of,
    "backward_covariance": to_digits_of,
}


class ComponentAnswer(ComponentSchema):
    """One component of a stored map: the fields that it has, and no others."""

    chapter: str | None = Field(None, description="The chapter's notation", examples=["D_x(x)"])
    iso: str | None = Field(None, description="ISO 230-1 name of a squareness", examples=["C0Y"])
    iso_value_urad: Number | None = Field(None, description="Its value in ISO's sign [µrad]")

    # Without the type of what it gives, which would be published in place of the fields.
    _without_nulls = model_serializer(mode="wrap")(
        lambda self, write: {name: v for name, v in write(self).items() if v is not None}
    )

    @classmethod
    def computed(cls, table: ComponentTable) -> Self:
        """Show a table that was computed, rounded as all that is; what is stored is not."""
        numbers: dict[str, Any] = {
            name: write(values)
            for name, write in _ROUNDED.items()
            if (values := getattr(table, name)) is not None
        }
        answer = cls.of(replace(table, **numbers))
        uncertain = [name for name in answer.model_fields_set if "standard_error" in name]
        return answer.model_copy(
            update={name: to_digits_in(getattr(answer, name)) for name in uncertain}
        )

    @classmethod
    def of(cls, table: ComponentTable) -> Self:
        """Show a table: standard errors, and the covariance where they do not say all of it."""
        component = table.component
        numbers: dict[str, Any] = {
            "component": component.code,
            "chapter": component.chapter or None,
        }
        if component.is_table:
            numbers["positions_mm"] = table.positions_mm.tolist()
        for before, errors, covariance in (
            ("", table.errors, table.covariance),
            ("backward_", table.backward_errors, table.backward_covariance),
        ):
            columns = {component.input_field: errors}
            if covariance is not None:
                columns[component.standard_error_field] = standard_errors_of(covariance)
                covariance = without_zeros(covariance)
                if covariance.ndim == 2:
                    numbers[f"{before}covariance"] = covariance.tolist()
            for name, values in columns.items():
                if values is not None:
                    written = values.tolist()
                    numbers[before + name] = written if component.is_table else written[0]
        if component.iso:
            numbers["iso"] = component.iso
            numbers["iso_value_urad"] = component.iso_sign * float(table.errors[0]) + 0.0
        return cls(**numbers)


class MeasuringLineSchema(Schema):
    """A measuring line on which a tool offset stood."""

    point_mm: Point = Field(description="A point x, y, z of the line [mm]")
    tool_offset_mm: Point = Field(
        description="Tool offset with which it was measured [mm]", examples=[[0, 0, 160]]
    )


def _which(value: Any) -> str:
    return way_of("point") if isinstance(value, list | tuple) else way_of("line")


LineOrPoint = Annotated[
    Annotated[Point, Tag(way_of("point"))] | Annotated[MeasuringLineSchema, Tag(way_of("line"))],
    Discriminator(_which),
]
"""A measuring line as a point of it, where no tool offset stood on it, or with the offset."""


def _lines(stated: Mapping[str, Any]) -> dict[str, MeasuringLine]:
    lines = {}
    for axis, line in ((axis.lower(), line) for axis, line in stated.items()):
        has_offset = isinstance(line, MeasuringLineSchema)
        parts = (line.point_mm, line.tool_offset_mm) if has_offset else (line,)
        lines[axis] = MeasuringLine.make(axis, *parts)
    return lines


def shown_lines(lines: MeasuringLines) -> dict[str, Any]:
    """Show measuring lines: as points where no tool offset stood on them."""
    return {
        axis: MeasuringLineSchema(point_mm=line.point_mm, tool_offset_mm=line.tool_offset_mm)
        if any(line.tool_offset_mm)
        else line.point_mm
        for axis, line in lines.items()
    }


def _by_code(tables: Sequence[ComponentTable]) -> dict[str, ComponentTable]:
    by_code: dict[str, ComponentTable] = {}
    for i, table in enumerate(tables):
        if by_code.setdefault(table.component.code, table) is not table:
            raise InvalidContent.of_field(
                f"{i}.component",
                f"expected each component once, got {table.component.code} again",
            )
    return by_code


if TYPE_CHECKING:
    StatedTable: TypeAlias = ComponentTable
    TablesByCode: TypeAlias = Mapping[str, ComponentTable]
    StatedLines: TypeAlias = MeasuringLines
else:
    StatedTable = Annotated[ComponentSchema, made(ComponentSchema.to_table)]
    """A table as it is stated."""
    TablesByCode = Annotated[
        list[StatedTable],
        made(_by_code),
        PlainSerializer(
            lambda tables: list(map(ComponentAnswer.of, tables.values())), list[ComponentAnswer]
        ),
    ]
    """Stated and answered as a list."""
    StatedLines = Annotated[
        dict[str, LineOrPoint],
        made(_lines, "measuring_lines_mm"),
        PlainSerializer(shown_lines, dict[str, LineOrPoint]),
    ]

ComputedTables: TypeAlias = Annotated[
    Sequence[ComponentTable],
    AS_IT_IS,
    PlainSerializer(
        lambda tables: list(map(ComponentAnswer.computed, tables)), list[ComponentAnswer]
    ),
]
"""Tables that were computed, as they are answered."""

ShownLines: TypeAlias = Annotated[
    Mapping[str, MeasuringLine], AS_IT_IS, PlainSerializer(shown_lines, dict[str, LineOrPoint])
]

EXAMPLE = {
    "label": "Run #1",
    "measured_at": "2026-03-01T06:00:00Z",
    "temperatures_c": {"x-middle": 20.1, "y-front": 20.0, "z-column": 20.3},
    "components": [
        {"component": "EXX", "positions_mm": [0, 250, 500], "errors_um": [0, 1.2, 2.1]},
        {"component": "SXY", "value_um_per_m": -12.1},
    ],
}


@dataclass(frozen=True, eq=False)
class ErrorMap(Answer, published_as="ErrorMapSchema", stated=True, example=EXAMPLE):
    """All components measured in one thermal state, with every sensor's temperature."""

    label: Annotated[Name, Field(examples=["Run #1"])]
    """The map's name on its machine"""
    measured_at: Annotated[UtcTime, Field(examples=["2026-03-01T06:00:00Z"])]
    """When it was measured, with a zone"""
    temperatures_c: Annotated[Temperatures, Field(min_length=1)]
    """Every sensor's temperature at that time [°C]"""
    tables: Annotated[TablesByCode, Field(alias="components", min_length=1, max_length=100)]
    """The measured components"""
    measuring_lines: Annotated[
        StatedLines, Field(alias="measuring_lines_mm", examples=[{"x": [0, 250, 100]}])
    ] = field(default_factory=dict)
    """Axis to the line along which its translations were measured: a point (x, y, z) of it [mm], or
    that point with the tool offset; absent where they are free of the rotations' effect"""
    repeatability_um: Annotated[Number, Field(ge=0)] | None = None
    """Repeatability of the measurement, one standard deviation [µm]"""
    instrument: Annotated[Name | None, Field(examples=["laser vector"])] = None
    """What measured"""


ERROR_MAP: Final = TypeAdapter(ErrorMap)
"""Reads a map as it is stated."""
