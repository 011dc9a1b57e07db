"""A finished search beside the rows that it looked at, and the effects that it found."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray, rms
from app.effects.adopted.learnt_ranges import growths, limited_in_time, with_ranges
from app.effects.claim import claim_of
from app.effects.driver import SinceReference, StepAfter
from app.effects.effect import Effect
from app.effects.hypothesis import Estimate, Hypothesis
from app.effects.kind import OverTime
from app.effects.map_tables import times_of_maps
from app.effects.projection import sum_of_terms
from app.effects.registry import do_the_same, kind_of
from app.effects.term import Term
from app.identification.analysis.unseen_part import Shrunk, with_expected
from app.identification.residuals.residuals import Residuals
from app.search.findings import Findings, FoundTerm, Rival, Status
from app.search.rows import Nuisance, Rows
from app.search.scatter import FEWEST_BLOCKS
from app.search.validation import holds
from app.search.zeros import UnknownZero, unknown_zeros, without_zeros
from app.thermal.error_map import ErrorMap
from app.units import SECONDS_PER_DAY

SLOWEST: Final = 0.99
"""Share of the longest time constant from which it counts as that."""


@dataclass(frozen=True, eq=False)
class FinishedSearch:
    """A finished search beside the rows that it looked at.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Which rows took part.
    of_maps
        The maps' own uncertainty, as columns of each channel.
    """

    residuals: Residuals
    rows: Rows
    findings: Findings
    use: BoolArray
    hypotheses: Mapping[str, Hypothesis]
    of_maps: Sequence[Nuisance] = ()
    maps: Sequence[ErrorMap] = ()

    @cached_property
    def zeros(self) -> list[UnknownZero]:
        """Rows of each unknown zero."""
        return unknown_zeros(self.rows)

    def effects(self) -> list[Effect]:
        """Make the effects that adoption would store, in the order of the terms."""
        return [self.effect_of(term) for term in self.findings.terms]

    def is_unexplained_at(self, channels: Collection[int], *, besides: str = "") -> bool:
        """Say whether structure remains in any of some channels, whatever one test says."""
        unexplained = {part.channel for part in self.findings.unexplained if part.test != besides}
        return bool(unexplained.intersection(channels))

    def scatter(self, channel: int) -> tuple[float, float]:
        """Give the standard deviations of an observation and of a set-up as a whole.

        An observation scatters by no less than the floor was made with: what was fitted lies
        below it by chance, or because values that are read in steps hardly move.
        """
        noise, held_out = self.noise(channel), self.findings.held_out.get(channel)
        if held_out is None:
            return noise, 0.0
        return max(noise, held_out.floor.noise), held_out.floor.setups

    def noise(self, channel: int) -> float:
        """Give the standard deviation of an observation, as fitted to these rows; above zero."""
        return max(self.findings.noise[channel].fitted, float(np.finfo(float).tiny))

    @cached_property
    def set_up(self) -> IntArray:
        """Number of each row's set-up in its channel, growing with both, shape (n,)."""
        pairs = np.column_stack([self.rows.channel, self.rows.visit])
        return np.unique(pairs, axis=0, return_inverse=True)[1].ravel()

    @cached_property
    def scatters(self) -> FloatArray:
        """Standard deviations of each row and of its set-up as a whole, shape (n, 2)."""
        scatters = np.full((len(self.use), 2), np.nan)
        for channel in self.findings.noise:
            scatters[self.rows.channel == channel] = self.scatter(channel)
        return scatters

    def acts(self, contribution: FloatArray, channels: Collection[int]) -> BoolArray:
        """Say in which rows of some channels a contribution is anything, shape (n,)."""
        acts: BoolArray = np.isin(self.rows.channel, list(channels)) & (contribution != 0.0)
        return acts & self.use

    def size(self, contribution: FloatArray, chosen: BoolArray) -> float:
        """Give the root mean square of a contribution to some rows, in scatters of the rows."""
        return rms(contribution[chosen] / np.hypot(*self.scatters[chosen].T))

    def largest_unexplained(self, channels: Collection[int]) -> float:
        """Give the size of what all effects leave of that set-up of which they leave most.

        In scatters of the rows, and beyond what single observations scatter by.
        """
        chosen = self.use & np.isin(self.rows.channel, list(channels))
        explained = sum((self.explained(e) for e in self.effects()), np.zeros(len(self.use)))
        residuals = self.from_zero(self.rows.values - explained, chosen)
        noise, shift = self.scatters[chosen].T
        squares = (residuals**2 - noise**2) / (noise**2 + shift**2)
        _, group = np.unique(self.set_up[chosen], return_inverse=True)
        means = np.bincount(group, weights=squares) / np.bincount(group)
        return float(np.sqrt(np.max(means, initial=0.0)))

    def from_zero(self, values: FloatArray, chosen: BoolArray) -> FloatArray:
        """Give values of m chosen rows without the zeros that nobody knows, shape (m,).

        Parameters
        ----------
        values : ndarray, shape (n,)
            Of all rows.
        """
        return without_zeros(self.zeros, np.where(chosen, values, np.nan))[chosen]

    def own_channels(self, effect: Effect, term: FoundTerm) -> list[int]:
        """The effect's own components where they were observed by themselves, else all channels."""
        names = self.residuals.rows.channels
        return [c for c in term.channels if names[c] in effect.components] or list(term.channels)

    def is_proxy(self, effect: Effect, term: FoundTerm) -> bool:
        """Whether something unexplained remains where it acts, for which it may stand."""
        return self.is_unexplained_at(self.own_channels(effect, term))

    def is_name_sure(self, effect: Effect, term: FoundTerm) -> bool:
        """Whether held-out visits show the effect, and nothing else that would do the same.

        Of a tied one held-out visits show what it does as well: they say nothing of which it is.
        Of the longest time constant nobody knows whether a still longer one, a drift, or what the
        library lacks would be better.
        """
        return self.doubt_of_name(effect, term) == 0.0

    def doubt_of_name(self, effect: Effect, term: FoundTerm) -> float:
        """Say how probable another name is, from 0 to 1; that of the effect has 1.

        Where only ties speak against it, their weights together; else nobody knows, which is 1.
        """
        kind = kind_of(effect.kind)
        is_doubted = bool(kind.never_sure or kind.doubt(effect) or self.is_slowest(term))
        if term.status is not Status.CONFIRMED or is_doubted or self.is_proxy(effect, term):
            return 1.0
        ties = [
            rival.weight
            for rival in term.rivals
            if rival.tied and not do_the_same(self.hypotheses[rival.key], effect)
        ]
        return min(sum(ties), 1.0)

    def is_slowest(self, term: FoundTerm) -> bool:
        """Say whether a term has the longest time constant that was tried for it."""
        nonlinear = self.hypotheses[term.key].nonlinear
        if nonlinear is None or not nonlinear.is_time or term.theta is None:
            return False
        return term.theta >= SLOWEST * (nonlinear.bounds or nonlinear.grid)[-1]

    def without_refits(self) -> FinishedSearch:
        """Leave the effects that the model has as they are, in what is predicted too."""
        findings = self.findings
        if findings.known is None:
            return self
        return replace(
            self,
            findings=replace(
                findings,
                predicted=findings.predicted - findings.known,
                adopted=findings.adopted - findings.known,
                known=None,
            ),
        )

    def mapped_s(self, effect: Effect) -> list[float]:
        """Say when the maps of an effect's components were measured [s since 1970]."""
        model = self.residuals.projection.model
        each = (times_of_maps(model, self.maps, code) for code in effect.components)
        return [time_s for times_s in each for time_s in times_s]

    def with_ranges(self, effect: Effect) -> Effect:
        """Set beside an effect where these rows show it."""
        return with_ranges(effect, self.residuals.projection, self.use)

    def effect_of(self, term: FoundTerm) -> Effect:
        """Make the effect of one term, new or refitted."""
        hypothesis, expected = self.hypotheses[term.key], self.expected_of(term)
        effect = self.with_ranges(
            hypothesis.fitted(
                Estimate(term.theta, term.theta_error, expected.amplitudes, expected.covariance)
            )
        )
        if effect.valid is None:
            return effect
        bounds = growths(
            effect.valid,
            hypothesis.unit_terms(term.theta),
            expected.amplitudes,
            expected.covariance,
            self.residuals.projection,
            {channel: noise.fitted for channel, noise in self.findings.noise.items()},
        )
        valid = limited_in_time(effect.valid, bounds, goes_on=self.goes_on(term))
        return replace(effect, valid=valid)

    def expected_of(self, term: FoundTerm) -> Shrunk:
        """Give a term's amplitudes with what is expected of that which zeros of set-ups hide."""
        hypothesis = self.hypotheses[term.key]
        if hypothesis.supposed is not None:
            return Shrunk(term.amplitudes, term.covariance)
        return with_expected(
            term.amplitudes,
            term.covariance,
            hypothesis.parts(self.residuals.projection, term.theta),
            self.rows,
            self.use,
            {c: self.noise(c) for c in term.channels},
        )

    def goes_on(self, term: FoundTerm) -> bool:
        """Whether the last of enough set-ups have shown what a growth was foretold to be.

        What one set-up shows may be the instrument's. What settles, or has ended, differs in its
        course from an even growth, ties with a step, or has one found beside it.
        """
        rows_of_term = self.use & np.isin(self.rows.channel, term.channels)
        others = (
            other.family
            for other in self.findings.terms
            if other.place != term.place and set(other.channels) & set(term.channels)
        )
        tied = (rival.family for rival in term.rivals if rival.tied)
        return (
            np.unique(self.rows.visit[rows_of_term]).size >= FEWEST_BLOCKS
            and term.status is Status.CONFIRMED
            and term.forward_slope is not None
            and holds(term.forward_slope, term.likelihood_ratio)
            and all(kind_of(family).over_time is not OverTime.BEGINS for family in {*tied, *others})
        )

    def explained(self, effect: Effect) -> FloatArray:
        """Say what an effect adds to each row, shape (n,) [the channels' units].

        A mistake in the data adds nothing to the model: what is said is what it left in the rows.
        """
        hypothesis = self.hypotheses.get(claim_of(effect).key)
        if hypothesis is not None and hypothesis.supposed is not None:
            return sum(
                (
                    hypothesis.columns(self.residuals.projection, term.theta) @ term.amplitudes
                    for term in self.findings.terms
                    if term.key == hypothesis.key
                ),
                np.zeros(len(self.use)),
            )
        total = sum_of_terms(self.residuals.projection, effect.terms)
        return np.nan_to_num(total, nan=0.0)

    def foretold(self, number: int) -> FloatArray:
        """Say what a term was foretold to add to held-out rows where it acts, shape (n,).

        0 where it was not found without them.
        """
        apart, channels = self.findings.apart, self.findings.terms[number].channels
        acts = np.isin(self.rows.channel, channels)
        return np.zeros(len(acts)) if apart is None else np.nan_to_num(apart[number]) * acts

    def later(self, effect: Effect) -> FloatArray:
        """Say what an effect adds to each row from now on, shape (n,) [the channels' units].

        At these places and in these thermal states, but after all of them: what has begun stays,
        and what has grown is as large as at the last of them.
        """
        last_s = float(self.residuals.rows.times_s[self.use].max())
        terms = [_as_at(term, last_s) for term in effect.terms]
        return np.nan_to_num(sum_of_terms(self.residuals.projection, terms), nan=0.0)

    def later_with(self, rival: Rival) -> FloatArray:
        """Say what a table would need more from now on if a tied rival were true, shape (n,).

        What the rival itself adds, and by how much all other terms are larger beside it. A mistake
        in the data, once it is corrected, adds nothing.
        """
        total = self._later_of(rival.key, rival.theta, rival.amplitudes)
        for term in (*self.findings.terms, *self.findings.refitted):
            if (sizes := rival.beside.get(term.place)) is not None:
                total += self._later_of(term.key, term.theta, sizes)
                total -= self._later_of(term.key, term.theta, term.amplitudes)
        return total

    def _later_of(self, key: str, theta: float | None, sizes: FloatArray | None) -> FloatArray:
        hypothesis = self.hypotheses[key]
        if hypothesis.supposed is not None or sizes is None:
            return np.zeros(len(self.use))
        covariance = np.zeros((sizes.size, sizes.size))
        return self.later(hypothesis.fitted(Estimate(theta, None, sizes, covariance)))

    def hidden_share(self, effect: Effect) -> float:
        """Say which share of an effect's squares zeros of set-ups hide."""
        explained = self.explained(effect)
        size = float(explained[self.use] @ explained[self.use])
        visible = without_zeros([replace(zero, is_first=False) for zero in self.zeros], explained)[
            self.use
        ]
        return 1.0 - float(visible @ visible) / size if size > 0.0 else 0.0


def _as_at(term: Term, time_s: float) -> Term:
    """Let a term that comes with time be, at all times, as it is at one of them."""
    driver = term.driver
    if not isinstance(driver, SinceReference | StepAfter):
        return term
    height = driver.height
    if isinstance(driver, SinceReference):
        height *= (time_s - driver.reference_time_s) / SECONDS_PER_DAY
    return replace(term, driver=StepAfter(-np.inf, height))
