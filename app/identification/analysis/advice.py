"""The answer in plain sentences: what was found, and what to do next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from typing import Final

from app.arrays import FloatArray
from app.effects.claim import Named
from app.effects.registry import do_the_same, kind_of
from app.effects.words import MOST_NAMED
from app.errors import capitalised, counted, list_names
from app.identification.analysis.analysis import UnexplainedPart
from app.identification.analysis.far_values import FarValue, asked_again
from app.identification.analysis.figures import ComponentFigures, Figures
from app.identification.analysis.found_effect import Alternative, FoundEffect, RefittedEffect
from app.identification.analysis.not_judged import LARGER
from app.identification.analysis.shown_by_few import hours_of_day
from app.identification.residuals.residuals import BEYOND_THE_MAPS, LeftOut
from app.search.findings import Status
from app.search.scatter import FEWEST_BLOCKS
from app.search.search import MOST_TERMS

ENOUGH_VISITS: Final = 20
"""From so many visits on no more are asked for."""

MUCH: Final = 0.1
"""Where so large a share of the values took no part, the answer says so."""

NOT_ADOPTED: Final = "it is to be put right where it was made"

CUT: Final = (
    f"Adopt what helps and analyse again: the search stopped at {MOST_TERMS} effects, the most "
    "that one analysis names, and more would be worth naming."
)


def summary(
    verdict: str,
    effects: Sequence[FoundEffect],
    refitted: Sequence[RefittedEffect],
    unexplained: Sequence[UnexplainedPart],
    before: Figures,
    after: Figures,
    noise: float | None,
    unit: str,
    kinds: Collection[str] | None,
    components: Sequence[ComponentFigures] = (),
) -> str:
    """Say the answer in two or three sentences.

    Parameters
    ----------
    refitted
        What becomes of the effects that the model has.
    kinds
        The kinds that were looked for; None: all.
    components
        Figures of each: those in another unit, where an effect may show alone.
    """
    scatter = "" if noise is None else f"; one observation scatters by {noise:.2g} {unit}"
    size = before.shown_rms
    if verdict == "nothing-found":
        return (
            f"Nothing was found that the model lacks{_of_kinds(kinds)}. The residuals are "
            f"{size:.3g} {unit} (root mean square){scatter}."
        )
    size_after = after.shown_rms
    where = list_names([part.component for part in unexplained], 4)
    moved = [refit.explanation for refit in refitted if refit.is_changed]
    if not effects and not moved:
        return (
            f"Something remains in {where} that no effect of the library explains. The residuals "
            f"are {size:.3g} {unit} (root mean square){scatter}."
        )
    description = "; ".join(
        [*_named(effects), *moved[:MOST_NAMED], *_more(len(moved) - MOST_NAMED)]
    )
    turn = "fall" if size_after < size else "do not fall but rise"
    moves = f"{turn} from {size:.3g} to {size_after:.3g}"
    moves = f"stay at {size:.3g}" if size_after == size else moves
    held = "" if after.holdout_rms is None else " on held-out visits"
    apart = _of_another_unit(components, unit) if size_after == size else ""
    # The figures are of all that was found, and that is not what adopting by default takes.
    is_mixed = len(effects) > 1 and len({candidate.helps for candidate in effects}) > 1
    whose = "With all effects the" if is_mixed else "The"
    changed = f"{whose} residuals {moves} {unit}{apart}{held}{scatter}"
    if effects and not moved and not any(candidate.helps for candidate in effects):
        why_not = next(
            (candidate.why_not for candidate in effects if candidate.why_not), NOT_ADOPTED
        )
        goes = f"go from {size:.3g} to {size_after:.3g} {unit}{apart}{held}{scatter}"
        changed = f"With it the residuals would {goes}. It is not adopted: {why_not}"
    rest = f". Something unexplained remains in {where}" if verdict == "unexplained" else ""
    sensors = [name for candidate in effects for name in candidate.sensors]
    sensors += [name for refit in refitted for name in refit.effect.sensors]
    return f"{capitalised(description, sensors)}. {changed}{rest}."


def not_compared(left_out: Sequence[LeftOut], compared: int) -> tuple[str, str]:
    """Say that a large part of the values could not be compared with the model, and what to do.

    Parameters
    ----------
    left_out
        Values that the model says nothing of, with the reasons.
    compared
        How many values it says something of.

    Returns
    -------
    in_summary, to_do : str
        Empty where few or none were left out.

    Examples
    --------
    >>> not_compared([LeftOut("frozen", 3)], 97)
    ('', '')
    >>> said, to_do = not_compared([LeftOut(BEYOND_THE_MAPS, 80), LeftOut("frozen", 1)], 19)
    >>> said
    " 81 of 100 values took no part (80 outside the maps' temperatures, 1 frozen)."
    >>> not_compared([LeftOut("frozen", 30)], 70)[1]
    'Find out why 30 of 100 values took no part: frozen.'
    """
    count = sum(group.count for group in left_out)
    if count < MUCH * (count + compared):
        return "", ""
    several = [f"{group.count} {group.reason}" for group in left_out]
    reasons = list_names(several, MOST_NAMED) if len(left_out) > 1 else left_out[0].reason
    share = f"{count} of {counted(count + compared, 'value')}"
    beyond = sum(group.count for group in left_out if group.reason == BEYOND_THE_MAPS)
    to_do = (
        "Measure maps at the temperatures of these visits, or let the machine extrapolate "
        f"(`out_of_range`): {share} took no part, {beyond} of them because they lie "
        f"{BEYOND_THE_MAPS}."
        if 2 * beyond >= count
        else f"Find out why {share} took no part: {reasons}."
    )
    return f" {share} took no part ({reasons}).", to_do


def _of_another_unit(components: Sequence[ComponentFigures], unit: str) -> str:
    """Say which component that the overall figures leave out has changed most; empty: none has."""
    changed = [
        component
        for component in components
        if component.unit != unit and len({*component.shown_rms}) > 1
    ]
    if not changed:
        return ""
    largest = max(changed, key=lambda it: abs(it.shown_rms[0] - it.shown_rms[1]) / it.noise)
    before, after = largest.shown_rms
    how = "fall" if after < before else "rise"
    return (
        f", and those of {largest.component} {how} from {before:.3g} to {after:.3g} {largest.unit}"
    )


def _named(effects: Sequence[FoundEffect]) -> list[str]:
    """Name the few effects that matter most, and count the others by how sure they are.

    Of too many a mistake that is sure comes first, as all else is to be judged anew after it; then
    what is sure, what helps, and what stands for itself.
    """

    def matters(effect: FoundEffect) -> tuple[bool, ...]:
        is_sure = effect.status == Status.CONFIRMED
        is_mistake = bool(kind_of(effect.kind).not_adopted)
        return not (is_mistake and is_sure), not is_sure, not effect.helps, effect.is_proxy

    if len(effects) <= MOST_NAMED:
        return [_how_sure(effect) for effect in effects]
    ordered = sorted(effects, key=matters)
    descriptions = [_how_sure(effect) for effect in ordered[:MOST_NAMED]]
    rest = Counter(str(effect.status) for effect in ordered[MOST_NAMED:])
    sure = ", ".join(f"{count} {status}" for status, count in rest.items())
    return [*descriptions, *(f"{more} ({sure})" for more in _more(len(ordered) - MOST_NAMED))]


def _more(count: int) -> list[str]:
    return [f"and {count} more"] if count > 0 else []


def _how_sure(effect: FoundEffect) -> str:
    """Say what was found, and where its name is not sure; a proxy says so itself."""
    if effect.is_proxy:
        return effect.explanation
    sure = effect.status == Status.CONFIRMED
    return effect.explanation if sure else f"{effect.explanation} ({effect.status})"


def _of_kinds(kinds: Collection[str] | None) -> str:
    return "" if kinds is None else f" among the kinds looked for ({list_names(kinds)})"


def what_next(
    effects: Sequence[FoundEffect],
    unexplained: Sequence[UnexplainedPart],
    visits: int,
    far: Sequence[FarValue] = (),
    to_state: Sequence[str] = (),
    *,
    components: Sequence[ComponentFigures] = (),
    is_short_of_visits: bool = False,
    is_cut: bool = False,
    times_s: FloatArray | None = None,
) -> tuple[str, ...]:
    """Say what to measure or to do next, the most useful first.

    Parameters
    ----------
    far
        Values that were left out because they are far from the others.
    to_state
        What verifications should state instead.
    is_short_of_visits
        Whether something could not be looked for because of too few visits.
    is_cut
        Whether the search ended at as many effects as one analysis names.
    times_s : ndarray, shape (n,), or None
        When it was observed [s since 1970].
    """
    steps = [*mistakes_first(effects), *([CUT] if is_cut else [])]
    steps += asked_again(far)
    for number, effect in enumerate(effects):
        steps += _of_effect(effect, f"effect {number}: " if len(effects) > 1 else "")
    steps += _look_at(unexplained)
    if visits < (ENOUGH_VISITS if is_short_of_visits else FEWEST_BLOCKS):
        steps.append(
            f"Add visits at other temperatures: {visits} took part, and effects that change from "
            f"visit to visit need at least {FEWEST_BLOCKS}, preferably {ENOUGH_VISITS}."
        )
    if times_s is not None and (hours := hours_of_day(times_s)):
        steps.append(
            f"Measure at other hours of the day too: all observations were between {hours} UTC, "
            "and what changes with the hour looks there as if it were always so."
        )
    steps += to_state
    if not steps:
        steps += _left_to_set_ups(components)
    if not steps:
        steps.append("Nothing needs to be done. Measure again once the machine may have worn.")
    return tuple(dict.fromkeys(steps))


def _left_to_set_ups(components: Sequence[ComponentFigures]) -> list[str]:
    """Name the components that keep much more than one observation scatters by.

    Where set-ups differ by more than that, too: what is the same in all of them, the maps' own
    uncertainty may explain.
    """
    return [
        f"{component.component} keeps {left:.3g} {component.unit} where one observation scatters "
        f"by {component.noise:.2g} {component.unit}: that differs from set-up to set-up, and "
        "follows nothing that was recorded. Measure it in more set-ups, and record what else "
        "changes there."
        for component in components
        if (left := component.shown_rms[1]) > LARGER * component.noise
        and (component.setup_scatter or 0.0) > component.noise
    ]


def _look_at(unexplained: Sequence[UnexplainedPart]) -> list[str]:
    """Send people to what is unexplained: those together of which nobody knows more."""
    alone = [p for p in unexplained if p.moves_with]
    together = [p.component for p in unexplained if not p.moves_with]
    where = [f"{p.component}: it moves with {list_names(p.moves_with, 3)}" for p in alone]
    where += [list_names(together)] if together else []
    return [
        f"Look at {part}. Record what else changes there (coolant, doors, clamping, other "
        "machines), and measure it again together with that record."
        for part in where
    ]


def mistakes_first(effects: Sequence[FoundEffect]) -> list[str]:
    """Say how to put the mistakes right that are sure: all else is to be judged anew after it."""
    return [
        what_to_do(effect)
        for effect in effects
        if kind_of(effect.kind).not_adopted and _is_as_sure_as_can_be(effect)
    ]


def _is_as_sure_as_can_be(effect: FoundEffect) -> bool:
    """Whether an effect is confirmed, or would be, if its kind ever could be."""
    if not kind_of(effect.kind).never_sure:
        return effect.status == Status.CONFIRMED
    speaks_against = effect.is_proxy or effect.doubts
    other_kinds = (rival for rival in effect.ties if rival.kind != effect.kind)
    return effect.status == Status.SUSPECTED and not speaks_against and not any(other_kinds)


def what_to_do(effect: FoundEffect) -> str:
    """Say what to do about an effect, in a sentence; empty where nothing need be done.

    Of one whose name is not sure it is said under that condition: nobody swaps plugs on a
    suspicion. What can never be confirmed has no such condition: it is said or not.
    """
    kind = kind_of(effect.kind)
    words = kind.what_to_do(effect.effect)
    if not words or _is_as_sure_as_can_be(effect):
        return words
    return "" if kind.never_sure else f"If it is confirmed, {words[:1].lower()}{words[1:]}"


def from_rival(effect: Named, rival: Named, number: int | None = None) -> str:
    """Name the two that are to be separated; of one kind by what they act on and what drives them.

    Parameters
    ----------
    number
        The effect's in the answer, where it is to be said.

    Examples
    --------
    >>> from functools import partial
    >>> from types import SimpleNamespace
    >>> made = partial(SimpleNamespace, variant="", components=("EXX",), states=())
    >>> lag = made(kind="thermal-lag", sensors=("bed",))
    >>> from_rival(lag, made(kind="drift", sensors=()))
    'thermal-lag from drift'
    >>> from_rival(lag, made(kind="thermal-lag", sensors=(), states=("rpm",)))
    'thermal-lag of EXX with bed from that of EXX with rpm'
    >>> from_rival(lag, made(kind="thermal-lag", sensors=("room",)), number=2)
    'thermal-lag of EXX with bed (effect 2) from that of EXX with room'
    >>> wrong = partial(made, kind="wrong-map", sensors=("bed",))
    >>> from_rival(wrong(variant="1: shift"), wrong(variant="2: slope"))
    "wrong-map of EXX with bed in map '1' from that of EXX with bed in map '2'"
    """
    which = "" if number is None else f" (effect {number})"
    if effect.kind != rival.kind:
        return f"{effect.kind}{which} from {rival.kind}"
    return f"{effect.kind} of {_what(effect)}{which} from that of {_what(rival)}"


def separating_step(effect: Named, rival: Alternative) -> str:
    """Say which measurement tells an effect from a rival."""
    step = capitalised(rival.separating_measurement or "")
    return f"{step} (this separates {from_rival(effect, rival)})."


def _what(named: Named) -> str:
    """Say what an effect acts on, in which map, and what drives it."""
    label = kind_of(named.kind).which_map(named.variant)
    where = f" in map {label!r}" if label else ""
    drivers = (*named.sensors, *named.states)
    parts = (list_names(names, 3) for names in (named.components, drivers) if names)
    return " with ".join(parts) + where


def _of_effect(effect: FoundEffect, which: str) -> list[str]:
    """Say what to do about one effect."""
    steps = [
        separating_step(effect, a)
        for a in effect.ties[:2]
        if a.separating_measurement and not do_the_same(a, effect.effect)
    ]
    kind = kind_of(effect.effect.kind)
    if effect.status != "confirmed":
        shown_by = kind.separating_measurement(effect.effect, effect.effect)
        steps.append(
            f"To confirm the {effect.effect.kind} effect on "
            f"{list_names(effect.effect.components, 3)}, now {effect.status}: {shown_by}."
        )
    if effect.doubt:
        doubt = capitalised(which + effect.doubt, effect.sensors)
        steps.append(f"{doubt}: look for what else changes there.")
    if effect.leverage_warning:
        steps.append(f"{capitalised(which + effect.leverage_warning)}.")
    if to_do := what_to_do(effect):
        steps.append(to_do)
    # Until when it may be used, is no advice about what is not known to help.
    if effect.measure_again and effect.helps:
        steps.append(f"{effect.measure_again}.")
    return steps
