"""Evidence that something has changed, valid whenever one looks: an e-process for one number.

Each observation multiplies the evidence by the likelihood ratio of a wider distribution to the
expected one. Under the null the expected
product never exceeds one, so it reaches 1/α with a probability of at most α, however long one
goes on and whenever one stops (Ville's inequality). A change may begin at any time: the evidence
is averaged over all beginnings k with weights 1/(k (k + 1)), which add up to one.

References
----------
G. Shafer, V. Vovk, Game-Theoretic Foundations for Probability and Finance (2019).
J. Shin, A. Ramdas, A. Rinaldo, E-detectors, New England Journal of Statistics in Data Science
2 (2023) 229.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import FloatArray

WIDER: Final = (3.0, 15.0, 63.0)
"""Variances that a change adds, over the expected one: a change of 1.7, 4 or 8 sigma."""


@dataclass(frozen=True, slots=True)
class EProcess:
    """The evidence after some observations.

    Parameters
    ----------
    begun
        Evidence of all beginnings so far, each with its weight.
    """

    steps: int = 0
    begun: float = 0.0

    @property
    def evidence(self) -> float:
        """The e-value: 1 says nothing, 1/α is reached with probability α at most by chance."""
        # Beginnings still to come have the evidence 1 and together the weight Σ 1/(k (k + 1)) over
        # k > n, which is 1/(n + 1).
        return self.begun + 1.0 / (self.steps + 1)

    def after(self, ratio: float) -> EProcess:
        """Take one observation.

        Examples
        --------
        >>> one = np.ones(1)
        >>> ratios = (likelihood_ratio(z * one, one, one) for z in (0.3, 5.0))
        >>> quiet, loud = map(EProcess().after, ratios)
        >>> quiet.evidence < 1.0 < 1000 < loud.evidence
        True
        """
        weight = 1.0 / ((self.steps + 1) * (self.steps + 2))
        # Bounded: an infinite evidence would stay so, and become NaN at a ratio of 0.
        return EProcess(self.steps + 1, min((self.begun + weight) * ratio, 1e300))


def likelihood_ratio(away: FloatArray, variances: FloatArray, weights: FloatArray) -> float:
    """Compare wider normal distributions with those that were expected.

    Parameters
    ----------
    away, variances, weights : ndarray, shape (m,)
        Distances from the means that are held possible, variances about them, and how much each
        is believed; the weights add up to one.

    Examples
    --------
    >>> round(likelihood_ratio(np.zeros(1), np.ones(1), np.ones(1)), 3)
    0.292
    """
    wider = variances * (1.0 + np.array(WIDER)[:, None])
    expected = _log_density(away, variances, weights)
    changed = _log_density(away, wider, weights) - np.log(len(WIDER))
    return float(np.exp(min(changed - expected, 600.0)))


def _log_density(away: FloatArray, variances: FloatArray, weights: FloatArray) -> float:
    """Mix normal distributions; up to a constant."""
    logs = np.log(np.maximum(weights, 1e-300)) - 0.5 * (away**2 / variances + np.log(variances))
    return float(np.logaddexp.reduce(logs.ravel()))
