"""thermap import: machine descriptions, error maps, readings and measurements from files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final

import typer

from app.api.contract_json import read_contract_json
from app.api.schemas.error_maps import ErrorMapSchema
from app.api.schemas.machines import MachineSettings, settings_of
from app.api.schemas.readings import ReadingSchema
from app.api.uploaded_map import read_error_map
from app.cli.import_checks import (
    ImportMode,
    choose_machine,
    expect_one_label,
    expect_sensors,
    naming,
    note_unassigned_components,
    refusing_other_kind,
    report_stored_map,
    settings_of_stored,
    show_preview,
    show_what_was_read,
)
from app.cli.import_measurements import import_measurements
from app.cli.options import TemperatureOption, UrlOption, connect, read_named_numbers
from app.cli.terminal import echo
from app.errors import Conflict, counted, list_names
from app.files.csv_comments import Header
from app.files.delimited_text import UnreadableFile
from app.files.file_kind import FileKind
from app.files.instrument_files import InstrumentFormat, instrument_format
from app.pages.what_was_read import read_of_map
from thermap import DEFAULT_URL, ThermapClient, UnknownThingError

KEPT_AS: Final = ("maps", "verification", "both")


@dataclass(slots=True)
class ImportedFile:
    """What one file holds, checked."""

    file: Path
    machines: list[MachineSettings] = field(default_factory=list)
    error_maps: list[ErrorMapSchema] = field(default_factory=list)
    readings: list[ReadingSchema] = field(default_factory=list)
    machine: str = ""
    remarks: Sequence[str] = ()

    @property
    def needs_machine(self) -> bool:
        """Whether something in it belongs to a machine that has to be named."""
        return bool(self.error_maps or self.readings)


def import_files(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE…", help="JSON of the HTTP contract, or CSV.")
    ],
    machine: Annotated[
        str | None,
        typer.Option("--machine", "-m", help="The machine that they belong to."),
    ] = None,
    label: Annotated[str | None, typer.Option(help="A CSV map's name.")] = None,
    measured_at: Annotated[
        str | None,
        typer.Option(help="When a CSV map was measured, ISO 8601."),
    ] = None,
    temperature: TemperatureOption = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="The files are an instrument's readings by this method, such as step-diagonal; "
            "the map that they make is stored and shown."
        ),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(
            "--axis", help="The axis of an instrument's file (.rtl) that does not say x, y or z."
        ),
    ] = None,
    evaluate_only: Annotated[
        bool,
        typer.Option(
            "--evaluate-only", help="With --method: show what comes out and store nothing."
        ),
    ] = False,
    preview: Annotated[
        bool,
        typer.Option(
            "--preview",
            help="Show what was read, and what tables would lose, gain and change; store nothing.",
        ),
    ] = False,
    accept_losses: Annotated[
        bool,
        typer.Option(
            "--accept-losses",
            help="Let tables follow a map although they lose positions, components or else by it; "
            "without it such a map is stored, and its model version waits.",
        ),
    ] = False,
    keep_as: Annotated[
        str,
        typer.Option(
            "--as",
            envvar="THERMAP_IMPORT_AS",
            metavar="WHAT",
            help="With --method thermal-drift: what is made of the test, maps of its thermal "
            "states, a verification of its course, or both.",
        ),
    ] = "maps",
    json: Annotated[
        bool,
        typer.Option("--json", help="With --method: the service's JSON, a line for each file."),
    ] = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Store machines, error maps and readings from files; all are checked before any is sent.

    JSON: a machine, an error map, readings, or lists of them. CSV: an error map with
    the columns component, position_mm, error_um (or error_urad, slope_um_per_m,
    value_um_per_m …), optional backward_error_um, and comment lines above them:
    `# label: Run #1`, `# measured_at: 2026-03-01T06:00:00Z`,
    `# temperature x-middle: 20.1` (°C). Options overrule a file.

    What is there already with the same content stays as it is.

    Before a map is sent, what tables would lose, gain and change by it is shown. Where they
    would lose something the map is stored, but tables stay as they are until its model version
    is activated; maps that follow are added to that version.

    With `--method`, CSV files hold an instrument's readings, with columns and comment
    lines as docs/methods/files.md shows, and JSON files the body of the request.
    Renishaw's linear `.rtl` says itself that it is `positioning`.

    Example: `thermap import machine.json run-1.csv run-3.csv run-6.csv`

    Example: `thermap import --method step-diagonal laser.csv --machine mcfv5050`
    """
    temperatures_c = read_named_numbers(temperature, "--temperature", "a temperature in °C")
    header = Header(label, measured_at, temperatures_c)
    if preview and (evaluate_only or accept_losses):
        raise typer.BadParameter(
            "a preview stores nothing: leave out --evaluate-only and --accept-losses",
            param_hint="--preview",
        )
    if keep_as not in KEPT_AS or (keep_as != "maps" and method != "thermal-drift"):
        raise typer.BadParameter(
            f"expected one of {list_names(KEPT_AS)} with --method thermal-drift, got {keep_as!r}",
            param_hint="--as",
        )
    if preview and keep_as == "verification":
        raise typer.BadParameter(
            "says what maps would do to the tables, and a verification changes none: leave it out",
            param_hint="--preview",
        )
    mode = ImportMode(
        evaluate_only=evaluate_only,
        preview=preview,
        accept_losses=accept_losses,
        as_maps=keep_as != "verification",
        as_verification=keep_as != "maps",
    )
    written = [instrument_format(file) for file in files]
    if axis is not None and not all(written):
        raise typer.BadParameter(
            "goes with files as instruments write them, such as .rtl", param_hint="--axis"
        )
    method = method or _method_of(files, written)
    if method is not None:
        import_measurements(files, method, machine, header, mode, json=json, url=url, axis=axis)
        return
    for option, is_given in {"--evaluate-only": evaluate_only, "--json": json}.items():
        if is_given:
            raise typer.BadParameter("goes with --method", param_hint=option)
    imported = _read_all(files, header, machine)
    with connect(url) as thermap:
        machines = _check_with_service(thermap, imported)
        for settings in machines.values():
            note_unassigned_components(thermap, settings, _components_of(settings.id, imported))
        noted: set[tuple[str, str]] = set()
        for i, imported_file in enumerate(imported):
            with naming(imported_file.file, [later.file for later in imported[i + 1 :]]):
                _send(thermap, imported_file, mode, noted)


