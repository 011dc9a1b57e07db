"""What may be lacking: one candidate, its columns, and the one parameter that is not linear."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Final, NamedTuple

import numpy as np

from app.arrays import FloatArray, IntArray
from app.errors import InvalidContent


class Part(NamedTuple):
    """What a candidate does to some rows of one channel.

    Parameters
    ----------
    rows : ndarray, shape (m,)
        Which rows; zero elsewhere.
    columns : ndarray, shape (m, k)
        The channel's change for each unit of each of the candidate's k amplitudes.
    """

    channel: int
    rows: IntArray
    columns: FloatArray


class Expected(NamedTuple):
    """How large an amplitude must be if its name is right: a sign is reversed wholly or not at all.

    Parameters
    ----------
    values
        What it may be, each as likely as the others.
    spread
        Standard deviation about each, as a share of it.
    """

    values: tuple[float, ...]
    spread: float

    def cost(self, amplitude: float, variance: float) -> float:
        """Give what the expectation costs against an amplitude that is entirely free.

        Returns
        -------
        float
            −2 ln of the likelihood's mean over what is expected, over its maximum.

        Examples
        --------
        >>> whole = Expected((1.0,), 0.05)
        >>> round(whole.cost(1.0, 0.0), 3), round(whole.cost(0.5, 0.0), 3)
        (0.0, 100.0)
        """
        costs = []
        for value in self.values:
            prior = (self.spread * value) ** 2
            ratio = variance / (variance + prior)
            occam = -np.log(ratio) if variance > 0 else 0.0
            costs.append((amplitude - value) ** 2 / (variance + prior) + occam)
        return float(min(costs) + 2.0 * np.log(len(costs)))


OFFSET: Final = "offset"
"""The flexible version that is a constant beside a candidate."""


class Flexible(NamedTuple):
    """What would be added if a candidate were only roughly right, and how the truth differs."""

    words: str
    parts: Sequence[Part]


class Layout(NamedTuple):
    """How candidates are laid out together: many columns take hardly longer than one.

    Parameters
    ----------
    where
        Equal for candidates that show in the same rows.
    amplitudes
        Gives for a value of the nonlinear parameter what is laid out, one for each amplitude.
    parts
        Lays amplitudes out, also those of several candidates, their columns side by side.
    """

    where: Hashable
    amplitudes: Callable[[float | None], Sequence[Any]]
    parts: Callable[[Sequence[Any]], Sequence[Part]]


class Form(NamedTuple):
    """Another form of a candidate's cause, and what is said of it where the values prefer it."""

    words: str
    candidate: Candidate


@dataclass(frozen=True, eq=False, kw_only=True)
class Traits:
    """What is to be known of an effect beside what it does to the rows.

    Parameters
    ----------
    trending
        Whether it must also hold forward in time: a drift, a step.
    standing
        Whether it is the same in all visits, as what set-ups have in common is.
    keeps_zero
        Of what is trending: whether no instrument whose zero walks can do the same. A set-up's
        zero then counts as one before the last visits and on them, and what came shows by its
        level there.
    within_visit
        Whether a single visit excites it, so that few visits suffice.
    of_setups
        Whether it is what set-ups themselves do: noise whose set-ups resemble each other does the
        same, and is no rival.
    only_once
        Whether one place has it once at most: a second one imitates something unknown.
    expected
        What its one amplitude is, where that is known beforehand: it then costs no parameter,
        and an estimate that differs is evidence against the candidate.
    """

    trending: bool = False
    standing: bool = False
    keeps_zero: bool = False
    within_visit: bool = False
    of_setups: bool = False
    only_once: bool = False
    expected: Expected | None = None

    @property
    def traits(self) -> dict[str, Any]:
        """All of them by name."""
        return {trait_field.name: getattr(self, trait_field.name) for trait_field in fields(Traits)}


