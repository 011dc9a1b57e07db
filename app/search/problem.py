"""The whole campaign made ready: its channels, its cells of visits, and candidates as columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Final, NamedTuple

import numpy as np
from scipy.special import softmax

from app.arrays import BoolArray, FloatArray, IntArray
from app.errors import InvalidContent
from app.search.candidate import Candidate, Part
from app.search.channel import Channel, prepare
from app.search.levels import expected_beside
from app.search.moments import Fixed, Moments, fixed_of, moments_of
from app.search.noise import at_least_rounding, repeatability
from app.search.priors import ESTIMATED_WEIGHT
from app.search.rows import Nuisance, Rows
from app.search.state import State

FEWEST_OTHERS: Final = 3
"""Fewer other channels do not say what to expect of one."""


@dataclass(eq=False)
class Term:
    """A candidate at one value of its nonlinear parameter, as columns of unit length.

    Parameters
    ----------
    columns
        Channel to columns, shape (n, k), in repeatabilities, divided by `norms`.
    norms : ndarray, shape (k,)
        Length of each column over all channels; 0: nothing excites it.
    theta_error
        Standard error of theta; None where theta stays on the grid.
    origin
        Of a term that the model has already, its number there; None for what is new.
    about
        The amplitude about which its columns are right, where its candidate is not proportional
        to it; None: about 0.
    """

    candidate: Candidate
    theta: float | None
    columns: Mapping[int, FloatArray]
    norms: FloatArray
    theta_error: float | None = None
    origin: int | None = None
    about: float | None = None
    _moments: dict[int, Moments] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """How many amplitudes it has."""
        return len(self.norms)

    @property
    def channels(self) -> tuple[int, ...]:
        """The channels it acts on."""
        return tuple(sorted(self.columns))

    def moments(self, fixed: Fixed) -> Moments:
        """Multiply its columns in one channel, once."""
        number = fixed.channel.number
        if number not in self._moments:
            self._moments[number] = moments_of(fixed.channel, self.columns[number], fixed.cells)
        return self._moments[number]


def places(terms: Sequence[Term]) -> list[slice]:
    """Say which of all amplitudes are each term's: they stand one after the other."""
    ends = np.cumsum([term.size for term in terms]).tolist()
    return [slice(end - term.size, end) for term, end in zip(terms, ends, strict=True)]


class SideBySide(NamedTuple):
    """Columns of e candidates, m in all, of unit length over all channels.

    `columns` are each channel's, shape (n, m), and `norms` their lengths, shape (m,); each has
    those from `starts` to before `ends`, shape (e,), and `shows` says in which of the channels,
    shape (channels, e).
    """

    columns: Mapping[int, FloatArray]
    norms: FloatArray
    starts: IntArray
    ends: IntArray
    shows: BoolArray


