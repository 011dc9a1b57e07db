"""Recorded temperatures from CSV: columns of times, of each sensor, and of the machine's state.

    time,x-middle,z-column_c,state spindle_rpm
    2026-03-01T06:00:00Z,20.1,20.3,2000

The time is ISO 8601 with its zone (`time`), or counts from the beginning of the
recording (`time_s`, `time_min`, `time_h`). An empty cell, or NaN, is a sensor that
gave no value, or a state that is not known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import tzinfo
from decimal import Decimal
from pathlib import Path
from typing import Final, NamedTuple

from app.decimal_text import read_number
from app.errors import list_names
from app.files.csv_columns import (
    Column,
    Columns,
    Named,
    Quantity,
    by_field,
    match_columns,
    name_after,
    named,
    names_after,
    normal_heading,
)
from app.files.csv_verification import STATE
from app.files.delimited_text import DelimitedText, Problems, Row, left_out, read_delimited
from app.units import SECONDS_PER_H, SECONDS_PER_MIN

_COUNT: Final = Quantity(
    "s", {"s": Decimal(1), "min": Decimal(SECONDS_PER_MIN), "h": Decimal(SECONDS_PER_H)}
)
_TIMES: Final = (Named("time", None), Named("time", _COUNT))
"""A moment, or a count from the beginning."""

TIME_COLUMNS: Final = ("time", *(f"time_{unit}" for unit in _COUNT.factors))

_CELSIUS: Final = Quantity("c", dict.fromkeys(("c", "degc", "deg_c"), Decimal(1)), assumed="c")
_NOT_CELSIUS: Final = frozenset({"k", "f", "degf", "kelvin", "fahrenheit"})
_NO_VALUE: Final = frozenset({"nan", "null", "none", "-"})


@dataclass(frozen=True, slots=True)
class Recording:
    """Temperatures and the machine's states in order of time.

    Parameters
    ----------
    times_s
        Seconds since 1970-01-01 UTC where `is_dated`, else since the recording's zero.
    temperatures_c
        At each time, sensor to temperature [°C].
    states
        At each time, name to number of what is known of the machine's state.
    unread
        Columns that are neither a time nor a sensor nor a state.
    """

    times_s: Sequence[float]
    temperatures_c: Sequence[Mapping[str, float]]
    states: Sequence[Mapping[str, float]]
    is_dated: bool
    unread: Sequence[str] = ()

    @property
    def duration_s(self) -> float:
        """From the first to the last reading [s]."""
        return self.times_s[-1] - self.times_s[0]

    @property
    def left_out(self) -> str:
        """Say which columns were not read; empty where all were."""
        return left_out(self.unread) if self.unread else ""


def is_state(meaning: str) -> bool:
    """Whether a column is said to be a state of the machine, such as `state spindle_rpm`."""
    return bool(name_after(STATE, meaning))


def read_recording(
    file: Path, sensors: Sequence[str], columns: Mapping[str, str], zone: tzinfo | None
) -> Recording:
    """Read a recording and check all of it.

    Parameters
    ----------
    columns
        Column of the file to sensor, to `state NAME`, or to `time`, `time_s`, `time_min`,
        `time_h`, where the file calls it otherwise.
    zone
        Of times that state none.

    Raises
    ------
    UnreadableFile
        With file, line and column of everything that is wrong.
    """
    problems = Problems(file)
    text = read_delimited(file, problems)
    matches = _match_columns(text, sensors, columns)
    states = _match_states(text, matches, columns)
    time = _time_column(text, [match for match in matches if match.thing in _TIMES])
    of_sensors = by_field(text, [match for match in matches if match.thing not in _TIMES])
    if not of_sensors:
        problems.add(
            f"expected columns named as the sensors {list_names(sensors)}, got "
            f"{list_names(text.headings)}; --column NAME=SENSOR says which is which",
            text.heading_line,
        )
    problems.raise_if_any()
    table = Columns(text, {**of_sensors, "time": time})
    names = {field: name for name in sensors if (field := normal_heading(name)) in of_sensors}
    lines: dict[float, _Line] = {}
    for row in text.rows:
        time_s = _read_time(table, row, zone)
        line = _Line(row, _read_values(table, row, names), _read_states(text, row, states))
        if time_s is None or not line.temperatures_c:
            continue
        earlier = lines.setdefault(time_s, line)
        if (earlier.temperatures_c, earlier.states) != (line.temperatures_c, line.states):
            table.complain(
                row, "time", f"expected each time once, got the time of line {earlier.row.line}"
            )
    if not lines:
        problems.add("expected lines with a time and temperatures, got none")
    problems.raise_if_any()
    times = sorted(lines)
    read = {*states, *(match.index for match in matches)}
    return Recording(
        times,
        [lines[time_s].temperatures_c for time_s in times],
        [lines[time_s].states for time_s in times],
        time.thing.quantity is None,
        [heading for i, heading in enumerate(text.headings) if heading and i not in read],
    )


class _Line(NamedTuple):
    """One line of the file, and what it says of sensors and states."""

    row: Row
    temperatures_c: dict[str, float]
    states: dict[str, float]


def _match_columns(
    text: DelimitedText, sensors: Sequence[str], columns: Mapping[str, str]
) -> list[Column]:
    """Find the columns of times and sensors, by their names or as the command line says."""
    meanings = {name.lower(): meaning for name, meaning in columns.items()}
    absent = meanings.keys() - {heading.lower() for heading in text.headings}
    if absent:
        text.problems.add(
            f"the file has no column {list_names(sorted(absent))}; "
            f"it has {list_names(text.headings)}"
        )
        text.problems.raise_if_any()
    fields = sorted(map(normal_heading, sensors), key=len, reverse=True)
    things = [*_TIMES, *(Named(field, _CELSIUS) for field in fields)]
    _expect_celsius(text, dict(zip(map(normal_heading, sensors), sensors, strict=True)), meanings)
    by_index = {one.index: one for one in match_columns(text, things)}
    for i, heading in enumerate(text.headings):
        match = named(things, meanings.get(heading.lower(), ""))
        if match:
            by_index[i] = Column(*match, i)
    return [by_index[i] for i in sorted(by_index)]


def _match_states(
    text: DelimitedText, matches: Sequence[Column], columns: Mapping[str, str]
) -> dict[int, str]:
    """Find the columns `state NAME`, by their headings or as the command line says."""
    meanings = {name.lower(): meaning for name, meaning in columns.items()}
    taken = {match.index for match in matches}
    headings = [
        "" if i in taken else meanings.get(heading.lower(), heading)
        for i, heading in enumerate(text.headings)
    ]
    return names_after(replace(text, headings=headings), STATE)


def _expect_celsius(
    text: DelimitedText, sensors: Mapping[str, str], meanings: Mapping[str, str]
) -> None:
    """Refuse a sensor's column in another unit, which would be left out otherwise."""
    for i, heading in enumerate(text.headings):
        for field, name in sensors.items():
            unit = Named(field, _CELSIUS).unit_in(heading)
            if unit in _NOT_CELSIUS and heading.lower() not in meanings:
                text.problems.add(
                    f"expected {name} in °C, got the unit {unit!r}",
                    text.heading_line,
                    text.place(i),
                )


