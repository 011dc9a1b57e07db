"""Whether an effect helps: what decides which effects are adopted unasked.

How sure its name is, is another question, and its status answers it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.stats import norm, t

from app.arrays import BoolArray, FloatArray
from app.effects.driver import Always, SinceReference, StepAfter
from app.effects.effect import Effect
from app.effects.kind import Shakes
from app.effects.kinds.drift import Drift
from app.effects.kinds.other_sensor import OtherSensor
from app.effects.kinds.outdated_map import OutdatedMap
from app.effects.kinds.step import Step
from app.effects.observations import POINT_CHANNELS
from app.effects.registry import kind_of
from app.errors import list_names
from app.geometry.components import COMPONENTS
from app.identification.analysis.finished_search import GROWING, FinishedSearch
from app.identification.residuals.residuals import channel_unit
from app.search.figures import rms
from app.search.findings import FLEXIBLE, FoundTerm
from app.search.names import ALIKE, WALKS
from app.search.rows import Datum
from app.search.scatter import FEWEST_SETUPS
from app.search.validation import ABOVE_ZERO, OFTEN_FOUND, holds

ONE_SIDED: Final = 0.01
"""Probability by which a gain counts as one, and a visit as worse, although it is not."""

AGREES: Final = 0.05
"""Probability by which held-out set-ups seem to agree with a refit although it gains nothing."""

MARKEDLY: Final = 0.1
"""A visit is not markedly worse by less than this share of what it was."""

FEWEST_GAINS: Final = 5
"""Visits from which a mean gain has a lower bound."""

MOST_CHANNELS: Final = 4
"""So many channels are named in a reason."""

FEWEST_SEEN: Final = 2
"""Set-ups that must show which sensor a component follows where something else may be."""

SHOWN: Final = 0.05
"""Share of its largest size from which an effect shows in a visit."""

HALF: Final = 0.5
"""Share of what is predicted below which squares grow by it."""

ITSELF: Final = 3.0
"""Standard errors by which a component's own observations must show less than the whole."""

APART: Final = 1e-9
"""Share of an effect's information below which nothing tells it from what was always there."""

CHANGES: Final = 0.1
"""Share of an effect's squares from which it changes at its places."""

SPARE_PLACES: Final = 2
"""So many more places than unknowns."""

EITHER: Final = frozenset({*GROWING, Step.kind})
"""What a machine and an instrument can do alike."""

ONCE: Final = frozenset({Drift.kind, Step.kind})
"""What comes with time, and not again with temperatures or states."""

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
    "mounting's and not the maps'"
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
    what an instrument does as well as a machine, or they never change at any of a few places.
    """

    helps: list[Help]
    refits_hold: bool = True
    unsure: frozenset[int] = frozenset()


class _Worse(NamedTuple):
    """A visit of one channel that gets markedly worse with what would be adopted."""

    rows: BoolArray
    channel: int
    before: float
    after: float


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
        or _is_of_few_places(found, effect, term)
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
        worse = next(_markedly_worse(found, predicted), None)
        if worse is None:
            break
        # The one without which that visit would be best.
        least = min(chosen, key=lambda i: _size(found, predicted - own[i], worse.rows))
        if not own[least][worse.rows].any():
            break
        said[least] = _gets_worse(found, worse)
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
    holds_refitted = next(_markedly_worse(found, predicted), None) is None
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
        np.array(_gains_of_visits(found, channels, predicted, seen))
        for predicted in (found.findings.adopted, instead)
    )
    return _is_above_zero(anew - before, AGREES)


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
    size = product = variance = 0.0
    for c in (c for c, name in enumerate(names) if name in effect.components):
        noise, shift = found.scatter(c)
        here = found.use & (found.rows.channel == c)
        for visit in np.unique(found.rows.visit[here]):
            rows = here & (found.rows.visit == visit)
            claimed = found.from_zero(own, rows)
            left = found.from_zero(found.rows.values - together + own, rows)
            weight = 1.0 / (noise**2 + shift**2)
            size += weight * float(claimed @ claimed)
            product += weight * float(claimed @ left)
            spread = noise**2 * float(claimed @ claimed) + shift**2 * float(claimed.sum()) ** 2
            variance += weight**2 * spread
    if size <= 0.0:
        return None
    share, error = product / size, float(np.sqrt(variance)) / size
    if share >= HALF or 1.0 - share <= ITSELF * error:
        return None
    shown = [name for name in names if name in effect.components]
    return (
        f"the residuals of {list_names(shown, MOST_CHANNELS)}, measured directly, would get "
        f"larger: {share:.2f} ± {error:.2f} of what it predicts is there"
    )


def _gain(found: FinishedSearch, channels: Collection[int], predicted: FloatArray) -> float:
    """Sum up by how much the squares of some channels fall, each in its floor's."""
    return sum(_gains_of_visits(found, channels, predicted, found.use))


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
    if effect.kind == OutdatedMap.kind and any(WALKS in other.doubts for other in others):
        return BESIDE_A_WALK
    tied = {rival.family for rival in term.rivals if rival.tied}
    either = (kind_of(family).never_sure for family in sorted(tied))
    if of_either := next(filter(None, either), None):
        return of_either
    if (effect.sensors or effect.states) and tied & ONCE:
        return ONCE_AS_WELL
    if effect.kind == OtherSensor.kind and tied and _setups(found, term) < FEWEST_SEEN:
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
    if not fails_forward and (is_seen or (is_alone and _gains(found, term.channels))):
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
    if effect.kind not in EITHER:
        return AS_SLOW_AS_CAN_BE if is_open and found.is_slowest(term) else None
    if _is_of_one_setup(found, effect):
        return OF_EITHER
    if WALKS in term.doubts:
        return OF_A_WALK
    return BESIDE_WHAT_NOBODY_KNOWS if is_open else None


