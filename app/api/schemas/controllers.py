"""Controllers' files over HTTP: formats, exports, what files hold, and comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from app.api.schemas.base import MachineState, Name, Number, Point, Schema, Temperatures, UtcTime
from app.api.schemas.error_field import triple

if TYPE_CHECKING:
    from app.controllers.compare import Comparison
    from app.controllers.curve import Curve
    from app.controllers.export import Check, Resampled
    from app.controllers.format import ControllerFile, Format, NotHeld, Options, Parsed
    from app.controllers.option_fields import OptionField
    from app.services.ask_field import FieldQuestion
    from app.services.controllers import BandsWanted, Compared, Exported

Sign = Literal["error", "compensation"]
StatedOptions = Annotated[
    dict[str, Any],
    Field(
        default_factory=dict,
        max_length=100,
        description="Options of the format, as `GET /v1/controllers` lists them",
        examples=[{"sign": "error"}],
    ),
]


class OptionAnswer(Schema):
    """One option of a format."""

    name: str = Field(description="Name", examples=["spacing_mm"])
    description: str = Field(description="What it says")
    required: bool = Field(description="Whether it has to be stated")
    default: Any = Field(description="What holds where it is not stated; null where nothing does")
    takes: Literal["choice", "number", "whole-number", "text", "components"] = Field(
        description="What its value is; with `axes` what each axis' value is"
    )
    axes: list[str] = Field(
        description="Axes of which it has one value each, as an object; empty where it has one"
    )
    unit: str | None = Field(description="Unit of its value; null where it has none")
    choices: list[Any] = Field(
        description="What it may be; of `components` any number of them, empty where it is free"
    )
    minimum: float | None = Field(description="Least value that it may have, in `unit`")
    above: float | None = Field(description="Its value is larger than this, in `unit`")
    maximum: float | None = Field(description="Greatest value that it may have, in `unit`")

    @classmethod
    def of(cls, option: OptionField) -> OptionAnswer:
        """Describe an option."""
        return cls(
            name=option.name,
            description=option.description,
            required=option.is_required,
            default=option.default,
            takes=option.takes.value,
            axes=list(option.axes),
            unit=option.unit,
            choices=list(option.choices),
            minimum=option.minimum,
            above=option.above,
            maximum=option.maximum,
        )


class ControllerAnswer(Schema):
    """One controller's file format."""

    name: str = Field(description="Name by which it is asked for", examples=["linuxcnc"])
    title: str = Field(description="What it is")
    sign: Sign | None = Field(
        description="What its values are, `error` (actual minus nominal) or `compensation` (minus "
        "that); null where no source says: then the option `sign` has to be stated"
    )
    units: str = Field(description="Units of positions and values")
    spacing: str = Field(description="What it wants of positions")
    limits: str = Field(description="What limits it")
    status: str = Field(
        description="How surely all this is known: `verified on the running controller`, "
        "`source-verified`, `manual-verified`, `seed example` or `ours`"
    )
    holds: list[str] = Field(description="Components that it can hold")
    squareness_in_straightness: bool = Field(
        description="Whether squareness is folded into straightness, because it has no table for it"
    )
    both_directions: bool = Field(description="Whether it holds both directions of approach")
    options: list[OptionAnswer] = Field(description="What it can be told")

    @classmethod
    def of(cls, controller: Format) -> ControllerAnswer:
        """Describe a format."""
        from app.controllers.option_fields import option_fields

        return cls(
            name=controller.name,
            title=controller.title,
            sign=controller.sign,
            units=controller.units,
            spacing=controller.spacing,
            limits=controller.limits,
            status=controller.status.value,
            holds=list(controller.holds),
            squareness_in_straightness=controller.folds,
            both_directions=bool(controller.both_directions),
            options=[OptionAnswer.of(option) for option in option_fields(controller)],
        )


class ControllersAnswer(Schema):
    """Every format."""

    controllers: list[ControllerAnswer] = Field(description="Formats")


