"""What a search says: what was found, how sure, against which rivals, and what remains."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import exp, hypot
from typing import Final

from app.arrays import FloatArray
from app.search.priors import TRUST

FAR_OFF: Final = "far-off"
"""The test of channels of few set-ups that are further from the model than usual."""

ALIKE_OUTLIERS: Final = "alike-outliers"
"""The test of rows that were left out and are off by the same."""

FLEXIBLE: Final = "flexible"
"""The test of a found term's flexible versions."""


FEW_VISITS: Final = "few-visits"
"""Why a candidate is not tested that changes from visit to visit."""


class Verdict(StrEnum):
    """The answer in a word."""

    NOTHING = "nothing"
    FOUND = "found"
    UNEXPLAINED = "unexplained"


class Status(StrEnum):
    """What observations that took no part in the search say of a term."""

    CONFIRMED = "confirmed"
    NOT_CONFIRMABLE = "not-confirmable"
    SUSPECTED = "suspected"


@dataclass(frozen=True, slots=True)
class Slope:
    """Measured against predicted contribution on held-out visits: 1 is right, 0 is nothing.

    `information` is the square of the slope's expected value over its error, were it 1.
    """

    value: float
    error: float
    information: float


@dataclass(frozen=True, eq=False, slots=True)
class Rival:
    """Another explanation of what a term explains.

    Parameters
    ----------
    behind
        2 ln B of the term against it; below 6 the evidence hardly decides.
    alias_share
        Share of the term's fitted signal that the rival reproduces.
    amplitudes : ndarray, shape (k,), or None
        Its sizes in the term's place, in the candidate's own unit; None where it is not tied.
    beside
        Place to the sizes that each other term then has.
    """

    key: str
    family: str
    theta: float | None
    behind: float
    alias_share: float
    tied: bool
    with_offset: bool = False
    """Whether it comes so close only with a constant beside it."""
    amplitudes: FloatArray | None = None
    beside: Mapping[int, FloatArray] = field(default_factory=dict)

    @property
    def weight(self) -> float:
        """How probable it is beside the term, which has 1."""
        return exp(-0.5 * TRUST * max(self.behind, 0.0))


@dataclass(frozen=True, eq=False)
class FoundTerm:
    """One term that the rows call for.

    Parameters
    ----------
    theta, theta_error
        Its nonlinear parameter and standard error; infinite where the rows do not bound it.
    amplitudes : ndarray, shape (k,)
        In the candidate's own unit; all visits together.
    covariance : ndarray, shape (k, k)
        Of the amplitudes.
    likelihood_ratio, degrees_of_freedom
        Twice the rise of the log likelihood, the other terms given.
    evidence
        2 ln B against its absence.
    global_p
        Probability that noise alone gives as strong a candidate, by its likelihood ratio,
        anywhere in the library.
    rivals
        The best of every other family, and members of its own that come close.
    slope
        On visits held out in turn; None: never found without them.
    forward_slope
        On the last visits, found on the earlier ones: for trends.
    inclusion
        Share of the folds that find it, or one it is tied with, again.
    strongest_visits, leverage
        The two visits that carry most of the evidence, and their share of it.
    doubts
        How the values depart from it, which leaves its name open; empty: they do not.
    place
        Its number among all chosen terms.
    origin
        Of a term that the model has already, its number there; None for what is new.
    """

    key: str
    family: str
    channels: tuple[int, ...]
    theta: float | None
    theta_error: float | None
    amplitudes: FloatArray
    covariance: FloatArray
    likelihood_ratio: float
    degrees_of_freedom: int
    evidence: float
    global_p: float
    rivals: tuple[Rival, ...]
    slope: Slope | None
    forward_slope: Slope | None
    inclusion: float | None
    status: Status
    strongest_visits: tuple[int, ...]
    leverage: float
    doubts: tuple[str, ...] = ()
    place: int = 0
    origin: int | None = None


