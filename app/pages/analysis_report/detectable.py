"""The smallest effects that would have been seen: what `nothing found` is worth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from app.errors import counted
from app.identification.analysis import Analysis, SmallestSeen
from app.pages.analysis_report.names import kind_name
from app.pages.report_parts.tables import NUMBER, Column, body, row, table
from app.pages.report_parts.words import decimals_for, escaped, figure_text
from app.units import Unit


class Seen(Protocol):
    """How small an effect may be and is still seen."""

    @property
    def unit(self) -> str:
        """Symbol of its unit."""

    @property
    def smallest_rms(self) -> float:
        """In that unit."""


def detectable_section(result: Analysis) -> str:
    """Write how small an effect of each kind could be and still be seen.

    Parameters
    ----------
    result
        The analysis' answer.

    Returns
    -------
    str
        HTML, empty where nothing was tested.
    """
    seen = result.detectable
    if not seen:
        return ""
    units = units_of(seen)
    kinds = dict.fromkeys(one.kind for one in seen)
    decimals = decimals_for(result.noise_um)
    columns = [Column("effect"), *(Column(f"[{escaped(u)}]", NUMBER) for u in units)]
    rows = body(row(columns, _cells(kind, seen, units, decimals)) for kind in kinds)
    return f"""<section><h2>The smallest effects that would have been seen</h2>
<p class="quiet">RMS, over the rows where it acts, of an effect that is found nine times in ten: on
the component where it is easiest to see, to the one where it is hardest. What is smaller may be
there.</p>
<div class="narrow">{table(columns, rows)}</div>
{_by_component(seen, decimals)}</section>"""


def units_of(seen: Sequence[Seen]) -> list[str]:
    """List the units of some effects, lengths first.

    Parameters
    ----------
    seen
        Effects.

    Returns
    -------
    list of str
        Symbols.
    """
    found = {one.unit for one in seen}
    return [unit.symbol for unit in Unit if unit.symbol in found]


def size_range(seen: Sequence[Seen], unit: str, decimals: int) -> str:
    """Say from where to where the smallest sizes of one unit go.

    Parameters
    ----------
    seen
        Effects.
    unit
        Symbol of the unit; effects in others are passed over.
    decimals
        How many.

    Returns
    -------
    str

    Examples
    --------
    >>> seen = [SmallestSeen("step", "EXX", "µm", rms) for rms in (0.31, 0.5)]
    >>> size_range(seen, "µm", 2), size_range(seen, "µrad", 2)
    ('0.31 to 0.50', '–')
    """
    sizes = [one.smallest_rms for one in seen if one.unit == unit]
    if not sizes:
        return "–"
    ends = (figure_text(size, decimals) for size in (min(sizes), max(sizes)))
    return " to ".join(dict.fromkeys(ends))


def _cells(
    kind: str, seen: Sequence[SmallestSeen], units: Sequence[str], decimals: int
) -> list[str]:
    own = [one for one in seen if one.kind == kind]
    return [escaped(kind_name(kind)), *(size_range(own, unit, decimals) for unit in units)]


def _by_component(seen: Sequence[SmallestSeen], decimals: int) -> str:
    """The whole list, folded away."""
    columns = (Column("effect"), Column("on"), Column("seen from", NUMBER), Column("unit"))
    rows = body(
        row(
            columns,
            [
                escaped(kind_name(one.kind)),
                escaped(one.component),
                figure_text(one.smallest_rms, decimals),
                escaped(one.unit),
            ],
        )
        for one in seen
    )
    return (
        f"<details><summary>By component ({counted(len(seen), 'row')})</summary>"
        f'<div class="narrow">{table(columns, rows)}</div></details>'
    )
