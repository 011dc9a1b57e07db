"""Measurements from CSV: the body of `POST …/measurements/{method}` for each method.

Comment lines state the thermal state and what belongs to the whole measurement; a
table holds the readings. Units stand in the names and bind: `linear_um` or
`linear [mm]`. docs/methods/files.md shows a file of each method.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from app.errors import InvalidContent, list_names
from app.files.csv_comments import (
    Header,
    complain_of_missing,
    read_comments,
    with_stated,
)
from app.files.csv_measurements.formats import Format
from app.files.csv_measurements.methods import (
    BODY_DIAGONAL,
    DRILLED_PLATE,
    MACHINED_PART,
    POSITIONING,
    ROTARY_AXIS,
    SIX_DOF,
    STEP_DIAGONAL,
)
from app.files.csv_measurements.thermal_drift import THERMAL_DRIFT
from app.files.delimited_text import Problems, parse_delimited

FORMATS: Final[Mapping[str, Format]] = {
    "step-diagonal": STEP_DIAGONAL,
    "body-diagonal": BODY_DIAGONAL,
    "positioning": POSITIONING,
    "six-dof": SIX_DOF,
    "machined-part": MACHINED_PART,
    "rotary-axis": ROTARY_AXIS,
    "drilled-plate": DRILLED_PLATE,
    "thermal-drift": THERMAL_DRIFT,
}

METHODS: Final = tuple(FORMATS)
"""The methods whose files can be read."""


@dataclass(frozen=True, slots=True)
class CsvMeasurement:
    """A measurement as it is to be sent, the machine that the file names, what was noticed."""

    body: dict[str, Any]
    machine: str | None
    remarks: Sequence[str]


def read_csv_measurement(
    method: str,
    text: str,
    *,
    name: str = "measurement.csv",
    header: Header | None = None,
    complete: bool = False,
) -> CsvMeasurement:
    r"""Read a measurement, and say what of the file was not read.

    Parameters
    ----------
    header
        What takes precedence over the file's own comment lines.
    complete
        Whether label, time and temperatures are needed, as for storing a map.

    Raises
    ------
    InvalidContent
        If there is no such method.
    UnreadableFile
        With line and column of everything that is wrong, what was expected and what
        came.

    Examples
    --------
    >>> turn = "# axis: C\nangle_deg,x [mm],y [mm],z [m]\n0,101,2,0.05\n180,-99,2,0.05"
    >>> read_csv_measurement("rotary-axis", turn).body["points"][1]
    {'angle_deg': 180.0, 'position_mm': [-99.0, 2.0, 50.0]}
    """
    if method not in FORMATS:
        raise InvalidContent.of_field(
            "method", f"expected one of {list_names(METHODS)}, got {method!r}"
        )
    wanted = FORMATS[method]
    table = parse_delimited(text, Problems(Path(name)))
    remarks: list[str] = []
    comments = read_comments(
        table,
        header or Header(),
        remarks,
        wanted.statements,
        complete=complete,
        is_dated=wanted.is_dated,
    )
    if not table.rows:
        table.problems.add("expected lines of values, got none")
    body = wanted.read(table, comments.statements, remarks)
    table.problems.raise_if_any()
    return CsvMeasurement({**comments.state, **body}, comments.machine, remarks)


def completed(
    found: CsvMeasurement, method: str, file: Path, stated: Header, *, complete: bool
) -> CsvMeasurement:
    """Put what is stated into a measurement that no table of ours holds.

    Raises
    ------
    UnreadableFile
        With what a map still lacks, if it is to be `complete`.
    """
    problems = Problems(file)
    body = with_stated(found.body, stated)
    if complete:
        complain_of_missing(body, problems, is_dated=FORMATS[method].is_dated, has_comments=False)
    problems.raise_if_any()
    return replace(found, body=body)
