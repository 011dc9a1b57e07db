"""thermap compensate: the table for stated temperatures, or at the latest reading.

A person reads it grouped by what the numbers rest on: components that follow one sensor lie
between the same maps with the same weight, so that this stands once above them. Of long
tables a few evenly chosen positions are shown, both ends among them; the unit and the sign
stand in every row.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
import typer
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from app.cli.asking import Shown, asks, calls
from app.cli.console import console
from app.cli.options import (
    MachineArgument,
    Named,
    TemperatureOption,
    named_option,
)
from app.geometry.components import COMPONENTS
from app.pages.report_parts.words import sentence
from thermap import TaggedTable
from thermap.answers import (
    CompensationAnswer,
    ComponentCompensationAnswer,
    CurrentCompensationAnswer,
    SurenessAnswer,
)

POSITIONS_SHOWN: Final = 5
SIGN: Final = "error: actual minus nominal; compensation: minus the error, added to the command"
_PLAIN: Final = frozenset({"interpolated", "at-map"})
_NAME, _CHAPTER, _WORD, _UNIT, _NUMBER = 7, 8, 12, 6, 7
"""Widths of the columns, the same in every group; numbers may need more."""

_NumberColumns: TypeAlias = Sequence[Mapping[str, Any]]
"""How rich is to make the columns of numbers."""


@asks
def compensate(
    machine: MachineArgument,
    temperature: TemperatureOption = None,
    state: Annotated[
        Named | None,
        named_option(
            "a number of the machine's state",
            "A number of the machine's state, such as spindle_rpm=8000.",
            metavar="NAME=NUMBER",
        ),
    ] = None,
) -> Shown:
    """Show the compensation table: for these temperatures, or at the latest reading.

    Errors and compensation are in µm, µrad or µm/m as each row says; positions in mm.
    The compensation is minus the error: what is to be added to the command.

    Example: `thermap compensate mcfv5050 -t x-middle=24.1 -t z-column=27.3`
    """
    if state and not temperature:
        raise typer.BadParameter(
            "goes with --temperature; the latest reading has its own state", param_hint="--state"
        )
    width = console().width
    if temperature:
        call = calls.compensation(machine, temperature, state)
        return Shown(call, lambda table: table_view(table, width))

    def view(tagged: TaggedTable | None) -> RenderableType:
        assert tagged is not None  # without an ETag there is always a table
        return table_view(tagged.table, width)

    return Shown(calls.current_table(machine), view)


@dataclass(frozen=True, slots=True)
class ComponentRow:
    """One component in one direction of approach: what a row of the view is made of."""

    code: str
    chapter: str
    unit: str
    errors: Sequence[float]
    compensation: Sequence[float]
    remark: str = ""


def evenly_chosen(count: int, rows: int) -> list[int]:
    """Choose indices evenly, both ends among them.

    >>> evenly_chosen(21, 5), evenly_chosen(3, 5), evenly_chosen(1, 5)
    ([0, 5, 10, 15, 20], [0, 1, 2], [0])
    """
    chosen = np.linspace(0, count - 1, min(count, rows)).round()
    return sorted({int(i) for i in chosen})


def signed(value: float) -> str:
    """Write a number with its sign and two decimals; nothing has no sign.

    >>> signed(1.5), signed(-0.001), signed(-12)
    ('+1.50', '0.00', '-12.00')
    """
    rounded = round(value, 2)
    return f"{rounded:+.2f}" if rounded else "0.00"


def table_view(
    answer: CompensationAnswer, width: int, *, hint: str = "--json has all"
) -> RenderableType:
    """Lay a table out for a terminal.

    Parameters
    ----------
    width
        Columns of the terminal; where they suffice, errors and compensation stand
        side by side, else one above the other.
    hint
        Where the positions are that are left out.
    """
    parts: list[RenderableType] = [_heading(answer)]
    if isinstance(answer, CurrentCompensationAnswer):
        parts.append(_sensors(answer))
    parts.extend(Text(f"! {warning}", style="yellow") for warning in answer.warnings)
    for effect in answer.effects:
        if effect.in_table:
            parts.append(Text(f"+ {effect.kind}: {sentence(effect.explanation)}", style="dim"))
            parts.extend(Text(f"  {_sure(sureness)}", style="dim") for sureness in effect.sureness)
    for entries in _by_origin(answer.components):
        parts.extend([Text(), _origin(entries[0])])
        for _, group in groupby(entries, key=lambda entry: (entry.axis, entry.positions_mm)):
            parts.append(_numbers(list(group), width))
    parts.append(Text("\n" + SIGN + _left_out(answer, _rows_in(width), hint), style="dim"))
    return Group(*parts)


def _sure(sureness: SurenessAnswer) -> str:
    """Say how sure a learnt effect is now, and how much of it is therefore in the table."""
    symbol = COMPONENTS[sureness.component].unit.symbol
    error = math.hypot(sureness.learnt_error, sureness.wander_error)
    expected = f"{sureness.expected:+.1f} ± {error:.1f} {symbol} expected now"
    words = (
        f"{sureness.component}: {expected}, {sureness.corrected:+.1f} {symbol} of it in the table"
    )
    return words.replace("-", "−")


def _by_origin(
    components: Iterable[ComponentCompensationAnswer],
) -> Iterable[list[ComponentCompensationAnswer]]:
    """Put together what rests on the same sensor, maps and weight."""
    groups: dict[tuple[object, ...], list[ComponentCompensationAnswer]] = {}
    for entry in components:
        maps = (entry.lower_map, entry.upper_map, entry.weight, entry.status)
        followed = tuple(f.sensor for f in entry.follows or ())
        groups.setdefault((entry.sensor, entry.stand_in_for, followed, *maps), []).append(entry)
    return groups.values()


def _heading(answer: CompensationAnswer) -> Text:
    text = Text.assemble(
        (answer.machine, "bold"),
        f"  model version {answer.model_version}  "
        f"computed {answer.computed_at:%Y-%m-%d %H:%M:%S} UTC  ",
    )
    text.append(*(("complete", "green") if answer.complete else ("not complete", "yellow")))
    return text


def _sensors(answer: CurrentCompensationAnswer) -> Text:
    text = Text()
    for sensor in answer.sensors:
        value = "" if sensor.temperature_c is None else f" {sensor.temperature_c:.2f} °C"
        state = "" if sensor.health == "ok" else f" ({sensor.health})"
        text.append(f"{sensor.sensor}{value}{state}   ", "yellow" if state else "")
    stale = ", stale" if answer.stale else ""
    text.append(
        f"reading {answer.reading_age_s:.1f} s old{stale}", "yellow" if answer.stale else "dim"
    )
    return text


def _origin(entry: ComponentCompensationAnswer) -> Text:
    if entry.sensor is None:
        text = Text.assemble(("adopted effects alone", "bold"), ", no two maps have it")
        return (
            text if entry.status == "effects-only" else text.append(f", {entry.status}", "yellow")
        )
    stands_in = f" for {entry.stand_in_for}" if entry.stand_in_for else ""
    text = Text.assemble(
        (f"{entry.sensor} {entry.temperature_c:.2f} °C{stands_in}", "bold"),
        _others_followed(entry),
        f", {entry.lower_map} to {entry.upper_map}, weight {entry.weight:.2f}, "
        if entry.weight is not None
        else ", between several maps, ",
    )
    text.append(entry.status, "green" if entry.status in _PLAIN else "yellow")
    return text


def _others_followed(entry: ComponentCompensationAnswer) -> str:
    """Name what else than its sensor a component follows, with the shares."""
    others = (entry.follows or ())[1:]
    shares = [f"{f.sensor} {f.temperature_c:.2f} °C by {f.share:.2f}" for f in others]
    return f" ({', '.join(shares)})" if shares else ""


def _numbers(entries: Sequence[ComponentCompensationAnswer], width: int) -> Table:
    """Lay a group's numbers out under their positions."""
    positions = entries[0].positions_mm or []
    chosen = evenly_chosen(len(positions), _rows_in(width)) if positions else [0]
    headings = [f"{positions[i]:g}" for i in chosen] if positions else [""]
    rows = [row for entry in entries for row in _component_rows(entry, chosen)]
    numbers = [signed(v) for row in rows for v in (*row.errors, *row.compensation)]
    number_width = max(_NUMBER, *map(len, numbers), *map(len, headings))
    is_wide = 38 + 2 * POSITIONS_SHOWN * (number_width + 1) <= width
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, header_style="dim")
    table.show_header = bool(positions)
    table.add_column(f"{entries[0].axis} in mm" if positions else "", width=_NAME)
    add = _add_wide if is_wide else _add_tall
    add(table, rows, [{"header": heading, "min_width": number_width} for heading in headings])
    return table


