"""Thermal drift read by a nest of displacement sensors (ISO 230-3), over hours."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Final

from pydantic import Field

from app.api.methods.method import Method
from app.decimal_text import read_number
from app.errors import InvalidContent
from app.files.csv_columns import (
    LENGTH,
    POSITION,
    Named,
    find_columns,
    names_after,
)
from app.files.csv_comments import Statement
from app.files.csv_measurements.formats import (
    REPEATABILITY,
    TOOL_OFFSET,
    Body,
    Format,
    word_among,
)
from app.files.delimited_text import DelimitedText
from app.geometry.components import LINEAR_LETTERS
from app.in_pieces import InPieces
from app.measurement.thermal_drift import ThermalDrift, evaluate_thermal_drift
from app.measurement.thermal_drift_readings import SENSORS, DriftTest
from app.services.context import Context
from app.services.measurements import Axis, MeasurementAnswer, MeasurementRequest, Storing
from app.services.thermal_drift import (
    DriftReading,
    KeptState,
    KeptVerification,
    Nest,
    keep_drift,
    running_of,
)
from app.stated import Millimetres, Number, Point, UtcTime
from app.thermal.machine import Machine
from app.units import SECONDS_PER_MIN, read_time

MOST_READINGS: Final = 10_000
"""A week of a reading a minute."""


class NestReading(DriftReading):
    """What the nest, the temperature sensors and the control said at one time."""

    position_mm: Millimetres | None = Field(
        None, description="Where the moving axis stood [mm]; of the test linear-axis alone"
    )
    x_um: Number | None = Field(
        None,
        description="Displacement of the tool against the workpiece along X, from any zero [µm]",
    )
    y_um: Number | None = Field(None, description="The same along Y [µm]")
    z_um: Number | None = Field(None, description="The same along Z [µm]")
    x2_um: Number | None = Field(
        None, description="Along X, read sensor_distance_mm further along Z than x_um [µm]"
    )
    y2_um: Number | None = Field(None, description="Along Y, as far from y_um [µm]")


class ThermalDriftRequest(
    MeasurementRequest,
    example={
        "test": "spindle",
        "point_mm": [250, 200, 200],
        "tool_offset_mm": [0, 0, 160],
        "readings": [
            {
                "time": "2026-03-01T06:00:00Z",
                "x_um": 0.2,
                "y_um": -0.1,
                "z_um": 0.0,
                "temperatures_c": {"x-middle": 20.1, "y-front": 20.0, "z-column": 20.3},
            },
            {
                "time": "2026-03-01T06:30:00Z",
                "x_um": 1.1,
                "y_um": 2.4,
                "z_um": 9.3,
                "temperatures_c": {"x-middle": 20.4, "y-front": 20.2, "z-column": 23.9},
            },
            {
                "time": "2026-03-01T07:00:00Z",
                "x_um": 1.6,
                "y_um": 3.9,
                "z_um": 14.2,
                "temperatures_c": {"x-middle": 20.9, "y-front": 20.5, "z-column": 26.1},
            },
        ],
    },
):
    """A nest of displacement sensors over hours, with the machine's temperatures.

    `measured_at` and `temperatures_c` of the whole are not used: each reading states its own.
    """

    test: DriftTest = Field(
        description="`environment` (nothing moves: ETVE), `spindle` (it turns), `linear-axis` "
        "(an axis runs between targets)"
    )
    readings: Annotated[list[NestReading], InPieces(MOST_READINGS)] = Field(
        description="Two or more, in order of time; all with the same displacements"
    )
    axis: Axis | None = Field(None, description="The moving axis, of the test linear-axis")
    sensor_distance_mm: Number | None = Field(
        None,
        description="How far along Z x2_um and y2_um are read from x_um and y_um, with its sign "
        "[mm]; with them come the tilts A and B",
        examples=[100.0],
    )
    running_from: UtcTime | None = Field(
        None,
        description="Since when the spindle turned or the axis moved; from the state spindle_rpm "
        "where left out, else from the first reading",
    )
    running_to: UtcTime | None = Field(None, description="Until when; as running_from")
    point_mm: Point | None = Field(
        None,
        description="Where the machine stood while the nest was read [mm]; tables and "
        "verifications of displacements need it",
    )
    tool_offset_mm: Point = Field(
        (0.0, 0.0, 0.0), description="Offset, as a tool, of the place that x, y and z read [mm]"
    )
    components: dict[str, str] = Field(
        default_factory=dict,
        description="Displacement (x, y, z) or tilt (a, b) to the component as which it counts in "
        "maps and in the verification; those of the moving axis, or of the axis that carries the "
        "spindle, where left out",
        examples=[{"x": "EXX", "z": "EZZ"}],
    )
    states_min: list[Number] | None = Field(
        None,
        min_length=1,
        max_length=100,
        description="Thermal states of which maps are made, after the first reading [min]; the "
        "first reading and the end of running where left out",
        examples=[[0, 60, 240]],
    )

    def displacements_um(self) -> dict[str, list[float]]:
        """Give each sensor's readings; InvalidContent where one of them lacks some."""
        by_sensor: dict[str, list[float]] = {}
        for sensor in SENSORS:
            values = [getattr(reading, f"{sensor}_um") for reading in self.readings]
            lacking = [i for i, value in enumerate(values) if value is None]
            if lacking and len(lacking) < len(values):
                raise InvalidContent.of_field(
                    f"readings.{lacking[0]}.{sensor}_um",
                    f"expected {sensor}_um in µm of every reading or of none, got none here",
                )
            if not lacking:
                by_sensor[sensor] = values
        return by_sensor

    def positions_mm(self) -> list[float] | None:
        """Give where the moving axis stood; None where no reading says it."""
        places = [r.position_mm for r in self.readings]
        lacking = [i for i, place in enumerate(places) if place is None]
        if len(lacking) == len(places):
            return None
        if lacking:
            raise InvalidContent.of_field(
                f"readings.{lacking[0]}.position_mm",
                "expected position_mm of every reading or of none, got none here",
            )
        return [place for place in places if place is not None]

    def states_s(self) -> list[float] | None:
        """Give the thermal states' times, in seconds since 1970-01-01 UTC."""
        first_s = self.readings[0].time.timestamp()
        if self.states_min is None:
            return None
        return [first_s + minutes * SECONDS_PER_MIN for minutes in self.states_min]


