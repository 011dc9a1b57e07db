"""A drift test's file: a line for each time, with displacements, temperatures and states."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from app.decimal_text import read_number
from app.errors import InvalidContent
from app.files.csv_columns import LENGTH, POSITION, Named, find_columns, names_after
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
from app.measurement.thermal_drift_readings import SENSORS, DriftTest
from app.units import read_time

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


THERMAL_DRIFT: Final = Format(
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
