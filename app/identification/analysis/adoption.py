"""Whether an effect helps: what decides which effects are adopted unasked.

How sure its name is, is another question, and its status answers it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray, IntArray
from app.effects.effect import Effect
from app.effects.flexible import OVER_TIME
from app.effects.kind import AsOtherSensor, Shakes
from app.effects.registry import kind_of
from app.errors import list_names
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.analysis.held_out_visits import (
    gains_of_visits,
    get_smaller,
    is_above_zero,
    markedly_worse,
    size_left,
    worse_words,
)
from app.identification.analysis.shown_by_few import (
    ITSELF,
    is_of_few_places,
    is_of_one_hour,
    is_of_one_setup,
)
from app.search.findings import FLEXIBLE, FoundTerm
from app.search.names import ALIKE, WALKS
from app.search.validation import ABOVE_ZERO, OFTEN_FOUND, holds

AGREES: Final = 0.05
"""Probability by which held-out set-ups seem to agree with a refit although it gains nothing."""

MOST_CHANNELS: Final = 4
"""So many channels are named in a reason."""

FEWEST_SEEN: Final = 2
"""Set-ups that must show which sensor a component follows where something else may be."""

HALF: Final = 0.5
"""Share of what is predicted below which squares grow by it."""

LAST: Final = 0.25
"""Share of the set-ups that are the last ones."""

ONCE_AS_WELL: Final = (
    "a drift or a step in time explains these observations as well, so nobody knows whether it "
    "will recur with what it seems to follow"
)
BESIDE_WHAT_NOBODY_KNOWS: Final = (
    "something unexplained remains where it acts and may undo this change later, so nobody knows "
    "whether it lasts"
)
OF_EITHER: Final = (
    "only one set-up shows it, so it may come from the machine or from the instrument in "
    "this channel"
)
EITHER_SENSOR: Final = (
    "only one set-up shows it, and there something else explains it as well: what rises together "
    "in one warm-up need not do so on another day"
)
AS_SLOW_AS_CAN_BE: Final = (
    "its time constant is the longest that was tried, and something unexplained remains where it "
    "acts: anything that changes about as slowly as the visits follow each other can look like it"
)
OF_A_WALK: Final = (
    "a zero of the instrument or the foundation that shifts at random from set-up to set-up "
    "would look the same, and held-out visits between the others would confirm it too"
)
BESIDE_A_WALK: Final = (
    "the zero of the instrument or the foundation seems to shift at random from set-up to "
    "set-up, so the offset seen here may be its own and not the maps'"
)
OF_ALIKE_SET_UPS: Final = (
    "these set-ups resemble each other, so what they have in common may be the instrument's or its "
    "mounting's and not the machine's"
)
OF_ONE_HOUR: Final = (
    "all visits were at one hour of the day and its maps at others, so it may go with the hour: "
    "measure at another hour too"
)
BY_THE_TABLES_ALONE: Final = (
    "its share is not 1, and what it does at all positions alike follows from the tables alone, "
    "because set-ups have zeros of their own: whatever resembles the tables along the axis would "
    "look the same; measure one position with the datum `absolute`, cold and hot"
)
OF_EITHER_MAP: Final = (
    "another of its maps may be wrong instead, the other way round, and zeros of set-ups hide by "
    "how much the two differ at all positions alike: measure one position with the datum "
    "`absolute`, cold and hot"
)
BESIDE_A_MISTAKE: Final = (
    "a mistake that was found beside it is to be corrected first, then analyse again"
)
NOT_HELD_OUT: Final = "nothing could be held out to show whether it helps"


class Help(NamedTuple):
    """Whether an effect helps, and if not, why nobody can say that it does."""

    helps: bool
    why_not: str | None = None


class Judged(NamedTuple):
    """Which of the found effects help, and whether what is refitted beside them holds.

    Nobody is sure of the names of those that are `unsure`: a mistake that was found beside them may
    have made them, with them a visit that was held out gets markedly worse, one set-up alone shows
    what an instrument does as well as a machine, they never change at any of a few places, the
    hour of the day may do the same, the tables alone say most of it, or it is one map's mistake or
    another's.
    """

    helps: list[Help]
    refits_hold: bool = True
    unsure: frozenset[int] = frozenset()


def judge_help(found: FinishedSearch, effects: Sequence[Effect]) -> Judged:
    """Say of each found effect whether it helps, those together that do.

    An effect helps if visits that took no part in finding it show it about as large as
    predicted, or if it makes them smaller significantly; and if none of them gets markedly worse
    with all that helps: by more than a tenth, and by more than set-up scatter and repeatability
    would do to one of so many visits in one campaign of a hundred. Visits are taken from their
    zero as the machine has it. What is refitted is part of what would be adopted: where it alone
    makes a visit markedly worse, it does not hold.

    Parameters
    ----------
    effects
        As adoption would store them, in the order of the terms.
    """
    terms = found.findings.terms
    shaken = _shaken(found, effects)
    said: list[str | None] = [
        _spoilt(effect, effects)
        or shaken.get(i)
        or _why_not(found, effect, term, terms[:i] + terms[i + 1 :])
        for i, (effect, term) in enumerate(zip(effects, terms, strict=True))
    ]
    own = [found.explained(effect) for effect in effects]
    unsure = {
        i
        for i, (effect, term) in enumerate(zip(effects, terms, strict=True))
        if _spoilt(effect, effects) is not None
        or i in shaken
        or _why_not_lasting(found, effect, term) is not None
        or is_of_few_places(found, effect, term)
        or _is_of_one_hour(found, effect, term)
        or _is_by_the_tables_alone(found, effect, term)
        or _is_of_either_map(found, effect, term)
    }
    while chosen := [i for i, words in enumerate(said) if words is None]:
        dropped = [
            i
            for i, words in enumerate(said)
            if words is not None and (terms[i].inclusion or 0.0) >= OFTEN_FOUND
        ]
        predicted = found.findings.adopted - sum(
            (own[i] for i in dropped), np.zeros(len(found.use))
        )
        worse = next(markedly_worse(found, predicted), None)
        if worse is None:
            break
        # The one without which that visit would be best.
        least = min(chosen, key=lambda i: size_left(found, predicted - own[i], worse.rows))
        if not own[least][worse.rows].any():
            break
        said[least] = worse_words(found, worse)
        unsure.add(least)
    if not found.findings.refitted:
        _keep_what_stands_alone(found, effects, own, said)
    helps = [Help(words is None, words) for words in said]
    if found.findings.known is None or not (found.findings.refitted or found.findings.dropped):
        return Judged(helps, unsure=frozenset(unsure))
    # What takes no part was fitted beside what is refitted: it is judged by what is left of both.
    rest = [part for part, one in zip(own, helps, strict=True) if not one.helps]
    together = found.findings.adopted - sum(rest, np.zeros(len(found.use)))
    predicted = together if any(one.helps for one in helps) else found.findings.known
    holds_refitted = next(markedly_worse(found, predicted), None) is None
    return Judged(helps, holds_refitted, frozenset(unsure))


def is_refit_better(found: FinishedSearch, channels: Collection[int], instead: FloatArray) -> bool:
    """Whether held-out set-ups agree that effects of the model are better fitted anew.

    What was learnt before stays unless the mean by which the squares of its set-ups fall is
    surely above zero. Fitted beside something that resembles it, an effect may fit what was
    measured as well as before, and be wrong on any other day: then it has gained nothing here.

    Parameters
    ----------
    found
        With these effects fitted anew.
    channels
        Where they act.
    instead : ndarray, shape (n,)
        What is predicted of held-out rows where they stay; NaN: not held out.
    """
    seen = found.use & np.isfinite(found.findings.adopted) & np.isfinite(instead)
    anew, before = (
        gains_of_visits(found, channels, predicted, seen)
        for predicted in (found.findings.adopted, instead)
    )
    return is_above_zero(anew - before, AGREES)


def _keep_what_stands_alone(
    found: FinishedSearch,
    effects: Sequence[Effect],
    own: Sequence[FloatArray],
    said: list[str | None],
) -> None:
    """Refuse what makes nothing smaller as it would be adopted: without what it was fitted beside.

    Effects that imitate something together, as sines imitate a notch, have sizes that hold
    together alone. What was held out was predicted with all of them, by what each part of the
    visits had found: who was found again too rarely cannot be taken off there. And all were
    fitted beside maps that may be wrong, which are adopted as they are.
    """
    terms = found.findings.terms

    def is_torn(i: int) -> bool:
        mine = set(terms[i].channels)
        others = (j for j, words in enumerate(said) if words is not None)
        return any(mine.intersection(terms[j].channels) for j in others)

    while chosen := [i for i, words in enumerate(said) if words is None]:
        together = sum((own[i] for i in chosen), np.zeros(len(found.use)))
        worse = [i for i in chosen if _gain(found, terms[i].channels, together) <= 0.0]
        if not worse:
            unlike = {i: _why_not_itself(found, effects[i], own[i], together) for i in chosen}
            denied = [i for i in chosen if unlike[i] is not None]
            if not denied:
                break
            # The weakest first: those found before it may be right without it.
            said[denied[-1]] = unlike[denied[-1]]
            continue
        least = max(worse, key=lambda i: _gain(found, terms[i].channels, together - own[i]))
        names = [found.residuals.rows.channels[c] for c in terms[least].channels]
        beside = (
            "effects that are not adopted"
            if is_torn(least)
            else "map corrections that are not adopted"
        )
        said[least] = (
            f"the residuals of {list_names(names, MOST_CHANNELS)} would get no smaller: it was "
            f"fitted together with {beside}"
        )


def _why_not_itself(
    found: FinishedSearch, effect: Effect, own: FloatArray, together: FloatArray
) -> str | None:
    """Say that the effect's own components, observed by themselves, do not show it.

    At points many components move alike: what the wrong one explains there, it spoils where it
    is looked at alone. Held-out visits say nothing of it where their fold has not found it.
    """
    names = found.residuals.rows.channels
    direct = [c for c, name in enumerate(names) if name in effect.components]
    setups = np.unique(found.rows.visit[found.use])
    share, error = _share_shown(found, direct, setups, own, together - own)
    if share >= HALF or 1.0 - share <= ITSELF * error:
        return None
    shown = [name for name in names if name in effect.components]
    return (
        f"the residuals of {list_names(shown, MOST_CHANNELS)}, measured directly, would get "
        f"larger: {share:.2f} ± {error:.2f} of what it predicts is there"
    )


def _share_shown(
    found: FinishedSearch,
    channels: Collection[int],
    setups: IntArray,
    own: FloatArray,
    others: FloatArray,
) -> tuple[float, float]:
    """Say how much of what an effect predicts some set-ups show, and how well they know it.

    1 ± ∞ where it predicts nothing there.

    Parameters
    ----------
    own, others : ndarray, shape (n,)
        What it says of each row, and what stands beside it.
    """
    rows = found.use & np.isin(found.rows.channel, list(channels))
    rows &= np.isin(found.rows.visit, setups)
    claimed, left = (found.from_zero(values, rows) for values in (own, found.rows.values - others))
    noise, shift = found.scatters[rows].T
    weights = claimed / (noise**2 + shift**2)
    size = float(weights @ claimed)
    if size <= 0.0:
        return 1.0, np.inf
    # a'y with y's covariance: each row's noise, and the shift that a set-up's rows share.
    together = np.bincount(found.set_up[rows], weights=weights * shift)
    error = float(np.sqrt(np.sum((weights * noise) ** 2) + np.sum(together**2)))
    return float(weights @ left) / size, error / size


def _why_not_any_more(found: FinishedSearch, effect: Effect, term: FoundTerm) -> str | None:
    """Say that of what changed with time the last set-ups show less than half.

    What was there at first only makes the held-out set-ups of that time smaller, and is wrong from
    now on.
    """
    setups = np.unique(found.rows.visit[found.use & np.isin(found.rows.channel, term.channels)])
    last = setups[-max(round(LAST * len(setups)), 1) :]
    own = found.explained(effect)
    others = sum((found.explained(one) for one in found.effects()), -own)
    share, error = _share_shown(found, term.channels, last, own, others)
    if share >= HALF or 1.0 - share <= ITSELF * error:
        return None
    return (
        f"its size changes over time, and the last set-ups show {share:.2f} ± {error:.2f} of what "
        "it predicts"
    )


def _gain(found: FinishedSearch, channels: Collection[int], predicted: FloatArray) -> float:
    """Sum up by how much the squares of some channels fall, each in its floor's."""
    return float(gains_of_visits(found, channels, predicted, found.use).sum())


