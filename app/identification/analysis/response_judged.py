"""A response held against set-ups that it was not learnt from, as the machine would use it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Final

import numpy as np
from scipy.stats import wilcoxon

from app.arrays import BoolArray, FloatArray, rms
from app.identification.analysis.response_rows import ResponseRows, SetUp
from app.search.jump import held_out_jump
from app.search.response import FREEDOM
from app.search.response_average import Average, learn_average

AGAIN: Final = 5
"""Steps of learning again, from what all set-ups gave, with one of them left out."""

LEAST_SCALE: Final = 1e-9

SURE: Final = 0.01
"""Probability that as many set-ups get better by chance."""

CARES: Final = (1.0, 1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
"""Factors by which caution counts variances, tried in turn until no set-up held out gets markedly
worse, what is not sure going half back to the maps; then the same, going back to the maps alone."""

SETTLED: Final = 50
"""Steps in which the usual surprise settles."""

LEAST_GAIN: Final = 0.1
"""Share of the root mean square that a response must take away on set-ups held out."""

WORSE_SHARE: Final = 0.1
"""A set-up gets markedly worse if it loses more than this share of itself, and more than
`WORSE_BESIDE_OTHERS` of `Judged.typical`."""

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
        show.
    usual
        The same of the usual set-up, without the weight that odd ones have in a mean: from it
        caution begins.
    care
        By how much caution counts variances more than that, so that no set-up gets markedly
        worse: 1 where that was not needed.
    spares_maps
        Whether what is not sure goes back to the maps alone: half of it back to no correction
        would make a set-up markedly worse than the maps leave it.
    typical
        What the middle one of the set-ups held out is left with by the least cautious response.
    uncompensated, before, after
        For each set-up what was measured, and its residuals, from its zero [the component's unit].
    """

    rows: ResponseRows
    average: Average
    doubt: float
    usual: float
    care: float
    spares_maps: bool
    typical: float
    uncompensated: list[FloatArray]
    before: list[FloatArray]
    after: list[FloatArray]

    @property
    def counted(self) -> float:
        """How often caution counts the variances."""
        return self.care * self.usual / self.doubt

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
    def is_worse(self) -> BoolArray:
        """Which set-ups get markedly worse than the model leaves them."""
        return self._is_markedly_worse_than(self.each[0])

    @property
    def is_worse_than_none(self) -> BoolArray:
        """Which set-ups are left markedly worse than they are without any correction."""
        return self._is_markedly_worse_than(np.array([rms(v) for v in self.uncompensated]))

    def _is_markedly_worse_than(self, before: FloatArray) -> BoolArray:
        may_lose = np.maximum(WORSE_SHARE * before, WORSE_BESIDE_OTHERS * self.typical)
        found: BoolArray = self.each[1] - before > may_lose
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
                f"held-out set-ups go from {self.before_rms:.3g} to {self.after_rms:.3g} (root "
                "mean square), which may be chance"
            )
        if self.is_worse.any():
            at = self.worst
            return (
                f"the held-out set-up {self.rows.set_ups[at].label!r} would get worse, from "
                f"{before[at]:.3g} to {after[at]:.3g}"
            )
        return ""


def judge(rows: ResponseRows) -> Judged:
    """Learn a response, and predict every set-up by that of all others.

    It is learnt twice: as if set-ups jumped when the machine is switched on, so that what follows
    within a set-up says more than where it begins, and as if they did not. Of what may be adopted
    the one that leaves less of set-ups held out is taken. How likely the values are cannot decide
    that: it says that set-ups jump, and of machines that do, some are foretold better without.

    Parameters
    ----------
    rows
        The set-ups; everything is learnt again without each of them, noise and scales included.
    """
    may_jump = (False, True) if any(one.is_zeroed for one in rows.set_ups) else (False,)
    found = [_judge(replace(rows, jumps=jumps)) for jumps in may_jump]
    return min(found, key=lambda one: (bool(one.why_not), one.after_rms))


def _judge(rows: ResponseRows) -> Judged:
    """Judge by one kind of noise, with as little caution as will do."""
    average = learn_average(rows.response, rows.changing, unsure=rows.unsure)
    learnt = [
        learn_average(
            rows.response.without(i),
            rows.changing,
            unsure=rows.unsure,
            start=average.priors,
            iterations=AGAIN,
        )
        for i in range(len(rows.set_ups))
    ]
    courses = [one.course for one in rows.set_ups]
    jump = held_out_jump(list(zip(courses, learnt, strict=True)))
    average, *learnt = (one.jumping(jump) for one in (average, *learnt))
    surprises = np.array(
        [_surprise(one, set_up) for one, set_up in zip(learnt, rows.set_ups, strict=True)]
    )
    found: list[Judged] = []
    for spares, care in product((False, True) if rows.maps else (True,), CARES):
        one = _judged(rows, average, learnt, surprises, care, spares)
        # The same measure for all: the more caution leaves, the more would pass as little.
        typical = found[0].typical if found else float(np.median(one.each[1]))
        found.append(replace(one, typical=typical))
        if not found[-1].why_not and not found[-1].is_worse_than_none.any():
            return found[-1]
    # Where maps harm a set-up by themselves, what leaves less of that is still to be had.
    return next((one for one in found if not one.why_not), found[0])


def _judged(
    rows: ResponseRows,
    average: Average,
    learnt: Sequence[Average],
    surprises: FloatArray,
    care: float,
    spares_maps: bool,
) -> Judged:
    """Predict every set-up by what was learnt without it, with a caution that is `care` larger."""
    uncompensated, before, after = [], [], []
    for i, held_out in enumerate(rows.set_ups):
        others = [one for j, one in enumerate(rows.set_ups) if j != i]
        without = np.delete(surprises, i)
        doubt = _doubt(without)
        counted = care * _usual(without) / doubt
        driver = replace(rows, set_ups=others).driver(learnt[i], others, doubt, counted)
        maps = None if spares_maps else held_out.maps
        expected = driver.expected_of(held_out.found, held_out.times_s, maps)
        values = held_out.from_zero(held_out.values)
        own = slice(1 if held_out.is_zeroed else 0, None)
        uncompensated.append(held_out.from_zero(held_out.measured)[own])
        before.append(values[own])
        after.append((values - held_out.from_zero(expected.corrected))[own])
    doubt, usual = _doubt(surprises), _usual(surprises)
    return Judged(
        rows, average, doubt, usual, care, spares_maps, np.nan, uncompensated, before, after
    )


def _surprise(learnt: Average, held_out: SetUp) -> float:
    """Say how large the square of a set-up's error is beside the variance that was foretold."""
    course = held_out.course
    foretold = learnt.predict(course)
    variance = foretold.learnt**2 + foretold.wander**2 + learnt.noise.white**2
    return float(np.mean((course.values - foretold.mean) ** 2) / np.mean(variance))


def _doubt(surprises: FloatArray) -> float:
    """Say by how much variances are too small: never that they are too large."""
    return max(1.0, float(surprises.mean()))


def _usual(surprises: FloatArray) -> float:
    """Say the same of the usual set-up: the scale of Student's t, as odd ones weigh in learning."""
    scale = 1.0
    for _ in range(SETTLED):
        weights = (FREEDOM + 1.0) / (FREEDOM + surprises / scale)
        scale = max(float(np.mean(weights * surprises)), LEAST_SCALE)
    return max(1.0, scale)