def _method_of(files: Sequence[Path], written: Sequence[InstrumentFormat | None]) -> str | None:
    """Take the method of files that instruments wrote; others go another way."""
    methods = {form.method if form else None for form in written}
    if len(methods) > 1:
        theirs = [str(file) for file, form in zip(files, written, strict=True) if form]
        raise typer.BadParameter(
            f"expected files of one kind, got {list_names(theirs)} as an instrument wrote them "
            "beside others: import them one after the other",
            param_hint="FILE",
        )
    return next(iter(methods), None)


def _read_all(files: Sequence[Path], header: Header, machine: str | None) -> list[ImportedFile]:
    """Read every file, machines first, and complain of all that is wrong in any."""
    tables = [file for file in files if file.suffix.lower() != ".json"]
    expect_one_label(header, tables)
    imported: list[ImportedFile] = []
    problems: list[str] = []
    for file in files:
        try:
            imported.append(_read_csv(file, header) if file in tables else _read_json(file))
        except UnreadableFile as error:
            problems.append(error.detail)
    if problems:
        raise UnreadableFile("\n".join(["nothing was sent:", *problems]))
    described = [settings.id for imported_file in imported for settings in imported_file.machines]
    for imported_file in imported:
        if imported_file.needs_machine:
            imported_file.machine = choose_machine(
                imported_file.file, imported_file.machine, machine, described
            )
    return sorted(imported, key=lambda item: not item.machines)


def _read_csv(file: Path, header: Header) -> ImportedFile:
    with refusing_other_kind(FileKind.MAP, file):
        content = read_error_map(file, header)
    return ImportedFile(
        file, error_maps=[content.error_map], machine=content.machine or "", remarks=content.remarks
    )