def _rows_in(width: int) -> int:
    """Say how many positions fit beside the words of a row."""
    beside = (width - (_CHAPTER + _WORD + _UNIT + 3)) // (_NUMBER + 1)
    return min(max(beside, 2), POSITIONS_SHOWN)


def _add_wide(table: Table, rows: Iterable[ComponentRow], numbers: _NumberColumns) -> None:
    """Errors to the left, compensation to the right."""
    table.add_column("", width=_CHAPTER)
    table.add_column("", width=_UNIT)
    for _ in ("error", "comp."):
        table.add_column("", width=5)
        _add_numbers(table, numbers)
    table.add_column("")
    for row in rows:
        errors, compensation = map(signed, row.errors), map(signed, row.compensation)
        table.add_row(
            row.code, row.chapter, row.unit, "error", *errors, "comp.", *compensation, row.remark
        )


def _add_tall(table: Table, rows: Iterable[ComponentRow], numbers: _NumberColumns) -> None:
    """Two rows a component."""
    table.columns[0].width = _CHAPTER
    table.add_column("", width=_WORD)
    table.add_column("", width=_UNIT)
    _add_numbers(table, numbers)
    table.add_column("")
    for row in rows:
        table.add_row(row.code, "error", row.unit, *map(signed, row.errors), row.remark)
        compensation = map(signed, row.compensation)
        table.add_row(row.chapter, "compensation", row.unit, *compensation, style="cyan")


def _add_numbers(table: Table, numbers: _NumberColumns) -> None:
    for column in numbers:
        table.add_column(justify="right", no_wrap=True, **column)


def _component_rows(
    entry: ComponentCompensationAnswer, chosen: Sequence[int]
) -> Iterator[ComponentRow]:
    for direction in entry.directions:
        arrays = entry.to_numpy(direction)
        code = entry.component if direction == "both" else f"{entry.component} {direction}"
        errors, compensation = (
            np.atleast_1d(v)[list(chosen)].tolist() for v in (arrays.error, arrays.compensation)
        )
        iso = f"ISO {entry.iso} {signed(entry.iso_error_urad or 0.0)} µrad" if entry.iso else ""
        yield ComponentRow(code, entry.chapter, arrays.unit, errors, compensation, iso)


def _left_out(answer: CompensationAnswer, rows: int, hint: str) -> str:
    most = max((len(entry.positions_mm or ()) for entry in answer.components), default=0)
    if most <= rows:
        return ""
    return f". {rows} of {most} positions; {hint}"