@dataclass(frozen=True, eq=False)
class Candidate(Traits):
    """One effect that the residuals may hold.

    Parameters
    ----------
    family
        What it competes within: the prior is spread evenly inside a family.
    columns
        Gives its parts for a value of the nonlinear parameter. Several channels make a
        fingerprint: the same amplitudes act on all of them.
    grid
        Values of the nonlinear parameter that are scanned, increasing; empty: none.
    bounds
        Where the parameter may be refined to; without bounds it stays on the grid.
    log_scale
        Whether the refinement steps in the parameter's logarithm.
    generic
        Whether it is a smooth shape without a physical meaning: it is never found, but
        says that something is left.
    layout
        How several values, and several candidates, are laid out at once; None: each is by itself.
    about
        Of an effect that is not proportional to its one amplitude: its parts for each unit, where
        the amplitude is about as large as stated. `columns` are its parts where it is small.
    flexible
        Gives, for a value of the nonlinear parameter, what would be added if the candidate were
        only roughly right; None: it is not known.
    forms
        Gives the same cause with another course in time and as many parameters: never chosen
        itself, but compared with the candidate where that is chosen.
    apart
        Of a candidate that claims one amplitude for several places: the same with an amplitude for
        each place. Nothing of its family is chosen where these explain more, their extra
        parameters paid for.
    follows
        What its amplitudes respond to, such as a sensor, mapped to 1, or to −1 where it enters
        with a minus. `app.search.same_course` compares candidates that follow the same; these
        have their amplitudes in the same order.
    """

    key: str
    family: str
    columns: Callable[[float | None], Sequence[Part]]
    grid: tuple[float, ...] = ()
    bounds: tuple[float, float] | None = None
    log_scale: bool = True
    generic: bool = False
    layout: Layout | None = None
    about: Callable[[float | None, float], Sequence[Part]] | None = None
    flexible: Callable[[float | None], Sequence[Flexible]] | None = None
    forms: Callable[[], Sequence[Form]] = tuple
    apart: Candidate | None = None
    follows: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if any(b <= a for a, b in zip(self.grid, self.grid[1:], strict=False)):
            raise InvalidContent.of_field(f"{self.key}.grid", "expected increasing values")
        if self.bounds and self.log_scale and self.bounds[0] <= 0:
            raise InvalidContent.of_field(
                f"{self.key}.bounds", "expected values above 0 on a logarithmic scale"
            )

    @classmethod
    def of_parts(cls, key: str, family: str, parts: Sequence[Part], **traits: Any) -> Candidate:
        """Make one without a nonlinear parameter, of parts that are laid out already."""
        return cls(key, family, lambda _: parts, **traits)

    @property
    def thetas(self) -> tuple[float | None, ...]:
        """The values that are scanned; a lone None without a nonlinear parameter."""
        return self.grid or (None,)

    @property
    def nonlinear(self) -> int:
        """How many nonlinear parameters it has."""
        return int(bool(self.grid))

    def around(self, theta: float) -> tuple[float, float]:
        """Give the interval, within bounds, in which a value may be refined.

        It lies between the neighbours of the nearest value of the grid. Between the value's own
        neighbours, one that was refined to just above a value of the grid could never get below
        it again, whatever has been found beside it since.

        >>> Candidate("k", "f", lambda _: [], (1.0, 2.0, 4.0), (0.5, 8.0)).around(2.0)
        (1.0, 4.0)
        >>> Candidate("k", "f", lambda _: [], (1.0, 2.0, 4.0), (0.5, 8.0)).around(2.1)
        (1.0, 4.0)
        >>> Candidate("k", "f", lambda _: [], (1.0, 2.0, 4.0), (0.5, 8.0)).around(4.0)
        (2.0, 8.0)
        """
        low, high = self.bounds or (theta, theta)
        grid = np.array(self.grid)
        places = np.log(grid) if self.log_scale else grid
        near = int(np.abs(places - (np.log(theta) if self.log_scale else theta)).argmin())
        below, above = self.grid[:near], self.grid[near + 1 :]
        return max([low, *below[-1:]]), min([high, *above[:1]])


class KnownTerm(NamedTuple):
    """A candidate that the model has already, with the nonlinear parameter that it has there."""

    candidate: Candidate
    theta: float | None


class Known(NamedTuple):
    """What the model has already, and is fitted anew beside whatever is found.

    Parameters
    ----------
    explained : ndarray, shape (n,)
        What all of them together explain of each row in the model as it is; the residuals do
        not hold it.
    """

    terms: Sequence[KnownTerm]
    explained: FloatArray
