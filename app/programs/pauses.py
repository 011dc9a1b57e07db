"""The times between readings of a warm-up, and how they stand in the readings' file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from app.errors import InvalidContent
from app.units import SECONDS_PER_MIN, iso_time

MOST_RETURNS: Final = 2000
LONGEST_MIN: Final = 7 * 24 * 60.0

TIME_COLUMNS: Final = "time,after_min"
"""The planned time, and the minutes after the start for who writes the clock's."""


def expect_few_returns(minutes: Sequence[float], every_min: float) -> None:
    """Refuse steps that would be read too often, or a pause that is not positive or too long.

    Parameters
    ----------
    minutes
        How long each step is [min].
    every_min
        Pause between readings [min].

    Raises
    ------
    InvalidContent
        Which says how often they would be read.
    """
    if not 0.0 < every_min <= LONGEST_MIN:
        raise InvalidContent.of_field(
            "every",
            f"expected a pause above 0 and at most {LONGEST_MIN:g} min, got {every_min:g} min",
        )
    returns = sum(duration / every_min + 1 for duration in minutes)
    if returns > MOST_RETURNS:
        raise InvalidContent.of_field(
            "every", f"expected at most {MOST_RETURNS} returns, got {returns:.0f}: read less often"
        )


def pauses_s(minutes: float, every_min: float) -> Iterator[float]:
    """Part a step into pauses [s]; the last one may be shorter."""
    remaining = minutes
    while remaining > 1e-9:
        part = min(every_min, remaining)
        yield part * SECONDS_PER_MIN
        remaining -= part


def time_cells(seconds: float, start_s: float | None) -> str:
    """Write the cells of `TIME_COLUMNS`.

    Parameters
    ----------
    seconds
        After the start [s].
    start_s
        Seconds since 1970-01-01 UTC; None leaves the time to be filled in.

    Examples
    --------
    >>> time_cells(90.0, 0.0), time_cells(90.0, None)
    ('1970-01-01T00:01:30Z,1.50', ',1.50')
    """
    return f"{planned_time(seconds, start_s)},{seconds / SECONDS_PER_MIN:.2f}"


def planned_time(seconds: float, start_s: float | None) -> str:
    """Write a time after the start [s]; nothing where the start is not known."""
    return "" if start_s is None else iso_time(start_s + seconds)
