"""Verifications from CSV: the body of `POST …/verifications`.

    # label: night shift
    # datum: first
    time,component,position_mm,direction,measured_um,state spindle_rpm
    2026-03-01T06:00:00Z,EXX,250,+,4.31,0

One line for each observation: of a component, or at a point (`point_x_mm` …, `tool_x_mm` …,
`measured_x_um` …). docs/closing-the-loop.md shows files of both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from app.effects.observations import MOST_OBSERVATIONS
from app.errors import list_names
from app.files.component_columns import ComponentValue
from app.files.component_sheets import ComponentSheets, read_component_sheets
from app.files.csv_columns import (
    LENGTH,
    POSITION,
    SMALL_ANGLE,
    Column,
    Columns,
    Named,
    find_columns,
    has_column,
    match_columns,
    names_after,
)
from app.files.csv_comments import Comments, Header, Statement, read_comments
from app.files.csv_measurements.formats import REPEATABILITY, choice_among
from app.files.delimited_text import (
    DelimitedText,
    Row,
    only_sheet,
    parse_delimited,
    read_sheets,
)
from app.files.delimited_text import Problems as FileProblems
from app.files.read_body import ReadBody
from app.geometry.components import (
    LINEAR_LETTERS,
    Component,
    find_component,
    parse_component,
    unknown_component,
)
from app.search.rows import Datum
from app.thermal.error_map import impossible_error
from app.units import Unit

Body = dict[str, Any]

STATE: Final = "state"
"""Columns that begin with this word hold the machine's state."""

DIRECTIONS: Final = ("+", "-")

_DATUM: Final = choice_among("datum", *(str(datum) for datum in Datum))
_OPERATOR: Final = Statement(Named("operator", None), 0, "operator: M. Weber")
_STATEMENTS: Final[tuple[Statement, ...]] = (_DATUM, REPEATABILITY, _OPERATOR)
_READ_OF_COMMENTS: Final = frozenset({"label", "instrument"})

_BESIDE: Final = ("time", "direction", "setup", STATE)
"""Columns that stand beside those of components."""

_ANGLES: Final = (Unit.URAD, Unit.UM_PER_M)
"""A µm/m is a µrad."""

_TIME: Final = Named("time", None)
_COMPONENT: Final = Named("component", None)
_POSITION: Final = Named("position", POSITION)
_DIRECTION: Final = Named("direction", None)
_SETUP: Final = Named("setup", None)
_MEASURED: Final = Named("measured", LENGTH)
_MEASURED_ANGLE: Final = Named("measured_angle", SMALL_ANGLE, ("measured",))
_MEASURED_SLOPE: Final = Named("measured_slope", SMALL_ANGLE)
"""A second column of angles in another unit: squareness in µm/m beside rotations in µrad."""
_VALUES: Final = (_MEASURED, _MEASURED_ANGLE)
_AT_POINTS: Final = tuple(
    tuple(Named(f"{stem}_{axis}", quantity) for axis in LINEAR_LETTERS)
    for stem, quantity in (
        ("point", POSITION),
        ("measured", LENGTH),
        ("tool", POSITION),
        ("direction", None),
    )
)
_POINT, _MEASURED_AT, _TOOL, _DIRECTIONS_AT = _AT_POINTS


def read_csv_verification(file: Path, *, is_planned: bool = False) -> ReadBody:
    """Read a verification, and say what of the file was not read.

    Parameters
    ----------
    file
        CSV, see above; without a label it is called as the file.
    is_planned
        Whether it is yet to be measured: it needs no values, and those it has are not read.

    Raises
    ------
    UnreadableFile
        With line and column of everything that is wrong, what was expected and what came.
    """
    return parse_csv_verification(read_sheets(file), file, is_planned=is_planned)


def parse_csv_verification(
    sheets: Mapping[str, str], file: Path, *, is_planned: bool = False
) -> ReadBody:
    """Read a verification from the sheets of a file, as `read_csv_verification` does."""
    remarks: list[str] = []
    problems = FileProblems(file)
    tables = read_component_sheets(sheets, problems, remarks, MOST_OBSERVATIONS, _BESIDE)
    if tables is not None:
        return _of_component_columns(tables, file, remarks, is_planned)
    text = parse_delimited(only_sheet(sheets, file), problems, MOST_OBSERVATIONS)
    comments = read_comments(text, Header(), remarks, _STATEMENTS, complete=False)
    unread = sorted(comments.state.keys() - _READ_OF_COMMENTS)
    if unread:
        remarks.append(f"comment lines that say nothing of a verification: {list_names(unread)}")
    columns, states = _find_columns(text, remarks, is_planned)
    if not text.rows:
        text.problems.add("expected lines of observations, got none")
    observations = [_observation(columns, states, row, is_planned) for row in text.rows]
    _check_sizes(text, observations)
    text.problems.raise_if_any()
    head = _head(comments, file.stem)
    return ReadBody(
        {**head, "observations": observations},
        comments.machine,
        remarks,
        [row.line for row in text.rows],
    )


