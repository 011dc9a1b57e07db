"""The search: what the residuals hold beside noise, how sure that is, and what remains."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from scipy.special import chdtri

from app.arrays import BoolArray, FloatArray
from app.errors import InvalidContent, repeated
from app.search.adequacy import adequacy
from app.search.candidate import Candidate, Known, KnownTerm
from app.search.common_scatter import screen_at_common_scatter
from app.search.detectability import Chances, smallest_effects
from app.search.draws import Draws
from app.search.findings import (
    ALIKE_OUTLIERS,
    FEW_VISITS,
    FLEXIBLE,
    ChannelNoise,
    Detectable,
    Excluded,
    Findings,
    FoundTerm,
    HeldOut,
    Rival,
    Status,
    Unexplained,
    Untested,
    Verdict,
)
from app.search.foresight import learn
from app.search.held_out import held_out_figures, typical_scatter
from app.search.joint_fit import Fit, left_out
from app.search.leverage import leverage
from app.search.library import Library, read_library
from app.search.names import ALIKE, WALKS, WANDERS_ALONE, name_doubts, offset_of, set_ups_alike
from app.search.noise import at_least_rounding, repeatability
from app.search.problem import Problem, Term, make_problem, places, with_likely_scatters
from app.search.refinement import refine
from app.search.rivals import better_forms, find_all_rivals
from app.search.rows import Nuisance, Rows
from app.search.scatter import FEWEST_BLOCKS
from app.search.screening import Screened, screen
from app.search.selection import Selection, Selector
from app.search.shared import not_shared
from app.search.splits import Splits, split
from app.search.validation import Rivals, Validation, status_of, validate

FALSE_ALARM: Final = 0.01
"""Accepted probability that anything is found in noise."""

DRAWS: Final = 200
"""Draws of noise behind the threshold."""

MOST_TERMS: Final = 24
"""At most so many terms are named, so that an analysis ends; it says where this limit ended it."""

NOT_ZERO: Final = 0.05
"""Probability with which a size that is zero is still taken for one that is not."""

Progress = Callable[[float, str], None]


@dataclass(eq=False)
class _ProgressReport:
    """Reports how far the search is, never backwards."""

    progress: Progress | None
    share: float = 0.0

    def __call__(self, share: float, words: str) -> None:
        self.share = max(self.share, min(share, 1.0))
        if self.progress is not None:
            self.progress(self.share, words)


def search(
    rows: Rows,
    nuisance: Sequence[Nuisance],
    candidates: Sequence[Candidate],
    *,
    holdout_fraction: float,
    adopted: Known | None = None,
    unsaid: Sequence[Nuisance] = (),
    seed: int = 0,
    false_alarm: float = FALSE_ALARM,
    most_terms: int = MOST_TERMS,
    progress: Progress | None = None,
) -> Findings:
    """Search residuals for the effects that a model lacks.

    All visits together decide what is found; then the whole search is repeated with
    every fold of visits held out in turn, which gives the figures before and after, the
    calibration slopes and how often each term is found again.

    Parameters
    ----------
    rows
        Residuals: measured minus predicted.
    holdout_fraction
        Share of the visits held out each time: one fold for each 1/share.
    adopted
        Terms that the model has already, of candidates among these: fitted anew together with
        what is found.
    unsaid
        Errors of the model that no value and no likelihood counts, as columns: they make the
        standard errors of sizes larger, and choose nothing.
    seed
        Of all draws; the same rows, candidates and seed give the same findings.
    false_alarm
        Accepted probability that anything is found in noise.
    most_terms
        How many terms are chosen at most; the findings say where that ended the search.
    progress
        Told the share done, 0 to 1, never falling, and what is being done.

    Raises
    ------
    InvalidContent
        If two candidates have one key, or a share is not between 0 and 1.
    """
    _refuse(candidates, holdout_fraction, false_alarm)
    report = _ProgressReport(progress)
    report(0.0, "screening rows")
    residuals, first = screen_at_common_scatter(rows, nuisance)
    rows = residuals
    if adopted is not None:
        rows = replace(rows, values=rows.values + adopted.explained)
    chooser = _Chooser(
        rows=rows,
        nuisance=nuisance,
        candidates=candidates,
        known=() if adopted is None else adopted.terms,
        holdout_fraction=holdout_fraction,
        seed=seed,
        false_alarm=false_alarm,
        most_terms=most_terms,
        report=report,
    )
    screened, (splits, draws, selector, main) = chooser.screen_and_choose(first)
    use, excluded = screened.use, screened.excluded
    library, allowed, problem = selector.library, selector.allowed, selector.library.problem
    report(0.55, "comparing rivals")
    main.terms = _in_order(selector, main.terms)
    main.terms, rivals = find_all_rivals(selector, main.terms)
    unlike = name_doubts(selector, main.terms, draws)
    doubts = [
        (*doubt, *better_forms(term, rivals_of_term))
        for doubt, term, rivals_of_term in zip(unlike, main.terms, rivals, strict=True)
    ]
    report(0.65, "holding visits out")
    checked = validate(
        library,
        splits,
        main,
        allowed,
        rivals,
        lambda s: report(0.65 + 0.25 * s, "holding visits out"),
    )
    report(0.9, "looking for what is left")
    fit = selector.fit(main.terms)
    typical = typical_scatter(selector.given(main.terms))
    held_out = held_out_figures(problem, fit, typical, checked, seed)
    # An effect that is not sure may stand for another: what it leaves counts in full.
    settled = checked.settled(main.terms, doubts)
    checked_there = checked.where_found(main.terms, settled, problem.rows.channel)
    # Where no effect acts, the maps alone are open.
    settled |= problem.fixed.keys() - {c for term in main.terms for c in term.channels}
    beside_learning = held_out_figures(problem, fit, typical, checked_there, seed, settled=settled)
    remains = [
        *adequacy(selector, main.terms, fit, use, draws, beside_learning),
        *(
            Unexplained(FLEXIBLE, term.channels[0], term.candidate.key)
            for term, doubt in zip(main.terms, unlike, strict=True)
            if set(doubt) - {WANDERS_ALONE, WALKS, ALIKE}
        ),
        *(
            Unexplained(ALIKE_OUTLIERS, exclusion.channel, None)
            for exclusion in excluded
            if exclusion.alike
        ),
    ]
    report(0.95, "summing up")
    outcome = _Outcome(selector, main, fit, rivals, doubts, checked, unsaid, draws)
    answer = _answer(outcome, use, excluded, held_out, remains)
    report(1.0, "done")
    return _beyond(answer, residuals.values - rows.values)


class _Chosen(NamedTuple):
    """Terms chosen on some rows, and what they were chosen by."""

    splits: Splits
    draws: Draws
    selector: Selector
    main: Selection


@dataclass(frozen=True, eq=False)
class _Chooser:
    """Chooses terms on all visits, as often as rows are screened anew."""

    rows: Rows
    nuisance: Sequence[Nuisance]
    candidates: Sequence[Candidate]
    known: Sequence[KnownTerm]
    holdout_fraction: float
    seed: int
    false_alarm: float
    most_terms: int
    report: Progress

    def screen_and_choose(self, screened: Screened) -> tuple[Screened, _Chosen]:
        """Choose terms, and look for outliers again beside what is found.

        Parameters
        ----------
        screened
            What was found before anything was explained.
        """
        doubtful = screened.doubtful(self.rows)
        if doubtful.any():
            # An effect that acts seldom looks like slips, until it is known.
            explained = self._beside(self._choose(screened.use | doubtful), screened)
            if screened.is_explained_by(explained, self.rows):
                screened = explained
        chosen = self._choose(screened.use)
        # What an effect had hidden, by making all values scatter, shows beside it.
        closer = self._beside(chosen, screened)
        if (screened.use & ~closer.use).any():
            screened = closer
            del chosen  # all its products, before others take as much
            chosen = self._choose(screened.use)
        return screened, chosen

    def _beside(self, chosen: _Chosen, screened: Screened) -> Screened:
        """Screen what the chosen terms leave."""
        terms = chosen.main.terms
        if not terms:
            return screened
        residuals = self.rows.values - _explained(chosen.selector, terms)
        return screen(replace(self.rows, values=residuals), self.nuisance, screened)

    def _choose(self, use: BoolArray) -> _Chosen:
        draws = Draws(self.seed, DRAWS)
        splits = split(self.rows, use, self.holdout_fraction)
        problem = with_likely_scatters(
            make_problem(self.rows, self.nuisance, use, splits.cell_of, splits.cells)
        )
        library = read_library(
            *(problem, self.candidates, draws),
            lambda s: self.report(0.02 + 0.33 * s, "reading candidates"),
            by_cell=False,  # parts of the visits see few of them (`Library.take`)
        )
        everything, allowed = np.ones(splits.cells, dtype=bool), library.testable
        selector = Selector(
            *(library, everything, allowed, self.false_alarm, self.most_terms),
            known=[
                replace(problem.term(known_term.candidate, known_term.theta), origin=number)
                for number, known_term in enumerate(self.known)
            ],
            step=lambda: self.report(0.35, "searching"),
        )
        main = selector.select(draws)
        if refuted := not_shared(selector, main.terms):
            is_refuted = [
                library.candidates[e.candidate].family in refuted for e in library.entries
            ]
            selector.allowed = selector.allowed & ~np.array(is_refuted)
            main = selector.select(draws)
        alike = set_ups_alike(selector, main.terms)
        if alike.is_likely:
            draws, selector.made_anew = draws.with_alike(alike), main.stages[0].limit
            main = selector.select(draws)
        return _Chosen(splits, draws, selector, main)


def _explained(selector: Selector, terms: Sequence[Term]) -> FloatArray:
    """Say what terms explain of each of the caller's rows, in the channels' own units."""
    learned = learn(selector.states, terms)
    explained = np.zeros(len(selector.library.problem.place))
    for c, state in learned.states.items():
        channel = state.fixed.channel
        explained[channel.rows] = learned.effect(c) * channel.scale
    return explained


class _Outcome(NamedTuple):
    """What was chosen on all visits, with its rivals, and what held-out visits say of it."""

    selector: Selector
    main: Selection
    fit: Fit
    rivals: Rivals
    doubts: Sequence[tuple[str, ...]]
    checked: Validation
    unsaid: Sequence[Nuisance]
    draws: Draws


def _answer(
    outcome: _Outcome,
    use: BoolArray,
    excluded: Sequence[Excluded],
    held_out: Mapping[int, HeldOut],
    unexplained: Sequence[Unexplained],
) -> Findings:
    """Write everything down, in the channels' own units."""
    selector, main, fit, _, _, checked, unsaid, draws = outcome
    library = selector.library
    sized = _with_unsaid(selector, main.terms, fit, unsaid)
    every = [_found_term(outcome, number, sized) for number in range(len(main.terms))]
    terms = tuple(term for term in every if term.origin is None)
    still = {term.origin for term in every}
    return Findings(
        verdict=Verdict.UNEXPLAINED if unexplained else Verdict.FOUND if terms else Verdict.NOTHING,
        terms=terms,
        unexplained=tuple(unexplained),
        noise=_noise(library.problem, fit, use),
        held_out=held_out,
        global_p=min(
            main.stages[0].global_p,
            # What the model has already is no news, however sure it is.
            *(
                found.global_p
                for found, term in zip(every, main.terms, strict=True)
                if term.candidate.expected and found.origin is None
            ),
            1.0,
        ),
        excluded=tuple(excluded),
        untested=tuple(_untested(library, main.stages[0].rank)),
        detectable=tuple(_detectable(selector, main, draws)),
        predicted=_in_own_unit(library.problem, checked.after),
        adopted=_in_own_unit(library.problem, checked.adopted),
        is_cut=main.is_cut,
        refitted=tuple(term for term in every if term.origin is not None),
        dropped=tuple(n for n in range(len(selector.known)) if n not in still),
        known=_in_own_unit(library.problem, checked.known),
        apart=np.array(
            [
                _in_own_unit(library.problem, checked.apart[number])
                for number, term in enumerate(main.terms)
                if term.origin is None
            ]
        ),
        beside=partial(_beside, selector, main.terms, every, unsaid),
    )


