"""All candidates with all values of their grids, their products gathered in one pass."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby, islice
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.arrays import BoolArray, FloatArray, IntArray
from app.errors import InvalidContent
from app.search.candidate import Candidate
from app.search.draws import Draws
from app.search.moments import Fixed, Moments, blocks, moments_of
from app.search.problem import Problem, Term
from app.search.scatter import FEWEST_BLOCKS

WIDTH: Final = 256
"""Columns of one batch: bounds the memory at any number of candidates."""

FINGERPRINT_WIDTH: Final = 192
"""Columns of a batch over several channels: each channel keeps its products."""

TOGETHER: Final = 400_000
"""Numbers, at one for each row and entry, that are laid out at once at most."""

KEPT_BYTES: Final = 300_000_000
"""Columns are kept up to this size, and evaluated again beyond it."""

WAITING_BYTES: Final = 200_000_000
"""Columns may wait for their batch to be full up to this size: there are dozens of batches."""

GB: Final = 1_000_000_000

MOST_BYTES: Final = 4 * GB
"""Size of the products: they grow as candidates times visits, and times entries of the maps."""


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

    @cached_property
    def excited(self) -> bool:
        """Whether the rows show it at all."""
        return bool(self.norms.any())


@dataclass(eq=False)
class Sheet:
    """A batch's columns in one channel, and their products.

    Parameters
    ----------
    own : ndarray, shape (cells, g, k, k)
        Products of each entry's own columns within each cell. These and the moments' products
        have a single cell, that of all rows, where no cells are asked for apart.
    noise : ndarray, shape (g k, B)
        Products with the draws of noise.
    columns : ndarray, shape (n, g k) or None
        The columns, where they are kept.
    """

    own: FloatArray
    moments: Moments
    noise: NDArray[np.float32]
    columns: FloatArray | None

    def within(self, products: FloatArray, cells: BoolArray) -> FloatArray:
        """Add products up over some cells: over all of them, where they are not kept apart.

        Parameters
        ----------
        products : ndarray, shape (cells, ...) or (1, ...)
        """
        if len(products) == len(cells):
            found: FloatArray = products[cells].sum(axis=0)
            return found
        if not cells.all():
            raise ValueError("expected all cells: these products are not kept apart by cell")
        return np.asarray(products[0])

    @property
    def bytes_of_products(self) -> int:
        """Size of all but the columns."""
        moments = self.moments
        parts = (self.own, self.noise, moments.nuisance, moments.values, moments.reduced)
        return sum(part.nbytes for part in parts)


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
    """Every entry, in batches."""

    problem: Problem
    candidates: Sequence[Candidate]
    entries: list[Entry] = field(default_factory=list)
    batches: list[Batch] = field(default_factory=list)

    @cached_property
    def groups(self) -> IntArray:
        """Each entry's candidate, shape (entries,)."""
        return np.array([entry.candidate for entry in self.entries], dtype=np.intp)

    @cached_property
    def families(self) -> IntArray:
        """Number of each entry's family, shape (entries,)."""
        names = [candidate.family for candidate in self.candidates]
        return np.unique(names, return_inverse=True)[1].astype(np.intp)[self.groups]

    @cached_property
    def blocks_of_entries(self) -> IntArray:
        """The blocks behind every entry, the most of any channel it acts on: shape (entries,)."""
        found = np.zeros(len(self.entries), dtype=np.intp)
        for batch in self.batches:
            counts = [len(self.problem.fixed[c].channel.starts) for c in batch.channels]
            found[batch.entries] = max(counts)
        return found

    @cached_property
    def testable(self) -> BoolArray:
        """Which entries may be chosen: with few visits only what one visit excites."""
        blocks = self.blocks_of_entries
        allowed = np.zeros(len(self.entries), dtype=bool)
        for i, entry in enumerate(self.entries):
            candidate = self.candidates[entry.candidate]
            enough = candidate.within_visit or blocks[i] >= FEWEST_BLOCKS
            allowed[i] = entry.excited and enough and not candidate.generic
        return allowed

    def columns(
        self, batch: Batch, channel: int, chosen: Sequence[int] | None = None
    ) -> FloatArray:
        """Give a batch's columns in one channel, kept or evaluated again.

        Parameters
        ----------
        chosen
            Places in the batch of the only entries that are wanted; all without it.

        Returns
        -------
        ndarray, shape (n, g k)
        """
        kept = batch.sheets[channel].columns
        if kept is not None:
            if chosen is None:
                return kept
            by_entry = kept.reshape(len(kept), len(batch.entries), batch.size)
            return by_entry[:, chosen].reshape(len(kept), -1)
        wanted = batch.entries if chosen is None else [batch.entries[i] for i in chosen]
        return np.hstack([self.term(entry).columns[channel] for entry in wanted])

    def take(self, wanted: BoolArray) -> Library:
        """Read some entries again, with their products apart by cell; they keep their numbers.

        Parameters
        ----------
        wanted : ndarray, shape (entries,)
            Which.

        Returns
        -------
        Library
            Without draws of noise.
        """
        taken = Library(self.problem, self.candidates, self.entries)
        builder = _BatchBuilder(taken, None, by_cell=True)
        for batch in self.batches:
            at = [i for i, entry in enumerate(batch.entries) if wanted[entry]]
            if at:
                own = replace(batch, entries=[batch.entries[i] for i in at], sheets={})
                builder.add_batch(own, {c: self.columns(batch, c, at) for c in batch.channels})
        return taken

    def term(self, entry: int) -> Term:
        """Evaluate one entry."""
        one = self.entries[entry]
        return self.problem.term(self.candidates[one.candidate], one.theta)


