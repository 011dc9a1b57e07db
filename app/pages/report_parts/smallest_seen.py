"""The smallest effects that would have been seen: what `nothing found` is worth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from app.pages.report_parts.words import figure_text
from app.units import Unit


class Seen(Protocol):
    """How small an effect may be and is still seen."""

    @property
    def unit(self) -> str:
        """Symbol of its unit."""

    @property
    def smallest_rms(self) -> float:
        """In that unit."""


def units_of(seen: Sequence[Seen]) -> list[str]:
    """List the units of some effects, lengths first."""
    found = {one.unit for one in seen}
    return [unit.symbol for unit in Unit if unit.symbol in found]


def size_range(seen: Sequence[Seen], unit: str, decimals: int) -> str:
    """Say from where to where the smallest sizes of one unit go.

    Parameters
    ----------
    unit
        Symbol of the unit; effects in others are passed over.

    Examples
    --------
    >>> from app.identification.analysis.analysis import SmallestSeen
    >>> seen = [SmallestSeen("step", "EXX", "µm", rms) for rms in (0.31, 0.5)]
    >>> size_range(seen, "µm", 2), size_range(seen, "µrad", 2)
    ('0.31 to 0.50', '–')
    """
    sizes = [one.smallest_rms for one in seen if one.unit == unit]
    if not sizes:
        return "–"
    ends = (figure_text(size, decimals) for size in (min(sizes), max(sizes)))
    return " to ".join(dict.fromkeys(ends))
