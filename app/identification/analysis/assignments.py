"""Which components should follow another sensor, as the search has found.

The sensor that a component follows was chosen of a few maps. Verifications may know better: that
its maps are read by another sensor is looked for among all other effects (`other-sensor`), with a
share of it that is estimated, and judged by set-ups that were held out, as these are. Where the
share may be the whole, that sensor is proposed where the effect would be adopted, none on the
present sensor ties with it (a structure that answers late looks like one that follows another
sensor), and what an assignment says, which is the whole, makes no held-out set-up markedly worse.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from math import hypot

import numpy as np

from app.arrays import FloatArray
from app.effects.effect import Effect
from app.effects.hypothesis import WHOLE
from app.effects.kinds.other_sensor import OtherSensor
from app.effects.observations import POINT_CHANNELS
from app.effects.words import TWO_ERRORS
from app.errors import list_names
from app.identification.analysis.analysis import Analysis, TriedAssignment
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.analysis.found_effect import FoundEffect
from app.identification.analysis.held_out_visits import markedly_worse, size_left, worse_words
from app.identification.residuals.residuals import channel_unit


def found_assignments(
    finished: FinishedSearch, effects: Sequence[FoundEffect], adopted: Sequence[Effect]
) -> tuple[TriedAssignment, ...]:
    """Say of each component that is found to follow another sensor as a whole whether to assign it.

    With another share, or with several sensors, it follows none as a table does.

    Parameters
    ----------
    effects
        Those of the search, in the order of its terms.
    adopted
        What the model has.

    Returns
    -------
    tuple of TriedAssignment
        Proposals first.
    """
    numbers = [i for i, effect in enumerate(effects) if effect.kind == OtherSensor.kind]
    helping = Counter(c for i in numbers if effects[i].helps for c in effects[i].components)
    found = [
        _of_component(finished, number, effects[number], code, adopted)
        for number in numbers
        if _is_whole(effects[number])
        for code in effects[number].components
        if helping[code] < 2
    ]
    judged = [assignment for assignment in found if assignment is not None]
    return tuple(sorted(judged, key=lambda assignment: assignment.why_not is not None))


def said_first(answer: Analysis, machine_id: str) -> Analysis:
    """Set the proposals before everything else that an analysis says.

    What was adopted with the present sensor ends where the assignment changes
    (`app.effects.adopted.carry_over`), so that it may serve until then.
    """
    proposals = answer.proposals
    if not proposals:
        return answer
    pairs = [f"{proposal.component}={proposal.proposed_sensor}" for proposal in proposals]
    words = " ".join(f'"{pair}"' if " " in pair else pair for pair in pairs)  # for a shell
    what = (
        f"Change the sensor assignment first: `thermap sensors assign {words} --machine "
        f"{machine_id}` makes the next model version. Then analyse again, because effects of "
        f"{list_names([proposal.component for proposal in proposals], 4)} were looked for with the "
        "present "
        "assignment, and adopted ones that follow a sensor end with it."
    )
    return replace(
        answer,
        summary=" ".join([*(f"{proposal.sentence}." for proposal in proposals), answer.summary]),
        what_next=(what, *answer.what_next),
    )


def _is_whole(effect: FoundEffect) -> bool:
    """Whether the share is 1, as far as its error and those of the maps' slopes can tell."""
    share, error = effect.parameters["share"], effect.standard_errors.get("share", 0.0)
    is_one = abs(share - 1.0) <= TWO_ERRORS * hypot(error, WHOLE.spread)
    # Of a share s all of it leaves (s − 1)² of what was s²: more, where s is below a half.
    return is_one and share - TWO_ERRORS * error > 0.5


def _of_component(
    finished: FinishedSearch,
    number: int,
    effect: FoundEffect,
    code: str,
    adopted: Sequence[Effect],
) -> TriedAssignment | None:
    """Hold held-out set-ups by the present sensor against the same by the other one.

    To assign a sensor estimates nothing: set-ups in which others foretold a share of it know
    nothing of the whole. None where there are none of these.
    """
    term, names = finished.findings.terms[number], finished.residuals.rows.channels
    shows = [c for c in term.channels if names[c] in (code, *POINT_CHANNELS)]
    channels = [c for c in shows if names[c] == code] or shows
    is_held_out = np.isin(finished.set_up, finished.set_up[finished.foretold(number) != 0.0])
    is_held_out &= finished.use & np.isin(finished.rows.channel, shows)
    acts = is_held_out & np.isin(finished.rows.channel, channels)
    if not acts.any():
        return None
    columns = finished.hypotheses[term.key].columns(finished.residuals.projection, term.theta)
    whole = np.where(is_held_out, columns.sum(axis=1), np.nan)
    before, after = (
        size_left(finished, prediction, acts) for prediction in (np.zeros(len(whole)), whole)
    )
    present, other = effect.sensors
    unit = channel_unit(names[channels[0]]).symbol
    as_good = tuple(
        tie.sensors[-1]
        for tie in effect.ties
        if tie.kind == OtherSensor.kind and code in tie.components and tie.sensors[-1] != other
    )
    where = "" if code in names else " at points"
    over = (
        f"{code} with {other} instead of {present} would leave {after:.3g} instead of "
        f"{before:.3g} {unit}{where} on held-out set-ups"
    )
    also = f"; {list_names(as_good, 4)} would do as well" if as_good else ""
    why = _why_not(effect, code, adopted) or _why_not_whole(finished, whole, before, after)
    return TriedAssignment(
        component=code,
        present_sensor=present,
        other_sensor=other,
        as_good=as_good,
        unit=unit,
        before_rms=before,
        after_rms=after,
        why_not=why or None,
        sentence=f"{code} stays on {present}: {over}, but {why}"
        if why
        else f"{over}; no set-up would get markedly worse{also}",
    )


def _why_not(effect: FoundEffect, code: str, adopted: Sequence[Effect]) -> str:
    """Say why the other sensor is not proposed, empty where it is."""
    present, other = effect.sensors
    if any(code in of_model.components for of_model in adopted):
        return f"the model has effects on it that were learnt with {present}"
    if not effect.helps:
        return effect.why_not or ""
    for tie in effect.ties:
        if tie.kind != OtherSensor.kind and other not in tie.sensors:
            drivers = (*tie.sensors, *tie.states)
            by = f" driven by {list_names(drivers, 3)}" if drivers else ""
            return f"{tie.kind} of {list_names(tie.components, 4)}{by} explains as much"
    return ""


def _why_not_whole(finished: FinishedSearch, whole: FloatArray, before: float, after: float) -> str:
    """Say where all of it is worse than none, although a share of it is not; empty: nowhere."""
    worse = next(markedly_worse(finished, whole), None)
    if worse is not None:
        return worse_words(finished, worse)
    return "" if after < before else "that is no less"
