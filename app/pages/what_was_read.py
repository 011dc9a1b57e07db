"""What was read of a file, before it is stored: its facts, and each component with a small plot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from markupsafe import Markup

from app.effects.observations import POINT_CHANNELS, Observation, Verification
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component
from app.pages.dashboard.numbers import marked, temperature
from app.pages.dashboard.numbers import position as placed
from app.pages.reader import day_and_time, reader
from app.pages.report_parts.words import figure_text
from app.pages.wording import _, counted, listed, message
from app.search.rows import Datum
from app.thermal.error_map import ErrorMap
from app.units import Unit

NOT_STATED: Final = message("not stated")
DECIMALS: Final = 2

ZEROS: Final = {
    Datum.ABSOLUTE: message("absolute: the model's own"),
    Datum.FIRST: message("first: each component's first value"),
    Datum.FREE: message("free: unknown"),
}

SIZE: Final = 1000
FINENESS: Final = 10
"""Units of a plot, and those of its smallest step."""

_WAYS: Final = {1.0: "+", -1.0: "−", 0.0: message("direction not stated")}


@dataclass(frozen=True, slots=True)
class ReadComponent:
    """One component, or one direction of points.

    Parameters
    ----------
    lines
        Of each direction, 1, −1 or 0 where none is stated: positions [mm] and values [unit].
    """

    name: str
    unit: str
    lines: dict[float, list[tuple[float, float]]]

    @property
    def _points(self) -> list[tuple[float, float]]:
        return [point for line in self.lines.values() for point in line]

    @property
    def count(self) -> int:
        """How many values."""
        return len(self._points)

    @property
    def positions(self) -> str:
        """From where to where in the reader's unit; empty for one value without position."""
        if not self.has_positions:
            return ""
        at = [position for position, _ in self._points]
        return _("%(low)s to %(high)s", low=placed(min(at)), high=placed(max(at)))

    @property
    def has_positions(self) -> bool:
        """Whether its values have positions, over which they are drawn."""
        return self.name not in COMPONENTS or COMPONENTS[self.name].is_table

    @property
    def values(self) -> str:
        """The smallest and the largest, in the unit."""
        values = [value for _, value in self._points]
        ends = dict.fromkeys(figure_text(end, DECIMALS) for end in (min(values), max(values)))
        return f" {_('to')} ".join(ends)

    @property
    def directions(self) -> str:
        """From where it was approached."""
        return ", ".join(_(words) for way, words in _WAYS.items() if way in self.lines)

    @property
    def words(self) -> str:
        """All of it as a line of text."""
        over = f"{self.positions} {reader().length}"
        at = _(" over %(positions)s", positions=over) if self.positions else ""
        count = counted(self.count, "%(count)s value", "%(count)s values")
        ways = f", {self.directions}" if self.has_positions else ""
        return f"{self.name}: {self.values} {self.unit}{at}, {count}{ways}"

    @property
    def svg(self) -> Markup:
        """The values over the positions, zero as a line; what is thin is approached backward."""
        at = [position for position, _ in self._points]
        values = [0.0, *(value for _, value in self._points)]
        low, high = min(values), max(values)
        across, up = (max(at) - min(at)) or 1.0, (high - low) or 1.0

        def place(point: tuple[float, float]) -> str:
            x, y = (point[0] - min(at)) / across, (high - point[1]) / up
            return (
                f"{FINENESS * round(SIZE / FINENESS * x)},{FINENESS * round(SIZE / FINENESS * y)}"
            )

        zero = place((min(at), 0.0)).partition(",")[2]
        parts = [f'<line class="zero" x2="{SIZE}" y1="{zero}" y2="{zero}"/>']
        for way, line in self.lines.items():
            # What lies on one place of a drawing as small as this is one point of it.
            points = list(dict.fromkeys(map(place, sorted(line))))
            if len(points) == 1:
                points.append(f"{SIZE},{points[0].partition(',')[2]}")
            style = "now backward" if way < 0.0 else "now"
            parts.append(f'<polyline class="{style}" points="{" ".join(points)}"/>')
        return Markup(
            '<svg class="small" viewBox="0 0 1000 1000" preserveAspectRatio="none" '
            f'aria-hidden="true">{"".join(parts)}</svg>'
        )