def _spoilt(effect: Effect, effects: Sequence[Effect]) -> str | None:
    """Say which mistake found beside an effect makes nothing of it sure."""
    reasons = (kind_of(one.kind).spoils.get(effect.kind) for one in effects)
    return next(filter(None, reasons), None)


def _shaken(found: FinishedSearch, effects: Sequence[Effect]) -> dict[int, str]:
    """Say which effects have to wait until a mistake found beside them is corrected, and why.

    What a mistake leaves in the rows is known only as far as the mistake is; the rest of it
    moves with temperatures too, and would be adopted by another name. Beside a mistake of which
    nobody is sure, only what is no surer waits: it may be either of the two.
    """
    terms = found.findings.terms
    is_sure = [found.is_name_sure(*one) for one in zip(effects, terms, strict=True)]
    said: dict[int, str] = {}
    for m, mistake in enumerate(effects):
        kind = kind_of(mistake.kind)
        if kind.shakes is None:
            continue
        for i, effect in enumerate(effects):
            if kind_of(effect.kind).not_adopted or (is_sure[i] and not is_sure[m]):
                continue
            if shakes(mistake, effect, set(terms[m].channels) & set(terms[i].channels)):
                said.setdefault(i, f"{BESIDE_A_MISTAKE}: {kind.text}")
    return said


