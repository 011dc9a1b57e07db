"""Values that were left out because they are far from the others: which, and by how much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from app.answer import IN_ITS_UNIT, Answer, UnitSymbol
from app.effects.observations import POINT_CHANNELS
from app.effects.words import MOST_NAMED
from app.errors import counted, list_names
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.residuals.residuals import channel_unit

MOST_LISTED: Final = 200
"""So many are listed, the furthest first; all are counted."""


@dataclass(frozen=True, slots=True)
class FarValue(Answer, published_as="FarValueAnswer"):
    """A value, or a component's values of one visit, left out because far from the others."""

    component: Annotated[str, Field(examples=["EXX"])]
    """Component code, or direction at points"""

    label: str
    """Label of the verification"""

    time: datetime
    """When it was measured; of a visit, when that began, UTC"""

    position_mm: float | None
    """Position on its axis [mm]; null at points, of squareness and of a visit"""

    point_mm: tuple[float, float, float] | None
    """Nominal point x, y, z [mm]; null elsewhere"""

    count: int
    """How many values: 1, or all of the component in a visit that is far from all other visits"""

    off: Annotated[
        float, Field(alias="off_um", description=f"How far from what the others say {IN_ITS_UNIT}")
    ]

    unit: UnitSymbol
    """The unit of that number"""

    is_alike: bool = False
    """Whether others of the component are off by the same, in several visits, as slips hardly are:
    something comes and goes that nobody logs"""

    @property
    def place(self) -> str:
        """Where, in words; empty where no place is known."""
        if self.point_mm is not None:
            return f"{list_names(map('{:g}'.format, self.point_mm))} mm"
        return "" if self.position_mm is None else f"{self.position_mm:g} mm"


def far_values(finished: FinishedSearch) -> tuple[FarValue, ...]:
    """List what was left out because it is far, the furthest over its scatter first."""
    listed: list[tuple[float, FarValue]] = []
    for group in finished.findings.excluded:
        whole = group.visit is not None
        pairs = list(zip(group.rows, group.off, strict=True))
        for row, off in pairs[:1] if whole else pairs:
            count = len(pairs) if whole else 1
            value = _value(finished, row, off, count, is_alike=row in group.alike)
            noise = finished.findings.noise.get(group.channel)
            listed.append((abs(off) / (noise.fitted if noise else 1.0), value))
    return tuple(value for _, value in sorted(listed, key=lambda pair: -pair[0]))


def _value(
    finished: FinishedSearch, row: int, off: float, count: int, *, is_alike: bool
) -> FarValue:
    rows = finished.residuals.rows
    name = rows.channels[int(rows.channel[row])]
    point = rows.points_mm[row]
    is_point = name in POINT_CHANNELS
    coordinates = point[~np.isnan(point)]
    return FarValue(
        component=name,
        label=rows.verifications[int(rows.verification[row])].label,
        time=datetime.fromtimestamp(float(rows.times_s[row]), UTC),
        position_mm=float(coordinates[0])
        if not is_point and len(coordinates) == 1 and count == 1
        else None,
        point_mm=(float(point[0]), float(point[1]), float(point[2]))
        if is_point and count == 1
        else None,
        count=count,
        off=off,
        unit=channel_unit(name).symbol,
        is_alike=is_alike,
    )


def left_out_words(far: Sequence[FarValue]) -> str:
    """Say for the summary what the answer is not about; empty where it is about all.

    Parameters
    ----------
    far
        What was left out, the furthest first.
    """
    visits = [value for value in far if value.count > 1]
    single = [value for value in far if value.count == 1]
    words = ""
    if visits:
        named = list_names(
            [f"{visit.component} in {visit.label!r}" for visit in visits], MOST_NAMED
        )
        words += f" Left out because it lies far from all other visits: {named}."
    if single:
        named = list_names([_named(value) for value in single], MOST_NAMED)
        they = "they lie" if len(single) > 1 else "it lies"
        words += (
            f" {counted(len(single), 'value was', 'values were')} left out because {they} far from "
            f"what the others say: {named}."
        )
    return words


def _named(value: FarValue) -> str:
    at = f" at {value.place}" if value.place else ""
    return f"{value.component}{at} in {value.label!r} ({value.off:+.2g} {value.unit})"


def asked_again(far: Sequence[FarValue]) -> list[str]:
    """Say what to do about what was left out."""
    steps = [
        f"Find out what happened to {value.component} in {value.label!r}: it lies far from all "
        "other "
        "visits and was left out as a slip; measure it again."
        for value in far
        if value.count > 1
    ]
    for name in dict.fromkeys(value.component for value in far if value.is_alike):
        alike = [value for value in far if value.component == name and value.is_alike]
        sizes = sorted(value.off for value in alike)
        steps.append(
            f"Find out what was on when {name} was off by about {sizes[len(sizes) // 2]:+.2g} "
            f"{alike[0].unit} in {counted(len(alike), 'value')}: they are too much alike for "
            "slips. "
            "Log it as a state."
        )
    single = [value for value in far if value.count == 1 and not value.is_alike]
    if single:
        steps.append(
            f"Look at the {len(single)} values that were left out as slips, and measure there "
            f"again if they matter: the furthest is {_named(single[0])}."
            if len(single) > 1
            else "Look at the value that was left out as a slip, and measure there again if it "
            f"matters: {_named(single[0])}."
        )
    return steps