@dataclass(frozen=True, eq=False, kw_only=True)
class ThermalDriftAnswer(MeasurementAnswer):
    """The figures of ISO 230-3's tests in `figures`; `components` are those of the last state."""

    states: Sequence[KeptState]
    """Thermal states, in order of time"""
    verification: KeptVerification | None
    """The stored verification, where one was asked for"""


def _evaluate(_context: Context, machine: Machine, body: ThermalDriftRequest) -> ThermalDrift:
    running = None
    if body.test is not DriftTest.ENVIRONMENT or body.running_from or body.running_to:
        running = running_of(body.readings, body.running_from, body.running_to)
    return evaluate_thermal_drift(
        machine.chain,
        body.test,
        [reading.time.timestamp() for reading in body.readings],
        body.displacements_um(),
        axis=body.axis,
        positions_mm=body.positions_mm(),
        sensor_distance_mm=body.sensor_distance_mm,
        running_s=running,
        point_mm=body.point_mm,
        tool_offset_mm=body.tool_offset_mm,
        components=body.components,
        states_s=body.states_s(),
        repeatability_um=body.repeatability_um,
    )


def _store(
    _method: Method[Any, Any],
    context: Context,
    machine: Machine,
    body: ThermalDriftRequest,
    evaluated: ThermalDrift,
    storing: Storing,
) -> ThermalDriftAnswer:
    """Make a map of each state, all of them or none, and keep the course as a verification."""
    nest = Nest(body.point_mm, body.tool_offset_mm)
    fields = keep_drift(context, machine, body, evaluated, nest, body.readings, storing)
    if body.measured_at is not None or body.temperatures_c:
        fields["notes"].append(
            "measured_at and temperatures_c of the whole were not used: each reading has its own."
        )
    return ThermalDriftAnswer(**fields)


_TIME: Final = Named("time", None)


_POSITION: Final = Named("position", POSITION)


_DISPLACEMENTS: Final = tuple(
    Named(sensor, LENGTH, (f"displacement_{sensor}",)) for sensor in SENSORS
)


_UNIT: Final = re.compile(r"[\[(]([^\[\]()]*)[\])]?|(°\s?\w)|_c")
"""What follows a sensor's name of a unit."""


def _moment(text: str) -> str:
    try:
        read_time(text)
    except ValueError:
        raise InvalidContent(
            f"expected a time with its zone such as 2026-03-01T06:00:00Z, got {text!r}"
        ) from None
    return text


