"""A proposed visit as a file: a verification's CSV without values, for planning and measuring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from app.cli.options import write_file
from app.cli.terminal import echo
from app.csv_text import csv_line, no_formula
from app.errors import counted
from app.geometry.components import LINEAR_LETTERS
from app.identification.analysis.analysis import NextVisit, PlannedPlace

_COLUMNS: Final = (
    *("time", "component", "position_mm", "direction"),
    *(f"{stem}_{axis}_mm" for stem in ("point", "tool") for axis in LINEAR_LETTERS),
    *(f"direction_{axis}" for axis in LINEAR_LETTERS),
)


def write_next_visit(file: Path, machine: str, visit: NextVisit | None) -> None:
    """Write the visit that an analysis proposes, or say that it proposes none."""
    if visit is None:
        echo(f"{file}: not written: the analysis proposes no visit", err=True)
        return
    write_file(file, visit_csv(machine, visit))
    planned = counted(len(visit.planned.observations), "observation")
    echo(
        f"{file}: {planned} to make; `thermap analyse {machine} --plan --verification {file}` "
        "says what they would show",
        err=True,
    )


def visit_csv(machine: str, visit: NextVisit) -> str:
    """Write a proposed visit as `thermap analyse --plan --verification` reads it."""
    planned = visit.planned
    head = [f"label: {planned.label}", f"machine: {machine}", f"datum: {planned.datum}"]
    if planned.repeatability_um is not None:
        head.append(f"repeatability_um: {planned.repeatability_um!r}")
    # A sentence without a colon is read by people alone.
    head.append(visit.sentence.replace(":", ";"))
    rows = [_cells(o) for o in planned.observations]
    used = [c for c in _COLUMNS if any(c in row for row in rows)]
    lines = [f"# {no_formula(line)}\n" for line in head]
    lines.append(csv_line(used))
    lines += [csv_line(row.get(column, "") for column in used) for row in rows]
    return "".join(lines)


def _cells(place: PlannedPlace) -> Mapping[str, Any]:
    directions = place.direction or {}
    if place.component is not None or place.point_mm is None:
        cells: dict[str, Any] = {"time": place.time, "component": place.component}
        if place.position_mm is not None:
            cells["position_mm"] = place.position_mm
        for sign in directions.values():  # that of its own axis, or one of all
            cells["direction"] = sign
        return cells
    return {
        "time": place.time,
        **_of_axes("point_{}_mm", place.point_mm),
        **_of_axes("tool_{}_mm", place.tool_offset_mm),
        **{f"direction_{axis}": sign for axis, sign in directions.items()},
    }


def _of_axes(name: str, values: Sequence[float]) -> dict[str, float]:
    return {name.format(a): v for a, v in zip(LINEAR_LETTERS, values, strict=True)}
