"""Many collinear drivers as one response: alike in all set-ups, equal in none.

What the model leaves of set-up i, counted from its zero where it has one, is

    y_i(t) = Φ_i(t) [μ + Σ_g W_g b_g(i)] + wander_i(t) + white noise,
    b_g(i) = s_g [common_g + κ ν drift_g(day_i) + κ ρ own_g,i],    each entry normal(0, 1),
    cov[drift(d), drift(d')] = exp(−|d − d'| / l),

with drivers Φ in natural units (a kelvin, a micrometre of the maps) and the directions W_g in which
the coefficients of group g may lie. What another set-up adds of its own is never known beforehand.
So a driver beyond what was seen makes a prediction unsure, and no rule has to say so; and of few
set-ups little is believed. Set-ups on days near each other have more in common, which is what a
machine that changes leaves of an average.

Coefficients of collinear drivers are far larger than what they do together, since they cancel. κ²,
the share of the values' variance in what s_g common_g alone would make, takes that off: ν and ρ are
shares of the response.

The logarithms of s_g, ν, l, ρ and the noise maximise the marginal likelihood times the weak priors
below (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.7 and 5.4).
A set-up unlike all others counts less: its own part and its noise have Student's t, as a scale
mixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import minimize
from scipy.special import ndtr

from app.arrays import FloatArray, IntArray, rms
from app.search.priors import (
    FREEDOM,
    HARM,
    RESPONSE_DRIFT,
    RESPONSE_DRIFT_SPAN,
    RESPONSE_NOISE,
    RESPONSE_OWN,
    START_SHARE,
)
from app.search.wander import Wander

STEPS, MORE_STEPS = 40, 20
"""Most steps of learning, and of learning on with weights."""

WITHIN: Final = (7.0, 5.0)
"""A logarithm stays within so much below and above where it begins."""

HALVINGS: Final = 30
"""A correction is found to a thousand millionth of the range in which it lies."""


@dataclass(frozen=True, eq=False)
class Course:
    """One set-up.

    Parameters
    ----------
    times_min : ndarray, shape (n,) [min]
        When; of a zeroed set-up since its zero, which is not among the rows.
    columns : ndarray, shape (n, p)
        The drivers; of a zeroed set-up what they differ by from its zero.
    values : ndarray, shape (n,)
        What is to be explained, likewise.
    is_zeroed
        Whether an observation at time 0 was subtracted.
    began
        When the set-up began, in any unit.
    record
        Set-ups with one number are parts of one record: what it has of its own is common to them,
        and the wander goes on, their times being those of the record. None: a record by itself.
    """

    times_min: FloatArray
    columns: FloatArray
    values: FloatArray
    is_zeroed: bool
    began: float = 0.0
    record: int | None = None


@dataclass(frozen=True, eq=False)
class Group:
    """Directions of the coefficients that share one scale.

    Parameters
    ----------
    directions : ndarray, shape (p, q)
        Each a column.
    as_large_as : ndarray, shape (p, r)
        Directions of the group whose size, explaining everything alone, is its unit too.
    unit
        That size where it is known beforehand.
    """

    name: str
    directions: FloatArray
    as_large_as: FloatArray
    unit: float | None = None


class Scales(NamedTuple):
    """What is learnt beside the coefficients: s_g, ν, l, ρ and the noise."""

    groups: FloatArray
    drift: float
    drift_span: float
    own: float
    noise: Wander


class Predicted(NamedTuple):
    """A prediction of n rows, and the standard deviation of what was learnt, shape (n,) each."""

    mean: FloatArray
    learnt: FloatArray


@dataclass(frozen=True, eq=False)
class Response:
    """Set-ups whose values many drivers are to explain together.

    Parameters
    ----------
    expected : ndarray, shape (p,)
        Prior mean μ of the coefficients.
    weights : ndarray, shape (m,), or None
        How much each set-up counts; None: all as one.
    """

    courses: Sequence[Course]
    groups: Sequence[Group]
    expected: FloatArray
    weights: FloatArray | None = None

    def covariance(self, scales: Scales) -> FloatArray:
        """Give the covariance of all rows, shape (n, n)."""
        shared = np.tensordot(scales.groups**2, self._grams, 1)
        result: FloatArray = shared * (1.0 + self.share(scales.groups) * self._unlike(scales))
        for rows, times_min, is_zeroed in self._blocks:
            noise = scales.noise.covariance(times_min, is_zeroed=is_zeroed)
            result[rows, rows] += self._same[rows, rows] * noise
        return result

    def share(self, groups: FloatArray) -> float:
        """Say which share of the variance of s_g common_g is the response's, κ²."""
        return self._size**2 / (self._size**2 + float(groups**2 @ self._levels))

    def scales(self, logarithms: FloatArray) -> Scales:
        """Read the parameters from their logarithms, in the order of `Scales`."""
        n = len(self.groups)
        values = np.exp(logarithms)
        drift, span, own, *noise = values[n:].tolist()
        return Scales(values[:n], drift, span, own, Wander(*noise))

    def misfit_and_slope(self, logarithms: FloatArray) -> tuple[float, FloatArray]:
        """Give minus the logarithm of likelihood times priors, constants aside, and its slopes.

        With α = K⁻¹ y the slope of the first is ½ tr[(K⁻¹ − αα') dK], of which `half` is the
        first factor and every dK an elementwise product of the parts of K.
        """
        n, scales = len(self.groups), self.scales(logarithms)
        covariance = self.covariance(scales)
        # The slope asks for every element of the inverse, and of the factor LAPACK makes it for
        # twice what the factor itself has cost. A step to where K is not positive definite is
        # refused by a large value.
        lower, failed = lapack.dpotrf(covariance, lower=1, overwrite_a=1)
        if failed:
            return 1e10, np.zeros(logarithms.size)
        inverse = np.tril(lapack.dpotri(lower, lower=1)[0])
        inverse = inverse + np.tril(inverse, -1).T
        alpha = inverse @ self._values
        value = 0.5 * float(self._values @ alpha) + float(np.log(np.diag(lower)).sum())
        half = 0.5 * (inverse - np.outer(alpha, alpha))
        slope = self._slopes(scales, half)
        # The prior of s is exponential; as a density of ln s it is s exp(−s/unit): hence s/unit −
        # ln s.
        shares = scales.groups / self._units
        off = (logarithms - self.start)[n:] / self._spread
        return (
            value + float((shares - logarithms[:n]).sum()) + 0.5 * float(off @ off),
            slope + np.concatenate([shares - 1.0, off / self._spread]),
        )

    def _slopes(self, scales: Scales, weights: FloatArray) -> FloatArray:
        """Give the sum of weights times the covariance's slope in each logarithm, shape (h,)."""
        squares, share = scales.groups**2, self.share(scales.groups)
        shared = np.tensordot(squares, self._grams, 1)
        unlike = self._unlike(scales)
        by_shared = weights * shared
        alike = (weights * (1.0 + share * unlike)).ravel()
        of_groups = self._grams.reshape(len(squares), -1) @ alike
        # κ² = v/(v + Σ s² level), v the values' variance, falls as a scale grows: in ln s_g its
        # slope is −2 s_g² level_g κ⁴/v.
        of_share = float(np.vdot(by_shared, unlike)) * (share / self._size) ** 2
        by_shared *= share
        by_drift = by_shared * scales.drift**2 * np.exp(-self._apart / scales.drift_span)
        of_noise = np.zeros(len(scales.noise))
        for rows, times_min, is_zeroed in self._blocks:
            block = weights[rows, rows] * self._same[rows, rows]
            slopes = scales.noise.slopes(times_min, is_zeroed=is_zeroed)
            of_noise += [np.vdot(block, slope) for slope in slopes]
        return np.concatenate(
            [
                2.0 * squares * (of_groups - of_share * self._levels),
                [2.0 * by_drift.sum(), np.vdot(by_drift, self._apart) / scales.drift_span],
                [2.0 * scales.own**2 * np.vdot(by_shared, self._same)],
                of_noise,
            ]
        )

    def learn(self, start: FloatArray | None = None, steps: int = STEPS) -> Fitted:
        """Find the scales that make the values most likely.

        Parameters
        ----------
        start : ndarray, shape (h,)
            Logarithms from which to begin; None: where the priors are.
        """
        low, high = WITHIN
        bounds = np.column_stack([self.start - low, self.start + high])
        result = minimize(  # type: ignore[call-overload]
            self.misfit_and_slope,
            self.start if start is None else start,
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": steps},
        )
        return Fitted(self, result.x)

    @cached_property
    def start(self) -> FloatArray:
        """Logarithms of where learning begins, which are the modes of the priors but of s_g."""
        size = self._size
        days = np.array([course.began for course in self.courses])
        span = max(float(np.ptp(days)) * RESPONSE_DRIFT_SPAN[0], 1e-9)
        # Of the noise, all but the third and the fifth are sizes.
        noise = [at if i in (2, 4) else at * size for i, (at, _) in enumerate(RESPONSE_NOISE)]
        result: FloatArray = np.log(
            [*(START_SHARE * self._units), RESPONSE_DRIFT[0], span, RESPONSE_OWN[0], *noise],
        )
        return result

    @cached_property
    def days(self) -> FloatArray:
        """When the set-up of each row began, shape (n,)."""
        return np.array([course.began for course in self.courses])[self.of]

    @cached_property
    def of(self) -> IntArray:
        """The set-up of each row, shape (n,)."""
        sizes = [len(course.values) for course in self.courses]
        return np.repeat(np.arange(len(sizes)), sizes)

    @cached_property
    def columns(self) -> FloatArray:
        """The drivers of all rows, shape (n, p)."""
        return np.concatenate([course.columns for course in self.courses])

    @cached_property
    def _values(self) -> FloatArray:
        return np.concatenate([c.values - c.columns @ self.expected for c in self.courses])

    @cached_property
    def _size(self) -> float:
        return rms(self._values) or 1.0

    @cached_property
    def _levels(self) -> FloatArray:
        """Mean variance of all rows by each group at scale 1, shape (G,)."""
        return np.array([np.diag(gram).mean() for gram in self._grams])

    def _unlike(self, scales: Scales) -> FloatArray:
        """Say what rows have in common beside what all have, at κ = 1, shape (n, n)."""
        drift = scales.drift**2 * np.exp(-self._apart / scales.drift_span)
        result: FloatArray = drift + scales.own**2 * self._same
        return result

    @cached_property
    def _grams(self) -> FloatArray:
        parts = [self.columns @ group.directions for group in self.groups]
        return np.array([part @ part.T for part in parts])

    @cached_property
    def _units(self) -> FloatArray:
        """Each group's scale that would explain everything alone, shape (G,)."""
        size = self._size
        alone = [np.sqrt(((self.columns @ g.as_large_as) ** 2).sum(1).mean()) for g in self.groups]
        return np.array(
            [
                size / max(float(largest_swing), 1e-9) if group.unit is None else group.unit
                for group, largest_swing in zip(self.groups, alone, strict=True)
            ]
        )

    @cached_property
    def _spread(self) -> FloatArray:
        priors = (RESPONSE_DRIFT, RESPONSE_DRIFT_SPAN, RESPONSE_OWN, *RESPONSE_NOISE)
        return np.array([spread for _, spread in priors])

    @cached_property
    def _apart(self) -> FloatArray:
        return np.abs(self.days[:, None] - self.days)

    @cached_property
    def _inverse_weights(self) -> FloatArray:
        each = np.ones(len(self.courses)) if self.weights is None else 1.0 / self.weights
        result: FloatArray = each[self.of]
        return result

    @cached_property
    def _record(self) -> IntArray:
        """The record of each row, shape (n,)."""
        each = [-1 - i if c.record is None else c.record for i, c in enumerate(self.courses)]
        return np.array(each)[self.of]

    @cached_property
    def _same(self) -> FloatArray:
        """Of rows of one record the inverse of their weight, else 0, shape (n, n)."""
        root = np.sqrt(self._inverse_weights)
        result: FloatArray = (self._record[:, None] == self._record) * np.outer(root, root)
        return result

    @cached_property
    def _blocks(self) -> list[tuple[slice, FloatArray, bool]]:
        """Rows of each record, in which the wander goes on, their times, and whether it is zeroed.

        Records whose rows alternate are taken as several.
        """
        times_min = np.concatenate([course.times_min for course in self.courses])
        edges = np.flatnonzero(np.diff(self._record)) + 1
        bounds = [0, *edges.tolist(), len(times_min)]
        return [
            (slice(begin, end), times_min[begin:end], self.courses[self.of[begin]].is_zeroed)
            for begin, end in pairwise(bounds)
        ]