class _AtTemperatures(Schema):
    """At which temperatures a controller's files are asked for."""

    temperatures_c: Temperatures | None = Field(
        None, description="Temperatures by sensor [°C]; those of the latest reading if left out"
    )
    state: MachineState
    tool_offset_mm: Point = Field(
        [0.0, 0.0, 0.0],
        description="Tool offset X, Y, Z [mm] at which angular errors are sized",
        examples=[[0, 0, 160]],
    )
    options: StatedOptions

    def question(self) -> FieldQuestion:
        """Make the question."""
        from app.services.ask_field import FieldQuestion

        given_c = self.temperatures_c
        return FieldQuestion(
            temperatures_c=None if given_c is None else [given_c],
            tool_offset_mm=triple(self.tool_offset_mm),
            missing_as_zero=True,
            state=self.state,
        )


class BandsRequest(Schema):
    """A range of temperatures over which a set of tables is wanted."""

    from_c: Temperatures = Field(description="Temperatures at one end [°C]")
    to_c: Temperatures = Field(description="Temperatures of the same sensors at the other end [°C]")
    largest_step_um: Annotated[Number, Field(gt=0, le=1e6)] = Field(
        description="So much a component may change from one table to the next [µm; angles µrad]"
    )

    def wanted(self) -> BandsWanted:
        """Make what the service is asked for."""
        from app.services.controllers import BandsWanted

        return BandsWanted(self.from_c, self.to_c, self.largest_step_um)


class ExportRequest(_AtTemperatures):
    """What is to be exported: at which temperatures, with which options, over which bands."""

    bands: BandsRequest | None = Field(
        None,
        description="A set of tables over a range of temperatures, for a controller that cannot "
        "ask a service; other sensors keep `temperatures_c`",
    )


class ExportedFileAnswer(Schema):
    """One file of an export."""

    name: str = Field(description="Name, with its band's folder", examples=["x.comp"])
    role: Literal["table", "settings", "check"] = Field(
        description="`table`, `settings` that go into the controller's own, or `check`: what to "
        "look at after loading"
    )
    axis: str | None = Field(description="Axis whose own file it is")
    content: str = Field(description="Its text")


class NotHeldAnswer(Schema):
    """What the controller does not hold."""

    component: str = Field(description="ISO 230-1 code", examples=["EYX"])
    largest: Number = Field(
        description="Largest displacement that it makes in the work volume at these temperatures, "
        "in `unit`; of a tilt of a rotary axis the angle",
        examples=[9.1],
    )
    unit: str = Field(description="Its unit", examples=["µm"])
    why: str = Field(description="Why not")

    @classmethod
    def of(cls, omission: NotHeld) -> NotHeldAnswer:
        """Take it as it is."""
        return cls(
            component=omission.component,
            largest=_tenth_nm(omission.largest),
            unit=omission.unit,
            why=omission.why,
        )


class ResamplingAnswer(Schema):
    """What spacing and rounding add to a component."""

    component: str = Field(description="ISO 230-1 code", examples=["EXX"])
    largest_deviation: Number = Field(
        description="Largest difference of the controller's curve from the table "
        "anywhere, in `unit`",
        examples=[0.2],
    )
    position_mm: Number | None = Field(description="Where [mm]; null for a single value")
    unit: str = Field(description="Its unit", examples=["µm"])

    @classmethod
    def of(cls, resampled: Resampled) -> ResamplingAnswer:
        """Take its size."""
        return cls(
            component=resampled.component,
            largest_deviation=_tenth_nm(abs(resampled.difference.largest)),
            position_mm=resampled.difference.position_mm,
            unit=resampled.unit,
        )


class CheckAnswer(Schema):
    """One move that shows whether the sign is right."""

    component: str = Field(description="ISO 230-1 code", examples=["EXX"])
    axis: str = Field(description="Axis that is moved", examples=["x"])
    position_mm: Number = Field(description="Where to [mm]", examples=[200.0])
    direction: str = Field(description="Coming in which direction, `+` or `-`", examples=["+"])
    moved_axis: str = Field(
        description="Axis that then stands elsewhere than before", examples=["x"]
    )
    expected_movement_um: Number = Field(
        description="By how much, + in that axis' direction [µm]", examples=[-10.0]
    )

    @classmethod
    def of(cls, check: Check) -> CheckAnswer:
        """Take it as it is."""
        return cls(
            component=check.component,
            axis=check.axis,
            position_mm=check.position_mm,
            direction=check.direction,
            moved_axis=check.moved_axis,
            expected_movement_um=_tenth_nm(check.expected_movement_um),
        )