@dataclass(frozen=True, eq=False)
class Problem:
    """A campaign ready to be searched.

    Parameters
    ----------
    place : ndarray, shape (n,)
        Where each of the caller's rows stands in its channel; −1: takes no part.
    """

    rows: Rows
    fixed: Mapping[int, Fixed]
    cells: int
    place: IntArray
    _origins: dict[int, tuple[IntArray, IntArray]] = field(default_factory=dict)

    @property
    def has_expected_wander(self) -> bool:
        """Whether channels say of each other how they wander."""
        return any(fixed.channel.expected is not None for fixed in self.fixed.values())

    @property
    def count(self) -> int:
        """How many rows take part."""
        return int((self.place >= 0).sum())

    def states(self, cells: BoolArray) -> dict[int, State]:
        """Look at every channel on some cells, without terms.

        Parameters
        ----------
        cells : ndarray, shape (cells,)
            Which cells take part.

        Returns
        -------
        dict
            Channel to state; channels without rows in these cells are left out.
        """
        return {c: State(f, cells) for c, f in self.fixed.items() if cells[f.channel.cells].any()}

    def term(self, candidate: Candidate, theta: float | None, about: float | None = None) -> Term:
        """Evaluate a candidate on all rows that take part, about an amplitude where stated."""
        if about is None or candidate.about is None:
            about, parts = None, candidate.columns(theta)
        else:
            parts = candidate.about(theta, about)
        columns = self._columns(candidate, parts)
        norms = np.sqrt(sum(self._squares(columns).values(), np.zeros(_width(columns))))
        self._divide(columns, norms)
        return Term(candidate, theta, columns, norms, about=about)

    def side_by_side(self, wanted: Sequence[tuple[Candidate, float | None]]) -> SideBySide:
        """Evaluate candidates of one layout, or without any, each at one parameter value."""
        layout = wanted[0][0].layout
        if layout is None:
            each = [
                self._columns(candidate, candidate.columns(theta)) for candidate, theta in wanted
            ]
            ends = np.cumsum([_width(columns) for columns in each])
            columns = self._beside_each_other(each, ends)
        else:
            amplitudes = [c.layout.amplitudes(theta) for c, theta in wanted if c.layout is not None]
            ends = np.cumsum([len(of_candidate) for of_candidate in amplitudes])
            columns = self._columns(wanted[0][0], layout.parts([*chain.from_iterable(amplitudes)]))
        squares = self._squares(columns)
        norms = np.sqrt(sum(squares.values(), np.zeros(ends[-1])))
        self._divide(columns, norms)
        starts = np.append(0, ends[:-1])
        # A candidate that is laid out with others may leave channels alone in which these show.
        shows = [np.add.reduceat(square, starts) > 0.0 for square in squares.values()]
        return SideBySide(
            columns, norms, starts, ends, np.array(shows, dtype=np.bool_).reshape(-1, len(ends))
        )

    def _beside_each_other(
        self, each: Sequence[Mapping[int, FloatArray]], ends: IntArray
    ) -> dict[int, FloatArray]:
        """Set columns of candidates side by side, each channel's before those that end there."""
        matrices: dict[int, FloatArray] = {}
        for end, columns in zip(ends.tolist(), each, strict=True):
            for number, column in columns.items():
                if number not in matrices:
                    matrices[number] = np.zeros((ends[-1], len(column))).T
                matrices[number][:, end - column.shape[1] : end] = column
        return dict(sorted(matrices.items()))

    def _columns(self, candidate: Candidate, parts: Sequence[Part]) -> dict[int, FloatArray]:
        """Lay parts out over the rows of their channels, by number."""
        columns: dict[int, FloatArray] = {}
        for part in parts:
            if part.channel not in self.fixed:
                continue
            laid_out, before = self._laid_out(candidate, part), columns.get(part.channel)
            columns[part.channel] = laid_out if before is None else before + laid_out
        sizes = {column.shape[1] for column in columns.values()}
        if len(sizes) > 1:
            raise InvalidContent.of_field(
                candidate.key, f"expected equally many columns in all channels, got {sorted(sizes)}"
            )
        return dict(sorted(columns.items()))

    def _squares(self, columns: Mapping[int, FloatArray]) -> dict[int, FloatArray]:
        """Give the columns' sums of squares in each channel, in its repeatabilities."""
        scales = {c: self.fixed[c].channel.scale for c in columns}
        return {
            c: np.einsum("nk,nk->k", column, column) / scales[c] ** 2
            for c, column in columns.items()
        }

    def _divide(self, columns: Mapping[int, FloatArray], norms: FloatArray) -> None:
        """Bring columns to repeatabilities and to unit length, where they stand."""
        safe = np.where(norms > 0, norms, 1.0)
        for number, column in columns.items():
            column /= self.fixed[number].channel.scale * safe

    def _laid_out(self, candidate: Candidate, part: Part) -> FloatArray:
        """Put a part's rows where they stand in its channel; most parts have the same rows."""
        rows, origin = self._origins.get(part.channel, (None, None))
        if rows is not part.rows or origin is None:
            origin = self._origin(candidate, part)
            self._origins[part.channel] = part.rows, origin
        absent = len(part.rows)
        columns = part.columns.T  # each of them is picked from where its numbers stand in a row
        if origin.max(initial=0) >= absent:
            columns = np.hstack([columns, np.zeros((len(columns), 1))])
        return columns.take(origin, axis=1).T

    def _origin(self, candidate: Candidate, part: Part) -> IntArray:
        """Say which row of a part each row of its channel is; the one after its last: none."""
        if (self.rows.channel[part.rows] != part.channel).any():
            raise InvalidContent.of_field(
                candidate.key, f"expected rows of channel {part.channel}, got rows of others"
            )
        origin = np.full(len(self.fixed[part.channel].channel.rows), len(part.rows), dtype=np.intp)
        here = self.place[part.rows]
        origin[here[here >= 0]] = np.flatnonzero(here >= 0)
        return origin


