"""What is adopted unasked: what leaves least to be expected later, over all that may be true.

Beside an effect as it was found there are other worlds that these observations leave open: what
ties with it, an instrument, a mistake that is to be corrected. What a world says of the table is
one number, the share of the correction that it would need later: where that is s, the correction c
changes what is left there from s² c² to (s − 1)² c², by (1 − 2 s) c². So worlds that say the same
of the table need not be told apart, and how sure the effect's name is decides nothing. Every world
counts by how probable it is, harm counts twice, and what leaves less is adopted, as far as set-ups
that were held out get smaller by what is adopted together, and none of them markedly larger.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.special import ndtr

from app.arrays import BoolArray, FloatArray
from app.effects.effect import Effect
from app.effects.kind import Shakes
from app.effects.registry import kind_of
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.analysis.held_out_visits import (
    FEWEST_GAINS,
    Worse,
    markedly_worse,
    size_left,
    worse_words,
)
from app.identification.analysis.shown_by_few import (
    is_of_few_places,
    is_of_one_hour,
    is_of_one_setup,
)
from app.identification.residuals.residuals import channel_unit
from app.search.findings import FLEXIBLE, FoundTerm, Rival
from app.search.names import ALIKE, WALKS
from app.search.priors import HARM
from app.search.scatter import LONG_MIN
from app.search.validation import ABOVE_ZERO
from app.units import SECONDS_PER_MIN

OF_EITHER: Final = (
    "only one set-up shows it, so it may come from the machine or from the instrument in "
    "this channel"
)
OF_A_WALK: Final = (
    "a zero of the instrument or the foundation that shifts at random from set-up to set-up "
    "would look the same, and held-out visits between the others would confirm it too"
)
BESIDE_A_WALK: Final = (
    "the zero of the instrument or the foundation seems to shift at random from set-up to "
    "set-up, so the offset seen here may be its own and not the maps'"
)
BESIDE_WHAT_NOBODY_KNOWS: Final = (
    "something unexplained remains where it acts and may undo this change later, so nobody knows "
    "whether it lasts"
)
OF_ALIKE_SET_UPS: Final = (
    "these set-ups resemble each other, so what they have in common may be the instrument's or its "
    "mounting's and not the machine's"
)
OF_ONE_HOUR: Final = (
    "all visits were at one hour of the day and its maps at others, so it may go with the hour: "
    "measure at another hour too"
)
BY_ITS_NAME_ALONE: Final = (
    "nobody is sure of its name, and what it does at all positions alike follows from that alone, "
    "because set-ups have zeros of their own: measure one position with the datum `absolute`, "
    "cold and hot"
)
OF_A_SHORT_TIME: Final = (
    f"nobody is sure of its name, and temperatures hardly move within {LONG_MIN:g} min, so others "
    "that were like it there may be needed later: measure over some hours"
)
BESIDE_A_MISTAKE: Final = (
    "a mistake that was found beside it is to be corrected first, then analyse again"
)
NOT_HELD_OUT: Final = "nothing could be held out to show whether it helps"
NOT_FOUND_AGAIN: Final = "it was not found again without the held-out visits"


class World(NamedTuple):
    """What may be true of an effect, and the share of its correction that is then needed later.

    Parameters
    ----------
    share, error
        That share, and its standard error.
    words
        What speaks against adopting the effect where this is true.
    weight
        How probable it is beside what it stands against, which has 1.
    """

    share: float
    words: str
    error: float = 0.0
    weight: float = 1.0

    @property
    def change(self) -> float:
        """By how much squares are expected to change, in those of the correction; harm twice.

        What is there beyond the whole of it is of something else, and no gain of this one.

        Examples
        --------
        >>> World(1.0, "").change, World(0.5, "").change, World(0.0, "").change
        (-1.0, 0.0, 2.0)
        """
        # For s normally distributed, of 1 − 2 s: its mean, once more what is above 0 (harm), and
        # what is below −1 not at all (s above 1).
        mean, error = 1.0 - 2.0 * self.share, 2.0 * self.error
        harm, beyond = (_positive_part(m, error) for m in (mean, -1.0 - mean))
        return mean + HARM * harm + beyond


def _positive_part(mean: float, error: float) -> float:
    """Give the mean of what is above zero of a normal distribution, as if the rest were zero."""
    if error <= 0.0:
        return max(mean, 0.0)
    z = mean / error
    return mean * float(ndtr(z)) + error * math.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi)


class Help(NamedTuple):
    """Whether an effect helps, and if not, why nobody can say that it does."""

    helps: bool
    why_not: str | None = None


class Decision(NamedTuple):
    """Which of the found effects help, and whether what is refitted beside them holds.

    Nobody is sure of the names of those that are `unsure`: in another world than theirs something
    else does what they do, with them a visit that was held out gets markedly worse, or they never
    change at any of a few places.
    """

    helps: list[Help]
    refits_hold: bool = True
    unsure: frozenset[int] = frozenset()


def decide(finished: FinishedSearch, effects: Sequence[Effect]) -> Decision:
    """Say of each found effect whether it helps, those together that do.

    What is refitted is part of what would be adopted: where it alone makes a visit markedly worse,
    it does not hold.

    Parameters
    ----------
    effects
        As adoption would store them, in the order of the terms.
    """
    terms = finished.findings.terms
    worlds = [list(_worlds(finished, effects, i)) for i in range(len(effects))]
    ties = [list(_ties(finished, *pair)) for pair in zip(effects, terms, strict=True)]
    unsure = {
        i
        for i, effect_worlds in enumerate(worlds)
        if any(world.change > 0.0 for world in effect_worlds)
        or is_of_few_places(finished, effects[i], terms[i])
    }
    refusals = [_never(finished, effects[i], term) for i, term in enumerate(terms)]
    # Of mistakes, and of what parts of the visits found in addition, nothing is taken back.
    base = finished.findings.adopted - sum(
        finished.foretold(i) for i, e in enumerate(effects) if not kind_of(e.kind).not_adopted
    )
    while True:
        open_to = [i for i, words in enumerate(refusals) if words is None]
        refused = _refused(finished, ties, worlds, open_to, base)
        chosen = [i for i in open_to if i not in refused]
        taken = base + sum(finished.foretold(i) for i in chosen)
        worse = next(_worse(finished, chosen, taken), None)
        if worse is None:
            break
        # The one without which that visit would be best.
        least = min(
            chosen, key=lambda i: size_left(finished, taken - finished.foretold(i), worse.rows)
        )
        refusals[least] = worse_words(finished, worse)
        unsure.add(least)
    refusals = [refused.get(i, words) for i, words in enumerate(refusals)]
    helps = [
        Help(words is None, words and words + _would_leave(finished, i, effects[i], taken))
        for i, words in enumerate(refusals)
    ]
    adopted = finished.findings.known
    if adopted is None or not (finished.findings.refitted or finished.findings.dropped):
        return Decision(helps, unsure=frozenset(unsure))
    if not any(answer.helps for answer in helps):
        taken = adopted
    return Decision(helps, next(markedly_worse(finished, taken), None) is None, frozenset(unsure))


def _refused(
    finished: FinishedSearch,
    ties: Sequence[Sequence[tuple[Rival, float]]],
    worlds: Sequence[Sequence[World]],
    candidates: Collection[int],
    base: FloatArray,
) -> dict[int, str]:
    """Choose those effects that together leave least, and say why each other one is refused.

    All are taken at first: some hold only together. Then the worst one is left out, as long as
    without it less is expected to be left, and of those that were left out the best one is taken
    again: what it imitated together with another may have been the other's.
    """
    chosen, refused = set(candidates), dict[int, str]()

    def judged(of: Collection[int]) -> list[tuple[float, int, str]]:
        beside = {i: base + sum(finished.foretold(j) for j in chosen - {i}) for i in of}
        each = {i: _judged(finished, i, ties[i], worlds[i], others) for i, others in beside.items()}
        return sorted((trial.change, i, trial.words) for i, trial in each.items())

    while chosen and (worst := judged(chosen)[-1])[0] >= 0.0:
        chosen.remove(worst[1])
        refused[worst[1]] = worst[2]
    while refused:
        again = judged(refused)
        if again[0][0] >= 0.0:
            return {i: words for _, i, words in again}
        chosen.add(again[0][1])
        del refused[again[0][1]]
    return refused


def _worse(finished: FinishedSearch, chosen: Collection[int], taken: FloatArray) -> Iterator[Worse]:
    """List the held-out visits that get markedly worse where any of what is chosen acts."""
    acts = sum((finished.foretold(i) != 0.0 for i in chosen), np.zeros(len(taken), dtype=bool))
    return (worse for worse in markedly_worse(finished, taken) if acts[worse.rows].any())


def _never(finished: FinishedSearch, effect: Effect, term: FoundTerm) -> str | None:
    """Say why nothing can be expected of an effect; None where something can."""
    if not_adopted := kind_of(effect.kind).not_adopted:
        return not_adopted
    if not np.isfinite(finished.findings.adopted[finished.use]).any():
        return NOT_HELD_OUT
    return NOT_FOUND_AGAIN if term.slope is None else None


class _Judged(NamedTuple):
    """By how much squares are expected to change, in those of a correction, and what makes it."""

    change: float
    words: str


def _judged(
    finished: FinishedSearch,
    number: int,
    ties: Sequence[tuple[Rival, float]],
    worlds: Sequence[World],
    others: FloatArray,
) -> _Judged:
    """Weigh an effect as found, what ties with it, and what may be true instead of any of these.

    Parameters
    ----------
    others : ndarray, shape (n,)
        What is foretold of held-out rows by all that would be adopted beside it.
    """
    itself = _as_found(finished, number, others)
    every = _weighed([itself, *_of_ties(finished, ties, itself)])
    every = _weighed([*every, *worlds])
    worst = max(every, key=lambda world: world.weight * world.change)
    likely = "" if worst.words == itself.words else f" (probability {worst.weight:.0%})"
    change = sum(world.weight * world.change for world in every)
    return _Judged(change, f"{worst.words}{likely}")


def _weighed(worlds: Sequence[World]) -> list[World]:
    """Let the weights of worlds add up to one."""
    total = sum(world.weight for world in worlds)
    return [world._replace(weight=world.weight / total) for world in worlds]


def _as_found(finished: FinishedSearch, number: int, others: FloatArray) -> World:
    """Say how much of an effect those set-ups show that did not teach it.

    Of a trend the last ones say how it goes on, where the earlier ones show it. Of few set-ups,
    whose zeros are unknown, the maps' freedom counts too.
    """
    term = finished.findings.terms[number]
    predicted = (
        finished.use
        & np.isfinite(finished.findings.adopted)
        & np.isin(finished.rows.channel, term.channels)
    )
    slope, when = term.slope, "held-out visits"
    if term.forward_slope is not None and term.forward_slope.information >= ABOVE_ZERO**2:
        slope, when = term.forward_slope, "the last visits"
        share, error = slope.value, slope.error
    elif np.unique(finished.rows.visit[predicted]).size >= FEWEST_GAINS or slope is None:
        contribution = finished.foretold(number)
        share, error = _share_shown(
            finished, contribution, finished.rows.values - others, predicted
        )
    else:
        share, error = slope.value, slope.error
    words = f"{when} show {share:.2f} ± {error:.2f} of what it predicts"
    # The prediction's own size is uncertain too: 1/√LR is its relative standard error.
    return World(share, words, float(np.hypot(error, max(term.likelihood_ratio, 1.0) ** -0.5)))


def _worlds(finished: FinishedSearch, effects: Sequence[Effect], number: int) -> Iterator[World]:
    """List what may be true instead of an effect and of all that ties with it, as likely as these.

    Less likely is only what hangs on a name against which nothing but ties speaks.
    """
    effect, term = effects[number], finished.findings.terms[number]
    kind = kind_of(effect.kind)
    if kind.may_be_instruments(effect):
        if is_of_one_setup(finished, effect):
            yield World(0.0, OF_EITHER)
        if WALKS in term.doubts:
            yield World(0.0, OF_A_WALK)
    if ALIKE in term.doubts:
        yield World(0.0, OF_ALIKE_SET_UPS)
    if kind.constant and is_of_one_hour(finished, effect, term):
        yield World(0.0, OF_ONE_HOUR)
    unseen = World(1.0 - finished.hidden_share(effect), BY_ITS_NAME_ALONE)
    if unseen.change > 0.0 and (doubt := finished.doubt_of_name(effect, term)) > 0.0:
        yield unseen._replace(weight=doubt)
    if _is_of_a_short_time(effect) and not finished.is_name_sure(effect, term):
        yield World(0.0, OF_A_SHORT_TIME)
    # Several such causes may all have made what each of them can.
    if causes := list(_beside_causes(finished, effects, number)):
        left = 1.0 - sum(1.0 - cause.share for cause in causes)
        yield min(causes, key=lambda cause: cause.share)._replace(share=max(left, 0.0))


def _is_of_a_short_time(effect: Effect) -> bool:
    """Whether what drives an effect was seen for a shorter time than temperatures need."""
    if effect.valid is None or not (effect.sensors or effect.states):
        return False
    return effect.valid.to_s - effect.valid.from_s < LONG_MIN * SECONDS_PER_MIN


def _ties(
    finished: FinishedSearch, effect: Effect, term: FoundTerm
) -> Iterator[tuple[Rival, float]]:
    """List what ties with an effect, with the share of it that the table would need instead."""
    acts = finished.use & np.isin(finished.rows.channel, term.channels)
    contribution = finished.later(effect)
    weighted = contribution[acts] / np.sum(finished.scatters[acts] ** 2, axis=1)
    size = float(weighted @ contribution[acts])
    for rival in term.rivals:
        if rival.tied:
            instead = _instead(finished, rival, contribution)
            # Of what adds nothing later, what ties needs no share either.
            yield rival, float(weighted @ instead[acts]) / size if size > 0.0 else 0.0


def _of_ties(
    finished: FinishedSearch, ties: Sequence[tuple[Rival, float]], itself: World
) -> Iterator[World]:
    """Let held-out set-ups show of all that tie alike what they show of an effect."""
    for rival, like in ties:
        kind = kind_of(finished.hypotheses[rival.key].kind)
        share, error = like * itself.share, abs(like) * itself.error
        words = kind.never_sure or (
            f"{rival.family} explains these observations as well ({kind.text}), and then "
            f"{share:.2f} of it would be needed later"
        )
        yield World(share, words, error, rival.weight)


def _instead(finished: FinishedSearch, rival: Rival, contribution: FloatArray) -> FloatArray:
    """Say what a rival would add later, with the constant that it needs to be like the effect."""
    other = finished.later_with(rival)
    if rival.with_offset:
        for c in np.unique(finished.rows.channel[finished.use & (other != 0.0)]).tolist():
            rows = finished.use & (finished.rows.channel == c)
            other[rows] += (contribution[rows] - other[rows]).mean()
    return other


def _share_shown(
    finished: FinishedSearch, contribution: FloatArray, residuals: FloatArray, rows: BoolArray
) -> tuple[float, float]:
    """Say how much of what an effect predicts some rows show, and how well they know it.

    1 ± ∞ where it predicts nothing there.

    Parameters
    ----------
    contribution, residuals : ndarray, shape (n,)
        What it predicts of each row, and what is there beside all other effects.
    """
    claimed, measured = (finished.from_zero(values, rows) for values in (contribution, residuals))
    noise, shift = finished.scatters[rows].T
    weights = claimed / (noise**2 + shift**2)
    size = float(weights @ claimed)
    if size <= 0.0:
        return 1.0, np.inf
    share = float(weights @ measured) / size
    # a'y with y's covariance: each row's noise, and the shift that a set-up's rows share.
    together = np.bincount(finished.set_up[rows], weights=weights * shift)
    variance = float(np.sum((weights * noise) ** 2) + np.sum(together**2))
    # Or as set-ups differ, where they do by more.
    _, visit = np.unique(finished.rows.visit[rows][claimed != 0.0], return_inverse=True)
    # What each visit is off by in the sum above, whatever makes it so: these parts' squares are its
    # variance, n/(n − 1) times as large since the share was fitted to them.
    apart = np.bincount(visit, weights=(weights * (measured - share * claimed))[claimed != 0.0])
    between = float(apart @ apart) * apart.size / max(apart.size - 1, 1)
    return share, float(np.sqrt(max(variance, between))) / size


def _beside_causes(
    finished: FinishedSearch, effects: Sequence[Effect], number: int
) -> Iterator[World]:
    """List what was found beside an effect and may have made it, or a part of it.

    What a mistake leaves in the rows is known only as far as the mistake is; the rest of it would
    be adopted by another name. But the rest is no larger than the whole: of an effect c beside a
    mistake m, c − m at least is its own, and by Cauchy and Schwarz the share 1 − |m|/|c| of c is
    needed later.
    """
    terms, effect = finished.findings.terms, effects[number]
    term, kind = terms[number], kind_of(effect.kind)
    contribution = finished.explained(effect)
    acts = finished.acts(contribution, term.channels)
    is_sure = finished.is_name_sure(effect, term)

    def world(made: float, words: str) -> World:
        size = finished.size(contribution, acts) if acts.any() else 0.0
        return World(max(1.0 - made / size, 0.0) if size > 0.0 else 0.0, words)

    for other, its_term in zip(effects, terms, strict=True):
        words = kind_of(other.kind).spoils.get(effect.kind, "")
        if kind.constant and other is not effect and WALKS in its_term.doubts:
            words = words or BESIDE_A_WALK
        # Beside a mistake of which nobody is sure, only what is no surer waits.
        waits = not kind.not_adopted and (not is_sure or finished.is_name_sure(other, its_term))
        if waits and shakes(other, effect, {*its_term.channels} & {*term.channels}):
            words = words or f"{BESIDE_A_MISTAKE}: {kind_of(other.kind).text}"
        if words:
            left = finished.explained(other)
            its_rows = finished.acts(left, its_term.channels)
            # What it leaves elsewhere alone, it may leave here too.
            rows = its_rows & acts if (its_rows & acts).any() else its_rows
            yield world(finished.size(left, rows) if rows.any() else np.inf, words)
    # What only differs in shape from what was found, is of the same cause as it.
    if kind.may_be_instruments(effect) and finished.is_unexplained_at(
        term.channels, besides=FLEXIBLE
    ):
        yield world(finished.largest_unexplained(term.channels), BESIDE_WHAT_NOBODY_KNOWS)


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


def _would_leave(finished: FinishedSearch, number: int, effect: Effect, taken: FloatArray) -> str:
    """Say what held-out set-ups would be left with by a refused effect beside what is adopted.

    Parameters
    ----------
    taken : ndarray, shape (n,)
        What is foretold by all that is adopted, and by all mistakes: also by this one, if it is.
    """
    part = finished.foretold(number)
    beside = taken - part if kind_of(effect.kind).not_adopted else taken
    predicted = finished.use & np.isfinite(finished.findings.adopted) & (part != 0.0)
    names = finished.residuals.rows.channels
    channels = finished.own_channels(effect, finished.findings.terms[number])
    units = {channel_unit(names[c]) for c in channels}
    chosen = predicted & np.isin(finished.rows.channel, channels)
    if len(units) != 1 or not chosen.any():
        return ""
    sizes = (size_left(finished, prediction, chosen) for prediction in (beside, beside + part))
    before, after = (f"{size:.3g}" for size in sizes)
    return f"; with it held-out set-ups would go from {before} to {after} {units.pop().symbol}"
