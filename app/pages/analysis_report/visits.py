"""The visits that an analysis proposes, as a list to take to the machine and to write on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from app.identification.plan.visit import NextVisit, PlannedPlace
from app.pages.environment import render
from app.services.analyses import ReportHead

MOST_COLUMNS: Final = 12
"""Positions side by side on paper."""

MOST_LINES: Final = 8
"""Lines of blank fields for one visit: of more the file serves alone."""


def visits_page(head: ReportHead, visits: Sequence[NextVisit], *, back: str = "") -> str:
    """Write the page of the visits to make.

    Parameters
    ----------
    back
        Where it was opened; empty where that is nowhere.
    """
    return render(
        "visits.html",
        plotly_js="inline",
        head=head,
        visits=[(visit, list(blank_tables(visit))) for visit in visits],
        back=back,
        drawings=[],
    )


def blank_tables(visit: NextVisit) -> Iterator[tuple[str, Sequence[str], Sequence[str]]]:
    """Lay out what is written down: corner, headings and lines of each table.

    Temperatures first; then the readings, unless they would be too many, or are at points or in
    rounds, where the file serves.
    """
    state = visit.state
    sensors = [f"{sensor}, °C" for sensor in state.target_c]
    if state.rounds > 1:
        turns = [f"{turn * (state.every_min or 0.0):g}" for turn in range(state.rounds)]
        yield "min", turns, ["clock", *sensors]
        return
    yield "", ["clock", *sensors, "remarks"], ["begin", "end"]
    observations = visit.planned.observations
    if any(o.position_mm is None for o in observations):
        return
    lines = list(dict.fromkeys(map(_line, observations)))
    places = [f"{o.position_mm:g}" for o in observations if _line(o) == lines[0]]
    rows = [places[i : i + MOST_COLUMNS] for i in range(0, len(places), MOST_COLUMNS)]
    if len(rows) * len(lines) <= MOST_LINES:
        yield from (("mm", row, lines) for row in rows)


def _line(place: PlannedPlace) -> str:
    signs = "".join((place.direction or {}).values())[:1].replace("-", "−")
    return f"{place.component} {signs}".strip()
