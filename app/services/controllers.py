"""Controllers' files: exported at stated temperatures or now, over bands of them, and compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field

from app.answer import Answer, Code, TemperaturesC, UnitSymbol
from app.arrays import FloatArray
from app.controllers.bands import temperature_bands
from app.controllers.compare import ComparedComponent, compare
from app.controllers.curve import Curve
from app.controllers.error_table import ErrorTable
from app.controllers.export import Check, Export, Resampled, export, holdable, wanted_of
from app.controllers.format import (
    ControllerFile,
    Format,
    Joint,
    NotHeld,
    Options,
    Sign,
)
from app.controllers.option_fields import OptionField, option_fields
from app.controllers.read import read_files
from app.controllers.registry import FORMATS, format_named, options_of
from app.errors import ThermapError, UnknownThing
from app.services.ask_field import TableQuestion, ask_field
from app.services.context import Context
from app.services.live_table import table_at
from app.services.load_machine import load_machine
from app.stated import Name, Number, Point, Schema, Temperatures

StatedOptions = Annotated[
    dict[str, Any],
    Field(
        default_factory=dict,
        max_length=100,
        description="Options of the format, as `GET /v1/controllers` lists them",
        examples=[{"sign": "error"}],
    ),
]


class BandsRequest(Schema):
    """A range of temperatures over which a set of tables is wanted."""

    from_c: Temperatures = Field(description="Temperatures at one end [°C]")
    to_c: Temperatures = Field(description="Temperatures of the same sensors at the other end [°C]")
    largest_step_um: Annotated[Number, Field(gt=0, le=1e6)] = Field(
        description="So much a component may change from one table to the next [µm; angles µrad]"
    )


class _FilesQuestion(TableQuestion):
    """At which temperatures a controller's files are asked for."""

    tool_offset_mm: Point = Field(
        (0.0, 0.0, 0.0),
        description="Tool offset X, Y, Z [mm] at which angular errors are sized",
        examples=[[0, 0, 160]],
    )
    options: StatedOptions


class ExportRequest(_FilesQuestion):
    """What is to be exported: at which temperatures, with which options, over which bands."""

    bands: BandsRequest | None = Field(
        None,
        description="A set of tables over a range of temperatures, for a controller that cannot "
        "ask a service; other sensors keep `temperatures_c`",
    )


class ControllerFileSchema(Schema):
    """One file of a controller."""

    name: Name = Field(description="Its name", examples=["x.comp"])
    content: Annotated[str, Field(max_length=4_000_000)] = Field(description="Its text")


def _parsed(files: list[ControllerFileSchema]) -> list[ControllerFile]:
    return [ControllerFile(file.name, file.content) for file in files]


if TYPE_CHECKING:
    Files: TypeAlias = list[ControllerFile]
else:
    Files = Annotated[
        list[ControllerFileSchema],
        Field(min_length=1, max_length=100, description="All files of one controller"),
        AfterValidator(_parsed),
    ]


class ParseRequest(Schema):
    """Files that are to be read."""

    files: Files
    options: StatedOptions


class CompareRequest(_FilesQuestion):
    """Files that are compared with what they should hold, at which temperatures."""

    files: Files


