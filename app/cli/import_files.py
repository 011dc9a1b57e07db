"""thermap import: machine descriptions, error maps, readings and measurements from files."""

from __future__ import annotations

import json as json_text
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import typer

from app.cli.asking import ThermapClient, asks
from app.cli.console import console
from app.cli.measurement_view import measurement_view
from app.cli.models import preview_lines, waiting_lines
from app.cli.options import TemperatureOption, refuse_if
from app.cli.terminal import echo, write_json
from app.cli.uploads import (
    Beside,
    Sent,
    Upload,
    choose_machine,
    look_at_all,
    machine_in,
    naming,
    raise_if_any,
    read_bytes,
    say_what_was_read,
    send,
)
from app.errors import counted, list_names
from app.json_text import NoJsonError, RepeatedNameError, read_json
from app.thermal.machine import Machine
from thermap import calls
from thermap.answers import (
    DriftVerificationAnswer,
    ErrorMapAnswer,
    MachineAnswer,
    MapPreview,
    MeasurementAnswer,
    PreviewAnswer,
    ThermalDriftAnswer,
)

_STATED: Final = {field.name for field in fields(Machine)} | {"configuration"}
_ANSWERED: Final = MachineAnswer.model_fields.keys() - _STATED
"""What the service says of a machine, and nobody states."""


@dataclass(slots=True)
class _Imported:
    """What files hold, by what it is sent as."""

    machines: list[tuple[Path, Mapping[str, Any]]] = field(default_factory=list)
    readings: list[tuple[Path, str, list[Mapping[str, Any]]]] = field(default_factory=list)
    uploads: list[Upload] = field(default_factory=list)