def make_problem(
    rows: Rows,
    nuisance: Sequence[Nuisance],
    use: BoolArray,
    cell_of: dict[int, int],
    cells: int,
) -> Problem:
    """Make a campaign ready.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Which rows take part.
    """
    fixed: dict[int, Fixed] = {}
    place = np.full(len(rows.values), -1, dtype=np.intp)
    for number in np.unique(rows.channel[use]).tolist():
        channel = prepared(rows, nuisance, number, use, cell_of)
        fixed[number] = fixed_of(channel, cells)
        place[channel.rows] = np.arange(len(channel.rows))
    return Problem(rows, fixed, cells, place)


def with_likely_scatters(problem: Problem) -> Problem:
    """Let channels say of each other how they wander, and try no scatter above what they show.

    Rooms, foundations and lasers wander in all channels alike. One channel's slow walk and its
    drift look the same; that it walks where no other does has its price, and that it wanders
    as all others do has none. What a channel shows by itself still enters by its likelihood.

    Whatever explains a part of the values leaves less scatter than there seems to be without it: a
    set of variances that is above the best one, and improbable beside it, stays so. That takes a
    repeatability that no effect has made larger, as variances count in its multiples.
    """
    everything = np.ones(problem.cells, dtype=np.bool_)
    states = {c: State(fixed, everything) for c, fixed in problem.fixed.items()}
    believed = {c: softmax(s.null) for c, s in states.items() if s.fixed.channel.blocks.may_wander}
    for number, belief in believed.items():
        others = [b for n, b in believed.items() if n != number and len(b) == len(belief)]
        if len(others) >= FEWEST_OTHERS:
            fixed = problem.fixed[number]
            expected = expected_beside(others, np.full(len(belief), 1.0 / len(belief)))
            informed = replace(fixed.channel, expected=expected)
            states[number] = State(replace(fixed, channel=informed), everything)
    return replace(problem, fixed={c: _likely(state) for c, state in states.items()})


def _likely(state: State) -> Fixed:
    """Leave out the sets of variances that are above the best one and not believable."""
    channel, best = state.fixed.channel, int(state.null.argmax())
    if channel.weight <= ESTIMATED_WEIGHT:
        return state.fixed
    pairs = [*zip(channel.tried, state.believable.tolist(), strict=True)]
    far = [s for s, it in pairs if not it and s.is_above(channel.tried[best])]
    # What scatters like observations makes them seem to scatter so much more, and set-ups less.
    times = max(float(state.scatter(state.rss[best])), 1.0)
    is_near = [it or not any(s.is_above(f, times) for f in far) for s, it in pairs]
    return replace(state.fixed, channel=channel.trying(np.array(is_near)))


def prepared(
    rows: Rows, nuisance: Sequence[Nuisance], number: int, use: BoolArray, cell_of: dict[int, int]
) -> Channel:
    """Scale by the repeatability; one that is only guessed is guessed again from the fit."""
    estimate = repeatability(rows, number, use)
    channel = prepare(rows, nuisance, number, estimate.value, estimate.weight, use, cell_of)
    if estimate.origin != "residuals":
        return channel
    state = State(
        fixed_of(channel, 1 + max(cell_of.values())), np.ones(1 + max(cell_of.values()), bool)
    )
    best = int(np.argmax(state.null))
    value = estimate.value * float(np.sqrt(state.scatter(state.rss[best])))
    least = at_least_rounding(rows, number, estimate._replace(value=value))
    return prepare(rows, nuisance, number, least.value, least.weight, use, cell_of)


def _width(columns: Mapping[int, FloatArray]) -> int:
    """Say how many columns there are; one where no channel has any."""
    return next((column.shape[1] for column in columns.values()), 1)