def _beyond(answer: Findings, change: FloatArray) -> Findings:
    """Count what is predicted from the model as it is, not from the one without known terms."""
    return replace(
        answer,
        predicted=answer.predicted + change,
        adopted=answer.adopted + change,
        known=None if answer.known is None else answer.known + change,
    )


def _beside(
    selector: Selector,
    terms: Sequence[Term],
    every: Sequence[FoundTerm],
    unsaid: Sequence[Nuisance],
    confirmed: Collection[int],
) -> tuple[list[FoundTerm], list[FoundTerm]]:
    """Fit known terms and some of the found ones again, without the others."""
    chosen = [i for i, term in enumerate(terms) if term.origin is not None or i in confirmed]
    again = [terms[i] for i in chosen]
    fit = _with_unsaid(selector, again, selector.fit(again), unsaid)
    divided: tuple[list[FoundTerm], list[FoundTerm]] = ([], [])
    for i, part in zip(chosen, places(again), strict=True):
        amplitudes, covariance = _sizes(terms[i], fit, part)
        refitted = replace(every[i], amplitudes=amplitudes, covariance=covariance)
        divided[terms[i].origin is not None].append(refitted)
    return divided


def _status(judged: Status, doubts: Sequence[str], *, is_sized: bool) -> Status:
    """Confirm no name where a flexible version explains more, or where the size is not known."""
    is_open = bool(doubts) or not is_sized
    return Status.SUSPECTED if is_open and judged is Status.CONFIRMED else judged


