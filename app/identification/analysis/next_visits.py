"""The visits that would settle what an analysis left open, as a list to take to the machine.

Each moment is one of the record: the machine was so once, so it can be so again. Where two
explanations differ by what drives them, it is the moment at which their drivers were furthest from
going together as they did in the visits; where no visit can bring them apart, that is said instead
of asking for it. What comes late is measured while its driver changes fastest. Else it is the
moment that is most unlike the visits that were made.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.effects.claim import Named
from app.effects.observations import observation_rows
from app.effects.registry import do_the_same
from app.geometry.components import COMPONENTS
from app.identification.analysis.advice import from_rival, separating_step
from app.identification.analysis.analysis import UnexplainedPart
from app.identification.analysis.found_effect import Alternative, FoundEffect
from app.identification.campaign import Campaign
from app.identification.plan.added_visits import (
    choose_added_visits,
    conditions_at,
    largest_visit,
    moments,
)
from app.identification.plan.described_visit import EVERY_S, MOST_PLACES, sentence_of, visit_at
from app.identification.plan.machine_state import (
    COLD,
    SensorRange,
    sensor_ranges,
    smallest_set_k,
    state_at,
)
from app.identification.plan.visit import MachineState, NextVisit
from app.search.scatter import FEWEST_BLOCKS
from app.units import SECONDS_PER_DAY, SECONDS_PER_H

MOST_VISITS: Final = 4
"""So many visits are on a list: no more are made in a day."""

OFF_COURSE: Final = 2.0
"""Drivers come apart where they leave their common course by so many times what they did in the
visits at most."""

IN_COMMON: Final = 0.3
"""Drivers had a common course in the visits where no more than so much of one's standard deviation
is left beside the other."""

STEP_S: Final = SECONDS_PER_H / 2.0
LASTS_S: Final = MOST_PLACES * EVERY_S
"""Moments of the record that are looked at, and how long a visit lasts [s]."""

_ORDER: Final = ("cold", "while-warming", "part-warm", "warm", "while-cooling")
"""Of a working day."""

_LATE: Final = ("thermal-lag", "late-sensor")


@dataclass(frozen=True, slots=True)
class _Question:
    """What is not settled: of which components, and what would settle it.

    Parameters
    ----------
    drivers
        Two sensors or states by which two explanations differ; none where it is another thing.
    decides
        What a visit says then: `tells drift from backlash`.
    follows
        What the explanations follow.
    time_constants_min
        Of what comes late, where they are known [min].
    is_late
        Whether it is in question that something comes late.
    tie
        The two explanations; None where it is another thing.
    """

    components: tuple[str, ...]
    drivers: tuple[str, str] | None
    decides: str
    follows: tuple[str, ...] = ()
    time_constants_min: tuple[float, ...] = ()
    is_late: bool = False
    tie: tuple[FoundEffect, Alternative] | None = None


class Proposed(NamedTuple):
    """Visits to make; which ties none of them can tell, a sentence each; what these replace."""

    visits: tuple[NextVisit, ...]
    untellable: tuple[str, ...]
    replaced: frozenset[str]


def propose_visits(
    campaign: Campaign, effects: Sequence[FoundEffect], unexplained: Sequence[UnexplainedPart]
) -> Proposed:
    """Propose the visits that would settle what an analysis left open.

    None of them where nothing is open, or the record has no moment for another visit.
    """
    count = len(np.unique(observation_rows(campaign.verifications).visit))
    questions = list(_questions(effects, unexplained, count))
    if not questions or campaign.readings.times_s.size < 2:
        return Proposed((), (), frozenset())
    ranges = sensor_ranges(campaign)
    visits: list[NextVisit] = []
    untellable: dict[str, str] = {}
    for question in questions:
        own = _restricted(campaign, question.components)
        made = _visit_for(own, question, ranges)
        if isinstance(made, str):
            assert question.tie is not None
            untellable[made] = separating_step(*question.tie)
        elif made is not None:
            _add(visits, made)
        if len(visits) == MOST_VISITS:
            break
    ordered = sorted(visits, key=lambda one: _ORDER.index(one.state.name))
    numbered = tuple(_numbered(one, i) for i, one in enumerate(ordered, start=1))
    return Proposed(numbered, tuple(untellable), frozenset(untellable.values()))


def _add(visits: list[NextVisit], made: NextVisit) -> None:
    """Add a visit, or to the one that is made anyway what else it decides."""
    for i, one in enumerate(visits):
        if (one.state, one.points) == (made.state, made.points):
            if made.decides not in one.decides:
                visits[i] = replace(one, decides=f"{one.decides}, and {made.decides}")
            return
    visits.append(made)


def _numbered(visit: NextVisit, number: int) -> NextVisit:
    return replace(
        visit,
        sentence=sentence_of(visit),
        planned=replace(visit.planned, label=f"visit {number}, {visit.state.name}"),
    )


def _questions(
    effects: Sequence[FoundEffect], unexplained: Sequence[UnexplainedPart], visits: int
) -> Iterator[_Question]:
    """List what is open: ties first, then names that are not sure, then what is not explained."""
    tied = set()
    for number, effect in enumerate(effects):
        for rival in effect.ties:
            question = _of_tie(effect, rival, number)
            # What does the same to the table need not be told apart.
            if question is not None and not do_the_same(rival, effect):
                tied.add(number)
                yield question
    for number, effect in enumerate(effects):
        if effect.status != "confirmed" and number not in tied:
            yield _Question(
                effect.components,
                None,
                f"tests {effect.kind} (effect {number})",
                (*effect.sensors, *effect.states),
                _time_constants_min(effect),
                _is_late(effect),
            )
    for part in unexplained:
        named = (part.component,) if part.component in COMPONENTS else ()
        yield _Question(named, None, f"explores what is unexplained in {part.component}")
    if visits < FEWEST_BLOCKS:
        yield _Question((), None, "shows what changes from visit to visit")


def _of_tie(effect: FoundEffect, rival: Alternative, number: int) -> _Question | None:
    """Ask how to tell two explanations apart that differ by their drivers or by coming late."""
    mine, other = (tuple(dict.fromkeys((*one.sensors, *one.states))) for one in (effect, rival))
    differing = [(a, b) for a in reversed(mine) for b in reversed(other) if a != b]
    are_apart = mine != other and bool(differing)
    is_late = _is_late(effect) != _is_late(rival)
    if not are_apart and not is_late:
        return None
    return _Question(
        effect.components,
        differing[0] if are_apart else None,
        f"tells {from_rival(effect, rival, number)}",
        mine or other,
        _time_constants_min(effect),
        is_late and not are_apart,
        (effect, rival),
    )


def _is_late(one: Named) -> bool:
    return one.kind in _LATE or "late" in one.variant


def _time_constants_min(effect: FoundEffect) -> tuple[float, ...]:
    return tuple(v for name, v in effect.parameters.items() if name.startswith("time_constant"))


def _restricted(campaign: Campaign, components: Sequence[str]) -> Campaign:
    """Keep the observations of some components; all where none of them was observed by itself."""
    kept = [
        replace(v, observations=[o for o in v.observations if o.component in components])
        for v in campaign.verifications
    ]
    kept = [v for v in kept if v.observations]
    return replace(campaign, verifications=kept) if kept else campaign


def _visit_for(
    campaign: Campaign, question: _Question, ranges: Mapping[str, SensorRange]
) -> NextVisit | str | None:
    """Make the visit for a question, or the sentence that none answers it."""
    if question.drivers is not None:
        return _apart(campaign, question, question.drivers, ranges)
    if question.is_late:
        return _while_changing(campaign, question, ranges)
    return _unlike(campaign, question, ranges)


def _apart(
    campaign: Campaign,
    question: _Question,
    drivers: tuple[str, str],
    ranges: Mapping[str, SensorRange],
) -> NextVisit | str | None:
    """Look for the moment at which two drivers leave the course that they had in the visits."""
    begins_s, moments_s = moments(campaign, STEP_S, LASTS_S)
    if not moments_s.size:
        return None
    there = conditions_at(campaign, np.concatenate([begins_s, moments_s]))
    everything = {**there.temperatures_c, **there.states}
    if any(name not in everything for name in drivers):
        return _unlike(campaign, question, ranges)
    one, other = (everything[name] for name in drivers)
    off, largest, is_together, slope = _off_course(one, other, begins_s.size)
    furthest = float(np.nanmax(np.abs(off))) if np.isfinite(off).any() else 0.0
    needed = _smallest_apart(drivers, slope, ranges)
    if furthest <= OFF_COURSE * largest or furthest < needed:
        # Where they were apart in the visits already, more of these tell, not another state.
        if not is_together and largest >= needed:
            return _unlike(campaign, question, ranges)
        return _never_apart(question, drivers, there.times_s, needed, ranges)
    time_s = float(moments_s[int(np.nanargmax(np.abs(off)))])
    state = state_at(campaign, ranges, time_s, drivers, question.time_constants_min, shows_all=True)
    return _visit(campaign, question, time_s, state)


def _smallest_apart(
    drivers: tuple[str, str], slope: float, ranges: Mapping[str, SensorRange]
) -> float:
    """Give by how much the first must leave its course: of a sensor what can be set [K]."""
    first, second = (ranges.get(name) for name in drivers)
    if first is None:
        return 0.0
    return smallest_set_k(first.scatter_k, 0.0 if second is None else slope * second.scatter_k)


def _never_apart(
    question: _Question,
    drivers: tuple[str, str],
    times_s: FloatArray,
    needed_k: float,
    ranges: Mapping[str, SensorRange],
) -> str | None:
    """Say that no visit tells two explanations apart, and what to do then."""
    assert question.tie is not None
    days = float(np.ptp(times_s)) / SECONDS_PER_DAY
    first, second = drivers
    much = f" by {needed_k:.2g} K, the least that can be set," if first in ranges else ""
    return (
        f"No visit {question.decides}: in {days:.2g} days of readings {first} never departed"
        f"{much} from the relation to {second} that it had in the visits. Move one of the two to "
        "another place, or record for longer and in other use; or accept the tie: "
        "while the machine is used as it is, both say nearly the same of the table."
    )


def _off_course(
    one: FloatArray, other: FloatArray, visits: int
) -> tuple[FloatArray, float, bool, float]:
    """Take the line through the visits off.

    Returns
    -------
    off : ndarray
        What is left of moments.
    most : float
        The most that is left of a visit.
    is_together : bool
        Whether the visits lie close to the line.
    slope : float
        Of the line.

    Examples
    --------
    >>> one, other = np.array([0.0, 1.0, 2.0, 5.0]), np.array([0.0, 1.0, 2.0, 1.0])
    >>> off, most, is_together, slope = _off_course(one, other, 3)
    >>> off.round(9).tolist(), round(most, 9), is_together, round(slope, 9)
    ([4.0], 0.0, True, 1.0)
    >>> _off_course(np.array([0.0, 1.0, 2.0, 0.0]), np.array([1.0, 0.0, 1.0, 0.0]), 4)[2]
    False
    """
    known = np.isfinite(one[:visits]) & np.isfinite(other[:visits])
    if known.sum() < 2:
        return np.full(one.size - visits, np.nan), 0.0, True, 0.0
    x, y = other[:visits][known], one[:visits][known]
    slope = float(np.cov(x, y)[0, 1] / np.var(x, ddof=1)) if np.ptp(x) > 0 else 0.0
    left = one - (y.mean() + slope * (other - x.mean()))
    there = left[:visits][known]
    is_together = bool(there.std() <= IN_COMMON * y.std())
    return left[visits:], float(np.abs(there).max()), is_together, slope


def _while_changing(
    campaign: Campaign, question: _Question, ranges: Mapping[str, SensorRange]
) -> NextVisit | None:
    """Take the moment from which the driver changes most within an hour."""
    driver = next((n for n in question.follows if n in ranges and ranges[n].can_be_set), None)
    _, moments_s = moments(campaign, STEP_S, LASTS_S)
    if driver is None or not moments_s.size:
        return _unlike(campaign, question, ranges)
    one = ranges[driver]
    read = np.interp([moments_s, moments_s + SECONDS_PER_H], one.times_s, one.temperatures_c)
    # From the cold, where there is the choice: it is where a working day begins.
    is_cold = read[0] < one.low_c + COLD * one.span_k
    rise = np.where(is_cold, 2.0, 1.0) * (read[1] - read[0])
    time_s = float(moments_s[int(rise.argmax())])
    state = state_at(
        campaign, ranges, time_s, [driver], question.time_constants_min, is_transient=True
    )
    return _visit(campaign, question, time_s, state)


def _unlike(
    campaign: Campaign, question: _Question, ranges: Mapping[str, SensorRange]
) -> NextVisit | None:
    """Take the moment that is most unlike the visits that were made."""
    added = choose_added_visits(campaign)
    if not added:
        return None
    first = added[0]
    state = state_at(campaign, ranges, first.time_s, first.leading, question.time_constants_min)
    return _visit(campaign, question, first.time_s, state)


def _visit(
    campaign: Campaign, question: _Question, time_s: float, state: MachineState
) -> NextVisit:
    largest = largest_visit(campaign)
    named = dict.fromkeys(o.component or "points" for o in largest.observations)
    own = [name for name in question.components if name in named]
    return visit_at(campaign, largest, time_s, state, own or list(named), question.decides)
