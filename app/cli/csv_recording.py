"""Recorded temperatures from CSV: a column of times, and a column for each sensor.

    time,x-middle,z-column_c
    2026-03-01T06:00:00Z,20.1,20.3

The time is ISO 8601 with its zone (`time`), or counts from the beginning of the
recording (`time_s`, `time_min`, `time_h`). An empty cell, or NaN, is a sensor that
gave no value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, tzinfo
from pathlib import Path
from typing import Final

import typer

from app.cli.delimited_text import DelimitedText, Problems, Row, plain_heading, read_delimited
from app.cli.options import read_number
from app.errors import list_names
from app.units import SECONDS_PER_H, SECONDS_PER_MIN

SECONDS_IN: Final = {"time_s": 1.0, "time_min": SECONDS_PER_MIN, "time_h": SECONDS_PER_H}
TIME_COLUMNS: Final = ("time", *SECONDS_IN)
_NOT_CELSIUS: Final = ("k", "f", "degf", "kelvin", "fahrenheit")
_NO_VALUE: Final = frozenset({"nan", "null", "none", "-"})


@dataclass(frozen=True, slots=True)
class Recording:
    """Temperatures in order of time.

    Parameters
    ----------
    times_s
        Seconds since 1970-01-01 UTC where `is_dated`, else since the recording's zero.
    temperatures_c
        At each time, sensor to temperature [°C].
    unread
        Columns that are neither a time nor a sensor.
    """

    times_s: Sequence[float]
    temperatures_c: Sequence[Mapping[str, float]]
    is_dated: bool
    unread: Sequence[str] = ()

    @property
    def duration_s(self) -> float:
        """From the first to the last reading [s]."""
        return self.times_s[-1] - self.times_s[0]


def read_recording(
    file: Path, sensors: Sequence[str], columns: Mapping[str, str], zone: tzinfo | None
) -> Recording:
    """Read a recording and check all of it.

    Parameters
    ----------
    file
        CSV, see above.
    sensors
        Names of the machine's sensors.
    columns
        Column of the file to sensor, or to `time`, `time_s`, `time_min`, `time_h`,
        where the file calls it otherwise.
    zone
        Of times that state none.

    Raises
    ------
    UnreadableFile
        With file, line and column of everything that is wrong.
    """
    problems = Problems(file)
    text = read_delimited(file, problems)
    meaning = _meaning_of_columns(text, sensors, columns)
    time_column = _time_column(text, meaning)
    sensor_columns = {i: name for i, name in meaning.items() if name in sensors}
    if not sensor_columns:
        problems.add(
            f"expected columns named as the sensors {list_names(sensors)}, came "
            f"{list_names(text.headings)}; --column NAME=SENSOR says which is which",
            text.heading_line,
        )
    problems.raise_if_any()
    found: dict[float, tuple[Row, dict[str, float]]] = {}
    for row in text.rows:
        time_s = _read_time(text, row, time_column, meaning[time_column], zone)
        values = _read_values(text, row, sensor_columns)
        if time_s is None or not values:
            continue
        earlier, known = found.setdefault(time_s, (row, values))
        if known != values:
            text.complain(
                row, time_column, f"expected each time once, came the time of line {earlier.line}"
            )
    if not found:
        problems.add("expected lines with a time and temperatures, came none")
    problems.raise_if_any()
    times = sorted(found)
    return Recording(
        times,
        [found[time_s][1] for time_s in times],
        meaning[time_column] == "time",
        [heading for i, heading in enumerate(text.headings) if i not in meaning and heading],
    )


def _meaning_of_columns(
    text: DelimitedText, sensors: Sequence[str], columns: Mapping[str, str]
) -> dict[int, str]:
    """Say for each column that is read which sensor or time it holds."""
    stated = {name.lower(): meaning for name, meaning in columns.items()}
    absent = stated.keys() - {heading.lower() for heading in text.headings}
    if absent:
        raise typer.BadParameter(
            f"the file has no column {list_names(sorted(absent))}; "
            f"it has {list_names(text.headings)}",
            param_hint="--column",
        )
    usual = {plain: name for name in sensors for plain in _usual_headings(name)}
    usual |= {name: name for name in TIME_COLUMNS}
    _expect_celsius(text, sensors, stated)
    meaning = {
        i: stated.get(heading.lower()) or usual.get(plain_heading(heading), "")
        for i, heading in enumerate(text.headings)
    }
    return {i: name for i, name in meaning.items() if name}


def _expect_celsius(text: DelimitedText, sensors: Sequence[str], stated: Mapping[str, str]) -> None:
    """Refuse a sensor's column in another unit, which would be left out otherwise."""
    others = {plain_heading(f"{name}_{unit}"): name for name in sensors for unit in _NOT_CELSIUS}
    for i, heading in enumerate(text.headings):
        plain = plain_heading(heading)
        if plain in others and heading.lower() not in stated:
            unit = plain.rpartition("_")[2]
            text.problems.add(
                f"expected {others[plain]} in °C, came the unit {unit!r}",
                text.heading_line,
                text.place(i),
            )


def _usual_headings(sensor: str) -> tuple[str, str]:
    return plain_heading(sensor), plain_heading(f"{sensor}_c")


def _time_column(text: DelimitedText, meaning: Mapping[int, str]) -> int:
    """Find the column of times; a number in `time` is a count whose unit is missing."""
    found = [i for i, name in meaning.items() if name in TIME_COLUMNS]
    if len(found) != 1:
        text.problems.add(
            f"expected one column of times ({', '.join(TIME_COLUMNS)}), came "
            f"{list_names(text.headings[i] for i in found)}; --column NAME=time_s names another",
            text.heading_line,
        )
        text.problems.raise_if_any()
    column = found[0]
    first = text.rows[0].cells[column] if text.rows else ""
    if meaning[column] == "time" and read_number(first) is not None:
        heading = text.headings[column]
        text.complain(
            text.rows[0],
            column,
            f"expected a time such as 2026-03-01T06:00:00Z, came {first!r}; where it counts "
            f"seconds or minutes from the beginning, --column {heading}=time_s or "
            f"--column {heading}=time_min says so",
        )
        text.problems.raise_if_any()
    return column


def _read_time(
    text: DelimitedText, row: Row, column: int, meaning: str, zone: tzinfo | None
) -> float | None:
    if meaning in SECONDS_IN:
        unit = meaning.removeprefix("time_")
        count = text.number(row, column, unit)
        if count is None and not row.cells[column]:
            text.complain(row, column, f"expected a time in {unit}, came none")
        return None if count is None else count * SECONDS_IN[meaning]
    written = row.cells[column]
    try:
        moment = datetime.fromisoformat(written)
    except ValueError:
        text.complain(
            row, column, f"expected a time such as 2026-03-01T06:00:00Z, came {written!r}"
        )
        return None
    if moment.tzinfo is None:
        if zone is None:
            text.complain(
                row,
                column,
                f"expected a time with its zone, such as {written}Z or {written}+01:00, came none; "
                "--utc-offset +01:00 says it for all lines",
            )
            return None
        moment = moment.replace(tzinfo=zone)
    return moment.timestamp()


def _read_values(text: DelimitedText, row: Row, columns: Mapping[int, str]) -> dict[str, float]:
    values = {
        name: text.number(row, column, "°C")
        for column, name in columns.items()
        if row.cells[column].lower() not in _NO_VALUE
    }
    return {name: value for name, value in values.items() if value is not None}