class Fitted:
    """A response with its scales: what it says of other set-ups.

    Parameters
    ----------
    logarithms
        Of its scales.
    """

    def __init__(self, response: Response, logarithms: FloatArray) -> None:
        self.response = response
        self.logarithms = logarithms
        self.scales = response.scales(logarithms)
        #: Prior covariance of the coefficients that all set-ups have in common, shape (p, p).
        self.prior = sum(
            (
                scale**2 * group.directions @ group.directions.T
                for scale, group in zip(self.scales.groups, response.groups, strict=True)
            ),
            np.zeros((response.expected.size,) * 2),
        )
        self._inverse = np.linalg.inv(response.covariance(self.scales))
        self._alpha = self._inverse @ response._values
        self._share = response.share(self.scales.groups)
        self._of_new = 1.0 + self._share * (self.scales.drift**2 + self.scales.own**2)

    def predict(self, columns: FloatArray, began: float, without: int | None = None) -> Predicted:
        """Predict what drivers do in a new set-up.

        Parameters
        ----------
        columns : ndarray, shape (k, p)
            The drivers.
        without
            Number of a set-up that is left out; scales stay as they were learnt with it.
        """
        rows = self.response
        cross = columns @ self.prior @ rows.columns.T * self._near(began)
        alpha, inverse = self._alpha, self._inverse
        if without is not None:
            # The inverse without some rows and columns follows from that with them.
            out = rows.of == without
            cross = np.where(out, 0.0, cross)
            by = np.linalg.solve(inverse[np.ix_(out, out)], inverse[out])
            alpha = alpha - by.T @ alpha[out]
            inverse = inverse - inverse[:, out] @ by
        prior = np.einsum("ij,jk,ik->i", columns, self.prior, columns) * self._of_new
        variance = prior - np.einsum("ij,ij->i", cross @ inverse, cross)
        return Predicted(
            columns @ rows.expected + cross @ alpha, np.sqrt(np.maximum(variance, 0.0))
        )

    def coefficients(self, began: float) -> FloatArray:
        """Give the mean of a new set-up's coefficients, shape (p,)."""
        by_rows = self.response.columns.T @ (self._alpha * self._near(began))
        result: FloatArray = self.response.expected + self.prior @ by_rows
        return result

    def common(self) -> FloatArray:
        """Give the same of a set-up on a day far from all others."""
        result: FloatArray = self.prior @ (self.response.columns.T @ self._alpha)
        return self.response.expected + result

    def parts(self) -> FloatArray:
        """Give what each group adds to each row in what is learnt, shape (G, n)."""
        rows = self.response
        near = np.array([self._near(day) for day in np.unique(rows.days)])
        which = np.unique(rows.days, return_inverse=True)[1]
        squares = self.scales.groups[:, None, None] ** 2
        result: FloatArray = (squares * rows._grams * near[which]) @ self._alpha
        return result

    def covariance(self, began: float) -> FloatArray:
        """Give the covariance of a new set-up's coefficients, shape (p, p)."""
        near = self.response.columns * self._near(began)[:, None]
        by = self.prior @ near.T
        result: FloatArray = self._of_new * self.prior - by @ self._inverse @ by.T
        return result

    def _near(self, began: float) -> FloatArray:
        """Say what a set-up has in common with each row, beside that of two alike, shape (n,)."""
        apart = np.abs(self.response.days - began)
        drift = self.scales.drift**2 * np.exp(-apart / self.scales.drift_span)
        result: FloatArray = 1.0 + self._share * drift
        return result

    def weighted(self) -> Response:
        """Let set-ups that the others foretell badly count less.

        One set-up's error is taken as a single number, its mean square beside the variance that
        the others foretell: rows of one set-up err together.
        """
        response, noise = self.response, self.scales.noise
        surprise = []
        for i, course in enumerate(response.courses):
            foretold = self.predict(course.columns, course.began, without=i)
            wander = noise.covariance(course.times_min, is_zeroed=course.is_zeroed)
            variance = np.mean(foretold.learnt**2 + np.diag(wander))
            surprise.append(np.mean((course.values - foretold.mean) ** 2) / variance)
        # What the scale mixture of Student's t expects of a precision after one deviation of this
        # square, in units of its variance.
        weights = (FREEDOM + 1.0) / (FREEDOM + np.array(surprise))
        return replace(response, weights=weights)