@dataclass(frozen=True, slots=True)
class WhatWasRead:
    """The facts of a file, by name, and its components."""

    facts: Sequence[tuple[str, str]]
    components: Sequence[ReadComponent]

    def lines(self) -> Iterator[str]:
        """Write it as lines of text."""
        yield "; ".join(f"{name} {value}" for name, value in self.facts)
        for one in self.components:
            yield one.words


def read_of_map(error_map: ErrorMap) -> WhatWasRead:
    """Say what was read of an error map."""
    temperatures = (
        f"{name} {temperature(t, DECIMALS)} {reader().temperature}"
        for name, t in error_map.temperatures_c.items()
    )
    components = []
    for code, table in error_map.tables.items():
        at = table.positions_mm.tolist() or [0.0]
        lines = {1.0 if table.backward_errors is not None else 0.0: table.errors.tolist()}
        if table.backward_errors is not None:
            lines[-1.0] = table.backward_errors.tolist()
        components.append(
            ReadComponent(
                code,
                table.component.unit.symbol,
                {way: list(zip(at, values, strict=True)) for way, values in lines.items()},
            )
        )
    return WhatWasRead(
        [
            (_("map"), f"‘{error_map.label}’"),
            (_("measured"), day_and_time(error_map.measured_at)),
            (_("temperatures"), listed(list(temperatures))),
            (_("repeatability"), _repeatability(error_map.repeatability_um)),
            (_("instrument"), error_map.instrument or _(NOT_STATED)),
        ],
        components,
    )


def read_of_verification(found: Verification) -> WhatWasRead:
    """Say what was read of a verification."""
    times = [one.time_s for one in found.observations]
    ends = (datetime.fromtimestamp(t, UTC) for t in (min(times), max(times)))
    span = f" {_('to')} ".join(dict.fromkeys(map(day_and_time, ends)))
    setups = {one.setup for one in found.observations if one.setup is not None}
    lines: dict[str, dict[float, list[tuple[float, float]]]] = {}
    for one in found.observations:
        for name, position, value, way in _values_of(one):
            lines.setdefault(name, {}).setdefault(float(way), []).append((position, value))
    return WhatWasRead(
        [
            (_("check"), f"‘{found.label}’"),
            (_("zero"), _(ZEROS[found.datum])),
            (_("repeatability"), _repeatability(found.repeatability_um)),
            (_("measured"), span),
            (_("set-ups"), listed(sorted(setups)) if setups else _(NOT_STATED)),
            (_("instrument"), found.instrument or _(NOT_STATED)),
            (_("operator"), found.operator or _(NOT_STATED)),
        ],
        [ReadComponent(name, _unit(name), of_ways) for name, of_ways in sorted(lines.items())],
    )


def _values_of(one: Observation) -> Iterator[tuple[str, float, float, int]]:
    """Give channel, position [mm], value and direction of each value of an observation."""
    if one.point_mm is not None:
        yield from zip(POINT_CHANNELS, one.point_mm, one.measured, one.directions, strict=True)
        return
    name = str(one.component)
    axis = COMPONENTS[name].axis
    way = one.directions[LINEAR_LETTERS.index(axis)] if axis else 0
    yield name, one.position_mm or 0.0, one.measured[0], way


def _repeatability(stated_um: float | None) -> str:
    return _(NOT_STATED) if stated_um is None else marked(f"{stated_um:g} µm")


def _unit(name: str) -> str:
    component: Component | None = COMPONENTS.get(name)
    return (Unit.UM if component is None else component.unit).symbol
