"""thermap import --method: an instrument's readings from files, and what comes out of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import typer
from pydantic import ValidationError
from rich.console import Console

from app.api.field_errors import field_error
from app.api.schemas.measurements.axes import PositioningRequest, SixDofRequest
from app.api.schemas.measurements.base import MeasurementRequest
from app.api.schemas.measurements.diagonals import BodyDiagonalRequest, StepDiagonalRequest
from app.api.schemas.measurements.parts import (
    DrilledPlateRequest,
    MachinedPartRequest,
    RotaryAxisRequest,
)
from app.cli.contract_json import read_json
from app.cli.csv_comments import Stated
from app.cli.csv_measurements import CsvMeasurement, read_csv_measurement
from app.cli.delimited_text import Problems, UnreadableFile, read_text
from app.cli.import_checks import (
    Wish,
    choose_machine,
    expect_one_label,
    expect_sensors,
    naming,
    say_what_became,
    say_what_follows_no_sensor,
    settings_of_stored,
    show_preview,
)
from app.cli.measurement_view import measurement_view
from app.cli.options import connect
from app.errors import list_names
from thermap import ThermapClient, calls
from thermap.answers import MeasurementAnswer
from thermap.call import Call

_OPTION_OF: Final = {
    "label": "--label",
    "measured_at": "--measured-at",
    "temperatures_c": "--temperature",
}


@dataclass(frozen=True, slots=True)
class _Method:
    """The shape of a method's body, and the call that sends it."""

    request: type[MeasurementRequest]
    call: Callable[[str, Mapping[str, Any], calls.Storing], Call[Any]]


_METHODS: Final = {
    "step-diagonal": _Method(StepDiagonalRequest, calls.measure_step_diagonal),
    "body-diagonal": _Method(BodyDiagonalRequest, calls.measure_body_diagonal),
    "positioning": _Method(PositioningRequest, calls.measure_positioning),
    "six-dof": _Method(SixDofRequest, calls.measure_six_dof),
    "machined-part": _Method(MachinedPartRequest, calls.measure_machined_part),
    "rotary-axis": _Method(RotaryAxisRequest, calls.measure_rotary_axis),
    "drilled-plate": _Method(DrilledPlateRequest, calls.measure_drilled_plate),
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
    stated: Stated,
    wish: Wish,
    *,
    json: bool,
    url: str,
) -> None:
    """Evaluate measurements, store what comes out as error maps, and show it.

    All files are read and checked, and of several all are evaluated, before any is
    stored.

    Parameters
    ----------
    files
        CSV as docs/methods/files.md shows, or the request's body as JSON.
    method
        The method of all files.
    machine
        The machine that was measured, where the files do not name it.
    stated
        What goes before the files' own label, time and temperatures.
    wish
        Whether maps are made; if not, label, time and temperatures are not needed.
    json
        Write the service's JSON, a line for each file.
    url
        Where the service is.
    """
    if method not in _METHODS:
        raise typer.BadParameter(
            f"expected one of {list_names(_METHODS)}, came {method!r}", param_hint="--method"
        )
    expect_one_label(stated, files)
    measured = _read_all(files, method, machine, stated, wish.makes_map)
    with connect(url) as thermap:
        _check_with_service(thermap, method, measured, wish)
        for i, one in enumerate(measured):
            for remark in one.remarks:
                typer.echo(f"{one.file}: note: {remark}", err=True)
            with naming(one.file, [later.file for later in measured[i + 1 :]]):
                _send(thermap, method, one, wish, json)


def _read_all(
    files: Sequence[Path], method: str, machine: str | None, stated: Stated, store: bool
) -> list[MeasuredFile]:
    """Read every file, and complain of all that is wrong in any."""
    found: list[tuple[Path, CsvMeasurement]] = []
    complaints: list[str] = []
    for file in files:
        try:
            read = _read_json if file.suffix.lower() == ".json" else _read_csv
            measurement = read(file, method, stated, store)
            _check_body(file, method, measurement.body)
            found.append((file, measurement))
        except UnreadableFile as error:
            complaints.append(error.detail)
    if complaints:
        raise UnreadableFile("\n".join(["nothing was sent:", *complaints]))
    return [
        MeasuredFile(file, m.body, choose_machine(file, m.machine, machine), m.remarks)
        for file, m in found
    ]


