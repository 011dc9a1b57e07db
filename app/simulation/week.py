"""A week of a simulated machine, in which somebody can close the loop himself.

Its readings, one a minute, verifications of five working days, and one undeclared effect; then
the visits of the two days after, of which an analysis of the week knows nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from app.simulation.undeclared import Campaign, make_campaign

ID: Final = "mcfv5050-week"
NAME: Final = "Another machine, a week of readings (simulated)"

SEED: Final = 12
EFFECT: Final = "thermal-lag:component"
SIZE: Final = 4.0
"""Standard deviation of the effect over that of one observation."""

VISITS: Final = 28
OBSERVATIONS: Final = 24
DAYS: Final = 8
WEEK_MIN: Final = 7 * 1440
"""What is measured later is not the week's."""

Body = dict[str, Any]


@dataclass(frozen=True)
class Days:
    """What comes in on some days: readings, and verifications."""

    readings: Sequence[Body]
    verifications: Sequence[Body]


@dataclass(frozen=True)
class Week:
    """The machine, what the week brought, and what came after it.

    Parameters
    ----------
    machine, error_maps
        Bodies of requests.
    week, after
        Seven days, and the two days after them.
    """

    machine: Body
    error_maps: Sequence[Body]
    week: Days
    after: Days
    effects: Sequence[dict[str, object]]


def make_week() -> Week:
    """Simulate the week; always the same.

    Examples
    --------
    >>> week = make_week()
    >>> len(week.week.readings), len(week.week.verifications[0]["observations"])
    (10080, 480)
    """
    campaign = make_campaign(
        SEED, EFFECT, SIZE, visits=VISITS, days=DAYS, observations_per_visit=OBSERVATIONS
    )
    inside = _visits_of_week(campaign)
    return Week(
        campaign.machine | {"id": ID, "name": NAME},
        campaign.error_maps,
        Days(campaign.readings[:WEEK_MIN], [_together(campaign.verifications[:inside])]),
        Days(campaign.readings[WEEK_MIN:], campaign.verifications[inside:]),
        campaign.truth.effects,
    )


def _together(visits: Sequence[Body]) -> Body:
    """Make one verification of visits: nobody can analyse half a week while it is stored."""
    observations = [
        observed | {"setup": visit["label"]}
        for visit in visits
        for observed in visit["observations"]
    ]
    return {**visits[0], "label": "the week", "observations": observations}


def _visits_of_week(campaign: Campaign) -> int:
    observations = campaign.truth.observations
    return int(observations.visit[observations.time_min < WEEK_MIN].max()) + 1
