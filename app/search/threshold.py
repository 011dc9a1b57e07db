"""A threshold for everything that was tried: the largest statistic under pure noise.

P. Westfall, S. Young, Resampling-Based Multiple Testing (1993): distribution of the largest
statistic from joint draws, so that entries which imitate each other are not counted twice.
E. Gumbel, Statistics of Extremes (1958): its tail, fitted by two moments.
M. Bartlett, Proc. R. Soc. A 160 (1937) 268: bringing a likelihood ratio to its χ² mean.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import gammaincc, gammaln

from app.arrays import BoolArray, FloatArray
from app.search.scan import Scan

BARTLETT: Final = (0.4, 1.3)
"""A correction beyond this says more about the draws than about the statistic."""

OWN_FALSE_ALARM: Final = 0.05
"""What the other channels' noise makes improbable must not be usual in the channel's own: the
null model that is fitted without an effect has taken part of it up already."""

LEAST_SCALE: Final = 1.0 / np.log(10.0)
"""Scale of −log10 p of a single test: a family's largest has no lighter tail than that."""


@dataclass(frozen=True, eq=False)
class Population:
    """How every family's largest surprise is distributed in draws of one kind of noise.

    Parameters
    ----------
    location, scale : ndarray, shape (entries,)
        Of a Gumbel distribution, the same within a family.
    bartlett : ndarray, shape (entries,)
        Factor that brings each statistic to its χ² mean.
    """

    location: FloatArray
    scale: FloatArray
    bartlett: FloatArray

    def except_for(self, which: BoolArray, other: Population) -> Population:
        """Take some entries' distribution from another population."""
        pairs = zip(
            (other.location, other.scale, other.bartlett),
            (self.location, self.scale, self.bartlett),
            strict=True,
        )
        return Population(*(np.where(which, theirs, mine) for theirs, mine in pairs))

    def reduced(self, scanned: Scan) -> FloatArray:
        """Give every entry's surprise on its family's scale, shape (entries,)."""
        surprises = surprise(scanned.ratio * self.bartlett, scanned.rank)
        return np.asarray((surprises - self.location) / self.scale)


@dataclass(frozen=True, eq=False)
class Threshold:
    """What a candidate must exceed.

    Every family may spend the same share of the false alarms, so that thousands of pitches do
    not cost the one drift its power.

    Parameters
    ----------
    noise
        What decides: noise whose wander is that of the other channels, where they tell.
    own
        Noise as the channel itself shows it without any effect; None: the same.
    limit, own_limit
        Reduced surprise above which an entry counts as found.
    families
        How many families share.
    """

    noise: Population
    own: Population | None
    limit: float
    own_limit: float
    families: int

    def except_for(self, which: BoolArray, other: Threshold) -> Threshold:
        """Judge some entries by another threshold, shape (entries,)."""
        own_population = self.own
        if own_population is not None and other.own is not None:
            own_population = own_population.except_for(which, other.own)
        return replace(self, noise=self.noise.except_for(which, other.noise), own=own_population)

    @property
    def bartlett(self) -> FloatArray:
        """Factors that bring each statistic to its χ² mean, shape (entries,)."""
        return self.noise.bartlett

    @property
    def surprise(self) -> FloatArray:
        """−log10 p above which an entry counts as found, shape (entries,)."""
        return np.asarray(self.noise.location + self.limit * self.noise.scale)

    def excess(self, scanned: Scan) -> FloatArray:
        """Give by how much every entry exceeds what it must, shape (entries,)."""
        excess = self.noise.reduced(scanned) - self.limit
        if self.own is not None:
            excess = np.minimum(excess, self.own.reduced(scanned) - self.own_limit)
        return excess

    def global_p(self, scanned: Scan) -> float:
        """Give the probability that noise alone surprises as much in any family."""
        if not self.families:
            return 1.0  # Nothing could be tested: nothing surprises.
        return self._chance(float(np.max(self.noise.reduced(scanned), initial=-np.inf)))

    def global_p_of(self, entry: int, ratio: float, rank: int) -> float:
        """Give the probability that noise alone surprises as much in any family as one term does.

        Parameters
        ----------
        entry
            Any entry of the term's candidate: these are distributed alike.
        ratio, rank
            Of the term: twice its log likelihood ratio, and how many amplitudes the rows tell.
        """
        if not self.families:
            return 1.0
        parts = (self.noise.location, self.noise.scale, self.noise.bartlett)
        population = Population(*(part[[entry]] for part in parts))
        scanned = Scan(np.array([ratio]), np.zeros((1, 0)), np.array([rank]))
        return self._chance(float(population.reduced(scanned)[0]))

    def _chance(self, rarest: float) -> float:
        # One family's largest stays below r with the probability exp(−exp(−r)), all of them with
        # its power.
        return float(-np.expm1(-self.families * np.exp(-rarest)))


