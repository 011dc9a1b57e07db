"""The visit that would tell most next, as one that can be made: what to measure, and when.

The moment is one of the record: the machine was so once, so it can be so again. Where two
explanations differ by what drives them, it is the moment at which their drivers were furthest from
going together as they did in the visits; where they never came apart, that is said instead of
asking for it. Else it is the moment that is most unlike the visits that were made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from app.arrays import FloatArray
from app.effects.observations import Observation, Verification, observation_rows
from app.errors import capitalised, list_names
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.identification.analysis.advice import from_rival
from app.identification.analysis.analysis import (
    NextVisit,
    PlannedPlace,
    PlannedVisit,
    UnexplainedPart,
)
from app.identification.analysis.found_effect import FoundEffect
from app.identification.campaign import Campaign
from app.identification.plan.added_visits import MOST_MOMENTS, choose_added_visits, conditions_at
from app.search.scatter import FEWEST_BLOCKS
from app.units import SECONDS_PER_DAY, SECONDS_PER_H, date_text, iso_time, utc_time

MOST_PLACES: Final = 40
"""Observations of a proposed visit: of more every second, third … is taken."""

EVERY_S: Final = 20.0
"""So long an instrument takes from one place to the next [s]."""

OFF_COURSE: Final = 2.0
"""Drivers come apart where they leave their common course by so many times what they did in the
visits at most."""

IN_COMMON: Final = 0.3
"""Drivers had a common course in the visits where no more than so much of one's standard deviation
is left beside the other."""


@dataclass(frozen=True, slots=True)
class _Question:
    """What is not settled: of which components, and what would settle it.

    Parameters
    ----------
    drivers
        Two sensors or states by which two explanations differ; none where it is another thing.
    """

    components: tuple[str, ...]
    drivers: tuple[str, str] | None
    words: str


def propose_visit(
    campaign: Campaign, effects: Sequence[FoundEffect], unexplained: Sequence[UnexplainedPart]
) -> NextVisit | None:
    """Propose the visit that would settle what an analysis left open.

    Returns
    -------
    NextVisit or None
        None where nothing is open, or the record has no moment for another visit.
    """
    visits = len(np.unique(observation_rows(campaign.verifications).visit))
    question = _question(effects, unexplained, visits)
    if question is None:
        return None
    own = _restricted(campaign, question.components)
    again = _measured_again(own)
    if question.drivers is not None:
        return _apart(own, question, question.drivers, again)
    return _unlike(own, question, again)


def _question(
    effects: Sequence[FoundEffect], unexplained: Sequence[UnexplainedPart], visits: int
) -> _Question | None:
    """Take the first thing that is open: a tie, a name that is not sure, what is not explained."""
    for number, effect in enumerate(effects):
        for rival in effect.ties:
            mine, other = (
                tuple(dict.fromkeys((*one.sensors, *one.states))) for one in (effect, rival)
            )
            differing = [(a, b) for a in reversed(mine) for b in reversed(other) if a != b]
            if mine != other and differing:
                words = f"to tell {from_rival(effect, rival, number)}"
                return _Question(effect.components, differing[0], words)
    for number, effect in enumerate(effects):
        if effect.status != "confirmed":
            words = f"to confirm {effect.kind} (effect {number})"
            return _Question(effect.components, None, words)
    for part in unexplained:
        named = (part.component,) if part.component in COMPONENTS else ()
        return _Question(named, None, f"to explore what is unexplained in {part.component}")
    if visits < FEWEST_BLOCKS:
        return _Question((), None, "to see what changes from visit to visit")
    return None


def _restricted(campaign: Campaign, components: Sequence[str]) -> Campaign:
    """Keep the observations of some components; all where none of them was observed by itself."""
    kept = [
        replace(v, observations=[o for o in v.observations if o.component in components])
        for v in campaign.verifications
    ]
    kept = [v for v in kept if v.observations]
    return replace(campaign, verifications=kept) if kept else campaign


def _measured_again(campaign: Campaign) -> Verification:
    """Take the places of the largest visit in their order, some of very many, the first again.

    The first place once more at the end shows the repeatability and what moved meanwhile. What
    measured that visit measures the next one: its zero and its repeatability are the same.
    """
    rows = observation_rows(campaign.verifications)
    largest = rows.visit == int(np.argmax(np.bincount(rows.visit)))
    source = campaign.verifications[int(rows.verification[largest][0])]
    numbers = list(dict.fromkeys(rows.observation[largest].tolist()))
    numbers = numbers[:: -(-len(numbers) // MOST_PLACES)]
    places = [source.observations[i] for i in numbers]
    return replace(source, observations=[*places, places[0], places[0]])


def _apart(
    campaign: Campaign,
    question: _Question,
    drivers: tuple[str, str],
    again: Verification,
) -> NextVisit | None:
    """Look for the moment at which two drivers leave the course that they had in the visits."""
    begins_s, moments_s = _moments(campaign, len(again.observations))
    if not moments_s.size:
        return None
    there = conditions_at(campaign, np.concatenate([begins_s, moments_s]))
    everything = {**there.temperatures_c, **there.states}
    if any(name not in everything for name in drivers):
        return _unlike(campaign, question, again)
    one, other = (everything[name] for name in drivers)
    off, largest, is_together = _off_course(one, other, begins_s.size)
    first, second = drivers
    if not np.isfinite(off).any() or np.nanmax(np.abs(off)) <= OFF_COURSE * largest:
        if not is_together:
            # They were apart in the visits already: more of these tell, not another state.
            return _unlike(campaign, question, again)
        days = float(np.ptp(there.times_s)) / SECONDS_PER_DAY
        found = _unlike(campaign, question, again)
        if found is None:
            return None
        never = (
            f"in {days:.2g} days of readings {first} and {second} never departed from the "
            "relation that they had in the visits, so these explanations cannot be told apart "
            "while the machine is used as it is; until that changes, it does not matter which is "
            "adopted"
        )
        return replace(found, sentence=f"{capitalised(never)}. {found.sentence}")
    best = int(np.nanargmax(np.abs(off)))
    time_s = float(moments_s[best])
    side = "above" if off[best] > 0 else "below"
    # A state has its own unit, which nobody states.
    unit = " K" if first in there.temperatures_c else ""
    much, most = (f"{size:.2g}{unit}" for size in (abs(off[best]), largest))
    sentence = (
        f"Measure {_named(question, again)} {question.words}, when {first} is far {side} the "
        f"value that it had beside {second} in the visits, as on {date_text(time_s)}: by {much}, "
        f"where the visits reached {most}."
    )
    return _visit(campaign, time_s, sentence, again)


def _off_course(one: FloatArray, other: FloatArray, visits: int) -> tuple[FloatArray, float, bool]:
    """Take the line through the visits off.

    Returns
    -------
    off : ndarray
        What is left of moments.
    most : float
        The most that is left of a visit.
    is_together : bool
        Whether the visits lie close to the line.

    Examples
    --------
    >>> one, other = np.array([0.0, 1.0, 2.0, 5.0]), np.array([0.0, 1.0, 2.0, 1.0])
    >>> off, most, is_together = _off_course(one, other, 3)
    >>> off.round(9).tolist(), round(most, 9), is_together
    ([4.0], 0.0, True)
    >>> _off_course(np.array([0.0, 1.0, 2.0, 0.0]), np.array([1.0, 0.0, 1.0, 0.0]), 4)[2]
    False
    """
    known = np.isfinite(one[:visits]) & np.isfinite(other[:visits])
    if known.sum() < 2:
        return np.full(one.size - visits, np.nan), 0.0, True
    x, y = other[:visits][known], one[:visits][known]
    slope = float(np.cov(x, y)[0, 1] / np.var(x, ddof=1)) if np.ptp(x) > 0 else 0.0
    left = one - (y.mean() + slope * (other - x.mean()))
    there = left[:visits][known]
    is_together = bool(there.std() <= IN_COMMON * y.std())
    return left[visits:], float(np.abs(there).max()), is_together


def _moments(campaign: Campaign, places: int) -> tuple[FloatArray, FloatArray]:
    """Give the times at which visits began, and moments of the record at which one could [s]."""
    rows = observation_rows(campaign.verifications)
    begins_s = np.array([rows.times_s[rows.visit == v].min() for v in np.unique(rows.visit)])
    if campaign.readings.times_s.size < 2:
        return begins_s, np.empty(0)
    first_s, last_s = campaign.readings.times_s[[0, -1]]
    step_s = max(SECONDS_PER_H / 2.0, (last_s - first_s) / MOST_MOMENTS)
    return begins_s, np.arange(first_s, last_s - places * EVERY_S, step_s)


def _unlike(campaign: Campaign, question: _Question, again: Verification) -> NextVisit | None:
    """Take the moment that is most unlike the visits that were made."""
    if campaign.readings.times_s.size < 2:
        return None
    added = choose_added_visits(campaign)
    if not added:
        return None
    sentence = (
        f"Measure {_named(question, again)} {question.words}, with {added[0].words}, as on "
        f"{date_text(added[0].time_s)}."
    )
    return _visit(campaign, added[0].time_s, sentence, again)


def _named(question: _Question, again: Verification) -> str:
    names = dict.fromkeys(o.component or "points" for o in again.observations)
    own = [name for name in question.components if name in names]
    return list_names(own or names, 4)


def _visit(campaign: Campaign, time_s: float, sentence: str, again: Verification) -> NextVisit:
    there = conditions_at(campaign, np.array([time_s]))
    return NextVisit(
        sentence=sentence,
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
                _place(o, time_s + i * EVERY_S) for i, o in enumerate(again.observations)
            ),
        ),
    )


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
