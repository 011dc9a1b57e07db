"""A visit in words: the state, how to reach it, how long to wait, which points, what it decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from app.effects.observations import Observation, Verification
from app.errors import capitalised, counted, list_names
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.identification.campaign import Campaign
from app.identification.plan.added_visits import conditions_at
from app.identification.plan.visit import MachineState, NextVisit, PlannedPlace, PlannedVisit
from app.units import SECONDS_PER_MIN, iso_time, utc_time

EVERY_S: Final = 20.0
"""So long an instrument takes from one place to the next [s]."""


MOST_PLACES: Final = 40
"""Observations of a proposed visit: of more every second, third … is taken."""

MOST_IN_ROUND: Final = 12
"""The same of each round of those that are measured again and again."""


def sentence_of(visit: NextVisit) -> str:
    """Write all of a visit in plain sentences."""
    state = visit.state
    again = (
        "" if state.every_min is None else f", every {state.every_min:g} min, {state.rounds} times"
    )
    name = state.name.replace("-", " ")
    return (
        f"{capitalised(name)}: {state.reached}, {state.conditions}; {state.wait}. Measure "
        f"{visit.points}{again}. It {visit.decides}."
    )


def visit_at(
    campaign: Campaign,
    like: Verification,
    time_s: float,
    state: MachineState,
    names: Sequence[str],
    decides: str,
) -> NextVisit:
    """Describe a visit in a state, with the places of another one.

    The first place once more at the end shows the repeatability and what moved meanwhile; rounds
    do by themselves.

    Parameters
    ----------
    like
        Whose places, zero and repeatability it has.
    time_s
        When the machine was recorded in that state [s since 1970-01-01 UTC].
    names
        Components that are named in the sentence.
    """
    places = _thinned(like.observations, MOST_PLACES if state.rounds == 1 else MOST_IN_ROUND)
    ends = [places[0], places[0]] if state.rounds == 1 else []
    again = replace(like, observations=[*places, *ends])
    there = conditions_at(campaign, np.array([time_s]))
    period_s = (state.every_min or 0.0) * SECONDS_PER_MIN
    visit = NextVisit(
        sentence="",
        state=state,
        points=_points(again, names),
        decides=decides,
        like_time=utc_time(time_s),
        temperatures_c={
            n: float(t[0]) for n, t in there.temperatures_c.items() if np.isfinite(t[0])
        },
        states={n: float(x[0]) for n, x in there.states.items() if np.isfinite(x[0])},
        planned=PlannedVisit(
            label="next visit",
            datum=str(again.datum),
            repeatability_um=again.repeatability_um,
            observations=tuple(
                _place(o, time_s + turn * period_s + i * EVERY_S)
                for turn in range(state.rounds)
                for i, o in enumerate(again.observations)
            ),
        ),
    )
    return replace(visit, sentence=sentence_of(visit))


def _thinned(observations: Sequence[Observation], most: int) -> list[Observation]:
    """Keep every second, third … place, with all that was observed there: both directions too."""
    there = list(dict.fromkeys(map(_where, observations)))
    kept = set(there[:: -(-len(observations) // most)])
    return [o for o in observations if _where(o) in kept]


def _where(o: Observation) -> tuple[object, ...]:
    axis = None if o.component is None else COMPONENTS[o.component].axis
    return axis, o.position_mm, o.point_mm


def _points(again: Verification, names: Sequence[str]) -> str:
    """Say which points: components, from where to where, from both sides or not."""
    own = again.observations
    count = len(set(map(_where, own)))
    at = [o.position_mm for o in own if o.position_mm is not None]
    span = f" from {min(at):g} to {max(at):g} mm" if at and min(at) < max(at) else ""
    ways = {sign for o in own for sign in o.directions if sign}
    both = ", from both sides" if len(ways) == 2 else ""
    is_again = len(own) > 2 and own[-1] is own[-2] is own[0]
    twice = ", the first place twice more at the end" if is_again else ""
    return f"{list_names(names, 4)} at {counted(count, 'place')}{span}{both}{twice}"


def _place(o: Observation, time_s: float) -> PlannedPlace:
    signs = zip(LINEAR_LETTERS, o.directions, strict=True)
    directions: dict[str, Literal["+", "-"]] = {
        axis: "+" if sign > 0 else "-" for axis, sign in signs if sign
    }
    of_all = len(directions) == len(LINEAR_LETTERS) and len(set(directions.values())) == 1
    if o.component is not None and not of_all:
        # Of a component planning takes its own axis' approach alone, or one of all.
        axis = COMPONENTS[o.component].axis
        directions = {a: sign for a, sign in directions.items() if a == axis}
    if o.component is not None and o.position_mm is None:
        directions = {}
    return PlannedPlace(
        time=iso_time(time_s),
        component=o.component,
        position_mm=o.position_mm,
        point_mm=o.point_mm,
        tool_offset_mm=o.tool_offset_mm,
        direction=directions or None,
    )
