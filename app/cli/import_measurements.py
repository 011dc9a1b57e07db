"""thermap import --method: an instrument's readings from files, and what comes out of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import typer
from pydantic import ValidationError

from app.api.contract_json import read_json
from app.api.schemas.measurements.axes import PositioningRequest, SixDofRequest
from app.api.schemas.measurements.base import MeasurementRequest
from app.api.schemas.measurements.diagonals import BodyDiagonalRequest, StepDiagonalRequest
from app.api.schemas.measurements.drift import ThermalDriftRequest
from app.api.schemas.measurements.parts import (
    DrilledPlateRequest,
    MachinedPartRequest,
    RotaryAxisRequest,
)
from app.cli.console import console
from app.cli.import_checks import (
    ImportMode,
    choose_machine,
    expect_one_label,
    expect_sensors,
    naming,
    note_unassigned_components,
    report_stored_map,
    settings_of_stored,
    show_preview,
)
from app.cli.measurement_view import measurement_view
from app.cli.options import connect
from app.cli.terminal import echo, write_document
from app.errors import counted, list_names
from app.field_errors import field_error
from app.files.csv_comments import Header
from app.files.csv_measurements import CsvMeasurement, completed, read_csv_measurement
from app.files.delimited_text import Problems, UnreadableFile, read_text
from app.files.instrument_files import InstrumentFormat, instrument_format
from thermap import ThermapClient, calls
from thermap.answers import (
    BodyDiagonalAnswer,
    DriftVerificationAnswer,
    DrilledPlateAnswer,
    MachinedPartAnswer,
    MeasurementAnswer,
    PositioningAnswer,
    RotaryAxisAnswer,
    StepDiagonalAnswer,
    ThermalDriftAnswer,
)
from thermap.call import Call


@dataclass(frozen=True, slots=True)
class _Method:
    """The shapes of what a method is asked with and of what it answers."""

    request: type[MeasurementRequest]
    answer: type[MeasurementAnswer]


_METHODS: Final = {
    "step-diagonal": _Method(StepDiagonalRequest, StepDiagonalAnswer),
    "body-diagonal": _Method(BodyDiagonalRequest, BodyDiagonalAnswer),
    "positioning": _Method(PositioningRequest, PositioningAnswer),
    "six-dof": _Method(SixDofRequest, MeasurementAnswer),
    "machined-part": _Method(MachinedPartRequest, MachinedPartAnswer),
    "rotary-axis": _Method(RotaryAxisRequest, RotaryAxisAnswer),
    "drilled-plate": _Method(DrilledPlateRequest, DrilledPlateAnswer),
    "thermal-drift": _Method(ThermalDriftRequest, ThermalDriftAnswer),
}


@dataclass(frozen=True, slots=True)
class MeasuredFile:
    """What one file holds, checked, and the machine that was measured."""

    file: Path
    body: Mapping[str, Any]
    machine: str
    remarks: Sequence[str]


def import_measurements(
    files: Sequence[Path],
    method: str,
    machine: str | None,
    header: Header,
    mode: ImportMode,
    *,
    json: bool,
    url: str,
    axis: str | None = None,
) -> None:
    """Evaluate measurements, store what comes out as error maps, and show it.

    All files are read and checked, and of several all are evaluated, before any is
    stored.

    Parameters
    ----------
    files
        CSV as docs/methods/files.md shows, the request's body as JSON, or as an
        instrument writes them.
    machine
        The machine that was measured, where the files do not name it.
    header
        What takes precedence over the files' own label, time and temperatures.
    mode
        Whether maps are made; if not, label, time and temperatures are not needed.
    json
        Write the service's JSON, a line for each file.
    axis
        The axis that was measured, where an instrument's file has free text for it.
    """
    if method not in _METHODS:
        raise typer.BadParameter(
            f"expected one of {list_names(_METHODS)}, got {method!r}", param_hint="--method"
        )
    expect_one_label(header, files)
    measured = _read_all(files, method, machine, header, mode.makes_map, axis)
    with connect(url) as thermap:
        _check_with_service(thermap, method, measured, mode)
        for i, measured_file in enumerate(measured):
            for remark in measured_file.remarks:
                echo(f"{measured_file.file}: note: {remark}", err=True)
            with naming(measured_file.file, [later.file for later in measured[i + 1 :]]):
                _send(thermap, method, measured_file, mode, json)


def _read_all(
    files: Sequence[Path],
    method: str,
    machine: str | None,
    header: Header,
    store: bool,
    axis: str | None,
) -> list[MeasuredFile]:
    """Read every file, and complain of all that is wrong in any."""
    measurements: list[tuple[Path, CsvMeasurement]] = []
    complaints: list[str] = []
    for file in files:
        try:
            written = instrument_format(file)
            if written is not None:
                measurement = _read_instrument(file, written, method, header, store, axis)
            else:
                read = _read_json if file.suffix.lower() == ".json" else _read_csv
                measurement = read(file, method, header, store)
            _check_body(file, method, measurement.body)
            measurements.append((file, measurement))
        except UnreadableFile as error:
            complaints.append(error.detail)
    if complaints:
        raise UnreadableFile("\n".join(["nothing was sent:", *complaints]))
    return [
        MeasuredFile(file, m.body, choose_machine(file, m.machine, machine), m.remarks)
        for file, m in measurements
    ]


def _read_csv(file: Path, method: str, stated: Header, store: bool) -> CsvMeasurement:
    return read_csv_measurement(
        method, read_text(file), name=str(file), header=stated, complete=store
    )


def _read_instrument(
    file: Path,
    written: InstrumentFormat,
    method: str,
    header: Header,
    store: bool,
    axis: str | None,
) -> CsvMeasurement:
    """Read a file as an instrument wrote it; what it cannot know is stated beside it."""
    if written.method != method:
        raise UnreadableFile(f"{file}: expected --method {written.method}, got {method}")
    content = written.read(read_text(file), file, axis)
    return completed(content, method, file, header, complete=store)


def _read_json(file: Path, method: str, header: Header, store: bool) -> CsvMeasurement:
    """Read a request's body; what the command line states takes precedence over it."""
    problems = Problems(file)
    body = read_json(file, problems)
    if not isinstance(body, dict):
        problems.add(f"expected the fields of a {method} measurement, got {type(body).__name__}")
        problems.raise_if_any()
    return completed(CsvMeasurement(body, None, ()), method, file, header, complete=store)


