"""Whether a component's maps, read by another of the machine's sensors, would leave less.

The sensor that a component follows was chosen of a few maps. Verifications may know better: the
same maps are interpolated over every other sensor whose temperatures they state, as a table would
be if it were assigned, and what that leaves of each set-up is held against what the assigned
sensor leaves. No number is estimated, but a sensor is chosen among many, and so

- the sensor that a set-up is judged by is the one that all others choose;
- the gain must be larger than any sensor's on any component would be by chance: the signs of
  whole set-ups are drawn anew, and the largest statistic of all pairs counts (P. Westfall,
  S. Young, Resampling-Based Multiple Testing (1993));
- no set-up may get markedly worse;
- no one effect of the library may explain as much on the sensor that is assigned
  (`assignment_rivals`): a structure that answers late looks like one that follows another sensor.

Points show many components at once. What a proposal explains is therefore taken off before the
other components are judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from app.arrays import rms
from app.errors import list_names
from app.geometry.components import ORDER
from app.identification.analysis.analysis import Analysis, TriedAssignment
from app.identification.analysis.assignment_rivals import Rivals
from app.identification.analysis.assignment_trials import (
    DRAWN,
    LEAST_GAIN,
    ROUNDING,
    SURE,
    OtherSensors,
    Trial,
    largest_by_chance,
    read_by_others,
)
from app.identification.analysis.set_ups import SetUps
from app.identification.campaign import Campaign
from app.identification.residuals.residuals import Residuals
from app.search.scatter import FEWEST_BLOCKS


def judge_assignments(campaign: Campaign, residuals: Residuals) -> tuple[TriedAssignment, ...]:
    """Test for each component whether another sensor would leave markedly less.

    Parameters
    ----------
    residuals
        What the campaign's model leaves, adopted effects included.

    Returns
    -------
    tuple of TriedAssignment
        One for each component that has maps in two states and shows in the observations: first
        those with a proposal, the one that explains most before the others.
    """
    set_ups = SetUps(residuals, residuals.values)
    refused, open_ = [], []
    for by_other in read_by_others(campaign, residuals):
        why = _why_not_judged(campaign, set_ups, by_other)
        if why:
            refused.append(_not_judged(Trial(set_ups, by_other), why))
        else:
            open_.append(by_other)
    rivals = Rivals(campaign, residuals)
    proposed: list[TriedAssignment] = []
    while True:
        trials = sorted((Trial(set_ups, other) for other in open_), key=lambda trial: -trial.gain)
        accepted, answers = _first_proposal(trials, rivals)
        if accepted is None:
            break
        proposed += answers
        set_ups = accepted.taken_off
        open_ = [other for other in open_ if other is not accepted.other]
    others = sorted([*answers, *refused], key=lambda assignment: ORDER[assignment.component])
    return (*proposed, *others)


def said_first(answer: Analysis, tried: Sequence[TriedAssignment], machine_id: str) -> Analysis:
    """Set the proposals before everything else that an analysis says.

    What was adopted with the present sensor ends where the assignment changes
    (`app.effects.adopted.carry_over`), so that it may serve until then.
    """
    proposals = [assignment for assignment in tried if assignment.proposed_sensor]
    answer = replace(answer, assignments=tuple(tried))
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


def _why_not_judged(campaign: Campaign, set_ups: SetUps, other: OtherSensors) -> str:
    """Say why nothing can be said of a component, empty where something can."""
    count = np.unique(set_ups.place[other.view.rows]).size
    if any(other.code in effect.components for effect in campaign.effects):
        return f"the model has effects on it that were learnt with {other.present}"
    if count < FEWEST_BLOCKS:
        return f"needs at least {FEWEST_BLOCKS} set-ups in which it shows, got {count}"
    if not np.any(np.abs(set_ups.remaining[other.view.rows]) > ROUNDING):
        return "each set-up has one value of it and a zero of its own: no two can be compared"
    if not other.sensors:
        return "no other sensor has readings there and can tell its maps apart"
    return ""


def _first_proposal(
    trials: Sequence[Trial], rivals: Rivals
) -> tuple[Trial | None, list[TriedAssignment]]:
    """Find the first component for which another sensor is proposed.

    Returns
    -------
    trial, answers
        The component, and what is said of it; or None, and what is said of all.
    """
    largest = largest_by_chance(trials)
    answers = []
    for trial in trials:
        beyond = np.count_nonzero(largest >= trial.statistic - ROUNDING)
        answer = _answer(trial, float(1 + beyond) / (1 + DRAWN), rivals)
        if answer.proposed_sensor:
            return trial, [answer]
        answers.append(answer)
    return None, answers


def _answer(trial: Trial, chance: float, rivals: Rivals) -> TriedAssignment:
    other, compared = trial.other, trial.compared
    before, after = trial.remaining[0][compared], trial.after[compared]
    place = trial.set_ups.place[trial.shows][compared]
    sizes = [
        (rms(after[place == at]) - rms(before[place == at]), int(at)) for at in np.unique(place)
    ]
    worst = max(sizes)[1]
    answer = replace(
        _not_judged(trial, ""),
        other_sensor=trial.sensor,
        as_good=trial.as_good,
        setups=len(trial.each[0]),
        after_rms=rms(after),
        worst_setup=trial.set_ups.label(worst),
        worst_before_rms=rms(before[place == worst]),
        worst_after_rms=rms(after[place == worst]),
        p_global=chance,
        why_not=None,
    )
    why = _why_not(trial, answer, chance, rivals)
    if why:
        words = f"{other.code} stays on {other.present}: {why}"
        return replace(answer, why_not=why, sentence=words)
    also = f"; {list_names(answer.as_good, 4)} would do as well" if answer.as_good else ""
    words = f"{_over(answer)}; no set-up would get markedly worse{also}"
    return replace(answer, sentence=words)


def _why_not(trial: Trial, assignment: TriedAssignment, chance: float, rivals: Rivals) -> str:
    """Say why the other sensor is not proposed, empty where it is."""
    before, after = assignment.before_rms, assignment.after_rms
    if after is None or after > (1.0 - LEAST_GAIN) * before:
        return f"{_over(assignment)}, not markedly less"
    if chance > SURE:
        return (
            f"{_over(assignment)}, but some sensor would gain as evenly by chance with probability "
            f"{chance:.2g}"
        )
    if trial.harmed is not None:
        return (
            f"{_over(assignment)}, but set-up {trial.set_ups.label(trial.harmed)!r} would get worse"
        )
    rival = rivals.explaining_as_much(
        trial.set_ups, trial.other.code, trial.shows, trial.scale, trial.gain
    )
    if rival:
        return f"{_over(assignment)}, but {rival} explains as much"
    return ""


def _over(assignment: TriedAssignment) -> str:
    """Say what the other sensor leaves.

    The numbers are of set-ups held out.
    """
    where = " at points" if assignment.at_points else ""
    return (
        f"{assignment.component} with {assignment.other_sensor} instead of "
        f"{assignment.present_sensor} would "
        f"leave {assignment.after_rms:.3g} instead of {assignment.before_rms:.3g} "
        f"{assignment.unit}{where} on "
        "held-out set-ups"
    )


def _not_judged(trial: Trial, why: str) -> TriedAssignment:
    other, set_ups = trial.other, trial.set_ups
    return TriedAssignment(
        component=other.code,
        present_sensor=other.present,
        other_sensor=None,
        as_good=(),
        unit=trial.unit,
        at_points=not trial.is_direct,
        setups=int(np.unique(set_ups.place[other.view.rows]).size),
        before_rms=rms(set_ups.remaining[trial.shows][trial.compared]),
        after_rms=None,
        worst_setup=None,
        worst_before_rms=None,
        worst_after_rms=None,
        p_global=None,
        why_not=why,
        sentence=f"{other.code} was not tried with a sensor other than {other.present}: {why}",
    )