def _read_csv(file: Path, method: str, stated: Stated, store: bool) -> CsvMeasurement:
    return read_csv_measurement(
        method, read_text(file), name=str(file), stated=stated, complete=store
    )


def _read_json(file: Path, method: str, stated: Stated, store: bool) -> CsvMeasurement:
    """Read a request's body; what the command line states goes before it."""
    problems = Problems(file)
    body = read_json(file, problems)
    if not isinstance(body, dict):
        problems.add(f"expected the fields of a {method} measurement, came {type(body).__name__}")
        problems.raise_if_any()
    overruled = {"label": stated.label, "measured_at": stated.measured_at}
    body |= {name: value for name, value in overruled.items() if value is not None}
    known = body.get("temperatures_c") or {}
    if stated.temperatures_c and isinstance(known, dict):
        body["temperatures_c"] = known | dict(stated.temperatures_c)
    for name, option in _OPTION_OF.items():
        if store and not body.get(name):
            problems.add(f"expected {name} of the map, came none: state it or give {option}")
    problems.raise_if_any()
    return CsvMeasurement(body, None, ())


def _check_body(file: Path, method: str, body: Mapping[str, Any]) -> None:
    """Make of a body what the service would, so that what it would refuse is known here."""
    problems = Problems(file)
    try:
        _METHODS[method].request.model_validate(body)
    except ValidationError as error:
        for found in map(field_error, error.errors()):
            problems.add(f"{found.field}: {found.message}")
    problems.raise_if_any()


def _check_with_service(
    thermap: ThermapClient, method: str, measured: Sequence[MeasuredFile], wish: Wish
) -> None:
    """Refuse what the machines cannot take and what the method refuses, before storing any."""
    machines = {id_: thermap.machine(id_) for id_ in sorted({one.machine for one in measured})}
    for one in measured if wish.makes_map else ():
        known = [sensor.name for sensor in machines[one.machine].sensors]
        expect_sensors(one.file, one.machine, known, one.body["temperatures_c"])
    if not wish.store:
        return
    components: dict[str, list[str]] = {id_: [] for id_ in machines}
    for one in measured:
        with naming(one.file, before="nothing was stored: " if len(measured) > 1 else ""):
            answer = thermap.send(_METHODS[method].call(one.machine, one.body, calls.Storing()))
        components[one.machine] += [found.component for found in answer.components]
    for id_, codes in components.items():
        say_what_follows_no_sensor(thermap, settings_of_stored(machines[id_]), codes)


def _send(thermap: ThermapClient, method: str, one: MeasuredFile, wish: Wish, json: bool) -> None:
    storing = calls.Storing(wish.store, wish.accept_losses, wish.preview)
    call = _METHODS[method].call(one.machine, one.body, storing)
    if json:
        typer.echo(thermap.content(call).decode())
        return
    known: set[str] = set()
    if wish.store:
        known = {m.label for m in thermap.error_maps(one.machine)}
        look = _METHODS[method].call(one.machine, one.body, calls.Storing(preview=True))
        before: MeasurementAnswer = thermap.send(look)
        if before.preview is not None:
            show_preview(one.file, before.preview)
    answer: MeasurementAnswer = thermap.send(call)
    if answer.preview is not None:
        show_preview(one.file, answer.preview, alone=True)
    elif answer.stored:
        label = str(one.body["label"]).strip()
        say_what_became(
            thermap, one.file, one.machine, label, answer.map_id, answer, was_there=label in known
        )
    else:
        typer.echo(f"{one.file}: {answer.method} evaluated, nothing stored")
    Console(highlight=False).print(measurement_view(answer))