def has_measured_columns(text: DelimitedText) -> bool:
    """Say whether a table's columns hold what was measured, of components or at points."""
    of_component = has_column(text, _COMPONENT) and any(has_column(text, v) for v in _VALUES)
    return of_component or all(has_column(text, column) for column in _MEASURED_AT)


def _of_component_columns(
    tables: ComponentSheets, file: Path, remarks: list[str], is_planned: bool
) -> ReadBody:
    """Read tables with a column for each component: each cell is an observation.

    Without a column of times all of them count as measured when the header says.
    """
    problems = tables.header.problems
    comments = read_comments(tables.header, Header(), remarks, _STATEMENTS, complete=False)
    whole = comments.state.get("measured_at")
    unread = sorted(comments.state.keys() - _READ_OF_COMMENTS - {"measured_at"})
    if unread:
        remarks.append(f"comment lines that say nothing of a verification: {list_names(unread)}")
    observations: list[Body] = []
    states: dict[int, Mapping[int, str]] = {}
    lines = []
    for value in tables.values:
        time = value.beside("time") or whole
        if time is None:
            problems.add_once(
                "expected a column time, or `# measured_at: 2026-03-01T06:00:00Z` for all values, "
                "got none",
                value.text.heading_line,
            )
            continue
        if value.column.is_standard_error:
            problems.add_once(
                f"expected no standard errors in a verification, got {value.column.name}: its "
                "repeatability is stated once, as `# repeatability_um: 0.5`",
                value.text.heading_line,
            )
            continue
        observation: Body = {"time": time, "component": value.column.name}
        if value.position_mm is not None:
            observation["position_mm"] = value.position_mm
        sign = _sign(value)
        observation |= {"direction": sign} if sign else {}
        observation |= {"setup": setup} if (setup := value.beside("setup")) else {}
        if (text := id(value.text)) not in states:
            states[text] = names_after(value.text, STATE)
        observation |= _state(value.text, states[text], value.row)
        if not is_planned:
            observation[f"measured_{value.column.component.unit}"] = value.value
        observations.append(observation)
        lines.append(value.row.line)
    problems.raise_if_any()
    return ReadBody(
        {**_head(comments, file.stem), "observations": observations},
        comments.machine,
        remarks,
        lines if tables.is_one_sheet else [],
    )


def _sign(value: ComponentValue) -> str | None:
    """Read the direction of approach: of the column, or of the line."""
    if value.column.is_backward:
        return "-"
    if value.column.is_forward:
        return "+"
    word = value.beside("direction").replace("\N{MINUS SIGN}", "-")
    if word and word not in DIRECTIONS:
        value.text.problems.add(f"expected + or - as direction, got {word!r}", value.row.line)
    return word or None


def _check_sizes(text: DelimitedText, observations: Sequence[Body]) -> None:
    """Refuse what can be no error of a machine tool."""
    for row, observation in zip(text.rows, observations, strict=True):
        for field, value in observation.items():
            if not field.startswith("measured_") or value is None:
                continue
            values = [v for v in (value if isinstance(value, list) else [value]) if v is not None]
            impossible = values and impossible_error(_component_of(observation), values)
            if impossible:
                text.problems.add(impossible, row.line)


def _component_of(observation: Body) -> Component | None:
    name = observation.get("component")
    return parse_component(name)[0] if name else None


def _head(comments: Comments, name: str) -> Body:
    """What the comment lines say of all observations, as far as stated."""
    statements = comments.statements
    head: Body = {"label": comments.state.get("label") or name}
    if "datum" in statements:
        head["datum"] = statements["datum"]
    if instrument := comments.state.get("instrument"):
        head["instrument"] = instrument
    if operator := statements.get("operator"):
        head["operator"] = operator
    if REPEATABILITY.thing.full in statements:
        head["repeatability_um"] = statements[REPEATABILITY.thing.full]
    return head


def _find_columns(
    text: DelimitedText, remarks: list[str], is_planned: bool
) -> tuple[Columns, Mapping[int, str]]:
    """Tell the columns of states from the others, and these apart."""
    states = names_after(text, STATE)
    others = ["" if i in states else heading for i, heading in enumerate(text.headings)]
    optional = [*(named for group in _AT_POINTS for named in group)]
    optional += [_COMPONENT, _POSITION, _DIRECTION, _MEASURED, _MEASURED_ANGLE, _SETUP]
    second = _second_of_angles(replace(text, headings=others))
    if second is not None:
        others[second.index] = ""
    columns = find_columns(replace(text, headings=others), [_TIME], optional, remarks)
    _expect_kind(text, columns, is_planned)
    also = {} if second is None else {_MEASURED_SLOPE.field: second}
    return Columns(text, {**columns.by_field, **also}), states


def _second_of_angles(text: DelimitedText) -> Column | None:
    """Find the second column of angles where it is in another unit than the first."""
    matches = match_columns(text, _VALUES)
    angles = [column for column in matches if column.thing is _MEASURED_ANGLE]
    if len(angles) != 2 or angles[0].unit == angles[1].unit:
        return None
    return replace(angles[1], thing=_MEASURED_SLOPE)