def shakes(mistake: Effect, effect: Effect, shared: Collection[int]) -> bool:
    """Whether nothing is sure of an effect until a mistake is corrected.

    Parameters
    ----------
    shared
        Channels in which both act.
    """
    how = kind_of(mistake.kind).shakes
    if how is None:
        return False
    if how is Shakes.VALUES:
        return bool(shared)
    if kind_of(effect.kind).alternates:
        return False
    # Of clocks no sensor is named: they concern all, and states as well.
    driven = bool(effect.sensors or effect.states)
    is_driven = driven if not mistake.sensors else bool({*mistake.sensors} & {*effect.sensors})
    return bool(shared) or is_driven


def _why_not(
    found: FinishedSearch, effect: Effect, term: FoundTerm, others: Collection[FoundTerm]
) -> str | None:
    """Say why an effect by itself does not help; None where it does."""
    if not_adopted := kind_of(effect.kind).not_adopted:
        return not_adopted
    if not_lasting := _why_not_lasting(found, effect, term):
        return not_lasting
    if ALIKE in term.doubts:
        return OF_ALIKE_SET_UPS
    if _is_of_one_hour(found, effect, term):
        return OF_ONE_HOUR
    if _is_by_the_tables_alone(found, effect, term):
        return BY_THE_TABLES_ALONE
    if _is_of_either_map(found, effect, term):
        return OF_EITHER_MAP
    if kind_of(effect.kind).constant and any(WALKS in other.doubts for other in others):
        return BESIDE_A_WALK
    if OVER_TIME in term.doubts and (not_now := _why_not_any_more(found, effect, term)):
        return not_now
    tied = {rival.family for rival in term.rivals if rival.tied}
    either = (kind_of(family).never_sure for family in sorted(tied))
    if of_either := next(filter(None, either), None):
        return of_either
    is_tied_to_time = any(kind_of(family).of_time_alone for family in tied)
    if (effect.sensors or effect.states) and is_tied_to_time:
        return ONCE_AS_WELL
    if _is_other_sensor(effect) and tied and _setups(found, term) < FEWEST_SEEN:
        return EITHER_SENSOR
    if not np.isfinite(found.findings.adopted[found.use]).any():
        return NOT_HELD_OUT
    forward = term.forward_slope
    fails_forward = (
        forward is not None
        and forward.information >= ABOVE_ZERO**2
        and not holds(forward, term.likelihood_ratio)
    )
    is_seen = (term.inclusion or 0.0) >= OFTEN_FOUND and _is_seen(found, effect, term)
    is_alone = not any(set(term.channels) & set(other.channels) for other in others)
    if not fails_forward and (is_seen or (is_alone and get_smaller(found, term.channels))):
        return None
    slope = forward if fails_forward else term.slope
    if slope is None:
        return "it was not found again without the held-out visits"
    when = "the last visits" if fails_forward else "held-out visits"
    return (
        f"{when} show {slope.value:.2f} ± {slope.error:.2f} of what it predicts, which does not "
        "prove that it helps"
    )


