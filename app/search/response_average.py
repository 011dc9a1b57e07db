"""A response averaged over two questions that set-ups leave open.

Whether, and since when, the machine answers differently: for each date a difference of the
response before and after it is estimated beside the response; every date, and no change, counts by
how likely it makes the values (Bayesian model averaging). And whether columns that say one thing
of a whole set-up may be believed: of these there are as many values as set-ups, so that what is
learnt of them from few set-ups may hold in others by luck. A response without them counts too, with
a fixed share: evidence that takes set-ups as exchangeable would give it none.
Between two dates the average is one set of coefficients with one covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray, IntArray, rms
from app.search.response import ITERATIONS, Course, Posterior, Prior, Response
from app.search.wander import Wander

EACH_SIDE: Final = 3
"""So many set-ups must lie before and after a change."""

CHANGE_ITERATIONS: Final = 12
"""Most steps at each date, from what was learnt without a change."""

LEAST_WEIGHT: Final = 0.01
"""What counts less is left out of the average."""

WORTH_LEARNING: Final = 0.1
"""What counts less keeps the noise and scales that it starts from."""

TRUST: Final = 0.5
"""Power of the likelihood by which dates are weighed. Set-ups differ in ways that no column holds,
so that evidence of them taken as exchangeable is worth less than it says: with its whole weight
another date leads without one of the set-ups (Miller and Dunson, Robust Bayesian inference via
coarsening, Journal of the American Statistical Association 114, 2019)."""


FEWER: Final = 0.25
"""Share of the response without the columns that say one thing of a whole set-up: half of it serves
a machine whose set-ups do not begin alike, none one whose set-ups do, and a quarter costs neither
much (docs/measured-data.md, the lathe)."""


class Priors(NamedTuple):
    """What was learnt beside the coefficients: without a change, and with one at each date.

    `fewer` is the same of the response without some columns, where one takes part.
    """

    constant: Prior
    changing: Mapping[float, Prior]
    fewer: Priors | None = None


@dataclass(frozen=True, eq=False)
class Stretch:
    """The response from one date to the next.

    Parameters
    ----------
    until
        When it ends, in the unit of `Course.began`.
    mean : ndarray, shape (p,)
        Coefficients.
    covariance : ndarray, shape (p, p)
        Their covariance, that of not knowing the date included.
    """

    until: float
    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class Average:
    """A response that was learnt.

    Parameters
    ----------
    priors
        What it starts from when it is learnt again from nearly the same set-ups.
    noise
        The noise within a set-up, and its wander, as learnt with all columns; and its jump, where
        set-ups held out have shown that (`app.search.jump`).
    stretches
        The response, from date to date.
    dates
        Date of a change to its weight; None: that there was none.
    weights : ndarray, shape (m,)
        How much each set-up counts.
    misfit
        Minus the logarithm of how likely the values are without a change.
    """

    priors: Priors
    noise: Wander
    stretches: Sequence[Stretch]
    dates: dict[float | None, float]
    weights: FloatArray
    misfit: float

    def at(self, began: float) -> Stretch:
        """Choose the response that holds at a time."""
        return next((s for s in self.stretches if began < s.until), self.stretches[-1])

    def jumping(self, jump: float) -> Average:
        """Say the same with a jump as set-ups begin, of that standard deviation."""
        return replace(self, noise=self.noise._replace(jump=jump))

    def predict(self, course: Course) -> Predicted:
        """Predict a set-up.

        Parameters
        ----------
        course
            Its columns; its values are not looked at.
        """
        own = self.at(course.began)
        columns = course.columns
        learnt = np.einsum("ij,jk,ik->i", columns, own.covariance, columns)
        wander = self.noise.variance(course.times_min, is_zeroed=course.is_zeroed)
        return Predicted(columns @ own.mean, np.sqrt(np.maximum(learnt, 0.0)), np.sqrt(wander))


class Predicted(NamedTuple):
    """A prediction, the standard deviation of what was learnt, and that of the wander."""

    mean: FloatArray
    learnt: FloatArray
    wander: FloatArray

    @property
    def factor(self) -> FloatArray:
        """How much of it to correct: the less, the larger the uncertainty beside it."""
        return caution(self.mean, self.learnt, self.wander)


def caution(mean: FloatArray, learnt: FloatArray, wander: FloatArray) -> FloatArray:
    """Say which share of a correction to apply: m² / (m² + s²), 0 where nothing is to be done.

    Examples
    --------
    >>> caution(np.array([3.0, 3.0, 0.0]), np.array([0.0, 3.0, 0.0]), np.zeros(3)).tolist()
    [1.0, 0.5, 0.0]
    """
    square = mean**2
    total = square + learnt**2 + wander**2
    return np.divide(square, total, out=np.zeros_like(square), where=total > 0.0)


def cautious(
    mean: FloatArray, maps: FloatArray, learnt: FloatArray, wander: FloatArray
) -> FloatArray:
    """Say what to correct beside the maps: what is unsure goes half back to them, half to nothing.

    The result should harm neither a user who corrects nothing nor one who corrects by the maps
    alone. One caution applies to what is corrected beside the maps, the other to all that is
    corrected since the start, maps included; this is their mean.

    Parameters
    ----------
    mean, learnt, wander : ndarray, shape (n,)
        What was learnt beside the maps, and standard deviations (`Predicted`).
    maps : ndarray, shape (n,)
        What the maps say has changed since the start; 0: caution is towards the maps alone.

    Examples
    --------
    >>> learnt, wander = np.full(3, 2.0), np.zeros(3)
    >>> cautious(np.array([2.0, 2.0, -2.0]), np.array([0.0, 2.0, 2.0]), learnt, wander).tolist()
    [1.0, 1.1, -1.5]
    """
    whole = maps + mean
    beside = mean * caution(mean, learnt, wander)
    found: FloatArray = 0.5 * (beside + whole * caution(whole, learnt, wander) - maps)
    return found


def learn_average(
    response: Response,
    changing: IntArray,
    *,
    unsure: Sequence[int] = (),
    start: Priors | None = None,
    iterations: int = ITERATIONS,
) -> Average:
    """Learn a response, averaged over a date of change and over whether some groups take part.

    Parameters
    ----------
    response
        The set-ups.
    changing : ndarray, shape (c,)
        Columns whose coefficients may have changed at a date; none: no change is considered.
    unsure
        Groups of columns, none of them changing, that a share of the average does without.
    start
        Where learning begins.
    iterations
        Most steps.
    """
    whole = _learnt(response, changing, start, iterations)
    kept = np.flatnonzero(~np.isin(response.groups, list(unsure)))
    if not 0 < kept.size < response.groups.size:
        return whole
    fewer = _learnt(
        response.without_groups(unsure),
        np.searchsorted(kept, changing),
        start.fewer if start else None,
        iterations,
    )
    return with_fewer(whole, fewer, kept)


def with_fewer(whole: Average, fewer: Average, kept: IntArray) -> Average:
    """Give the average of a response and of one with fewer columns.

    Parameters
    ----------
    whole, fewer
        What was learnt of the same set-ups.
    kept : ndarray, shape (q,)
        The columns that both have.
    """
    fold = np.zeros((whole.stretches[0].mean.size, kept.size))
    fold[kept, np.arange(kept.size)] = 1.0
    stretches = []
    for until in sorted({s.until for s in (*whole.stretches, *fewer.stretches)}):
        a, b = (one.at(np.nextafter(until, -np.inf)) for one in (whole, fewer))
        each = (a, Stretch(until, fold @ b.mean, fold @ b.covariance @ fold.T))
        shares = zip((1.0 - FEWER, FEWER), each, strict=True)
        stretches.append(_mixed(until, [(w, s.mean, s.covariance) for w, s in shares]))
    return replace(
        whole,
        priors=whole.priors._replace(fewer=fewer.priors),
        stretches=stretches,
        dates={
            date: (1.0 - FEWER) * whole.dates.get(date, 0.0) + FEWER * fewer.dates.get(date, 0.0)
            for date in dict.fromkeys((*whole.dates, *fewer.dates))
        },
        weights=(1.0 - FEWER) * whole.weights + FEWER * fewer.weights,
    )


def _learnt(
    response: Response, changing: IntArray, start: Priors | None, iterations: int
) -> Average:
    """Learn a response, averaged over a date of change alone."""
    began = np.array([course.began for course in response.courses])
    constant = response.learn(start.constant if start else None, iterations).prior
    options = [_Option(None, -response.misfit(constant), constant)]
    dates = _dates(began) if changing.size else []
    for date in dates:
        one = response.with_change(changing, _side(began, date))
        prior = start.changing.get(date) if start else None
        if prior is None:
            size = rms(constant.scales[response.groups[changing]])
            prior = Prior(constant.noise, np.append(constant.scales, size))
            prior = one.learn(prior, CHANGE_ITERATIONS).prior
        options.append(_Option(date, -one.misfit(prior), prior))
    if start is not None:
        worth = _shares(options) >= WORTH_LEARNING
        options = [
            _learnt_again(response, changing, option, iterations) if is_worth else option
            for option, is_worth in zip(options, worth.tolist(), strict=True)
        ]
    return _averaged(response, changing, options)


class _Option(NamedTuple):
    """A date, or None for no change; how likely it makes the values; what it starts from."""

    date: float | None
    log_likelihood: float
    prior: Prior


def _learnt_again(
    response: Response, changing: IntArray, option: _Option, iterations: int
) -> _Option:
    """Go on learning at a date."""
    if option.date is None:
        return option
    began = np.array([course.began for course in response.courses])
    one = response.with_change(changing, _side(began, option.date))
    prior = one.learn(option.prior, iterations).prior
    gained = one.misfit(option.prior) - one.misfit(prior)
    return _Option(option.date, option.log_likelihood + gained, prior)


def _shares(options: Sequence[_Option]) -> FloatArray:
    """Give the share of each date in the average; 0 for what hardly counts.

    Before anything is measured no change counts as much as all dates together.
    """
    none = float(np.log(max(len(options) - 1, 1)))
    logs = np.array([TRUST * o.log_likelihood + (none if o.date is None else 0) for o in options])
    shares = np.exp(logs - logs.max())
    shares = np.where(shares < LEAST_WEIGHT * shares.sum(), 0.0, shares)
    found: FloatArray = shares / shares.sum()
    return found


def _dates(began: FloatArray) -> list[float]:
    """List the dates of change that leave enough set-ups to either side."""
    ordered = np.sort(began)
    found = np.unique(ordered[EACH_SIDE : len(ordered) - EACH_SIDE + 1])
    return found.tolist() if found.size > 1 else []


def _averaged(response: Response, changing: IntArray, options: Sequence[_Option]) -> Average:
    shares = _shares(options)
    began = np.array([course.began for course in response.courses])
    parts, weights = [], np.zeros(began.size)
    for option, share in zip(options, shares.tolist(), strict=True):
        if share:
            one, date = response, option.date
            if date is not None:
                one = response.with_change(changing, _side(began, date))
            posterior = one.posterior(option.prior)
            parts.append((share, date, posterior))
            weights += share * posterior.weights
    heaviest = options[int(np.argmax(shares))]
    return Average(
        Priors(
            options[0].prior,
            {option.date: option.prior for option in options if option.date is not None},
        ),
        heaviest.prior.noise,
        _stretches(parts, changing, response.groups.size),
        {date: share for share, date, _ in parts},
        weights,
        -options[0].log_likelihood,
    )


def _side(began: FloatArray, date: float) -> FloatArray:
    """Give half of a change to either side of its date."""
    return np.where(began >= date, 0.5, -0.5)


def _stretches(
    parts: Sequence[tuple[float, float | None, Posterior]], changing: IntArray, p: int
) -> list[Stretch]:
    dates = sorted({date for _, date, _ in parts if date is not None})
    found = []
    for until in (*dates, np.inf):
        each = []
        for share, date, posterior in parts:
            fold = np.eye(p, posterior.mean.size)
            if date is not None:
                fold[changing, p + np.arange(changing.size)] = 0.5 if date < until else -0.5
            each.append((share, fold @ posterior.mean, fold @ posterior.covariance @ fold.T))
        found.append(_mixed(float(until), each))
    return found


def _mixed(until: float, each: Sequence[tuple[float, FloatArray, FloatArray]]) -> Stretch:
    """Mix coefficients by their shares, each with its covariance, into one stretch."""
    mean = np.sum([w * m for w, m, _ in each], axis=0)
    spread = [w * (c + np.outer(m - mean, m - mean)) for w, m, c in each]
    return Stretch(until, mean, np.sum(spread, axis=0))