def threshold(
    scanned: Scan,
    groups: np.ndarray,
    families: np.ndarray,
    false_alarm: float,
    halves: bool = False,
) -> Threshold:
    """Take the threshold from draws of noise, with a smoothed tail.

    The largest of many surprises is close to a Gumbel variable: its two moments are
    estimated well from few draws, an empirical 99th percentile is not.

    Parameters
    ----------
    groups : ndarray, shape (entries,)
        Entries of one candidate share their Bartlett factor: it is then less uncertain.
    families : ndarray, shape (entries,)
        Numbers of the families; one in which nothing can be tested has no share.
    false_alarm
        Accepted probability that anything is found in noise.
    halves
        Whether the second half of the draws wanders as the other channels do (`Draws`).
    """
    count = len([f for f in np.unique(families) if scanned.rank[families == f].any()])
    middle = scanned.noise.shape[1] // 2
    parts = [scanned.noise[:, middle:], scanned.noise[:, :middle]] if halves else [scanned.noise]
    populations = [
        _population(Scan(scanned.ratio, part, scanned.rank), groups, families) for part in parts
    ]
    return Threshold(
        noise=populations[0],
        own=populations[1] if halves else None,
        limit=_gumbel(false_alarm / max(count, 1)),
        own_limit=_gumbel(OWN_FALSE_ALARM),
        families=count,
    )


def _population(scanned: Scan, groups: np.ndarray, families: np.ndarray) -> Population:
    bartlett = _bartlett(scanned, groups)
    location, scale = np.zeros(len(families)), np.ones(len(families))
    for family in np.unique(families[scanned.rank > 0]):
        of_family = families == family
        largest = _most_surprising(
            scanned.noise[of_family] * bartlett[of_family, None], scanned.rank[of_family]
        )
        # A Gumbel variable has the standard deviation π/√6 times its scale, and the mean γ scales
        # above its location.
        scale[of_family] = max(float(largest.std(ddof=1)) * np.sqrt(6.0) / np.pi, LEAST_SCALE)
        location[of_family] = float(largest.mean()) - np.euler_gamma * scale[of_family]
    return Population(location, scale, bartlett)


def _most_surprising(noise: FloatArray, rank: FloatArray) -> FloatArray:
    """Give the largest surprise of each draw among some entries, shape (draws,).

    p values and not ratios: entries of one and of three amplitudes then compete on equal terms.
    Among entries of one rank the largest ratio is the most surprising one, which saves to ask
    for the probabilities of all others.
    """
    ranks = np.unique(rank)
    largest = np.stack([noise[rank == rank_value].max(axis=0) for rank_value in ranks])
    most: FloatArray = surprise(largest, ranks[:, None]).max(axis=0)
    return most


def _gumbel(probability: float) -> float:
    """Give what a reduced Gumbel variable exceeds with a probability."""
    return float(-np.log(-np.log1p(-probability)))


def surprise(ratio: FloatArray, freedom: FloatArray) -> FloatArray:
    """Give −log10 of the probability that χ² exceeds a value, far into the tail.

    Parameters
    ----------
    ratio : ndarray, shape (...)
    freedom : ndarray, shape (...)
        Degrees of freedom; 0: no surprise.

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> [round(float(v), 3) for v in surprise(np.array([3.841459, 4000.0]), np.array([1.0, 2.0]))]
    [1.301, 868.589]
    """
    a = np.maximum(freedom, 1.0) / 2.0
    x = np.maximum(ratio, 0.0) / 2.0
    # The upper tail underflows near x = 700; from 300 on its asymptotic series serves.
    with np.errstate(divide="ignore"):
        near = np.log(np.maximum(gammaincc(a, x), 1e-300))
    far = (
        -x
        + (a - 1.0) * np.log(np.maximum(x, 1.0))
        - gammaln(a)
        + np.log1p((a - 1) / np.maximum(x, 1))
    )
    surprises = -np.where(x < 300.0, near, far) / np.log(10.0)
    return np.where(freedom > 0, np.maximum(surprises, 0.0), 0.0)


def _bartlett(scanned: Scan, groups: np.ndarray) -> FloatArray:
    count = np.maximum(np.bincount(groups, weights=(scanned.rank > 0) * 1.0), 1.0)
    relative = scanned.noise.mean(axis=1) / np.maximum(scanned.rank, 1.0)
    mean = np.bincount(groups, weights=relative * (scanned.rank > 0)) / count
    return np.asarray(np.clip(1.0 / np.maximum(mean, 1e-3), *BARTLETT)[groups])
