"""Error maps over HTTP."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import ConfigDict, Discriminator, Field, Tag

from app.api.schemas.uncertainty import (
    Covariance,
    StandardError,
    StandardErrors,
    read_uncertainty,
    show_uncertainty,
    uncertainty_fields,
)
from app.errors import InvalidContent, UnknownComponent
from app.field_errors import way_of
from app.geometry.components import Component, parse_component
from app.geometry.measuring_line import MeasuringLine
from app.rounding import rounded, to_digits_in, to_digits_of
from app.services.change_model import ModelChange
from app.services.models import Preview
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
)
from app.thermal.error_map import ComponentTable, ErrorMap

if TYPE_CHECKING:
    from app.arrays import FloatArray
    from app.storage.records import StoredMap


class ComponentSchema(Schema):
    """One component of a map: a table over positions, or one value.

    Which field carries the numbers follows from the component: linear errors
    `errors_um`, angular errors `errors_urad`, nonrigid slopes `slopes_um_per_m` or
    `slopes_urad_per_m`, squareness `value_um_per_m`, rotary-axis locations
    `value_um` or `value_urad`; a single value may also be called `error_…`, as tables
    have it. What is known of their uncertainty stands beside them
    as standard errors in the same unit, or as a covariance where the errors at different
    positions are not independent of each other.
    """

    component: str = Field(
        description="ISO 230-1 code (EXX, SXY, EYY^x) or the chapter's notation (D_x(x), S_xy)",
        examples=["EXX"],
    )
    positions_mm: Positions | None = Field(
        None,
        description="Positions on the component's axis [mm], strictly increasing",
        examples=[[0, 50, 100]],
    )
    errors_um: Numbers | None = Field(
        None, description="Linear errors, actual minus nominal [µm]", examples=[[0, 1.2, 2.1]]
    )
    errors_urad: Numbers | None = Field(None, description="Angular errors [µrad]")
    slopes_um_per_m: Numbers | None = Field(None, description="Slopes of a linear error [µm/m]")
    slopes_urad_per_m: Numbers | None = Field(
        None, description="Slopes of an angular error [µrad/m]"
    )
    backward_errors_um: Numbers | None = Field(
        None, description="The errors when approached in the negative direction [µm]"
    )
    backward_errors_urad: Numbers | None = Field(None, description="The same [µrad]")
    backward_slopes_um_per_m: Numbers | None = Field(None, description="The same [µm/m]")
    backward_slopes_urad_per_m: Numbers | None = Field(None, description="The same [µrad/m]")
    value_um_per_m: Number | None = Field(
        None,
        validation_alias=also("value_um_per_m", "error_um_per_m"),
        description="Squareness [µm/m], E_x = SXY·y",
        examples=[-12.1],
    )
    value_um: Number | None = Field(
        None,
        validation_alias=also("value_um", "error_um"),
        description="Rotary-axis position error [µm]",
    )
    value_urad: Number | None = Field(
        None,
        validation_alias=also("value_urad", "error_urad"),
        description="Rotary-axis direction error [µrad]",
    )
    standard_errors_um: StandardErrors | None = Field(
        None,
        description="Standard error of each error, one standard deviation [µm]",
        examples=[[0.2, 0.2, 0.3]],
    )
    standard_errors_urad: StandardErrors | None = Field(None, description="The same [µrad]")
    standard_errors_um_per_m: StandardErrors | None = Field(
        None, description="Standard errors of slopes [µm/m]"
    )
    standard_errors_urad_per_m: StandardErrors | None = Field(None, description="The same [µrad/m]")
    backward_standard_errors_um: StandardErrors | None = Field(
        None, description="Standard errors of the backward errors [µm]"
    )
    backward_standard_errors_urad: StandardErrors | None = Field(
        None, description="The same [µrad]"
    )
    backward_standard_errors_um_per_m: StandardErrors | None = Field(
        None, description="The same [µm/m]"
    )
    backward_standard_errors_urad_per_m: StandardErrors | None = Field(
        None, description="The same [µrad/m]"
    )
    standard_error_um_per_m: StandardError | None = Field(
        None, description="Standard error of a squareness [µm/m]", examples=[0.8]
    )
    standard_error_um: StandardError | None = Field(
        None, description="Standard error of a rotary axis' position [µm]"
    )
    standard_error_urad: StandardError | None = Field(
        None, description="Standard error of a rotary axis' direction [µrad]"
    )
    covariance: Covariance | None = Field(
        None,
        description="Covariance of the errors [square of the errors' unit]: instead of standard "
        "errors or beside them, where the errors are not independent of each other",
        examples=[[[0.04, 0.02], [0.02, 0.09]]],
    )
    backward_covariance: Covariance | None = Field(
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
                component, [sign * values], covariance=read_uncertainty(self, component, 1)
            )
        backward = getattr(self, f"backward_{component.input_field}")
        n = len(self.positions_mm or values)
        return ComponentTable.make(
            component,
            values,
            self.positions_mm or (),
            backward,
            read_uncertainty(self, component, n),
            read_uncertainty(self, component, n, "backward_"),
        )

    def _refuse_other_fields(self, component: Component) -> None:
        fitting = {"component", component.input_field, *uncertainty_fields(component)}
        if component.is_table:
            fitting |= {"positions_mm", f"backward_{component.input_field}"}
            fitting |= set(uncertainty_fields(component, "backward_"))
        other = sorted(f for f in self.model_fields_set - fitting if getattr(self, f) is not None)
        if other:
            raise InvalidContent.of_field(
                other[0],
                f"expected {component.input_field} [{component.unit.symbol}] for "
                f"{component.code} ({component.kind}), got {', '.join(other)}",
            )


class ComponentAnswer(ComponentSchema):
    """One component of a stored map."""

    chapter: str | None = Field(None, description="The chapter's notation", examples=["D_x(x)"])
    iso: str | None = Field(None, description="ISO 230-1 name of a squareness", examples=["C0Y"])
    iso_value_urad: Number | None = Field(None, description="Its value in ISO's sign [µrad]")

    @classmethod
    def computed(cls, table: ComponentTable) -> Self:
        """Show a table that was computed, rounded as all that is; what is stored is not."""
        backward, covariance = table.backward_errors, table.covariance
        backward_covariance = table.backward_covariance
        answer = cls.of(
            replace(
                table,
                errors=rounded(table.errors),
                backward_errors=None if backward is None else rounded(backward),
                covariance=None if covariance is None else to_digits_of(covariance),
                backward_covariance=None
                if backward_covariance is None
                else to_digits_of(backward_covariance),
            )
        )
        uncertain = [name for name in answer.model_fields_set if "standard_error" in name]
        return answer.model_copy(
            update={name: to_digits_in(getattr(answer, name)) for name in uncertain}
        )

    @classmethod
    def of(cls, table: ComponentTable) -> Self:
        """Show a table."""
        component = table.component
        numbers: dict[str, Any] = {component.input_field: _plain(component, table.errors)}
        if component.is_table:
            numbers["positions_mm"] = table.positions_mm.tolist()
        if table.backward_errors is not None:
            numbers[table.backward_field] = table.backward_errors.tolist()
        numbers |= show_uncertainty(component, table.covariance)
        numbers |= show_uncertainty(component, table.backward_covariance, "backward_")
        if component.iso:
            numbers["iso"] = component.iso
            numbers["iso_value_urad"] = component.iso_sign * float(table.errors[0]) + 0.0
        return cls(component=component.code, chapter=component.chapter or None, **numbers)


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


class ErrorMapSchema(Schema):
    """All components measured in one thermal state."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "label": "Run #1",
                "measured_at": "2026-03-01T06:00:00Z",
                "temperatures_c": {"x-middle": 20.1, "y-front": 20.0, "z-column": 20.3},
                "components": [
                    {"component": "EXX", "positions_mm": [0, 250, 500], "errors_um": [0, 1.2, 2.1]},
                    {"component": "SXY", "value_um_per_m": -12.1},
                ],
            }
        }
    )

    label: Name = Field(description="The map's name on its machine", examples=["Run #1"])
    measured_at: UtcTime = Field(
        description="When it was measured, with a zone", examples=["2026-03-01T06:00:00Z"]
    )
    temperatures_c: Temperatures = Field(
        description="Every sensor's temperature at that time [°C]", min_length=1
    )
    components: list[ComponentSchema] = Field(
        min_length=1, max_length=100, description="The measured components"
    )
    measuring_lines_mm: dict[str, LineOrPoint] = Field(
        default_factory=dict,
        description=(
            "Axis to the line along which its translations were measured: a point (x, y, z) of "
            "it [mm], or that point with the tool offset"
        ),
        examples=[{"x": [0, 250, 100]}],
    )
    repeatability_um: Annotated[Number, Field(ge=0)] | None = Field(
        None, description="Repeatability of the measurement, one standard deviation [µm]"
    )
    instrument: Name | None = Field(None, description="What measured", examples=["laser vector"])

    def to_error_map(self) -> ErrorMap:
        """Make the map; InvalidContent names the component that is wrong."""
        tables: dict[str, ComponentTable] = {}
        for i, row in enumerate(self.components):
            try:
                table = row.to_table()
            except InvalidContent as error:
                raise error.inside(f"components.{i}") from None
            if table.component.code in tables:
                raise InvalidContent.of_field(
                    f"components.{i}.component",
                    f"expected each component once, got {table.component.code} again",
                )
            tables[table.component.code] = table
        return ErrorMap(
            label=self.label,
            measured_at=self.measured_at,
            temperatures_c=self.temperatures_c,
            tables=tables,
            measuring_lines={
                axis.lower(): _line(axis.lower(), given_line)
                for axis, given_line in self.measuring_lines_mm.items()
            },
            repeatability_um=self.repeatability_um,
            instrument=self.instrument,
        )


