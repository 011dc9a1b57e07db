"""Many collinear drivers as one response: coefficients shrunk by groups, wander in time.

The values of a set-up are y = X β + wander + noise, the columns X in natural units (a kelvin, one
unit of a state) and β_j normal about zero with one standard deviation for each group of columns.
These, and the noise, are what makes the values most likely (empirical Bayes; Rasmussen and
Williams, Gaussian Processes for Machine Learning, 2006, section 2.7 and chapter 5). A set-up that
does not fit counts less (Student's t with four degrees of freedom, as a scale mixture).

Normal equations are kept for each set-up, so that leaving one out is a subtraction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from app.arrays import BoolArray, FloatArray, IntArray, rms
from app.search.wander import Wander

FREEDOM: Final = 4.0
"""Degrees of freedom of Student's t by which odd set-ups count less."""

ROUNDS: Final = 6
"""Rounds of weighting: the weights settle within a hundredth."""

ITERATIONS: Final = 30
WITHIN: Final = 8.0
"""A parameter stays within so many e-foldings of where it begins."""

WHITE_SHARE, WANDER_SHARE = 0.04, 0.2
"""Where noise and each wander begin: shares of the size of all values."""

ROUGH_MIN, SMOOTH_MIN = 300.0, 200.0
"""Where the wanders' time constants begin [min]."""