def _is_seen(found: FinishedSearch, effect: Effect, term: FoundTerm) -> bool:
    """Whether held-out visits show what is predicted, or at least what makes their squares smaller.

    These fall where surely more than half of it is there, also where there is more than all of it.
    Compatible with all of it is enough where the name is sure, or nothing remains unexplained
    anywhere. Else it may stand for what nobody knows, and need not last as it is.
    """
    slope = term.slope
    if slope is None:
        return False
    is_known = found.is_name_sure(effect, term) or not found.findings.unexplained
    is_all = is_known and bool(holds(slope, term.likelihood_ratio))
    return is_all or slope.value - HALF > ABOVE_ZERO * slope.error


def _why_not_lasting(found: FinishedSearch, effect: Effect, term: FoundTerm) -> str | None:
    """Say why nobody knows of what grows or begins with time, or is very late, that it lasts."""
    # What only differs in shape from what was found, is of the same cause as it.
    is_open = found.is_unexplained_at(term.channels, besides=FLEXIBLE)
    if not kind_of(effect.kind).may_be_instruments(effect):
        return AS_SLOW_AS_CAN_BE if is_open and found.is_slowest(term) else None
    if is_of_one_setup(found, effect):
        return OF_EITHER
    if WALKS in term.doubts:
        return OF_A_WALK
    return BESIDE_WHAT_NOBODY_KNOWS if is_open else None