def _is_sized(amplitudes: FloatArray, covariance: FloatArray) -> bool:
    """Whether a size is known to be other than zero, its nonlinear parameter's error included.

    An effect may be sure and its size not: where a visit ends before anything has settled, only
    size over time constant is known.
    """
    distance = float(amplitudes @ np.linalg.pinv(covariance) @ amplitudes)
    return distance > float(chdtri(len(amplitudes), NOT_ZERO))


def _with_unsaid(
    selector: Selector, terms: Sequence[Term], fit: Fit, unsaid: Sequence[Nuisance]
) -> Fit:
    """Let the covariance of a fit's amplitudes count what no likelihood does."""
    if not terms or not unsaid:
        return fit
    more = left_out(selector.states, terms, fit, unsaid)
    return replace(fit, covariance=fit.covariance + more)


def _sizes(term: Term, fit: Fit, part: slice) -> tuple[FloatArray, FloatArray]:
    """Give amplitudes and their covariance in the candidate's own unit."""
    norms = np.where(term.norms > 0, term.norms, np.inf)
    return fit.amplitudes[part] / norms, fit.covariance[part, part] / np.outer(norms, norms)


def _sized(
    selector: Selector, rival: Rival, instead: Term, number: int, terms: Sequence[Term]
) -> Rival:
    """Set beside a tied rival the sizes that it and all other terms have with it instead of one."""
    if not rival.tied:
        return rival
    offset = offset_of(selector, terms[number]) if rival.with_offset else None
    again = [*terms[:number], instead, *terms[number + 1 :]]
    fit = selector.fit([*again, *([offset] if offset else [])])
    sizes = {
        place: _sizes(term, fit, part)[0]
        for place, (term, part) in enumerate(zip(again, places(again), strict=True))
    }
    return replace(rival, amplitudes=sizes.pop(number), beside=sizes)