@dataclass(frozen=True, slots=True)
class BandExport(Answer, published_as="BandAnswer"):
    """One band of temperatures."""

    folder: Annotated[str, Field(examples=["band-01"])]
    """Folder of its files"""
    from_c: TemperaturesC
    """Where it begins [°C]"""
    to_c: TemperaturesC
    """Where it ends [°C]"""
    at_c: TemperaturesC
    """Temperatures of its tables [°C]"""
    check: Sequence[Check]
    """Moves that show whether the sign is right"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerHead(Answer):
    """What an answer about a controller's files rests on."""

    machine: Annotated[str, Field(examples=["mcfv5050"])]
    """The machine's id"""
    model_version: Annotated[int, Field(examples=[3])]
    """Version of the model"""
    computed_at: datetime
    """When it was computed, UTC"""
    temperatures_c: TemperaturesC
    """Temperatures that were used [°C]"""
    controller: Annotated[str, Field(examples=["linuxcnc"])]
    """Format"""
    complete: bool
    """Whether the compensation table is complete"""
    warnings: Sequence[str]
    """All that is to be known, in sentences"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exported(ControllerHead, published_as="ExportAnswer"):
    """A controller's files, and everything that is to be said of them."""

    sign: Sign
    """What the values in the files are"""
    files: Sequence[ControllerFile]
    """Files"""
    not_held: Sequence[NotHeld]
    """What the controller does not hold, largest first"""
    resampling: Sequence[Resampled]
    """What spacing and rounding add"""
    check: Sequence[Check]
    """Moves that show whether the sign is right; with bands each has its own"""
    bands: Sequence[BandExport] | None = None
    """Bands of temperatures, where they were asked for"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared(ControllerHead, published_as="CompareAnswer"):
    """What a controller holds against what it should hold."""

    components: Sequence[ComparedComponent]
    """The largest difference first"""
    not_held: Sequence[NotHeld]
    """What the format cannot hold, and is not compared"""


@dataclass(frozen=True, slots=True)
class ParsedComponent(Answer, published_as="ParsedComponentAnswer"):
    """What files hold of one component."""

    component: Code
    """ISO 230-1 code"""
    axis: str | None
    """Axis of the positions, null for a single value"""
    unit: UnitSymbol
    """Unit of the values"""
    positions_mm: Sequence[float] | None
    """Positions [mm]; null for a single value"""
    errors: Sequence[float]
    """Errors, actual minus nominal, in `unit`"""
    compensation: Sequence[float]
    """Minus the errors, in `unit`"""
    backward_errors: Sequence[float] | None
    """Errors in the negative direction where they differ, in `unit`"""
    backward_compensation: Sequence[float] | None
    """Minus these, in `unit`"""
    endless: bool
    """Whether the values are a straight line that goes on beyond the positions; else the end values
    hold"""


@dataclass(frozen=True, slots=True)
class ParsedFiles(Answer, published_as="ParseAnswer"):
    """What files hold."""

    controller: Annotated[str, Field(examples=["linuxcnc"])]
    """Format"""
    sign: Sign
    """As what the values were read"""
    machine: str | None
    """Machine that the files name, null where they do not"""
    components: Sequence[ParsedComponent]
    """One for each component"""
    warnings: Sequence[str]
    """All that is to be known, in sentences"""


@dataclass(frozen=True, slots=True)
class DescribedFormat(Answer, published_as="ControllerAnswer"):
    """One controller's file format."""

    name: Annotated[str, Field(examples=["linuxcnc"])]
    """Name by which it is asked for"""
    title: str
    """What it is"""
    sign: Sign | None
    """What its values are, `error` (actual minus nominal) or `compensation` (minus that); null
    where no source says: then the option `sign` has to be stated"""
    units: str
    """Units of positions and values"""
    spacing: str
    """What it wants of positions"""
    limits: str
    """What limits it"""
    status: str
    """How surely all this is known: `verified on the running controller`, `source-verified`,
    `manual-verified`, `seed example` or `ours`"""
    holds: Sequence[str]
    """Components that it can hold"""
    squareness_in_straightness: bool
    """Whether squareness is folded into straightness, because it has no table for it"""
    both_directions: bool
    """Whether it holds both directions of approach"""
    options: Sequence[OptionField]
    """What it can be told"""


@dataclass(frozen=True, slots=True)
class DescribedFormats(Answer, published_as="ControllersAnswer"):
    """Every format."""

    controllers: Sequence[DescribedFormat]
    """Formats"""


def describe_formats() -> DescribedFormats:
    """Say of every format what it is."""
    return DescribedFormats(
        [
            DescribedFormat(
                form.name,
                form.title,
                form.sign,
                form.units,
                form.spacing,
                form.limits,
                form.status.value,
                form.holds,
                form.folds,
                bool(form.both_directions),
                list(option_fields(form)),
            )
            for form in FORMATS.values()
        ]
    )


def export_compensation(
    context: Context,
    machine_id: str,
    controller_name: str,
    request: ExportRequest,
) -> Exported:
    """Write a controller's files for a machine; nothing is stored.

    Parameters
    ----------
    context, machine_id, request
        As `ask_field`.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`, `options_of` and `export`; whatever is refused, nothing is written.
    """
    controller = format_named(controller_name)
    options = options_of(controller, request.options)
    sign = controller.sign_of(options)
    if request.bands is None:
        table, complete = _error_table(context, machine_id, request)
        rendered = export(controller, table, options)
        return _exported(controller, sign, table, rendered, complete=complete)
    return _export_bands(context, machine_id, (controller, options), request, request.bands)


def _export_bands(
    context: Context,
    machine_id: str,
    written: tuple[Format, Options],
    question: TableQuestion,
    wanted: BandsRequest,
) -> Exported:
    controller, options = written
    others = question.temperatures_c or {}
    current = (context.live.get(machine_id) or load_machine(context, machine_id)).current
    machine, now = current.model.machine, context.now()

    def curves_at(temperatures_c: Mapping[str, float]) -> Mapping[str, Curve]:
        table = table_at(current, temperatures_c, now, (), question.state)
        return wanted_of(controller, ErrorTable.of(table, machine), options).table.curves

    bands = temperature_bands(
        curves_at, {**others, **wanted.from_c}, {**others, **wanted.to_c}, wanted.largest_step_um
    )
    exports: list[tuple[BandExport, Export]] = []
    tables: list[ErrorTable] = []
    complete, before = True, 0
    for i, band in enumerate(bands):
        question_of_band = question.model_copy(update={"temperatures_c": band.at_c})
        table, whole = _error_table(context, machine_id, question_of_band)
        rendered = export(controller, table, controller.for_band(options, i, before))
        before += sum(len(curve.sides) for curve in rendered.loaded)
        tables.append(table)
        complete = complete and whole
        folder = f"band-{i + 1:02d}"
        answered = BandExport(folder, band.from_c, band.to_c, band.at_c, rendered.check)
        exports.append((answered, rendered))
    sign = controller.sign_of(options)
    joint = controller.joint([rendered.files for _, rendered in exports], options)
    return _exported(
        controller,
        sign,
        tables[0],
        _joined(exports, joint),
        complete=complete,
        bands=[band for band, _ in exports],
    )