@asks
def import_files(
    thermap: ThermapClient,
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
            "the map that they make is stored and shown.",
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
            "--evaluate-only",
            help="With --method: show what comes out and store nothing.",
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
        Literal["maps", "verification", "both"],
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
        typer.Option("--json", help="The service's JSON, a line for each map."),
    ] = False,
) -> None:
    """Store machines, error maps and readings from files; no map before all are looked at.

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
    refuse_if(
        preview and (evaluate_only or accept_losses),
        "a preview stores nothing: leave out --evaluate-only and --accept-losses",
        "--preview",
    )
    refuse_if(
        keep_as != "maps" and method != "thermal-drift",
        f"{keep_as} goes with --method thermal-drift alone",
        "--as",
    )
    refuse_if(
        preview and keep_as == "verification",
        "says what maps would do to the tables, and a verification changes none: leave it out",
        "--preview",
    )
    text_files = sum(method is not None or file.suffix.lower() != ".json" for file in files)
    refuse_if(label and text_files > 1, "names one map, got several files", "--label")
    beside = {
        "kind": "map",
        "label": label,
        "measured_at": measured_at,
        "temperature": [f"{name}={value!r}" for name, value in (temperature or {}).items()],
        "method": method,
        "axis": axis,
    }
    stores = not (evaluate_only or preview)
    storing = calls.Storing(
        stores and keep_as != "verification", accept_losses, preview, stores and keep_as != "maps"
    )
    imported = _read_all(files, machine, has_bodies=method is not None)
    for file, settings in imported.machines if stores else ():
        with naming(file):
            echo(f"{file}: {_store_machine(thermap, settings)}")
    look = calls.Storing(preview=not evaluate_only)
    if stores and keep_as != "maps":
        look = calls.Storing(preview=keep_as == "both")
    looks = look_at_all(thermap, imported.uploads, beside, look)
    if not stores:
        for upload, sent in zip(imported.uploads, looks, strict=True):
            _show(upload.file, sent, json=json)
        return
    for file, machine_id, readings in imported.readings:
        with naming(file):
            _store_readings(thermap, file, machine_id, readings)
    _store_uploads(thermap, imported.uploads, looks, beside, storing, json=json)


def _read_all(files: Sequence[Path], machine: str | None, *, has_bodies: bool) -> _Imported:
    """Read every file, and decide whose it is.

    Parameters
    ----------
    has_bodies
        Whether JSON files hold bodies of measurements, and no machines, maps or readings.
    """
    imported = _Imported()
    wrong: list[str] = []
    entries: list[tuple[Path, Mapping[str, Any]]] = []
    contents = read_bytes(files)
    for file, content in contents.items():
        if file.suffix.lower() == ".json" and not has_bodies:
            try:
                entries += [(file, entry) for entry in _entries(content)]
            except ValueError as error:
                wrong.append(f"{file}{error}")
    raise_if_any(wrong)
    imported.machines = [(file, entry) for file, entry in entries if "configuration" in entry]
    described = [str(entry.get("id")) for _, entry in imported.machines]
    readings: dict[Path, list[Mapping[str, Any]]] = {}
    of_file = {file for file, _ in entries}
    for file, entry in entries:
        if _is_reading(entry):
            readings.setdefault(file, []).append(entry)
    for file, content in contents.items():
        if file not in of_file:
            named = choose_machine(file, machine_in(content), machine, described)
            imported.uploads.append(Upload(file, named, content))
        is_one = content.lstrip()[:1] == b"{"
        for i, entry in enumerate((e for other, e in entries if other == file), start=1):
            if "configuration" not in entry and not _is_reading(entry):
                named = choose_machine(file, None, machine, described)
                written = content if is_one else json_text.dumps(entry).encode()
                place = "" if is_one else f"entry {i}: "
                imported.uploads.append(Upload(file, named, written, place))
    imported.readings = [
        (file, choose_machine(file, None, machine, described), entries_of_file)
        for file, entries_of_file in readings.items()
    ]
    return imported


def _entries(content: bytes) -> list[Mapping[str, Any]]:
    """Give the objects of a JSON file, one or a list of them; ValueError says what it is else."""
    try:
        document = read_json(content)
    except NoJsonError as error:
        raise ValueError(f": expected JSON: {error}") from None
    except RepeatedNameError as error:
        raise ValueError(
            f": expected each name once in an object, got {error.name} twice"
        ) from None
    entries = document if isinstance(document, list) else [document]
    if not entries:
        raise ValueError(": expected a machine, an error map or readings, got an empty list")
    for i, entry in enumerate(entries, start=1):
        if not isinstance(entry, dict) or not entry.keys() & _TOLD_BY:
            place = f"entry {i}: " if isinstance(document, list) else ""
            got = f"fields {', '.join(entry)}" if isinstance(entry, dict) else type(entry).__name__
            raise ValueError(
                f": {place}expected a machine (with configuration), an error map (with components) "
                f"or a reading (with time and temperatures_c), got {got}"
            )
    return entries


_TOLD_BY: Final = frozenset({"configuration", "components", "measured_at", "observations", "time"})


def _is_reading(entry: Mapping[str, Any]) -> bool:
    return "time" in entry and not entry.keys() & {"components", "measured_at", "configuration"}


def _store_machine(thermap: ThermapClient, entry: Mapping[str, Any]) -> str:
    settings = {name: value for name, value in entry.items() if name not in _ANSWERED}
    sent = send(thermap, calls.create_machine(settings))
    return f"machine {sent.answer.id} {'stored' if sent.is_new else 'was there already'}"


def _store_readings(
    thermap: ThermapClient, file: Path, machine: str, readings: Sequence[Mapping[str, Any]]
) -> None:
    done = thermap.store_readings(machine, readings)
    echo(f"{file}: {counted(done.stored, 'reading')} stored, {done.duplicates} there already")
    for warning in done.warnings:
        echo(f"{file}: {warning}", err=True)


def _store_uploads(
    thermap: ThermapClient,
    uploads: Sequence[Upload],
    looks: Sequence[Sent[calls.ImportedFile]],
    beside: Beside,
    storing: calls.Storing,
    *,
    json: bool,
) -> None:
    """Store each, and show before what it would do; what is noted of a machine is noted once."""
    noted: set[tuple[str, str]] = set()
    for i, (upload, look) in enumerate(zip(uploads, looks, strict=True)):
        with naming(upload.file, [later.file for later in uploads[i + 1 :]]):
            preview = _preview_in(look.answer)
            if preview is not None and i and not json:
                # Of the tables that the maps before it have changed.
                again = send(thermap, upload.call(beside, calls.Storing(preview=True)))
                preview = _preview_in(again.answer)
            if preview is not None and not json:
                _show_preview(upload.file, preview)
            sent = send(thermap, upload.call(beside, storing))
            if json:
                write_json(sent.content)
                continue
            for warning in getattr(sent.answer, "warnings", ()):
                if (upload.machine, warning) not in noted:
                    echo(f"{upload.file}: note: {warning}", err=True)
                noted.add((upload.machine, warning))
            _report(thermap, upload, sent)


def _preview_in(answer: calls.ImportedFile) -> PreviewAnswer | MapPreview | None:
    if isinstance(answer, MeasurementAnswer):
        return answer.preview
    return answer if isinstance(answer, MapPreview) else None


def _show(file: Path, sent: Sent[calls.ImportedFile], *, json: bool) -> None:
    """Show a preview, or an evaluation, of which nothing is stored."""
    if json:
        write_json(sent.content)
        return
    answer = sent.answer
    say_what_was_read(file, answer)
    preview = _preview_in(answer)
    if preview is not None:
        _show_preview(file, preview)
        _show_what_becomes(file, preview)
    if isinstance(answer, MeasurementAnswer):
        if preview is None:
            echo(f"{file}: {answer.method} evaluated, nothing stored")
        console().print(measurement_view(answer))


def _show_preview(file: Path, preview: PreviewAnswer | MapPreview) -> None:
    """Say what a map would do to the tables; losses where warnings go."""
    for line in preview_lines(preview):
        good = line.startswith(("would gain", "would change", "would have changed"))
        echo(f"{file}: {line}", err=not good)


def _show_what_becomes(file: Path, preview: PreviewAnswer | MapPreview) -> None:
    """Say that nothing is stored, and why nothing is known of changes."""
    if preview.not_compared:
        echo(f"{file}: it is not known by how much tables would change ({preview.not_compared})")
    became = (
        "would be active at once"
        if preview.activated
        else "would wait, and tables would stay as they are"
    )
    echo(f"{file}: a preview, nothing was stored; the model version that this map makes {became}")


def _report(thermap: ThermapClient, upload: Upload, sent: Sent[calls.ImportedFile]) -> None:
    """Say under which number what was sent is stored, and whether tables follow it."""
    answer = sent.answer
    if isinstance(answer, ErrorMapAnswer):
        _report_map(thermap, upload, answer.label, answer.id, answer, is_new=sent.is_new)
    if not isinstance(answer, MeasurementAnswer):
        return
    for label, number in _maps_of(answer):
        _report_map(thermap, upload, label, number, answer, is_new=sent.is_new)
    if isinstance(answer, ThermalDriftAnswer) and answer.verification is not None:
        echo(f"{upload.file}: {_kept_words(upload.machine, answer.label, answer.verification)}")
    console().print(measurement_view(answer))


def _maps_of(answer: MeasurementAnswer) -> Iterator[tuple[str, int]]:
    """Give label and number of each map that was stored."""
    if isinstance(answer, ThermalDriftAnswer):
        made = [(state.label, state.map_id) for state in answer.states]
    else:
        made = [(answer.label, answer.map_id)]
    yield from ((str(label), number) for label, number in made if number is not None)


def _report_map(
    thermap: ThermapClient,
    upload: Upload,
    label: str,
    number: int,
    change: ErrorMapAnswer | MeasurementAnswer,
    *,
    is_new: bool,
) -> None:
    waits = list(waiting_lines(change, upload.machine, number))
    version = change.model_version
    if is_new:
        active = version or thermap.machine(upload.machine).active_model
        text = f"error map {label!r} stored as number {number}"
        text += "" if waits else f", model version {active}"
    else:
        text = f"error map {label!r} was there already, number {number}"
        text += f"; model version {version} is active" if version and change.activated else ""
    echo(f"{upload.file}: {text}")
    for line in waits:
        echo(f"{upload.file}: {line}", err=True)


def _kept_words(machine: str, label: str | None, stored: DriftVerificationAnswer) -> str:
    """Say under which number a test's course is a verification, and what of it is new."""
    how = "stored as" if stored.is_new else "was there already,"
    readings = counted(stored.stored_readings, "new reading")
    return (
        f"verification {str(label)!r} {how} number {stored.id}: "
        f"{counted(stored.observations, 'observation')} of {list_names(stored.components)}, and "
        f"{readings} of the temperatures; `thermap analyse {machine}` searches it"
    )
