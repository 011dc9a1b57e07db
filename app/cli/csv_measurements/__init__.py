"""Measurements from CSV: the body of `POST …/measurements/{method}` for each method.

Comment lines state the thermal state and what belongs to the whole measurement; a
table holds the readings. Units stand in the names and bind: `linear_um` or
`linear [mm]`. docs/methods/files.md shows a file of each method.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from app.cli.csv_comments import Stated
from app.cli.csv_measurements.comments import read_measurement_comments
from app.cli.csv_measurements.diagonals import BODY_DIAGONAL, STEP_DIAGONAL
from app.cli.csv_measurements.formats import Format
from app.cli.csv_measurements.linear_axes import MACHINED_PART, SIX_DOF
from app.cli.csv_measurements.points import DRILLED_PLATE, ROTARY_AXIS
from app.cli.csv_measurements.positioning import POSITIONING
from app.cli.delimited_text import Problems, parse_delimited
from app.errors import InvalidContent, list_names

FORMATS: Final[Mapping[str, Format]] = {
    "step-diagonal": STEP_DIAGONAL,
    "body-diagonal": BODY_DIAGONAL,
    "positioning": POSITIONING,
    "six-dof": SIX_DOF,
    "machined-part": MACHINED_PART,
    "rotary-axis": ROTARY_AXIS,
    "drilled-plate": DRILLED_PLATE,
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
    stated: Stated | None = None,
    complete: bool = False,
) -> CsvMeasurement:
    """Read a measurement, and say what of the file was not read.

    Parameters
    ----------
    method
        One of METHODS.
    text
        The whole file.
    name
        What to call it in messages.
    stated
        What goes before the file's own comment lines.
    complete
        Whether label, time and temperatures are needed, as for storing a map.

    Raises
    ------
    InvalidContent
        If there is no such method.
    UnreadableFile
        With line and column of everything that is wrong, what was expected and what
        came.
    """
    if method not in FORMATS:
        raise InvalidContent.of_field(
            "method", f"expected one of {list_names(METHODS)}, came {method!r}"
        )
    wanted = FORMATS[method]
    table = parse_delimited(text, Problems(Path(name)))
    remarks: list[str] = []
    comments = read_measurement_comments(
        table, wanted.statements, stated or Stated(), complete, remarks
    )
    if not table.rows:
        table.problems.add("expected lines of values, came none")
    body = wanted.read(table, comments.statements, remarks)
    table.problems.raise_if_any()
    return CsvMeasurement({**comments.state, **body}, comments.machine, remarks)


def read_measurement(
    method: str,
    text: str,
    *,
    name: str = "measurement.csv",
    stated: Stated | None = None,
    complete: bool = False,
) -> dict[str, Any]:
    r"""Read a measurement into the body of its request; see `read_csv_measurement`.

    >>> turn = "# axis: C\nangle_deg,x [mm],y [mm],z [m]\n0,101,2,0.05\n180,-99,2,0.05"
    >>> read_measurement("rotary-axis", turn)["points"][1]
    {'angle_deg': 180.0, 'position_mm': [-99.0, 2.0, 50.0]}
    """
    return read_csv_measurement(method, text, name=name, stated=stated, complete=complete).body