class BandAnswer(Schema):
    """One band of temperatures."""

    folder: str = Field(description="Folder of its files", examples=["band-01"])
    from_c: Temperatures = Field(description="Where it begins [°C]")
    to_c: Temperatures = Field(description="Where it ends [°C]")
    at_c: Temperatures = Field(description="Temperatures of its tables [°C]")
    check: list[CheckAnswer] = Field(description="Moves that show whether the sign is right")


class _ControllerHead(Schema):
    """What an answer about a controller's files rests on."""

    machine: str = Field(description="The machine's id", examples=["mcfv5050"])
    model_version: int = Field(description="Version of the model", examples=[3])
    computed_at: UtcTime = Field(description="When it was computed, UTC")
    temperatures_c: Temperatures = Field(description="Temperatures that were used [°C]")
    controller: str = Field(description="Format", examples=["linuxcnc"])
    complete: bool = Field(description="Whether the compensation table is complete")
    warnings: list[str] = Field(description="All that is to be known, in sentences")


class ExportAnswer(_ControllerHead):
    """A controller's files, and everything that is to be said of them."""

    sign: Sign = Field(description="What the values in the files are")
    files: list[ExportedFileAnswer] = Field(description="Files")
    not_held: list[NotHeldAnswer] = Field(
        description="What the controller does not hold, largest first"
    )
    resampling: list[ResamplingAnswer] = Field(description="What spacing and rounding add")
    check: list[CheckAnswer] = Field(
        description="Moves that show whether the sign is right; with bands each has its own"
    )
    bands: list[BandAnswer] | None = Field(
        None, description="Bands of temperatures, where they were asked for"
    )

    @classmethod
    def of(cls, exported: Exported) -> ExportAnswer:
        """Write an export."""
        rendered = exported.found
        bands = [
            BandAnswer(
                folder=band.folder,
                from_c=dict(band.band.from_c),
                to_c=dict(band.band.to_c),
                at_c=dict(band.band.at_c),
                check=[CheckAnswer.of(check) for check in band.found.check],
            )
            for band in exported.bands
        ]
        origin = exported.table.origin
        return cls(
            machine=origin.machine_id,
            model_version=origin.model_version,
            computed_at=origin.computed_at,
            temperatures_c=dict(origin.temperatures_c),
            controller=exported.controller.name,
            complete=exported.complete,
            warnings=list(rendered.warnings),
            sign="error" if exported.sign == "error" else "compensation",
            files=[_file_answer(file) for file in rendered.files],
            not_held=[NotHeldAnswer.of(omission) for omission in rendered.not_held],
            resampling=[ResamplingAnswer.of(resampled) for resampled in rendered.resampling],
            check=[CheckAnswer.of(check) for check in rendered.check],
            bands=bands or None,
        )


class ControllerFileSchema(Schema):
    """One file of a controller."""

    name: Name = Field(description="Its name", examples=["x.comp"])
    content: Annotated[str, Field(max_length=4_000_000)] = Field(description="Its text")


Files = Annotated[
    list[ControllerFileSchema],
    Field(min_length=1, max_length=100, description="All files of one controller"),
]


def files_of(files: Sequence[ControllerFileSchema]) -> list[ControllerFile]:
    """Take files as the parsers want them."""
    from app.controllers.format import ControllerFile

    return [ControllerFile(file.name, file.content) for file in files]


class ParseRequest(Schema):
    """Files that are to be read."""

    files: Files
    options: StatedOptions