def _by_nonlinear(selector: Selector, term: Term, others: Sequence[Term]) -> FloatArray:
    """Say what the nonlinear parameter's own error adds to the amplitudes' covariance.

    With θ̂ ± σ the amplitudes are fitted anew, a(θ): to first order cov(â) = cov(â | θ̂) + a'a'ᵀ σ²
    (variable projection, Golub and Pereyra 1973). A lag's share without it is ten times too sure.
    What the rows do not bound is unsure by all that lies between its bounds.
    """
    nothing = np.zeros((term.size, term.size))
    bounds, theta, error = term.candidate.bounds, term.theta, term.theta_error
    if bounds is None or theta is None or error is None or error <= 0:
        return nothing
    ends = [float(np.clip(theta + side * error, *bounds)) for side in (-1.0, 1.0)]
    if ends[0] == ends[1]:
        return nothing
    low, high = (_amplitudes_at(selector, term, end, others) for end in ends)
    stretches = error / (ends[1] - ends[0]) if np.isfinite(error) else 1.0
    change = stretches * (high - low)
    return np.outer(change, change)


def _amplitudes_at(
    selector: Selector, term: Term, theta: float, others: Sequence[Term]
) -> FloatArray:
    moved = selector.library.problem.term(term.candidate, theta, term.about)
    fit = selector.fit([moved, *others])
    return _sizes(moved, fit, slice(0, moved.size))[0]


def _refuse(candidates: Sequence[Candidate], holdout_fraction: float, false_alarm: float) -> None:
    twice = repeated(c.key for c in candidates)
    if twice:
        raise InvalidContent.of_field(
            "candidates", f"expected different keys, got twice: {twice[0]}"
        )
    for name, share in (("holdout_fraction", holdout_fraction), ("false_alarm", false_alarm)):
        if not 0 < share < 1:
            raise InvalidContent.of_field(name, f"expected a share between 0 and 1, got {share:g}")