def read_library(
    problem: Problem,
    candidates: Sequence[Candidate],
    draws: Draws | None,
    step: Callable[[float], None] = lambda share: None,
    *,
    by_cell: bool = True,
) -> Library:
    """Evaluate every entry once and gather its products.

    Parameters
    ----------
    draws
        Draws of noise; None: none are needed.
    step
        Told how far it is, 0 to 1; may raise to stop.
    by_cell
        Whether products are kept apart by cell: they are then many times as large.

    Raises
    ------
    InvalidContent
        If the products would take more memory than is stated.
    """
    library = Library(problem, candidates)
    builder = _BatchBuilder(library, draws, by_cell)
    for share, entry, term in _terms(problem, library, candidates):
        step(share)
        if library.entries[entry].excited:
            builder.add(entry, term)
    builder.finish()
    return library


def _terms(
    problem: Problem, library: Library, candidates: Sequence[Candidate]
) -> Iterator[tuple[float, int, Term]]:
    size = max(1, TOGETHER // max(problem.count, 1))
    every = (
        (n, candidate, theta)
        for n, candidate in enumerate(candidates)
        for theta in candidate.thetas
    )
    for _, alike in groupby(every, key=lambda one: _laid_out_by(one[1])):
        while some := list(islice(alike, size)):
            terms = problem.terms([(candidate, theta) for _, candidate, theta in some])
            for (number, _, theta), term in zip(some, terms, strict=True):
                library.entries.append(Entry(number, theta, term.norms))
                yield number / len(candidates), len(library.entries) - 1, term


def _laid_out_by(candidate: Candidate) -> object:
    """Give what is equal for candidates that are laid out together."""
    layout = candidate.layout
    return candidate.key if layout is None else (layout.where, layout.parts)


@dataclass(eq=False)
class _BatchBuilder:
    """Entries on their way into batches.

    Those with the same key wait for each other until they fill a batch. What waits is of as
    many rows as there are observations: where it grows too large, the largest goes early.
    """

    library: Library
    draws: Draws | None
    by_cell: bool
    waiting: dict[Key, list[tuple[int, Term]]] = field(default_factory=lambda: defaultdict(list))
    waiting_bytes: dict[Key, int] = field(default_factory=lambda: defaultdict(int))
    all_waiting_bytes: int = 0
    kept_bytes: int = 0
    product_bytes: int = 0

    def add(self, entry: int, term: Term) -> None:
        """Let an entry wait for its batch."""
        key = (term.channels, term.size, term.candidate.generic)
        self.waiting[key].append((entry, term))
        self.waiting_bytes[key] += term.size_bytes
        self.all_waiting_bytes += term.size_bytes
        limit = WIDTH if len(term.columns) == 1 else FINGERPRINT_WIDTH
        if len(self.waiting[key]) * term.size >= limit:
            self._add_batch(key)
        elif self.all_waiting_bytes > WAITING_BYTES:
            self._add_batch(max(self.waiting_bytes, key=lambda key: (self.waiting_bytes[key], key)))

    def finish(self) -> None:
        """Let those go that still wait."""
        for key in sorted(self.waiting):
            self._add_batch(key)

    def _add_batch(self, key: Key) -> None:
        """Set what waits side by side."""
        channels, size, generic = key
        terms = self.waiting.pop(key)
        self.all_waiting_bytes -= self.waiting_bytes.pop(key)
        batch = Batch(channels, size, generic, [entry for entry, _ in terms])
        columns = {c: np.hstack([term.columns[c] for _, term in terms]) for c in channels}
        self.add_batch(batch, columns)

    def add_batch(self, batch: Batch, columns: Mapping[int, FloatArray]) -> None:
        """Gather a batch's products, of its columns in each channel, shape (n, g k)."""
        for number, own in columns.items():
            keep = self.kept_bytes + own.nbytes <= KEPT_BYTES
            fixed = self.library.problem.fixed[number]
            sheet = _sheet(fixed, own, batch.size, self.draws, keep, self.by_cell)
            batch.sheets[number] = sheet
            self.kept_bytes += own.nbytes if keep else 0
            self.product_bytes += sheet.bytes_of_products
        self.library.batches.append(batch)
        self._expect_to_fit()

    def _expect_to_fit(self) -> None:
        """Stop before more memory is taken than is stated."""
        if self.product_bytes <= MOST_BYTES:
            return
        channels = [fixed.channel for fixed in self.library.problem.fixed.values()]
        visits = max(len(channel.starts) for channel in channels)
        directions = max(channel.nuisance.shape[1] for channel in channels)
        raise InvalidContent(
            f"expected a search whose candidates take at most {MOST_BYTES / GB:g} GB, got more, "
            f"of {visits:,} visits and {directions:,} ways in which the maps may be wrong: analyse "
            "fewer verifications at once, name the kinds of effects to be tested, or store maps "
            "with fewer positions"
        )


def _sheet(
    fixed: Fixed, columns: FloatArray, size: int, draws: Draws | None, keep: bool, by_cell: bool
) -> Sheet:
    channel = fixed.channel
    none = np.zeros((columns.shape[1], 0), dtype=np.float32)
    noise = draws.products(fixed, columns) if draws else none
    own: FloatArray = blocks(columns, size)[None]
    if by_cell:
        own = np.zeros((fixed.cells, *own.shape[1:]))
        for cell, part in channel.parts:
            own[cell] = blocks(columns[part], size)
    moments = moments_of(channel, columns, fixed.cells if by_cell else None)
    return Sheet(own, moments, noise, columns if keep else None)