class ParsedComponentAnswer(Schema):
    """What files hold of one component."""

    component: str = Field(description="ISO 230-1 code", examples=["EXX"])
    axis: str | None = Field(description="Axis of the positions, null for a single value")
    unit: str = Field(description="Unit of the values", examples=["µm"])
    positions_mm: list[Number] | None = Field(description="Positions [mm]; null for a single value")
    errors: list[Number] = Field(description="Errors, actual minus nominal, in `unit`")
    compensation: list[Number] = Field(description="Minus the errors, in `unit`")
    backward_errors: list[Number] | None = Field(
        None, description="Errors in the negative direction where they differ, in `unit`"
    )
    backward_compensation: list[Number] | None = Field(None, description="Minus these, in `unit`")
    endless: bool = Field(
        description="Whether the values are a straight line that goes on beyond the positions; "
        "else the end values hold"
    )

    @classmethod
    def of(cls, curve: Curve) -> ParsedComponentAnswer:
        """Write a curve."""
        component, backward = curve.component, curve.backward_errors
        return cls(
            component=component.code,
            axis=component.axis,
            unit=component.unit.symbol,
            positions_mm=curve.positions_mm.tolist() if component.is_table else None,
            errors=[_picometre(v) for v in curve.errors],
            compensation=[_picometre(0.0 - v) for v in curve.errors],
            backward_errors=None if backward is None else [_picometre(v) for v in backward],
            backward_compensation=(
                None if backward is None else [_picometre(0.0 - v) for v in backward]
            ),
            endless=curve.endless,
        )


class ParseAnswer(Schema):
    """What files hold."""

    controller: str = Field(description="Format", examples=["linuxcnc"])
    sign: Sign = Field(description="As what the values were read")
    machine: str | None = Field(description="Machine that the files name, null where they do not")
    components: list[ParsedComponentAnswer] = Field(description="One for each component")
    warnings: list[str] = Field(description="All that is to be known, in sentences")

    @classmethod
    def of(cls, controller: Format, options: Options, parsed: Parsed) -> ParseAnswer:
        """Write what was read."""
        return cls(
            controller=controller.name,
            sign=controller.sign_of(options),
            machine=parsed.machine,
            components=[ParsedComponentAnswer.of(curve) for curve in parsed.curves.values()],
            warnings=list(parsed.warnings),
        )


class CompareRequest(_AtTemperatures):
    """Files that are compared with what they should hold, at which temperatures."""

    files: Files


class ComparedComponentAnswer(Schema):
    """How far a component in the files is from what should be there."""

    component: str = Field(description="ISO 230-1 code", examples=["EXX"])
    state: Literal["both", "missing", "unknown"] = Field(
        description="`both`; `missing`: the files lack it, which counts as 0; `unknown`: the files "
        "hold it, and the model has nothing of it"
    )
    largest: Number = Field(
        description="Largest difference of the errors: in the files minus as they should be, "
        "in `unit`",
        examples=[-5.0],
    )
    rms: Number = Field(description="Root mean square of the difference along the axis, in `unit`")
    unit: str = Field(description="Unit of both", examples=["µm"])
    position_mm: Number | None = Field(description="Where it is largest [mm]")
    direction: str = Field(description="In which direction of approach, `+` or `-`")


class CompareAnswer(_ControllerHead):
    """What a controller holds against what it should hold."""

    components: list[ComparedComponentAnswer] = Field(description="The largest difference first")
    not_held: list[NotHeldAnswer] = Field(
        description="What the format cannot hold, and is not compared"
    )

    @classmethod
    def of(cls, compared: Compared) -> CompareAnswer:
        """Write a comparison."""
        origin = compared.table.origin
        compared_files: Comparison = compared.found
        return cls(
            machine=origin.machine_id,
            model_version=origin.model_version,
            computed_at=origin.computed_at,
            temperatures_c=dict(origin.temperatures_c),
            controller=compared.controller.name,
            complete=compared.complete,
            warnings=list(compared_files.warnings),
            components=[
                ComparedComponentAnswer.model_validate(
                    {
                        "component": component.component,
                        "state": component.state,
                        "largest": _tenth_nm(component.difference.largest),
                        "rms": _tenth_nm(component.difference.rms),
                        "unit": component.unit,
                        "position_mm": component.difference.position_mm,
                        "direction": component.difference.direction,
                    }
                )
                for component in compared_files.components
            ],
            not_held=[NotHeldAnswer.of(omission) for omission in compared_files.not_held],
        )


def _file_answer(file: ControllerFile) -> ExportedFileAnswer:
    return ExportedFileAnswer.model_validate(
        {"name": file.name, "role": file.role, "axis": file.axis, "content": file.content}
    )


def _tenth_nm(value: float) -> float:
    return round(value, 4) + 0.0


def _picometre(value: float) -> float:
    return round(float(value), 6) + 0.0
