"""All candidates with all values of their grids, their products gathered in one pass."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.search.candidate import Candidate
from app.search.draws import Draws
from app.search.moments import Fixed, Moments, moments_of
from app.search.problem import Problem, Term

WIDTH: Final = 256
"""Columns of one batch: bounds the memory at any number of candidates."""

FINGERPRINT_WIDTH: Final = 192
"""Columns of a batch over several channels: each channel keeps its products."""

KEPT_BYTES: Final = 300_000_000
"""Columns are kept up to this size, and evaluated again beyond it."""


Key = tuple[tuple[int, ...], int, bool]
"""Channels, number of columns, and whether generic: what a batch has in common."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One candidate at one value of its grid; `norms` are its columns' lengths."""

    candidate: int
    theta: float | None
    norms: FloatArray

    @property
    def size(self) -> int:
        """How many amplitudes it has."""
        return len(self.norms)

    @property
    def excited(self) -> bool:
        """Whether the rows show it at all."""
        return bool((self.norms > 0).any())


@dataclass(eq=False)
class Sheet:
    """A batch's columns in one channel, and their products.

    Parameters
    ----------
    own : ndarray, shape (cells, g, k, k)
        Products of each entry's own columns.
    moments
        Products with nuisance, values and visits.
    noise : ndarray, shape (g k, B)
        Products with the draws of noise.
    columns : ndarray, shape (n, g k) or None
        The columns, where they are kept.
    """

    own: FloatArray
    moments: Moments
    noise: FloatArray
    columns: FloatArray | None


@dataclass(eq=False)
class Batch:
    """Entries with the same channels and as many columns, all generic or none."""

    channels: tuple[int, ...]
    size: int
    generic: bool
    entries: list[int]
    sheets: dict[int, Sheet] = field(default_factory=dict)


@dataclass(eq=False)
class Library:
    """Every entry, in batches.

    Parameters
    ----------
    problem
        The campaign.
    candidates
        The candidates.
    entries
        Every candidate at every value of its grid.
    batches
        The excited ones with their products.
    """

    problem: Problem
    candidates: Sequence[Candidate]
    entries: list[Entry] = field(default_factory=list)
    batches: list[Batch] = field(default_factory=list)

    def columns(self, batch: Batch, channel: int) -> FloatArray:
        """Give a batch's columns in one channel, kept or evaluated again.

        Parameters
        ----------
        batch
            The batch.
        channel
            One of its channels.

        Returns
        -------
        ndarray, shape (n, g k)
        """
        kept = batch.sheets[channel].columns
        if kept is not None:
            return kept
        entries = (self.entries[i] for i in batch.entries)
        terms = (self.problem.term(self.candidates[e.candidate], e.theta) for e in entries)
        return np.hstack([t.columns[channel] for t in terms])

    def take(self, wanted: BoolArray) -> Library:
        """Keep the products of some entries; entries keep their numbers.

        Parameters
        ----------
        wanted : ndarray, shape (entries,)
            Which.

        Returns
        -------
        Library
            Without draws of noise.
        """
        kept = []
        for batch in self.batches:
            at = [i for i, entry in enumerate(batch.entries) if wanted[entry]]
            if at:
                columns = np.repeat(np.array(at) * batch.size, batch.size)
                columns += np.tile(np.arange(batch.size), len(at))
                sheets = {c: _part_of(sheet, at, columns) for c, sheet in batch.sheets.items()}
                entries = [batch.entries[i] for i in at]
                kept.append(Batch(batch.channels, batch.size, batch.generic, entries, sheets))
        return Library(self.problem, self.candidates, self.entries, kept)

    def term(self, entry: int) -> Term:
        """Evaluate one entry.

        Parameters
        ----------
        entry
            Its number.

        Returns
        -------
        Term
        """
        one = self.entries[entry]
        return self.problem.term(self.candidates[one.candidate], one.theta)


def _part_of(sheet: Sheet, entries: Sequence[int], columns: IntArray) -> Sheet:
    moments = sheet.moments
    return Sheet(
        sheet.own[:, entries],
        Moments(
            moments.nuisance[:, columns], moments.values[:, columns], moments.reduced[:, :, columns]
        ),
        np.zeros((len(columns), 0)),
        None if sheet.columns is None else sheet.columns[:, columns],
    )


def read_library(
    problem: Problem,
    candidates: Sequence[Candidate],
    draws: Draws | None,
    step: Callable[[float], None] = lambda share: None,
) -> Library:
    """Evaluate every entry once and gather its products.

    Parameters
    ----------
    problem
        The campaign.
    candidates
        The candidates.
    draws
        Draws of noise; None: none are needed.
    step
        Told how far it is, 0 to 1; may raise to stop.

    Returns
    -------
    Library
    """
    library = Library(problem, candidates)
    waiting: dict[Key, list[tuple[int, Term]]] = {}
    kept = 0
    for share, entry, term in _terms(problem, library, candidates):
        step(share)
        if not library.entries[entry].excited:
            continue
        key = (term.channels, term.size, term.candidate.generic)
        waiting.setdefault(key, []).append((entry, term))
        limit = WIDTH if len(term.columns) == 1 else FINGERPRINT_WIDTH
        if len(waiting[key]) * term.size >= limit:
            kept += _add_batch(library, key, waiting.pop(key), draws, kept)
    for key, terms in sorted(waiting.items(), key=lambda item: item[0]):
        kept += _add_batch(library, key, terms, draws, kept)
    return library


def _terms(
    problem: Problem, library: Library, candidates: Sequence[Candidate]
) -> Iterator[tuple[float, int, Term]]:
    for number, candidate in enumerate(candidates):
        for theta in candidate.thetas:
            term = problem.term(candidate, theta)
            library.entries.append(Entry(number, theta, term.norms))
            yield number / len(candidates), len(library.entries) - 1, term


def _add_batch(
    library: Library,
    key: Key,
    terms: Sequence[tuple[int, Term]],
    draws: Draws | None,
    kept: int,
) -> int:
    """Gather a batch's products; return how many bytes of columns were kept."""
    channels, size, generic = key
    batch = Batch(channels, size, generic, [entry for entry, _ in terms])
    added = 0
    for number in channels:
        columns = np.hstack([term.columns[number] for _, term in terms])
        keep = kept + added + columns.nbytes <= KEPT_BYTES
        fixed = library.problem.fixed[number]
        batch.sheets[number] = _sheet(fixed, columns, size, draws, keep)
        added += columns.nbytes if keep else 0
    library.batches.append(batch)
    return added


def _sheet(fixed: Fixed, columns: FloatArray, size: int, draws: Draws | None, keep: bool) -> Sheet:
    channel = fixed.channel
    noise = draws.products(fixed, columns) if draws else np.zeros((columns.shape[1], 0))
    return Sheet(
        _own_products(fixed, columns, size),
        moments_of(channel, columns, fixed.cells),
        noise,
        columns if keep else None,
    )


def _own_products(fixed: Fixed, columns: FloatArray, size: int) -> FloatArray:
    """Multiply each entry's columns with each other, cell by cell."""
    channel, g = fixed.channel, columns.shape[1] // size
    stops = np.flatnonzero(np.append(True, np.diff(channel.cells) != 0))
    found = np.zeros((fixed.cells, g, size, size))
    for i in range(size):
        for j in range(i, size):
            product = columns[:, i::size] * columns[:, j::size]
            sums = np.add.reduceat(product, channel.starts[stops], axis=0)
            found[channel.cells[stops], :, i, j] = found[channel.cells[stops], :, j, i] = sums
    return found