NOISE_SPREAD: Final = (1.0, 1.0, 0.7, 1.0, 0.5, 1.0)
GROUP_SPREAD: Final = 2.0
"""How freely the logarithms may move from where they begin: one standard deviation of each."""


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
        When the set-up began, in any unit that orders set-ups.
    """

    times_min: FloatArray
    columns: FloatArray
    values: FloatArray
    is_zeroed: bool
    began: float = 0.0


class Prior(NamedTuple):
    """What was learnt beside the coefficients.

    `noise` is the noise; `scales` the standard deviation of the coefficients of each group.
    """

    noise: Wander
    scales: FloatArray


class Normal(NamedTuple):
    """Whitened normal equations of m set-ups.

    `gram` has shape (m, p, p), `right` (m, p), `square`, `log_determinant` and `rows` (m,).
    """

    gram: FloatArray
    right: FloatArray
    square: FloatArray
    log_determinant: FloatArray
    rows: IntArray

    def without(self, left_out: int) -> Normal:
        """Leave one set-up out."""
        kept = np.arange(len(self.rows)) != left_out
        return Normal(*(part[kept] for part in self))


class Posterior(NamedTuple):
    """Coefficients, shape (p,), their covariance (p, p), and the weight of each set-up (m,)."""

    mean: FloatArray
    covariance: FloatArray
    weights: FloatArray


class Learnt(NamedTuple):
    """A prior, and minus the logarithm of how likely it makes the values."""

    prior: Prior
    misfit: float


@dataclass(frozen=True, eq=False)
class Response:
    """Set-ups whose values many drivers are to explain together.

    Parameters
    ----------
    courses
        The set-ups.
    groups : ndarray, shape (p,)
        Number of the group of each column, from 0.
    jumps
        Whether zeroed set-ups may jump as they begin.
    """

    courses: Sequence[Course]
    groups: IntArray
    jumps: bool = False

    def begin(self) -> Prior:
        """Choose where learning begins: each group of columns could explain everything alone."""
        values = np.concatenate([c.values for c in self.courses])
        columns = np.concatenate([c.columns for c in self.courses])
        size = rms(values) or 1.0
        square = np.bincount(self.groups, np.mean(columns**2, axis=0))
        scales = size / np.sqrt(np.where(square > 0.0, square, 1.0))
        noise = Wander(
            WHITE_SHARE * size, WANDER_SHARE * size, ROUGH_MIN, WANDER_SHARE * size, SMOOTH_MIN
        )
        if self.jumps:
            noise = noise._replace(jump=WANDER_SHARE * size)
        return Prior(noise, scales)

    def normal(self, noise: Wander) -> Normal:
        """Whiten every set-up.

        Parameters
        ----------
        noise
            The noise within a set-up.
        """
        inverse, log_determinant = self._inverse(noise)
        by_columns = inverse @ self._rows.columns
        by_values = np.einsum("rij,rj->ri", inverse, self._rows.values)
        return Normal(
            self._rows.columns.transpose(0, 2, 1) @ by_columns,
            np.einsum("rij,ri->rj", self._rows.columns, by_values),
            np.einsum("ri,ri->r", self._rows.values, by_values),
            log_determinant,
            np.array([len(c.values) for c in self.courses]),
        )

    def misfit(self, prior: Prior, normal: Normal | None = None) -> float:
        """Give minus the logarithm of the marginal likelihood, constants aside.

        Parameters
        ----------
        prior
            Noise and scales.
        normal
            The whitened set-ups, where they are known already.
        """
        return misfit(self.normal(prior.noise) if normal is None else normal, self._scale(prior))

    def learn(self, start: Prior | None = None, iterations: int = ITERATIONS) -> Learnt:
        """Find the noise and the groups' scales that make the values most likely.

        Parameters
        ----------
        start
            Where to begin; without it, where `begin` says.
        iterations
            Most steps.

        Returns
        -------
        Learnt
            Its misfit counts the weak prior on the parameters' logarithms too.
        """
        middle = _logarithms(self.begin())
        groups = int(self.groups.max()) + 1
        of_noise = NOISE_SPREAD[: middle.size - groups]
        spread = np.concatenate([of_noise, np.full(groups, GROUP_SPREAD)])

        def objective(logs: FloatArray) -> tuple[float, FloatArray]:
            value, slope = self.misfit_and_slope(_prior(logs, groups))
            off = (logs - middle) / spread
            return value + 0.5 * float(off @ off), slope + off / spread

        found = minimize(
            objective,
            middle if start is None else _logarithms(start),
            jac=True,
            method="L-BFGS-B",
            bounds=[(m - WITHIN, m + WITHIN) for m in middle],
            options={"maxiter": iterations},
        )
        return Learnt(_prior(found.x, groups), float(found.fun))

    def posterior(
        self, prior: Prior, normal: Normal | None = None, *, weighs: bool = True
    ) -> Posterior:
        """Estimate the coefficients.

        Parameters
        ----------
        prior
            Noise and scales.
        normal
            The whitened set-ups, where they are known already, or some of them.
        weighs
            Whether set-ups that do not fit count less.
        """
        normal = self.normal(prior.noise) if normal is None else normal
        scale = self._scale(prior)
        weights = np.ones(len(normal.rows))
        for _ in range(ROUNDS if weighs else 1):
            factor = cho_factor(_scaled(np.tensordot(weights, normal.gram, 1), scale))
            mean = scale * cho_solve(factor, scale * (weights @ normal.right))
            left = normal.square - 2.0 * normal.right @ mean
            left = left + (normal.gram @ mean) @ mean
            weights = (FREEDOM + normal.rows) / (FREEDOM + left)
        inverse = cho_solve(factor, np.eye(scale.size))
        return Posterior(mean, scale[:, None] * inverse * scale, weights)

    def misfit_and_slope(self, prior: Prior) -> tuple[float, FloatArray]:
        """Give the misfit and its slope in the logarithms of the noise and of the scales.

        With the posterior β, Σ and α = K⁻¹(y − Xβ), that in a group's scale s is
        Σ_j 1 − (Σ_jj + β_j²) / s², and that in a parameter of the noise
        ½ tr[(K⁻¹ − αα' − K⁻¹XΣX'K⁻¹) dK].
        """
        columns, values, times_min, is_zeroed, is_row = self._rows
        inverse, log_determinant = self._inverse(prior.noise)
        by_columns = inverse @ columns
        flat = columns.reshape(-1, columns.shape[2])
        gram = flat.T @ by_columns.reshape(flat.shape)
        by_values = np.einsum("rij,rj->ri", inverse, values)
        right = flat.T @ by_values.ravel()
        scale = self._scale(prior)
        factor = cho_factor(_scaled(gram, scale), lower=True)
        unit_mean = cho_solve(factor, scale * right)
        unit_covariance = cho_solve(factor, np.eye(scale.size))
        fit = float((values * by_values).sum()) - float(scale * right @ unit_mean)
        value = 0.5 * (fit + log_determinant.sum()) + np.log(np.diag(factor[0])).sum()
        mean, covariance = scale * unit_mean, scale[:, None] * unit_covariance * scale
        left = by_values - by_columns @ mean
        inner = inverse - left[:, :, None] * left[:, None, :]
        inner -= (by_columns @ covariance) @ by_columns.transpose(0, 2, 1)
        inner *= is_row[:, :, None] & is_row[:, None, :]
        of_noise = [
            0.5 * float(np.vdot(inner, slope)) for slope in prior.noise.slopes(times_min, is_zeroed)
        ]
        of_scales = np.bincount(self.groups, 1.0 - np.diag(unit_covariance) - unit_mean**2)
        return float(value), np.concatenate([of_noise, of_scales])

    def without(self, left_out: int) -> Response:
        """Leave one set-up out."""
        return replace(self, courses=[c for i, c in enumerate(self.courses) if i != left_out])

    def without_groups(self, left_out: Sequence[int]) -> Response:
        """Leave groups of columns out."""
        kept = ~np.isin(self.groups, list(left_out))
        courses = [replace(c, columns=c.columns[:, kept]) for c in self.courses]
        _, groups = np.unique(self.groups[kept], return_inverse=True)
        return replace(self, courses=courses, groups=groups)

    def with_change(self, changing: IntArray, side: FloatArray) -> Response:
        """Add columns that are some of the others times a number for each set-up, as a group.

        Parameters
        ----------
        changing : ndarray, shape (c,)
            Which columns.
        side : ndarray, shape (m,)
            The number of each set-up.
        """
        courses = [
            replace(c, columns=np.hstack([c.columns, own * c.columns[:, changing]]))
            for c, own in zip(self.courses, side, strict=True)
        ]
        group = np.full(changing.size, self.groups.max() + 1)
        return replace(self, courses=courses, groups=np.concatenate([self.groups, group]))

    def _scale(self, prior: Prior) -> FloatArray:
        found: FloatArray = prior.scales[self.groups]
        return found

    @cached_property
    def _rows(self) -> _Rows:
        return _Rows.of(self.courses)

    def _inverse(self, noise: Wander) -> tuple[FloatArray, FloatArray]:
        """Invert the covariance of every set-up; rows that fill up are 0."""
        is_row = self._rows.is_row
        both = is_row[:, :, None] & is_row[:, None, :]
        covariance = np.where(both, noise.covariance(self._rows.times_min, self._rows.is_zeroed), 0)
        own = np.arange(is_row.shape[1])
        covariance[:, own, own] += ~is_row
        lower = np.linalg.cholesky(covariance)
        whiten = np.linalg.inv(lower)
        log_determinant = 2.0 * np.log(lower[:, own, own]).sum(axis=1)
        return whiten.transpose(0, 2, 1) @ whiten, log_determinant


class _Rows(NamedTuple):
    """All set-ups in arrays of one length, filled up with rows of zeros."""

    columns: FloatArray
    values: FloatArray
    times_min: FloatArray
    is_zeroed: BoolArray
    is_row: BoolArray

    @classmethod
    def of(cls, courses: Sequence[Course]) -> _Rows:
        m, n = len(courses), max(len(c.values) for c in courses)
        columns = np.zeros((m, n, courses[0].columns.shape[1]))
        values, times_min = np.zeros((m, n)), np.zeros((m, n))
        is_row = np.zeros((m, n), dtype=np.bool_)
        for i, course in enumerate(courses):
            own = slice(len(course.values))
            columns[i, own], values[i, own] = course.columns, course.values
            times_min[i, own], is_row[i, own] = course.times_min, True
        is_zeroed = np.array([c.is_zeroed for c in courses], dtype=np.bool_)
        return cls(columns, values, times_min, is_zeroed, is_row)


def misfit(normal: Normal, scale: FloatArray) -> float:
    """Give minus the logarithm of the marginal likelihood, constants aside.

    Parameters
    ----------
    normal
        The whitened set-ups.
    scale : ndarray, shape (p,)
        Standard deviation of each coefficient.
    """
    right = scale * normal.right.sum(axis=0)
    factor = cho_factor(_scaled(normal.gram.sum(axis=0), scale), lower=True)
    fit = normal.square.sum() - right @ cho_solve(factor, right) + normal.log_determinant.sum()
    return float(0.5 * fit + np.log(np.diag(factor[0])).sum())


def _scaled(gram: FloatArray, scale: FloatArray) -> FloatArray:
    found: FloatArray = scale[:, None] * gram * scale
    found[np.diag_indices_from(found)] += 1.0
    return found


def _logarithms(prior: Prior) -> FloatArray:
    noise = prior.noise if prior.noise.jump else prior.noise[:-1]
    found: FloatArray = np.log(np.concatenate([noise, prior.scales]))
    return found


def _prior(logs: FloatArray, groups: int) -> Prior:
    found = np.exp(logs)
    of_noise = found.size - groups
    return Prior(Wander(*found[:of_noise].tolist()), found[of_noise:])