def _read_json(file: Path) -> ImportedFile:
    imported_file = ImportedFile(file)
    with refusing_other_kind(FileKind.MAP, file):
        contents = read_contract_json(file)
    for content in contents:
        if isinstance(content, MachineSettings):
            imported_file.machines.append(content)
        elif isinstance(content, ErrorMapSchema):
            imported_file.error_maps.append(content)
        else:
            imported_file.readings.append(content)
    return imported_file


def _check_with_service(
    thermap: ThermapClient, imported: Sequence[ImportedFile]
) -> dict[str, MachineSettings]:
    """Refuse what the machines cannot take, before anything is sent; give the machines."""
    described = {settings.id: settings for one in imported for settings in one.machines}
    wanted = {one.machine for one in imported if one.needs_machine}
    machines = {
        id_: described.get(id_) or settings_of_stored(thermap.machine(id_))
        for id_ in sorted(wanted)
    }
    for imported_file in imported:
        if imported_file.needs_machine:
            sensor_names = [sensor.name for sensor in machines[imported_file.machine].sensors]
            expect_sensors(
                imported_file.file, imported_file.machine, sensor_names, _sensors_in(imported_file)
            )
    return machines


def _components_of(machine: str, imported: Sequence[ImportedFile]) -> Iterator[str]:
    for imported_file in imported:
        for error_map in imported_file.error_maps if imported_file.machine == machine else ():
            yield from (component.component for component in error_map.components)


def _sensors_in(imported_file: ImportedFile) -> Iterator[str]:
    for error_map in imported_file.error_maps:
        yield from error_map.temperatures_c
    for reading in imported_file.readings:
        yield from reading.temperatures_c


def _send(
    thermap: ThermapClient,
    imported_file: ImportedFile,
    mode: ImportMode,
    noted: set[tuple[str, str]],
) -> None:
    """Send a file's content; what was `noted` of a machine's earlier map is not said again."""
    for remark in imported_file.remarks:
        echo(f"{imported_file.file}: note: {remark}", err=True)
    if mode.preview:
        for error_map in imported_file.error_maps:
            show_what_was_read(imported_file.file, read_of_map(error_map.to_error_map()))
            preview = thermap.preview_error_map(imported_file.machine, error_map)
            show_preview(imported_file.file, preview, alone=True)
            _note_once(imported_file.machine, preview.warnings, noted)
        return
    for settings in imported_file.machines:
        echo(f"{imported_file.file}: {_send_machine(thermap, settings)}")
    labels = (
        {m.label for m in thermap.error_maps(imported_file.machine)}
        if imported_file.error_maps
        else set()
    )
    for error_map in imported_file.error_maps:
        show_preview(
            imported_file.file, thermap.preview_error_map(imported_file.machine, error_map)
        )
        stored = thermap.store_error_map(
            imported_file.machine, error_map, accept_losses=mode.accept_losses
        )
        _note_once(imported_file.machine, stored.warnings, noted)
        report_stored_map(
            thermap,
            imported_file.file,
            imported_file.machine,
            stored.label,
            stored.id,
            stored,
            was_there=stored.label in labels,
        )
        labels.add(stored.label)
    if imported_file.readings:
        done = thermap.store_readings(imported_file.machine, imported_file.readings)
        echo(
            f"{imported_file.file}: {counted(done.stored, 'reading')} stored, {done.duplicates} "
            "there already"
        )
        for warning in done.warnings:
            echo(f"{imported_file.file}: {warning}", err=True)


def _note_once(machine: str, warnings: Iterable[str], noted: set[tuple[str, str]]) -> None:
    for warning in warnings:
        if (machine, warning) not in noted:
            echo(f"note: {warning}", err=True)
        noted.add((machine, warning))


def _send_machine(thermap: ThermapClient, settings: MachineSettings) -> str:
    try:
        present = thermap.machine(settings.id)
    except UnknownThingError:
        thermap.create_machine(settings)
        return f"machine {settings.id} stored"
    wanted = MachineSettings.model_validate(settings_of(settings.to_machine()))
    if settings_of_stored(present) != wanted:
        raise Conflict(
            f"machine {settings.id} is there with other settings; "
            f"`thermap machines set {settings.id} KEY=VALUE` changes them"
        )
    return f"machine {settings.id} was there already"