def _expect_kind(text: DelimitedText, columns: Columns, is_planned: bool) -> None:
    """Refuse a file whose columns hold neither components nor points."""
    has_value = is_planned or "measured" in columns or "measured_angle" in columns
    of_component = "component" in columns and has_value
    needed = _POINT if is_planned else (*_POINT, *_MEASURED_AT)
    at_points = all(column.field in columns for column in needed)
    if not of_component and not at_points:
        points = list_names(column.full for column in (*_POINT, *_MEASURED_AT))
        text.problems.add(
            "expected the columns component, position_mm and measured_um (or measured_urad), or "
            f"at points {points}, got {list_names(text.headings)}",
            text.heading_line,
        )
        text.problems.raise_if_any()


def _observation(columns: Columns, states: Mapping[int, str], row: Row, is_planned: bool) -> Body:
    """Read one line."""
    columns.moment(row, "time")  # the service reads it itself; what is wrong is noted here
    observation: Body = {"time": columns.word(row, "time"), **_what(columns, row, is_planned)}
    setup = columns.word(row, "setup")
    observation |= {"setup": setup} if setup else {}
    return observation | _state(columns.text, states, row)


def _state(text: DelimitedText, states: Mapping[int, str], row: Row) -> Body:
    """Read the columns of states of one line, as far as it has them."""
    values = {n: text.number(row, i) for i, n in states.items() if i < len(row.cells)}
    present = {name: value for name, value in values.items() if value is not None}
    return {"state": present} if present else {}


def _what(columns: Columns, row: Row, is_planned: bool) -> Body:
    """Read what was measured: a component where one is named, else a point."""
    if columns.word(row, "component"):
        _expect_none(columns, row, _POINT + _MEASURED_AT, "a component or a point, and not both")
        return _of_component(columns, row, is_planned)
    if "point_x" not in columns:
        columns.complain(row, "component", "expected a component such as EXX, got none")
        return {}
    body: Body = {"point_mm": [columns.needed(row, column.field) for column in _POINT]}
    if not is_planned:
        body["measured_um"] = [columns.needed(row, column.field) for column in _MEASURED_AT]
    tool = [columns.number(row, place.field) for place in _TOOL]
    if any(value is not None for value in tool):
        body["tool_offset_mm"] = [value or 0.0 for value in tool]
    signs = {
        axis: sign
        for axis, column in zip(LINEAR_LETTERS, _DIRECTIONS_AT, strict=True)
        if (sign := _direction(columns, row, column.field))
    }
    return body | ({"direction": signs} if signs else {})


def _of_component(columns: Columns, row: Row, is_planned: bool) -> Body:
    name = columns.word(row, "component")
    match = find_component(name)
    if match is None:
        columns.complain(row, "component", lambda: unknown_component(name))
        return {}
    component, _ = match
    body: Body = {"component": name}
    if not is_planned:
        body |= _measured(columns, row, component.unit)
    position = columns.number(row, "position")
    if position is None and component.is_table and not columns.word(row, "position"):
        columns.complain(row, "position", f"expected a position of {name} in mm, got none")
    if position is not None:
        body["position_mm"] = position
    direction = _direction(columns, row, "direction")
    return body | ({"direction": direction} if direction else {})


def _measured(columns: Columns, row: Row, unit: Unit) -> Body:
    """Read a component's value; a column in µm may hold it in the component's own unit."""
    of_angles = (_MEASURED_ANGLE, _MEASURED_SLOPE)
    fitting = {Unit.UM: (_MEASURED,), **dict.fromkeys(_ANGLES, of_angles)}.get(unit, ())
    own = next((one.field for one in fitting if columns.word(row, one.field)), None)
    value = None if own is None else columns.number(row, own)
    others = [one for one in (_MEASURED, *of_angles) if one.field != own]
    if value is not None:
        _expect_none(columns, row, others, f"one measured value, in {unit.symbol}")
        return {f"measured_{unit}": value}
    column = columns.by_field.get("measured")
    if unit is not Unit.UM and column is not None and column.unit == LENGTH.unit:
        own = own or (column.thing.field if columns.word(row, "measured") else None)
        value = columns.number(row, "measured")
    if own is None:
        filled = [one.field for one in others if columns.word(row, one.field)]
        got = f"one in {columns.by_field[filled[0]].symbol}" if filled else "none"
        field = "measured_angle" if unit in _ANGLES else "measured"
        columns.complain(row, field, f"expected a measured value in {unit.symbol}, got {got}")
    return {"measured_um": value}


def _expect_none(columns: Columns, row: Row, others: Sequence[Named], expected: str) -> None:
    """Refuse what would be left unread: nothing that was measured is dropped."""
    for column in others:
        if columns.word(row, column.field):
            columns.complain(row, column.field, f"expected {expected}, got both")
            return


def _direction(columns: Columns, row: Row, field: str) -> str | None:
    """Read the direction of approach; None where it is not stated."""
    word = columns.word(row, field).replace("\N{MINUS SIGN}", "-")
    if not word:
        return None
    if word not in DIRECTIONS:
        columns.complain(row, field, f"expected + or -, got {word!r}")
        return None
    return word