class ErrorMapAnswer(ErrorMapSchema, ModelChange):
    """A stored error map."""

    id: int = Field(description="The map's number", examples=[1])
    stored_at: UtcTime = Field(description="When it was stored, UTC")
    components: list[ComponentAnswer] = Field(description="The measured components")  # type: ignore[assignment]
    in_active_model: bool = Field(description="Whether the active model version contains it")
    warnings: list[str] = Field(default_factory=list, description="What is unusual about it")

    @classmethod
    def of(
        cls,
        stored: StoredMap,
        in_active_model: bool,
        warnings: Sequence[str] = (),
        change: Mapping[str, Any] | None = None,
    ) -> Self:
        """Show a stored map, and the version that was made with it (fields of `ModelChange`)."""
        error_map = stored.error_map
        return cls(
            id=stored.id,
            stored_at=stored.stored_at,
            label=error_map.label,
            measured_at=error_map.measured_at,
            temperatures_c=dict(error_map.temperatures_c),
            components=[ComponentAnswer.of(table) for table in error_map.tables.values()],
            measuring_lines_mm={
                a: shown_line(line) for a, line in error_map.measuring_lines.items()
            },
            repeatability_um=error_map.repeatability_um,
            instrument=error_map.instrument,
            in_active_model=in_active_model,
            warnings=list(warnings),
            **{"activated": in_active_model, **(change or {})},
        )


def _line(axis: str, line: Point | MeasuringLineSchema) -> MeasuringLine:
    if not isinstance(line, MeasuringLineSchema):
        return MeasuringLine.make(axis, line)
    return MeasuringLine.make(axis, line.point_mm, line.tool_offset_mm)


def shown_line(line: MeasuringLine) -> Point | MeasuringLineSchema:
    """Show a measuring line: as a point where no tool offset stood on it."""
    point, tool = line.point_mm, line.tool_offset_mm
    return MeasuringLineSchema(point_mm=point, tool_offset_mm=tool) if any(tool) else point


def _plain(component: Component, values: FloatArray) -> list[float] | float:
    return values.tolist() if component.is_table else float(values[0])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MapPreview(Preview, whole=False):
    """What was read as a map, and what storing it would do to the tables; nothing is stored."""

    label: Annotated[str, Field(examples=["Run #7"])]
    """The map's name"""
    components: Annotated[Sequence[str], Field(examples=[["EXX"]])]
    """Codes of its components"""
    read: Sequence[str]
    """What was read of the file, in lines of text"""