def _is_of_one_hour(found: FinishedSearch, effect: Effect, term: FoundTerm) -> bool:
    """Whether the hour of the day may be all that a map is said to be off by."""
    return kind_of(effect.kind).constant and is_of_one_hour(found, effect, term)


def _is_by_the_tables_alone(found: FinishedSearch, effect: Effect, term: FoundTerm) -> bool:
    """Whether a part of a table is said to follow another sensor, and set-ups hide most of that.

    That all of it does, would be a strange chance were it not so. Several components have tables
    that differ, and one share of them all is no chance either.
    """
    if not _is_other_sensor(effect) or len(effect.components) > 1:
        return False
    share, error = effect.parameters.get("share", 1.0), effect.standard_errors.get("share", 0.0)
    is_part = abs(share - 1.0) > ITSELF * error
    return is_part and found.expected_of(term).is_mostly_hidden


def _is_of_either_map(found: FinishedSearch, effect: Effect, term: FoundTerm) -> bool:
    """Whether one map is said to be wrong that may as well be another, and set-ups hide which.

    Between two maps one that is too high differs by a constant from the other one too low. Where
    set-ups hide that constant they differ by all of it everywhere, and nobody knows which it is.
    """
    own = kind_of(effect.kind).which_map(effect.variant)
    if not own or not found.expected_of(term).is_mostly_hidden:
        return False
    rivals = (found.hypotheses[rival.key] for rival in term.rivals if rival.tied)
    return any(kind_of(one.kind).which_map(one.variant) not in ("", own) for one in rivals)


def _is_other_sensor(effect: Effect) -> bool:
    """Whether it claims that its components follow another sensor than their own."""
    return kind_of(effect.kind).as_other_sensor is AsOtherSensor.SAME


def _setups(found: FinishedSearch, term: FoundTerm) -> int:
    """Count the set-ups in which a term acts."""
    acts = found.use & np.isin(found.rows.channel, term.channels)
    return int(np.unique(found.rows.visit[acts]).size)