def learn_response(response: Response) -> Fitted:
    """Learn the scales, weigh the set-ups, and learn on."""
    fitted = response.learn()
    if len(response.courses) > 2:  # of two, nobody knows which is the odd one
        fitted = fitted.weighted().learn(fitted.logarithms, MORE_STEPS)
        fitted = Fitted(fitted.weighted(), fitted.logarithms)
    return fitted


def least_harm(mean: FloatArray, sd: FloatArray, *instead: FloatArray) -> FloatArray:
    """Choose the correction whose expected loss is least, shape (n,).

    For y normal(mean, sd) and what would be corrected instead, r, the loss of correcting c is

        E[(y − c)²] + h mean over r of E[(y − c)² − (y − r)²]₊,

    so that harm beside any of them counts twice (h = `HARM`). It is convex in c, with a bend at
    each r: what is not sure stays there. The squares cross at (c + r)/2, from where with the normal
    distribution Φ and density φ the slope of the last term is 2 [(c − mean) Φ(z) + sd φ(z)] for
    c > r, z = ((c + r)/2 − mean)/sd, and likewise on the other side.

    Parameters
    ----------
    mean, sd : ndarray, shape (n,)
        What is expected.
    instead : ndarray, shape (n,)
        What would be corrected otherwise, such as nothing, or the maps alone.

    Examples
    --------
    >>> sd = np.array([0.0, 1.0, 3.0, 30.0])
    >>> least_harm(np.full(4, 3.0), sd, np.zeros(4)).round(1).tolist()
    [3.0, 2.9, 2.2, 0.0]
    """
    sd = np.maximum(sd, 1e-9)
    low = np.minimum.reduce([mean, *instead])
    high = np.maximum.reduce([mean, *instead])
    for _ in range(HALVINGS):
        c = 0.5 * (low + high)
        slope = c - mean
        for r in instead:
            z = (0.5 * (c + r) - mean) / sd
            side = np.where(c > r, 1.0, -1.0)
            density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
            harm = (c - mean) * ndtr(side * z) + side * sd * density
            slope = slope + HARM / len(instead) * harm
        low, high = np.where(slope > 0.0, low, c), np.where(slope > 0.0, c, high)
    result: FloatArray = 0.5 * (low + high)
    return result
