"""Measurements from CSV: the body of `POST …/measurements/{method}` for each method.

Comment lines state the thermal state and what belongs to the whole measurement; a
table holds the readings. Units stand in the names and bind: `linear_um` or
`linear [mm]`. docs/methods/files.md shows a file of each method.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from app.files.csv_comments import (
    Header,
    complain_of_missing,
    read_comments,
    with_stated,
)
from app.files.csv_measurements.formats import Format
from app.files.delimited_text import Problems, parse_delimited
from app.files.read_body import ReadBody


def read_csv_measurement(
    form: Format,
    text: str,
    *,
    name: str = "measurement.csv",
    header: Header | None = None,
    complete: bool = False,
) -> ReadBody:
    """Read a measurement, and say what of the file was not read.

    Parameters
    ----------
    header
        What takes precedence over the file's own comment lines.
    complete
        Whether label, time and temperatures are needed, as for storing a map.

    Raises
    ------
    UnreadableFile
        With line and column of everything that is wrong, what was expected and what
        came.
    """
    table = parse_delimited(text, Problems(Path(name)))
    remarks: list[str] = []
    comments = read_comments(
        table,
        header or Header(),
        remarks,
        form.statements,
        complete=complete,
        is_dated=form.is_dated,
    )
    if not table.rows:
        table.problems.add("expected lines of values, got none")
    body = form.read(table, comments.statements, remarks)
    table.problems.raise_if_any()
    return ReadBody({**comments.state, **body}, comments.machine, remarks)


def completed(
    found: ReadBody, form: Format, file: Path, stated: Header, *, complete: bool
) -> ReadBody:
    """Put what is stated into a measurement that no table of ours holds.

    Raises
    ------
    UnreadableFile
        With what a map still lacks, if it is to be `complete`.
    """
    problems = Problems(file)
    body = with_stated(found.body, stated)
    if complete:
        complain_of_missing(body, problems, is_dated=form.is_dated, has_comments=False)
    problems.raise_if_any()
    return replace(found, body=body)