def _setups(found: FinishedSearch, term: FoundTerm) -> int:
    """Count the set-ups in which a term acts."""
    acts = found.use & np.isin(found.rows.channel, term.channels)
    return int(np.unique(found.rows.visit[acts]).size)


def _is_of_few_places(found: FinishedSearch, effect: Effect, term: FoundTerm) -> bool:
    """Whether an effect may be anything else, as it never changes at any of its few places.

    What changes with time or direction shows at one place. What is the same there always, shows
    by how places differ: where they are hardly more than what is unknown of it and of its set-up,
    whatever else differs from place to place looks the same, held-out moments included.
    """
    rows, size = found.residuals.rows, found.explained(effect)
    for c in term.channels:
        own = np.flatnonzero(found.use & (found.rows.channel == c))
        has_places = rows.channels[c] in POINT_CHANNELS or COMPONENTS[rows.channels[c]].axis
        if not has_places or not size[own].any():
            return False
        places = np.column_stack([rows.points_mm[own], rows.tool_offsets_mm[own]])
        place = np.unique(np.nan_to_num(places), axis=0, return_inverse=True)[1].ravel()
        counts = np.bincount(place)
        means = np.bincount(place, weights=size[own]) / counts
        if np.sum((size[own] - means[place]) ** 2) > CHANGES * np.sum(size[own] ** 2):
            return False
        setups = np.unique(found.rows.visit[own]).size
        zeros = {found.rows.datum.get((int(v), c), Datum.ABSOLUTE) for v in found.rows.visit[own]}
        unknown = term.degrees_of_freedom
        if setups < FEWEST_SETUPS:
            unknown += 1 + int((np.ptp(found.rows.tilt[own], axis=0) > 0.0).sum())
        elif zeros != {Datum.ABSOLUTE}:
            unknown += 1
        if len(counts) >= unknown + SPARE_PLACES:
            return False
    return bool(term.channels)


def _is_of_one_setup(found: FinishedSearch, effect: Effect) -> bool:
    """Whether one set-up alone knows an effect that grows or begins with time.

    Its components by themselves may show it in several set-ups, or points. Where both were
    measured, points count only if they show it by themselves: an effect that one record of its
    component knows alone is only predicted there.
    """
    names = np.array(found.residuals.rows.channels)[found.rows.channel]
    itself = found.use & np.isin(names, effect.components)
    if _is_in_several(found, effect, itself):
        return False
    always = _had_it_always_been(found, effect)
    points = found.use & np.isin(names, POINT_CHANNELS) & (always != 0.0)
    if not _is_in_several(found, effect, points):
        return True
    return bool(itself.any()) and not _is_shown(found, effect, always, points)


def _is_in_several(found: FinishedSearch, effect: Effect, acts: BoolArray) -> bool:
    """Whether it shows in two set-ups at least; where it begins, in two before it too.

    Parameters
    ----------
    acts : ndarray, shape (n,)
        Rows in which it shows, or would had it begun before.
    """
    size = np.abs(found.explained(effect))
    after = acts & (size > SHOWN * size[acts].max(initial=0.0))
    sides = [acts] if effect.kind in GROWING else [after, acts & ~after]
    return all(len(np.unique(found.rows.visit[side])) > 1 for side in sides)


def _had_it_always_been(found: FinishedSearch, effect: Effect) -> FloatArray:
    """Say what an effect of time would be had it always been the same, shape (n,)."""
    terms = (
        replace(term, driver=Always())
        if isinstance(term.driver, SinceReference | StepAfter)
        else term
        for term in effect.terms
    )
    return found.explained(replace(effect, terms=tuple(terms)))