def _exported(
    controller: Format,
    sign: Sign,
    table: ErrorTable,
    rendered: Export,
    *,
    complete: bool,
    bands: Sequence[BandExport] | None = None,
) -> Exported:
    return Exported(
        **_head(controller, table, complete=complete),
        warnings=rendered.warnings,
        sign=sign,
        files=rendered.files,
        not_held=rendered.not_held,
        resampling=rendered.resampling,
        check=rendered.check,
        bands=bands,
    )


def _head(controller: Format, table: ErrorTable, *, complete: bool) -> dict[str, Any]:
    """Write the fields of `ControllerHead`, but for the warnings."""
    return {
        "machine": table.origin.machine_id,
        "model_version": table.origin.model_version,
        "computed_at": table.origin.computed_at,
        "temperatures_c": table.origin.temperatures_c,
        "controller": controller.name,
        "complete": complete,
    }


def _joined(bands: Sequence[tuple[BandExport, Export]], joint: Joint) -> Export:
    """Put the bands' files into folders, and say the largest of what each of them says."""
    not_held: dict[tuple[str, str], NotHeld] = {}
    resampled: dict[str, Resampled] = {}
    for _, rendered in bands:
        for omission in rendered.not_held:
            largest = not_held.setdefault((omission.component, omission.why), omission)
            if omission.largest > largest.largest:
                not_held[omission.component, omission.why] = omission
        for other in rendered.resampling:
            last = resampled.setdefault(other.component, other)
            if other.largest_deviation > last.largest_deviation:
                resampled[other.component] = other
    return Export(
        files=[
            *joint.files,
            *(
                replace(file, name=f"{band.folder}/{file.name}")
                for band, rendered in bands
                for file in rendered.files
            ),
        ],
        not_held=sorted(not_held.values(), key=lambda omission_: -omission_.largest),
        resampling=list(resampled.values()),
        check=[],
        warnings=[
            *joint.warnings,
            *dict.fromkeys(w for _, rendered in bands for w in rendered.warnings),
        ],
        loaded=[],
    )


def writable_components(context: Context, machine_id: str, controller: Format) -> Sequence[str]:
    """List what an export would write at the latest reading; nothing where there is no table."""
    try:
        table, _ = _error_table(context, machine_id, TableQuestion())
    except UnknownThing:
        raise
    except ThermapError:
        return ()
    source, _ = holdable(controller, table)
    return list(source.curves)


def parse_files(
    controller_name: str, files: Sequence[ControllerFile], raw_options: Mapping[str, Any]
) -> ParsedFiles:
    """Read a controller's files.

    Raises
    ------
    UnknownThing, InvalidContent
        If there is no such format, an option is wrong, or a file would be read wrongly.
    """
    controller = format_named(controller_name)
    options, parsed = read_files(controller, files, raw_options)
    return ParsedFiles(
        controller.name,
        controller.sign_of(options),
        parsed.machine,
        [_parsed_component(curve) for curve in parsed.curves.values()],
        parsed.warnings,
    )


def _parsed_component(curve: Curve) -> ParsedComponent:
    component, backward = curve.component, curve.backward_errors
    return ParsedComponent(
        component.code,
        component.axis,
        component.unit.symbol,
        curve.positions_mm.tolist() if component.is_table else None,
        _to_pm(curve.errors),
        _to_pm(-curve.errors),
        None if backward is None else _to_pm(backward),
        None if backward is None else _to_pm(-backward),
        curve.endless,
    )


def _to_pm(errors: FloatArray) -> list[float]:
    rounded: list[float] = (np.round(errors, 6) + 0.0).tolist()
    return rounded


def compare_files(
    context: Context,
    machine_id: str,
    controller_name: str,
    request: CompareRequest,
) -> Compared:
    """Compare what a controller holds with what it should hold.

    Parameters
    ----------
    context, machine_id, request
        As `ask_field`.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`, `parse_files` and `compare`.
    """
    controller = format_named(controller_name)
    options, loaded = read_files(controller, request.files, request.options)
    table, complete = _error_table(context, machine_id, request)
    comparison = compare(controller, table, loaded, options)
    return Compared(
        **_head(controller, table, complete=complete),
        warnings=comparison.warnings,
        components=comparison.components,
        not_held=comparison.not_held,
    )


def _error_table(
    context: Context, machine_id: str, question: TableQuestion
) -> tuple[ErrorTable, bool]:
    """Give a machine's errors at one thermal state, and whether all of them are there."""
    answer = ask_field(context, machine_id, question, needed=())
    (table,) = answer.tables
    error_table = ErrorTable.of(table, answer.machine, answer.field, question.tool_offset_mm)
    return error_table, table.complete
