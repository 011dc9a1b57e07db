"""Controllers' files: exported at stated temperatures or now, over bands of them, and compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from app.controllers.bands import Band, temperature_bands
from app.controllers.compare import Comparison, compare
from app.controllers.curve import Curve
from app.controllers.error_table import ErrorTable
from app.controllers.export import Export, Resampled, export, holdable, wanted_of
from app.controllers.format import (
    ControllerFile,
    Format,
    Joint,
    NotHeld,
    Options,
    Parsed,
)
from app.controllers.read import read_files
from app.controllers.registry import format_named, options_of
from app.errors import ThermapError, UnknownThing
from app.services.ask_field import FieldQuestion, ask_field
from app.services.context import Context
from app.services.live_table import table_at
from app.services.load_machine import load_machine

Temperatures = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class BandsWanted:
    """From where to where [°C], and how far one table may be from the next [µm]."""

    from_c: Temperatures
    to_c: Temperatures
    largest_step_um: float


@dataclass(frozen=True, slots=True)
class BandExport:
    """One band: its temperatures, the folder of its files, and its own export."""

    band: Band
    folder: str
    found: Export


@dataclass(frozen=True, slots=True)
class Exported:
    """An export, and what it rests on; `bands` is empty where none were wanted."""

    controller: Format
    sign: str
    table: ErrorTable
    complete: bool
    found: Export
    bands: Sequence[BandExport] = ()

    @property
    def computed_at(self) -> datetime:
        """When it was computed."""
        return self.table.origin.computed_at


@dataclass(frozen=True, slots=True)
class Compared:
    """A comparison, and what it rests on."""

    controller: Format
    table: ErrorTable
    complete: bool
    found: Comparison


def export_compensation(
    context: Context,
    machine_id: str,
    controller_name: str,
    raw_options: Mapping[str, Any],
    question: FieldQuestion,
    bands: BandsWanted | None = None,
) -> Exported:
    """Write a controller's files for a machine; nothing is stored.

    Parameters
    ----------
    context, machine_id, question
        As `ask_field`, of one thermal state.
    bands
        A range of temperatures over which a set of tables is wanted; the question's temperatures
        are those of the sensors that the range leaves alone.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`, `options_of` and `export`; whatever is refused, nothing is written.
    """
    controller = format_named(controller_name)
    options = options_of(controller, raw_options)
    sign = controller.sign_of(options)
    if bands is None:
        table, complete = _error_table(context, machine_id, question)
        rendered = export(controller, table, options)
        return Exported(controller, sign, table, complete, rendered)
    return _export_bands(context, machine_id, (controller, options), question, bands)


def _export_bands(
    context: Context,
    machine_id: str,
    written: tuple[Format, Options],
    question: FieldQuestion,
    wanted: BandsWanted,
) -> Exported:
    controller, options = written
    others: Temperatures = (question.temperatures_c or [{}])[0]
    current = (context.live.get(machine_id) or load_machine(context, machine_id)).current
    machine, now = current.model.machine, context.now()

    def curves_at(temperatures_c: Temperatures) -> Mapping[str, Curve]:
        table = table_at(current, temperatures_c, now, (), question.state)
        return wanted_of(controller, ErrorTable.of(table, machine), options).table.curves

    bands = temperature_bands(
        curves_at, {**others, **wanted.from_c}, {**others, **wanted.to_c}, wanted.largest_step_um
    )
    exports: list[BandExport] = []
    tables: list[ErrorTable] = []
    complete, before = True, 0
    for i, band in enumerate(bands):
        question_of_band = replace(question, temperatures_c=[band.at_c])
        table, whole = _error_table(context, machine_id, question_of_band)
        rendered = export(controller, table, controller.for_band(options, i, before))
        before += sum(len(curve.sides) for curve in rendered.loaded)
        tables.append(table)
        complete = complete and whole
        exports.append(BandExport(band, f"band-{i + 1:02d}", rendered))
    sign = controller.sign_of(options)
    joint = controller.joint([band_export.found.files for band_export in exports], options)
    return Exported(controller, sign, tables[0], complete, _joined(exports, joint), exports)


def _joined(bands: Sequence[BandExport], joint: Joint) -> Export:
    """Put the bands' files into folders, and say the largest of what each of them says."""
    not_held: dict[tuple[str, str], NotHeld] = {}
    resampled: dict[str, Resampled] = {}
    for band in bands:
        for omission in band.found.not_held:
            largest = not_held.setdefault((omission.component, omission.why), omission)
            if omission.largest > largest.largest:
                not_held[omission.component, omission.why] = omission
        for other in band.found.resampling:
            last = resampled.setdefault(other.component, other)
            if abs(other.difference.largest) > abs(last.difference.largest):
                resampled[other.component] = other
    return Export(
        files=[
            *joint.files,
            *(
                replace(file, name=f"{band.folder}/{file.name}")
                for band in bands
                for file in band.found.files
            ),
        ],
        not_held=sorted(not_held.values(), key=lambda omission_: -omission_.largest),
        resampling=list(resampled.values()),
        check=[],
        warnings=[
            *joint.warnings,
            *dict.fromkeys(w for band in bands for w in band.found.warnings),
        ],
        loaded=[],
    )


def writable_components(context: Context, machine_id: str, controller: Format) -> Sequence[str]:
    """List what an export would write at the latest reading; nothing where there is no table."""
    try:
        table, _ = _error_table(context, machine_id, FieldQuestion(None, missing_as_zero=True))
    except UnknownThing:
        raise
    except ThermapError:
        return ()
    source, _ = holdable(controller, table)
    return list(source.curves)


def parse_files(
    controller_name: str, files: Sequence[ControllerFile], raw_options: Mapping[str, Any]
) -> tuple[Format, Options, Parsed]:
    """Read a controller's files.

    Raises
    ------
    UnknownThing, InvalidContent
        If there is no such format, an option is wrong, or a file would be read wrongly.
    """
    controller = format_named(controller_name)
    options, parsed = read_files(controller, files, raw_options)
    return controller, options, parsed


def compare_files(
    context: Context,
    machine_id: str,
    controller_name: str,
    files: Sequence[ControllerFile],
    raw_options: Mapping[str, Any],
    question: FieldQuestion,
) -> Compared:
    """Compare what a controller holds with what it should hold.

    Parameters
    ----------
    context, machine_id, question
        As `ask_field`, of one thermal state.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`, `parse_files` and `compare`.
    """
    controller, options, loaded = parse_files(controller_name, files, raw_options)
    table, complete = _error_table(context, machine_id, question)
    return Compared(controller, table, complete, compare(controller, table, loaded, options))


def _error_table(
    context: Context, machine_id: str, question: FieldQuestion
) -> tuple[ErrorTable, bool]:
    """Give a machine's errors at one thermal state, and whether all of them are there."""
    answer = ask_field(context, machine_id, question, needed=())
    (table,) = answer.tables
    error_table = ErrorTable.of(table, answer.machine, answer.field, question.tool_offset_mm)
    return error_table, table.complete
