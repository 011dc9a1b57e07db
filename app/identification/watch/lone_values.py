"""Single values of a visit that are far from the others of it, as where one was mistyped.

The watch follows levels and slopes, and a lone value hides in the scatter that it makes itself.
Not named, it would stand behind a sentence that all agrees; not left out, it would hide changes in
all later visits.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray, robust_sd
from app.effects.observations import POINT_CHANNELS, ObservationRows
from app.identification.residuals.residuals import channel_unit

LONELY: Final = 12.0
"""A value so many times further off than others scatter is no scatter, even of heavy tails."""

FEWEST_IN_VISIT: Final = 8
"""Of fewer values nobody knows which is the lone one."""

MOST_LONE: Final = 0.1
"""More than this share of a visit is not lone."""


class LoneValue(NamedTuple):
    """A value: its row, how far off it is, and how far others scatter [the component's unit]."""

    row: int
    off: float
    scatter: float


def lone_values(
    rows: Iterable[int], residuals: FloatArray, repeatability: float | None
) -> list[LoneValue]:
    """Find the lone values of one channel in one visit.

    Parameters
    ----------
    rows
        Where its values stand in the campaign.
    residuals
        What level and slopes leave of them, shape (n,) [the component's unit].
    repeatability
        Standard deviation of one observation, where it is known: others do not scatter by less.
    """
    if len(residuals) < FEWEST_IN_VISIT:
        return []
    off = residuals - np.median(residuals)
    scatter = max(robust_sd(off), repeatability or 0.0)
    if scatter == 0.0:
        return []
    lone = [
        LoneValue(row, float(away), scatter)
        for row, away in zip(rows, off, strict=True)
        if abs(away) > LONELY * scatter
    ]
    return lone if len(lone) <= max(1, MOST_LONE * len(residuals)) else []


def lone_words(lone: list[LoneValue], rows: ObservationRows) -> str:
    """Name the furthest of them, as a sentence with a space before it; empty without any."""
    if not lone:
        return ""
    farthest = max(lone, key=lambda value: abs(value.off) / value.scatter)
    name = rows.channels[int(rows.channel[farthest.row])]
    unit = channel_unit(name).symbol
    point = rows.points_mm[farthest.row]
    coordinates = point[~np.isnan(point)]
    places = f" at {', '.join(f'{x:g}' for x in coordinates)} mm" if coordinates.size else ""
    if name not in POINT_CHANNELS and coordinates.size != 1:
        places = ""
    time = datetime.fromtimestamp(float(rows.times_s[farthest.row]), UTC)
    several = len(lone) > 1
    more = f", and {len(lone) - 1} more are as far" if several else ""
    end = (
        "They are left out of this judgement: were they misread or mistyped?"
        if several
        else "It is left out of this judgement: was it misread or mistyped?"
    )
    scatter = f"±{farthest.scatter:.2g} {unit}"
    return (
        f" But one value is {abs(farthest.off):.2g} {unit} from the others of its visit, "
        f"{name}{places} "
        f"of {time:%Y-%m-%d %H:%M:%S} UTC, where they scatter by {scatter}{more}. {end}"
    )