def _is_shown(found: FinishedSearch, effect: Effect, always: FloatArray, acts: BoolArray) -> bool:
    """Whether some rows show by themselves that an effect came, as large as it is said to be.

    What was there all the time, such as a map that is wrong, is fitted beside it: generalised
    least squares, with the scatter of observations and of set-ups.

    Parameters
    ----------
    always : ndarray, shape (n,)
        What it would be had it always been the same.
    acts : ndarray, shape (n,)
        These rows.
    """
    own = found.explained(effect)
    others = sum((found.explained(e) for e in found.effects()), -own)
    information, product = np.zeros((2, 2)), np.zeros(2)
    for c, visit in np.unique(
        np.column_stack([found.rows.channel, found.rows.visit])[acts], axis=0
    ).tolist():
        rows = acts & (found.rows.channel == c) & (found.rows.visit == visit)
        noise, shift = found.scatter(c)
        columns = np.column_stack([found.from_zero(part, rows) for part in (own, always)])
        # V⁻¹ = (1 − k 11ᵀ) / noise², with the set-up's shift in common.
        shared = shift**2 / (noise**2 + len(columns) * shift**2)
        weighted = (columns - shared * columns.sum(axis=0)) / noise**2
        information += weighted.T @ columns
        product += weighted.T @ found.from_zero(found.rows.values - others, rows)
    covariance = np.linalg.pinv(information, hermitian=True)
    # Where nothing tells the two apart, neither is known.
    if information[0, 1] ** 2 >= (1.0 - APART) * information[0, 0] * information[1, 1]:
        return False
    share, error = float(covariance[0] @ product), float(np.sqrt(covariance[0, 0]))
    return share > ITSELF * error and abs(share - 1.0) <= ITSELF * error


def _gains(found: FinishedSearch, channels: Collection[int]) -> bool:
    """Whether held-out visits get smaller: the lower bound of their mean gain is above zero."""
    held_out = found.use & np.isfinite(found.findings.adopted)
    gains = _gains_of_visits(found, channels, found.findings.adopted, held_out)
    return _is_above_zero(np.array(gains), ONE_SIDED)


def _is_above_zero(gains: FloatArray, chance: float) -> bool:
    """Whether the mean gain of set-ups is above zero but for a chance; not known of a few."""
    if len(gains) < FEWEST_GAINS:
        return False
    error = float(np.std(gains, ddof=1)) / np.sqrt(len(gains))
    return bool(np.mean(gains) > t.isf(chance, len(gains) - 1) * error)


def _gains_of_visits(
    found: FinishedSearch, channels: Collection[int], predicted: FloatArray, chosen: BoolArray
) -> list[float]:
    """Sum up by how much the squares of each visit fall, each channel in its floor's."""
    gains: list[float] = []
    visit = found.rows.visit
    chosen = chosen & np.isin(found.rows.channel, list(channels))
    for number in np.unique(visit[chosen]):
        gain = 0.0
        for c in channels:
            own = chosen & (visit == number) & (found.rows.channel == c)
            before = found.from_zero(found.rows.values, own)
            after = found.from_zero(found.rows.values - predicted, own)
            gain += float(np.sum(before**2 - after**2)) / found.floor(c) ** 2
        gains.append(gain)
    return gains


def _markedly_worse(found: FinishedSearch, predicted: FloatArray) -> Iterator[_Worse]:
    """List the held-out visits, channel by channel, that get markedly worse."""
    seen = found.use & np.isfinite(predicted)
    pairs = np.unique(np.column_stack([found.rows.channel, found.rows.visit])[seen], axis=0)
    nothing = np.zeros(len(predicted))
    for c, visit in pairs.tolist():
        own = seen & (found.rows.channel == c) & (found.rows.visit == visit)
        if not predicted[own].any():
            continue
        before, after = (_size(found, part, own) for part in (nothing, predicted))
        often = float(norm.isf(ONE_SIDED / int((pairs[:, 0] == c).sum())))
        scatter = _scatter_of_visit(found, c, visit, int(own.sum()))
        if after - before > max(MARKEDLY * before, often * scatter):
            yield _Worse(own, c, before, after)


def _scatter_of_visit(found: FinishedSearch, channel: int, visit: int, count: int) -> float:
    """Say how far a visit lies off as a whole by its set-up and its repeatability."""
    noise, setup = found.scatter(channel)
    is_zeroed = found.rows.datum.get((visit, channel)) is Datum.FIRST
    return float(np.sqrt(setup**2 + noise**2 * (1.0 / count + is_zeroed)))


def _size(found: FinishedSearch, predicted: FloatArray, own: BoolArray) -> float:
    return rms(found.from_zero(found.rows.values - predicted, own))


def _gets_worse(found: FinishedSearch, worse: _Worse) -> str:
    rows = found.residuals.rows
    first = int(np.flatnonzero(worse.rows)[0])
    label = rows.verifications[int(rows.verification[first])].label
    setup = (
        rows.verifications[int(rows.verification[first])]
        .observations[int(rows.observation[first])]
        .setup
    )
    name = rows.channels[worse.channel]
    where = list_names([repr(label), *([] if setup is None else [f"set-up {setup!r}"])])
    return (
        f"the residuals of {name} would get worse in {where}, which was held out: from "
        f"{worse.before:.3g} to {worse.after:.3g} {channel_unit(name).symbol}"
    )
