"""The visits that an analysis proposes, as a list to take to the machine and to write on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from app.identification.plan.visit import MachineState, NextVisit, PlannedPlace
from app.pages.environment import render
from app.services.report_head import ReportHead

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
        visits=[(visit, list(blank_fields(visit))) for visit in visits],
        back=back,
        rounds=_rounds,
        drawings=[],
    )


def _rounds(state: MachineState) -> list[str]:
    return [f"{turn * (state.every_min or 0.0):g} min" for turn in range(state.rounds)]


def blank_fields(
    visit: NextVisit,
) -> Iterator[tuple[Sequence[str], Sequence[str]]]:
    """Lay out fields for the readings: headings of positions, and names of the lines.

    None where there would be too many, where points are measured, or in rounds.
    """
    observations = visit.planned.observations
    if visit.state.rounds > 1 or any(o.position_mm is None for o in observations):
        return
    lines = list(dict.fromkeys(map(_line, observations)))
    places = [f"{o.position_mm:g}" for o in observations if _line(o) == lines[0]]
    columns = list(dict.fromkeys(places))
    columns += [f"{place} again" for place in _measured_again(places)]
    rows = [columns[i : i + MOST_COLUMNS] for i in range(0, len(columns), MOST_COLUMNS)]
    if len(rows) * len(lines) <= MOST_LINES:
        for row in rows:
            yield row, lines


def _measured_again(places: Sequence[str]) -> list[str]:
    """Name the places that come again, as often as they do."""
    return [place for i, place in enumerate(places) if place in places[:i]]


def _line(place: PlannedPlace) -> str:
    signs = "".join((place.direction or {}).values())[:1]
    return f"{place.component} {signs}".strip()
