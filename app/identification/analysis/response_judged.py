"""A response held against set-ups that it was not learnt from, as the machine would use it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray, rms
from app.geometry.components import COMPONENTS
from app.identification.analysis.found_effect import Cause
from app.identification.analysis.response_rows import ResponseRows
from app.search.response import Fitted, learn_response

SURE: Final = 0.05
"""Probability that as many set-ups get better by chance, at most, where a response is adopted."""

CONFIRMED: Final = 0.01
"""The same of whole records where it is confirmed."""

LEAST_GAIN: Final = 0.1
"""Share of the root mean square that a response must take away on set-ups held out."""

WORSE_SHARE: Final = 0.1
FORETOLD: Final = 2.0
"""A set-up gets markedly worse if it loses more than this share of itself and more than so many of
the standard deviations that were foretold for it: the response is then not what it says."""

TAKES_PART: Final = 0.05
"""Share of what is corrected from which a kind of drivers takes part."""


@dataclass(frozen=True, eq=False)
class Judged:
    """What set-ups were before, and what each is left with by a response of all others.

    Parameters
    ----------
    uncompensated, before, after
        For each set-up what was measured, and its residuals, from its zero [the component's unit].
    foretold : ndarray, shape (m,)
        The error that was foretold for each, one standard deviation.
    """

    rows: ResponseRows
    fitted: Fitted
    uncompensated: Sequence[FloatArray]
    before: Sequence[FloatArray]
    after: Sequence[FloatArray]
    foretold: FloatArray

    @property
    def before_rms(self) -> float:
        """Root mean square before."""
        return rms(np.concatenate(self.before))

    @property
    def after_rms(self) -> float:
        """Root mean square after, each set-up held out."""
        return rms(np.concatenate(self.after))

    @cached_property
    def each(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Root mean square of every set-up uncompensated, before and after."""
        parts = (self.uncompensated, self.before, self.after)
        raw, before, after = (np.array([rms(v) for v in part]) for part in parts)
        return raw, before, after

    @property
    def worst(self) -> int:
        """The set-up that loses most beside what the model leaves of it."""
        _, before, after = self.each
        return int(np.argmax(after - before))

    @property
    def worse(self) -> IntArray:
        """Which set-ups get markedly worse than the model leaves them, or than without it.

        Of those without a zero of their own uncompensated values are of another time.
        """
        raw, before, after = self.each
        is_zeroed = np.array([set_up.is_zeroed for set_up in self.rows.set_ups])
        least = np.where(is_zeroed, np.minimum(raw, before), before)
        may_lose = np.maximum(WORSE_SHARE * least, FORETOLD * self.foretold)
        return np.flatnonzero(after - least > may_lose)

    @property
    def chance(self) -> float:
        """Probability of as much gain by chance: Wilcoxon's signed ranks of the set-ups."""
        return _chance(*self.each[1:])

    @property
    def is_confirmed(self) -> bool:
        """Whether records, each as a whole, hardly gain as much by chance.

        Stretches of one record share its drift and its zero: however many they are, they show
        what one set-up did.
        """
        ups = self.rows.set_ups
        # What was cut from no record is one by itself.
        record = [
            -1 - i if set_up.record is None else set_up.record for i, set_up in enumerate(ups)
        ]
        of = np.unique(record, return_inverse=True)[1]
        count = np.array([v.size for v in self.before])
        _, before, after = self.each
        whole = (
            np.sqrt(np.bincount(of, count * v**2) / np.bincount(of, count)) for v in (before, after)
        )
        return _chance(*whole) <= CONFIRMED

    @property
    def gains_nothing(self) -> bool:
        """Whether set-ups held out are hardly left smaller."""
        return self.after_rms > (1.0 - LEAST_GAIN) * self.before_rms

    @property
    def why_not(self) -> str:
        """Say what held-out set-ups would be left with and why it is not to be adopted, or ''."""
        goes = (
            f"held-out set-ups would go from {self.before_rms:.3g} to {self.after_rms:.3g} (root "
            "mean square)"
        )
        if self.gains_nothing:
            return f"{goes}, which is no gain to speak of"
        if self.chance > SURE:
            return f"{goes}, but so few of them get better that it may be chance"
        if self.worse.size:
            raw, before, after = self.each
            at = int(self.worse[np.argmax((after - np.minimum(raw, before))[self.worse])])
            return (
                f"{goes}, but {self.rows.set_ups[at].label!r} would be left with {after[at]:.3g}, "
                f"where the model leaves {before[at]:.3g} and no correction {raw[at]:.3g}, far "
                "more than was foretold"
            )
        return ""

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Say how much each kind of drivers moves the component in these set-ups.

        Their drivers are collinear: a kind that hardly moves it may still be a cause.
        """
        response, fitted = self.rows.response, self.fitted
        sizes: dict[str, FloatArray] = {}
        for group, part in zip(response.groups, fitted.parts(), strict=True):
            sizes[group.name] = sizes.get(group.name, np.zeros(part.shape)) + part
        total = rms(sum(sizes.values(), np.zeros(len(response.of)))) or 1.0
        states = {c.name for c in self.rows.columns if c.is_of_state}
        causes = []
        for name, part in sorted(sizes.items(), key=lambda item: -rms(item[1])):
            takes_part = rms(part) > TAKES_PART * total
            symbol = COMPONENTS[self.rows.code].unit.symbol
            amount = f"{rms(part):.2g} {symbol} (root mean square)" if takes_part else "not needed"
            causes.append(Cause((name,) if name in states else (), f"{name}: {amount}"))
        return tuple(causes)


def _chance(before: FloatArray, after: FloatArray) -> float:
    if np.array_equal(before, after):
        return 1.0
    from scipy.stats import wilcoxon  # takes half a second to import

    return float(wilcoxon(before**2, after**2, alternative="greater").pvalue)


def judge(rows: ResponseRows) -> Judged:
    """Learn a response, and predict every set-up by that of all others.

    Scales, and how much each set-up counts, stay as they were learnt from all: learnt again
    without each, they left as much of two measured machines (docs/measured-data.md).
    """
    fitted = learn_response(rows.response)
    uncompensated, before, after, foretold = [], [], [], []
    for i, held_out in enumerate(rows.set_ups):
        reach = rows.reach([set_up for j, set_up in enumerate(rows.set_ups) if j != i])
        values = reach.held(held_out.found)
        learnt = fitted.predict(np.nan_to_num(values), held_out.began_s, without=i)
        expected = reach.expected(held_out.found, values, learnt, fitted.scales.noise)
        # Where the record is too long, a live table is left as it is.
        corrected = np.where(np.isnan(values).any(axis=1), 0.0, expected.corrected)
        first = 1 if held_out.is_zeroed else 0
        residuals = held_out.from_zero(held_out.values - corrected)
        uncompensated.append(held_out.from_zero(held_out.measured)[first:])
        before.append(held_out.from_zero(held_out.values)[first:])
        after.append(residuals[first:])
        variance = expected.learnt**2 + expected.wander**2 + fitted.scales.noise.white**2
        foretold.append(float(np.sqrt(np.mean(variance))))
    return Judged(rows, fitted, uncompensated, before, after, np.array(foretold))