def _check_body(file: Path, method: str, body: Mapping[str, Any]) -> None:
    """Make of a body what the service would, so that what it would refuse is known here."""
    problems = Problems(file)
    try:
        _METHODS[method].request.model_validate(body)
    except ValidationError as error:
        for field_problem in map(field_error, error.errors()):
            problems.add(f"{field_problem.field}: {field_problem.message}")
    problems.raise_if_any()


def _check_with_service(
    thermap: ThermapClient, method: str, measured: Sequence[MeasuredFile], mode: ImportMode
) -> None:
    """Refuse what the machines cannot take and what the method refuses, before storing any."""
    machines = {id_: thermap.machine(id_) for id_ in sorted({one.machine for one in measured})}
    for measured_file in measured if mode.makes_map else ():
        sensor_names = [sensor.name for sensor in machines[measured_file.machine].sensors]
        expect_sensors(
            measured_file.file, measured_file.machine, sensor_names, _sensors_in(measured_file.body)
        )
    if not mode.store:
        return
    components: dict[str, list[str]] = {id_: [] for id_ in machines}
    for measured_file in measured:
        with naming(measured_file.file, before="nothing was stored: " if len(measured) > 1 else ""):
            answer = thermap.send(_call(method, measured_file, calls.Storing()))
        components[measured_file.machine] += [
            component.component for component in answer.components
        ]
    for id_, codes in components.items() if mode.stores_map else ():
        note_unassigned_components(thermap, settings_of_stored(machines[id_]), codes)


def _sensors_in(body: Mapping[str, Any]) -> Iterable[str]:
    """Name the sensors of a measurement's state, or of the readings of a drift test."""
    yield from body.get("temperatures_c") or ()
    for reading in body.get("readings", ()):
        yield from reading.get("temperatures_c") or ()


def _call(
    method: str, measured_file: MeasuredFile, storing: calls.Storing
) -> Call[MeasurementAnswer]:
    return calls.measure(
        measured_file.machine, method, _METHODS[method].answer, measured_file.body, storing
    )


def _maps_of(
    measured_file: MeasuredFile, answer: MeasurementAnswer
) -> Iterator[tuple[str, int | None]]:
    """Give label and number of each map that was stored."""
    if isinstance(answer, ThermalDriftAnswer):
        for state in answer.states:
            yield str(state.label), state.map_id
    else:
        yield str(measured_file.body["label"]).strip(), answer.map_id


def _send(
    thermap: ThermapClient, method: str, measured_file: MeasuredFile, mode: ImportMode, json: bool
) -> None:
    storing = calls.Storing(
        mode.stores_map,
        mode.accept_losses,
        mode.preview,
        mode.store and mode.as_verification,
    )
    call = _call(method, measured_file, storing)
    if json:
        write_document(thermap.content(call).decode() + "\n")
        return
    labels: set[str] = set()
    if mode.stores_map:
        labels = {m.label for m in thermap.error_maps(measured_file.machine)}
        before = thermap.send(_call(method, measured_file, calls.Storing(preview=True)))
        if before.preview is not None:
            show_preview(measured_file.file, before.preview)
    answer = thermap.send(call)
    if answer.preview is not None:
        show_preview(measured_file.file, answer.preview, alone=True)
    elif answer.stored:
        for label, number in _maps_of(measured_file, answer):
            report_stored_map(
                thermap,
                measured_file.file,
                measured_file.machine,
                label,
                number,
                answer,
                was_there=label in labels,
            )
    elif not mode.store or not mode.as_verification:
        echo(f"{measured_file.file}: {answer.method} evaluated, nothing stored")
    if isinstance(answer, ThermalDriftAnswer) and answer.verification is not None:
        echo(f"{measured_file.file}: {_kept_words(measured_file, answer.verification)}")
    console().print(measurement_view(answer))


def _kept_words(measured_file: MeasuredFile, stored: DriftVerificationAnswer) -> str:
    """Say under which number a test's course is a verification, and what of it is new."""
    how = "stored as" if stored.is_new else "was there already,"
    readings = counted(stored.stored_readings, "new reading")
    return (
        f"verification {str(measured_file.body['label']).strip()!r} {how} number {stored.id}: "
        f"{counted(stored.observations, 'observation')} of {list_names(stored.components)}, and "
        f"{readings} of the temperatures; `thermap analyse {measured_file.machine}` searches it"
    )