def _time_column(text: DelimitedText, time_columns: Sequence[Column]) -> Column:
    """Check the column of times; a number in `time` is a count whose unit is missing."""
    if len(time_columns) != 1:
        text.problems.add(
            f"expected one column of times ({', '.join(TIME_COLUMNS)}), got "
            f"{list_names(text.headings[one.index] for one in time_columns)}; "
            "--column NAME=time_s names another",
            text.heading_line,
        )
        text.problems.raise_if_any()
    (column,) = time_columns
    first = text.rows[0].cells[column.index] if text.rows else ""
    if column.thing.quantity is None and read_number(first) is not None:
        heading = text.headings[column.index]
        text.complain(
            text.rows[0],
            column.index,
            f"expected a time such as 2026-03-01T06:00:00Z, got {first!r}; where it counts "
            f"seconds or minutes from the beginning, --column {heading}=time_s or "
            f"--column {heading}=time_min says so",
        )
        text.problems.raise_if_any()
    return column


def _read_time(columns: Columns, row: Row, zone: tzinfo | None) -> float | None:
    time = columns.by_field["time"]
    if time.thing.quantity is not None:
        if not columns.word(row, "time"):
            columns.complain(row, "time", f"expected a time in {time.unit}, got none")
        return columns.number(row, "time")
    moment = columns.moment(row, "time", zone, "; --utc-offset +01:00 says it for all lines")
    return None if moment is None else moment.timestamp()


def _read_values(columns: Columns, row: Row, names: Mapping[str, str]) -> dict[str, float]:
    values = {
        name: columns.number(row, field)
        for field, name in names.items()
        if columns.word(row, field).lower() not in _NO_VALUE
    }
    return {name: value for name, value in values.items() if value is not None}


def _read_states(text: DelimitedText, row: Row, states: Mapping[int, str]) -> dict[str, float]:
    values = {
        name: text.number(row, i)
        for i, name in states.items()
        if row.cells[i].lower() not in _NO_VALUE
    }
    return {name: value for name, value in values.items() if value is not None}