@dataclass(frozen=True, slots=True)
class Figure:
    """Root mean square with its 95 % interval over visits."""

    rms: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Floor:
    """What would be left of held-out visits if nothing were missing, by what leaves it (RMS).

    Parameters
    ----------
    noise
        The scatter of single observations.
    setups
        What set-ups shift and tilt, and what wanders in time.
    learning
        What the visits that taught leave open, where that is counted.

    Examples
    --------
    >>> Floor(noise=0.4, setups=0.3).total
    0.5
    """

    noise: float
    setups: float
    learning: float = 0.0

    @property
    def total(self) -> float:
        """All of it: the root mean square that is to be expected."""
        return hypot(self.noise, self.setups, self.learning)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Residuals on held-out visits: each is predicted by what was learnt without it.

    Parameters
    ----------
    floor
        What repeatability and set-up scatter alone would leave.
    spread, chance
        Root mean square over the floor without the visit that is furthest from it, and the
        probability with which repeatability and set-ups alone leave as much or more.
    """

    rows: int
    visits: int
    after: Figure
    floor: Floor
    spread: float = 0.0
    chance: float = 1.0


@dataclass(frozen=True, slots=True)
class ChannelNoise:
    """A channel's scatter, in its unit.

    Parameters
    ----------
    repeatability, origin
        Standard deviation of one observation, and whether it was `declared`, is what nearly all
        channels have in `common`, or came from `replicates`, from `residuals` or from `rounding`.
    """

    repeatability: float
    origin: str
    fitted: float
    visits: int
    rows: int


@dataclass(frozen=True, slots=True)
class Unexplained:
    """Structure that the found terms do not explain.

    Parameters
    ----------
    test
        `generic`, `lack-of-fit`, `held-out`, `many-of-one-family`, `many-at-one-place`, `far-off`,
        `alike-outliers`, or `flexible`: a flexible version of a found term explains something that
        the term itself does not.
    moves_with
        What it moves with: a generic candidate's key, a family; None: not known.
    """

    test: str
    channel: int
    moves_with: str | None


@dataclass(frozen=True, slots=True)
class Excluded:
    """Rows that took no part, and why: `outlier` or `visit-apart`.

    Parameters
    ----------
    visit
        The one that is apart; None: single rows.
    off
        How far each row is from what the others foretell, in the channel's unit.
    alike
        Those of them that are off by the same, in several visits, as slips hardly are.
    """

    rows: tuple[int, ...]
    reason: str
    channel: int
    visit: int | None = None
    off: tuple[float, ...] = ()
    alike: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Untested:
    """A candidate that these rows cannot test: `few-visits` or `not-excited`.

    Parameters
    ----------
    needed, got
        Visits, each moment of a long one counted by itself.
    """

    key: str
    reason: str
    needed: int = 0
    got: int = 0


@dataclass(frozen=True, slots=True)
class Detectable:
    """How small an effect could be and still be seen with these rows.

    Parameters
    ----------
    key, family, theta
        The candidate, at the middle of its grid.
    smallest
        Root mean square of the effect over its rows, in repeatabilities, that is found
        nine times in ten.
    distinguishable
        The same to be told from its best rival.
    rival, overlap
        The candidate of another family that imitates it best, and how much of it; None
        where rivals were not looked at.
    """

    key: str
    family: str
    theta: float | None
    smallest: float
    distinguishable: float
    rival: str | None
    overlap: float | None


@dataclass(frozen=True, eq=False)
class Findings:
    """The whole answer.

    Parameters
    ----------
    verdict
        In a word; `unexplained` may still hold terms: they are proxies then.
    global_p
        Probability that noise alone gives a candidate as strong as the strongest one here.
    predicted, adopted : ndarray, shape (n,)
        What a model that did not see a row's visit predicts of it: with refitted maps, and by the
        terms alone, those that are refitted included; nan: excluded.
    is_cut
        Whether more terms would pay for their parameters, but were not taken because there are so
        many already.
    refitted
        Terms that the model has already, as they are beside those that were found.
    dropped
        Numbers of such terms that no longer pay for their parameters.
    known : ndarray, shape (n,), or None
        As `adopted`, but by the refitted and dropped terms only.
    apart : ndarray, shape (terms, n), or None
        As `adopted`, but by what stood for each of the terms; 0 where nothing did.
    beside
        Fits the model's own terms again with only some of the found terms, given by their places;
        gives those found terms and the model's own.
    """

    verdict: Verdict
    terms: tuple[FoundTerm, ...]
    unexplained: tuple[Unexplained, ...]
    noise: Mapping[int, ChannelNoise]
    held_out: Mapping[int, HeldOut]
    global_p: float
    excluded: tuple[Excluded, ...]
    untested: tuple[Untested, ...]
    detectable: tuple[Detectable, ...]
    predicted: FloatArray
    adopted: FloatArray
    is_cut: bool = False
    refitted: tuple[FoundTerm, ...] = ()
    dropped: tuple[int, ...] = ()
    known: FloatArray | None = None
    apart: FloatArray | None = None
    beside: Callable[[Collection[int]], tuple[list[FoundTerm], list[FoundTerm]]] | None = None