def _untested(library: Library, rank: FloatArray) -> list[Untested]:
    """List candidates that no value of their grid could be tested for, and why."""
    blocks = library.blocks_of_entries
    most: dict[int, tuple[float, int]] = {}
    for i, entry in enumerate(library.entries):
        before = most.get(entry.candidate, (0.0, 0))
        most[entry.candidate] = (max(before[0], rank[i]), max(before[1], int(blocks[i])))
    not_tried = []
    for number, (testable, count) in most.items():
        candidate = library.candidates[number]
        few = count < FEWEST_BLOCKS and not candidate.within_visit
        if not testable and not candidate.generic:
            not_tried.append(Untested(candidate.key, "not-excited"))
        elif few and not candidate.generic:
            not_tried.append(Untested(candidate.key, FEW_VISITS, FEWEST_BLOCKS, count))
    return not_tried


def _in_order(selector: Selector, terms: list[Term]) -> list[Term]:
    """Put the strongest first, with the standard errors of nonlinear parameters."""
    strength = [-selector.evidence(t, terms[:i] + terms[i + 1 :]) for i, t in enumerate(terms)]
    order = [terms[i] for i in np.argsort(strength, kind="stable")]
    return [
        refine(
            selector.library.problem, selector.states, t, order[:i] + order[i + 1 :], errors=True
        )
        for i, t in enumerate(order)
    ]


def _found_term(outcome: _Outcome, number: int, sized: Fit) -> FoundTerm:
    selector, main, fit, rivals, doubts, checked, _, _ = outcome
    term = main.terms[number]
    others = main.terms[:number] + main.terms[number + 1 :]
    part = places(main.terms)[number]
    ratio = 2.0 * (fit.log_likelihood - selector.fit(others).log_likelihood)
    strongest, share = leverage(selector, main.terms, number)
    slope, inclusion = checked.slope(number), checked.inclusion(number)
    judged = status_of(slope, checked.forward[number], inclusion, ratio, share)
    amplitudes, covariance = _sizes(term, sized, part)
    covariance = covariance + _by_nonlinear(selector, term, others)
    entries = np.flatnonzero(selector.groups == selector.library.candidates.index(term.candidate))
    # Beside itself, as a term that the model has is at first, a candidate tells nothing.
    rank = int(main.stages[0].rank[entries].max()) or term.size
    return FoundTerm(
        key=term.candidate.key,
        family=term.candidate.family,
        channels=term.channels,
        theta=term.theta,
        theta_error=term.theta_error,
        amplitudes=amplitudes,
        covariance=covariance,
        likelihood_ratio=ratio,
        degrees_of_freedom=term.size + term.candidate.nonlinear,
        evidence=ratio - selector.cost(term, fit, part.start),
        global_p=main.stages[0].limit.global_p_of(int(entries[0]), ratio, rank),
        rivals=tuple(_sized(selector, *rival, number, main.terms) for rival in rivals[number]),
        slope=slope,
        forward_slope=checked.forward[number],
        inclusion=inclusion,
        status=_status(judged, doubts[number], is_sized=_is_sized(amplitudes, covariance)),
        strongest_visits=strongest,
        leverage=share,
        doubts=doubts[number],
        place=number,
        origin=term.origin,
    )


def _noise(problem: Problem, fit: Fit, use: BoolArray) -> dict[int, ChannelNoise]:
    noise = {}
    for c, fixed in problem.fixed.items():
        channel, measured = fixed.channel, repeatability(problem.rows, c, use)
        read = measured._replace(value=channel.scale)  # what the fit made of a first guess
        noise[c] = ChannelNoise(
            repeatability=channel.scale,
            origin=at_least_rounding(problem.rows, c, read).origin,
            fitted=channel.scale * float(np.sqrt(fit.scatter[c])),
            visits=len(np.unique(channel.blocks.setups)),
            rows=len(channel.rows),
        )
    return noise


def _detectable(selector: Selector, main: Selection, draws: Draws) -> list[Detectable]:
    conditioned = selector.given(main.terms)
    chances = Chances.of(selector.base, conditioned, selector.allowed, draws, main.stages[0].limit)
    return smallest_effects(selector.library, selector.states, chances, rivals=False)


def _in_own_unit(problem: Problem, predicted: FloatArray) -> FloatArray:
    in_unit = np.full(len(predicted), np.nan)
    for fixed in problem.fixed.values():
        rows = fixed.channel.rows
        in_unit[rows] = predicted[rows] * fixed.channel.scale
    return in_unit
