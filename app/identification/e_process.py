"""Evidence that something has changed, valid whenever one looks: an e-process for one number.

Each observation z, standardised by what was to be expected, multiplies the evidence by the
likelihood ratio of a wider distribution to the expected one. Under the null the expected
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

WIDER: Final = (3.0, 15.0, 63.0)
"""Variances that a change adds, over the expected one: a change of 1.7, 4 or 8 sigma."""


@dataclass(frozen=True, slots=True)
class EProcess:
    """The evidence after some observations.

    Parameters
    ----------
    steps
        How many there were.
    begun
        Evidence of all beginnings so far, each with its weight.
    """

    steps: int = 0
    begun: float = 0.0

    @property
    def evidence(self) -> float:
        """The e-value: 1 says nothing, 1/α is reached with probability α at most by chance."""
        return self.begun + 1.0 / (self.steps + 1)

    def after(self, z: float) -> EProcess:
        """Take one observation.

        Parameters
        ----------
        z
            Deviation from what was expected, in standard deviations.

        Examples
        --------
        >>> quiet, loud = EProcess().after(0.3), EProcess().after(5.0)
        >>> quiet.evidence < 1.0 < 1000 < loud.evidence
        True
        """
        weight = 1.0 / ((self.steps + 1) * (self.steps + 2))
        return EProcess(self.steps + 1, min((self.begun + weight) * likelihood_ratio(z), 1e300))


def likelihood_ratio(z: float) -> float:
    """Compare wider normal distributions, evenly mixed, with the standard one.

    Parameters
    ----------
    z
        Where they are compared.

    Examples
    --------
    >>> round(likelihood_ratio(0.0), 3)
    0.292
    """
    wider = np.array(WIDER)
    exponent = np.minimum(0.5 * z**2 * wider / (1.0 + wider), 600.0)
    return float(np.mean(np.exp(exponent) / np.sqrt(1.0 + wider)))