def _minutes(text: str) -> list[float]:
    numbers = [read_number(part) for part in re.split(r"\s*;\s*|,\s+|\s+|,", text)]
    finite = [number for number in numbers if number is not None]
    if not finite or len(finite) < len(numbers):
        raise InvalidContent(f"expected minutes such as 0, 60, 240, got {text!r}")
    return finite


def _components(text: str) -> dict[str, str]:
    parts = [part.partition("=") for part in re.split(r"[,;\s]+", text) if part]
    if not parts or any(not name or not code for name, _, code in parts):
        raise InvalidContent(f"expected components such as x=EXX, z=EZZ, got {text!r}")
    return {name.strip().lower(): code for name, _, code in parts}


def _read_thermal_drift(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    states = names_after(text, "state")
    sensors = _sensors(text)
    taken = {*states, *sensors}
    others = ["" if i in taken else heading for i, heading in enumerate(text.headings)]
    columns = find_columns(
        replace(text, headings=others), [_TIME], [_POSITION, *_DISPLACEMENTS], remarks
    )
    columns = replace(columns, text=text)
    readings = []
    for row in text.rows:
        columns.moment(row, "time")  # the service reads it itself; what is wrong is noted here
        reading: Body = {"time": columns.word(row, "time")}
        for thing in (_POSITION, *_DISPLACEMENTS):
            if thing.field in columns:
                reading[thing.full] = columns.needed(row, thing.field)
        for field, names, unit in (
            ("temperatures_c", sensors, "°C"),
            ("state", states, "counts"),
        ):
            values = {name: text.number(row, i, unit) for i, name in names.items()}
            present = {name: value for name, value in values.items() if value is not None}
            reading |= {field: present} if present else {}
        readings.append(reading)
    return {**statements, "readings": readings}


def _sensors(text: DelimitedText) -> dict[int, str]:
    """Find the columns `temperature SENSOR`, in °C whether they say so or not."""
    sensors = {}
    for i, heading in names_after(text, "temperature").items():
        name, unit = _name_and_unit(heading)
        if unit.strip("° ").upper() != "C":
            text.problems.add(
                f"expected temperatures in °C, got {text.headings[i]!r}",
                text.heading_line,
                text.place(i),
            )
        else:
            sensors[i] = name
    return sensors


def _name_and_unit(heading: str) -> tuple[str, str]:
    """Part a sensor's name from its unit, °C where it states none.

    >>> _name_and_unit("bed (left) [°C"), _name_and_unit("bed_c"), _name_and_unit("bed °F")
    (('bed (left)', '°C'), ('bed', 'C'), ('bed', '°F'))
    """
    for mark in "[(°_":
        begin = heading.rfind(mark)
        unit = _UNIT.fullmatch(heading, begin) if begin > 0 else None
        if unit:
            unit_text = unit[1] or unit[2] or "C"
            return heading[:begin].rstrip(), unit_text
    return heading, "C"


_FILE: Final = Format(
    (
        Statement(
            Named("test", None), 0, "test: spindle", True, word_among("test", *map(str, DriftTest))
        ),
        Statement(Named("axis", None), 0, "axis: x", False, word_among("axis", *LINEAR_LETTERS)),
        Statement(Named("point", POSITION), 3, "point_mm: 250, 200, 300"),
        TOOL_OFFSET,
        Statement(Named("sensor_distance", POSITION), 1, "sensor_distance_mm: 100"),
        Statement(
            Named("running_from", None), 0, "running_from: 2026-03-01T06:00:00Z", False, _moment
        ),
        Statement(Named("running_to", None), 0, "running_to: 2026-03-01T10:00:00Z", False, _moment),
        Statement(Named("states_min", None), 0, "states_min: 0, 60, 240", False, _minutes),
        Statement(Named("components", None), 0, "components: x=EXX, z=EZZ", False, _components),
        REPEATABILITY,
    ),
    _read_thermal_drift,
    is_dated=True,
)


THERMAL_DRIFT: Final = Method(
    name="thermal-drift",
    title="thermal drift (ISO 230-3)",
    summary="Thermal drift by a nest of displacement sensors (ISO 230-3)",
    about=(
        "Evaluate hours of displacements: figures, maps of thermal states, a verification.\n\n"
        "`store` makes a map of each state, all of them or none; `store_verification` the\n"
        "verification. Temperatures that are stored with it stay although its values are refused "
        "then\nfor an evidently wrong unit."
    ),
    request=ThermalDriftRequest,
    answer=ThermalDriftAnswer,
    evaluate=_evaluate,
    store=_store,
    has_course=True,
    file=_FILE,
)
