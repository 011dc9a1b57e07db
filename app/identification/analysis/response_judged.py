"""A response held against set-ups that it was not learnt from, as the machine would use it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.stats import wilcoxon

from app.arrays import FloatArray
from app.identification.analysis.response_rows import ResponseRows, SetUp
from app.search.figures import rms
from app.search.response_average import Average, learn_average

AGAIN: Final = 5
"""Steps of learning again, from what all set-ups gave, with one of them left out."""

SURE: Final = 0.01
"""Probability that as many set-ups get better by chance."""

CARES: Final = (1.0, 2.0, 4.0, 8.0)
"""Factors of all variances that are tried in turn, until no set-up held out gets markedly worse."""

LEAST_GAIN: Final = 0.1
"""Share of the root mean square that a response must take away on set-ups held out."""

WORSE_SHARE: Final = 0.1
"""A set-up gets markedly worse if it loses more than this share of itself, and more than
`WORSE_BESIDE_OTHERS` of what the middle one of the set-ups held out is left with."""

WORSE_BESIDE_OTHERS: Final = 0.5
"""What is left of set-ups held out is how far they differ whatever is known of them."""


@dataclass(frozen=True, eq=False)
class Judged:
    """What set-ups were before, and what each is left with by a response of all others.

    Parameters
    ----------
    rows
        The set-ups.
    average
        What all of them together gave.
    doubt
        By how much variances are larger than what all of them together say, as set-ups held out
        show, `care` included.
    care
        By how much they were made larger still, so that no set-up gets markedly worse: 1 where that
        was not needed.
    before, after
        For each set-up its residuals from its zero [the component's unit].
    """

    rows: ResponseRows
    average: Average
    doubt: float
    care: float
    before: list[FloatArray]
    after: list[FloatArray]

    @property
    def before_rms(self) -> float:
        """Root mean square before."""
        return rms(np.concatenate(self.before))

    @property
    def after_rms(self) -> float:
        """Root mean square after, each set-up held out."""
        return rms(np.concatenate(self.after))

    @cached_property
    def each(self) -> tuple[FloatArray, FloatArray]:
        """Root mean square of every set-up before and after."""
        return np.array([rms(v) for v in self.before]), np.array([rms(v) for v in self.after])

    @property
    def worst(self) -> int:
        """The set-up that loses most."""
        before, after = self.each
        return int(np.argmax(after - before))

    @property
    def may_lose(self) -> FloatArray:
        """By how much each set-up may get worse and still count as unharmed."""
        before, after = self.each
        found: FloatArray = np.maximum(
            WORSE_SHARE * before, WORSE_BESIDE_OTHERS * float(np.median(after))
        )
        return found

    @property
    def chance(self) -> float:
        """Probability of as much gain by chance: Wilcoxon's signed ranks of the set-ups."""
        before, after = self.each
        if np.array_equal(before, after):
            return 1.0
        return float(wilcoxon(before**2, after**2, alternative="greater").pvalue)

    @property
    def is_by_chance(self) -> bool:
        """Whether set-ups held out gain no more than they would by chance."""
        is_small = self.after_rms > (1.0 - LEAST_GAIN) * self.before_rms
        return is_small or self.chance > SURE

    @property
    def why_not(self) -> str:
        """Say why it is not to be adopted, empty where it is."""
        before, after = self.each
        if self.is_by_chance:
            return (
                f"set-ups held out go from {self.before_rms:.3g} to {self.after_rms:.3g} "
                "(root mean square), which chance does as well"
            )
        if (after - before > self.may_lose).any():
            at = self.worst
            return (
                f"set-up {self.rows.set_ups[at].label!r}, held out, would go from "
                f"{before[at]:.3g} to {after[at]:.3g}"
            )
        return ""


def judge(rows: ResponseRows) -> Judged:
    """Learn a response, and predict every set-up by that of all others.

    Parameters
    ----------
    rows
        The set-ups; everything is learnt again without each of them, noise and scales included.
    """
    average = learn_average(rows.response, rows.changing)
    learnt = [
        learn_average(
            rows.response.without(i), rows.changing, start=average.priors, iterations=AGAIN
        )
        for i in range(len(rows.set_ups))
    ]
    surprises = np.array(
        [_surprise(one, set_up) for one, set_up in zip(learnt, rows.set_ups, strict=True)]
    )
    found = [_judged(rows, average, learnt, surprises, care) for care in CARES]
    return next((one for one in found if not one.why_not), found[0])


def _judged(
    rows: ResponseRows,
    average: Average,
    learnt: Sequence[Average],
    surprises: FloatArray,
    care: float,
) -> Judged:
    """Predict every set-up by what was learnt without it, with a caution that is `care` larger."""
    before, after = [], []
    for i, held_out in enumerate(rows.set_ups):
        others = [one for j, one in enumerate(rows.set_ups) if j != i]
        doubt = care * _doubt(np.delete(surprises, i))
        driver = replace(rows, set_ups=others).driver(learnt[i], others, doubt)
        told = driver.told_of(held_out.found, held_out.times_s)
        measured = held_out.from_zero(held_out.values)
        left = measured - held_out.from_zero(told.mean * told.factor)
        own = slice(1 if held_out.is_zeroed else 0, None)
        before.append(measured[own])
        after.append(left[own])
    return Judged(rows, average, care * _doubt(surprises), care, before, after)


def _surprise(learnt: Average, held_out: SetUp) -> float:
    """Say how large the square of a set-up's error is beside the variance that was foretold."""
    course = held_out.course
    foretold = learnt.predict(course)
    variance = foretold.learnt**2 + foretold.wander**2 + learnt.noise.white**2
    return float(np.mean((course.values - foretold.mean) ** 2) / np.mean(variance))


def _doubt(surprises: FloatArray) -> float:
    """Say by how much variances are too small: never that they are too large."""
    return max(1.0, float(surprises.mean()))
